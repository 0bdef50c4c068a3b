//! How well the noise itself is known: few trials tell little of a gain that differs from trial to trial, so that an
//! interval takes its quantile from Student's t, not from the normal distribution.
//!
//! ```text
//! ν_i = 2 C_ii² / (g_iᵀ W g_i),   g_ik = ∂C_ii/∂σ_k² = c_iᵀ (Σ X_tᵀ V_t⁻¹ V_tk V_t⁻¹ X_t) c_i
//! ```
//! C: covariance of parameters, c_i its column; W: covariance of the estimated variances σ_k².
//!
//! # References
//! Satterthwaite (1946), doi:10.2307/3002019; Giesbrecht & Burns (1985), doi:10.2307/2530872 (mixed models).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::likelihood::Fit;
use super::problem::Problem;
use carpus_diagnosis::noise::{COMPONENTS, NoiseLevels};
use carpus_numerics::statistics::t_quantile;
use carpus_simulation::simulation::SimulationError;

/// Standard deviation of a variance's logarithm before the data: laboratories' noise differs by factors, not by powers
/// of ten.
const LOG_VARIANCE_SD: f64 = 1.5;
/// Fewer degrees of freedom than this are not believed: the estimate of so few is itself no more than a guess.
const FEWEST: f64 = 4.0;
/// Where a muscle's moment is a smaller share of its largest, columns have no ratio to it.
const SMALLEST_SHARE: f64 = 0.02;
/// Largest factor of a variance by what noise seemed to tell.
const LARGEST_INFLATION: f64 = 9.0;

/// Degrees of freedom of every parameter's interval.
///
/// - `spread`: variance of every parameter's logarithm between the bounds, which the data need not better
///
/// # Errors
/// A trial that cannot be simulated.
pub(super) fn degrees_of_freedom(problem: &Problem, fit: &Fit, spread: &[f64]) -> Result<Vec<f64>, SimulationError> {
    let (n, p) = (fit.at.len(), problem.layout.len());
    let levels = fit.held.levels;
    let columns = problem.columns(&fit.held, &fit.at)?;
    let parts: Vec<_> = fit
        .held
        .trials
        .par_iter()
        .zip(&columns)
        .filter_map(|(held, columns)| {
            let noise = held.noise.as_ref()?;
            let ax = held.factor.solve(&columns.columns(0, n).into_owned());
            let places = noise.components();
            let own = places.map(|k| noise.covariance(&only(k)));
            let products: Vec<DMatrix<f64>> = own.iter().map(|own| held.factor.solve(own)).collect();
            let by_variance: Vec<DMatrix<f64>> = own.iter().map(|own| ax.tr_mul(&(own * &ax))).collect();
            let information = DMatrix::from_fn(products.len(), products.len(), |k, l| {
                0.5 * products[k].dot(&products[l].transpose())
            });
            Some((places, information, by_variance))
        })
        .collect();
    let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
    let mut by_variance = vec![DMatrix::zeros(n, n); COMPONENTS];
    for (places, own, by) in &parts {
        for (k, place) in places.iter().enumerate() {
            places.iter().enumerate().for_each(|(l, other)| information[(*place, *other)] += own[(k, l)]);
            by_variance[*place] += &by[k];
        }
    }
    for k in 0..COMPONENTS {
        information[(k, k)] += (LOG_VARIANCE_SD * levels.0[k]).powi(-2);
    }
    let mut of_parameters = fit.information.clone();
    for (i, variance) in spread.iter().enumerate() {
        of_parameters[(i, i)] += 1.0 / variance;
    }
    let (Some(variances), Some(covariance)) = (information.try_inverse(), of_parameters.try_inverse()) else {
        return Ok(vec![FEWEST; p]);
    };
    let of = |i: usize| {
        let c = covariance.column(i);
        let g = DVector::from_fn(COMPONENTS, |k, _| c.dot(&(&by_variance[k] * c)));
        let scatter = g.dot(&(&variances * &g));
        if scatter > 0.0 { (2.0 * covariance[(i, i)].powi(2) / scatter).max(FEWEST) } else { f64::INFINITY }
    };
    Ok((0..p).map(of).collect())
}

/// By how much every parameter's variance is larger when only the excitation tells of it, and not its noise.
///
/// Columns of derivatives are computed from an excitation that still holds noise after it was corrected. That noise
/// looks like variation that a parameter could be known by, most of all where trials hardly differ in how two muscles
/// share the work. What it adds to the information on average is taken away:
///
/// ```text
/// N_ab = Σ_t tr(V⁻¹ R_a (V_m − V_m V⁻¹ V_m) R_b),   R_a = diag(column a / column of strength)
/// ```
/// for parameters a, b of muscle m; V_m: the noise of its EMG in the moment, of which the second factor is what is
/// left.
///
/// # References
/// Fuller (1987), Measurement error models, section 2.2; Carroll et al. (2006), doi:10.1201/9781420010138.
///
/// # Errors
/// A trial that cannot be simulated.
pub(super) fn inflation(problem: &Problem, fit: &Fit, spread: &[f64]) -> Result<Vec<f64>, SimulationError> {
    let p = problem.layout.len();
    let levels = fit.held.levels;
    let columns = problem.columns(&fit.held, &fit.at)?;
    let moments = problem.muscle_moments(&fit.held, &fit.at)?;
    let parts: Vec<DMatrix<f64>> = fit
        .held
        .trials
        .par_iter()
        .zip(&columns)
        .zip(&moments)
        .map(|((held, columns), moments)| {
            let mut noise_part = DMatrix::zeros(p, p);
            let Some(noise) = &held.noise else { return noise_part };
            for (m, moment) in moments.iter().enumerate() {
                let own = noise.covariance_of_muscle(m, &levels);
                let left = &own - &own * held.factor.solve(&own);
                let of: Vec<usize> =
                    problem.layout.strengths[m].iter().chain(&problem.layout.shapes[m]).copied().collect();
                let largest = moment.amax();
                let ratio = |i: usize| {
                    let column = columns.column(i);
                    DVector::from_fn(moment.len(), |k, _| {
                        if moment[k].abs() > SMALLEST_SHARE * largest { column[k] / moment[k] } else { 0.0 }
                    })
                };
                let ratios: Vec<DVector<f64>> = of.iter().map(|i| ratio(*i)).collect();
                for (a, i) in of.iter().enumerate() {
                    let mut scaled = left.clone();
                    for (k, mut row) in scaled.row_iter_mut().enumerate() {
                        row *= ratios[a][k];
                    }
                    // V⁻¹ R_a L: its diagonal, weighted by R_b, sums to the trace.
                    let diagonal = held.factor.solve(&scaled).diagonal();
                    for (b, j) in of.iter().enumerate() {
                        noise_part[(*i, *j)] += diagonal.dot(&ratios[b]);
                    }
                }
            }
            noise_part
        })
        .collect();
    let mut noise_part = DMatrix::zeros(p, p);
    parts.iter().for_each(|part| noise_part += part);
    let noise_part = (&noise_part + noise_part.transpose()) * 0.5;
    let mut whole = fit.information.clone();
    for (i, variance) in spread.iter().enumerate() {
        whole[(i, i)] += 1.0 / variance;
    }
    let Some(before) = whole.clone().cholesky().map(|c| c.inverse()) else { return Ok(vec![1.0; p]) };
    // The average may be more than what this sample has: then less of it is taken away.
    for share in [1.0, 0.9, 0.75, 0.5, 0.25] {
        let mut less = whole.clone();
        let mut corner = less.view_mut((0, 0), (p, p));
        corner -= &noise_part * share;
        if let Some(after) = less.cholesky().map(|c| c.inverse()) {
            return Ok((0..p).map(|i| (after[(i, i)] / before[(i, i)]).clamp(1.0, LARGEST_INFLATION)).collect());
        }
    }
    Ok(vec![LARGEST_INFLATION; p])
}

fn only(component: usize) -> NoiseLevels {
    let mut levels = [0.0; COMPONENTS];
    levels[component] = 1.0;
    NoiseLevels(levels)
}

/// Drop of −2 log likelihood at the ends of an interval: the square of Student's t.
pub(super) fn drop_of(level: f64, degrees_of_freedom: f64) -> f64 {
    // Beyond this many, t is normal to more digits than an interval has.
    t_quantile(0.5 + 0.5 * level, degrees_of_freedom.min(1e4)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_drop_is_that_of_tables() {
        // t tables, 95 %: 2.132 at 4, 1.812 at 10, 1.645 at infinity.
        for (df, t) in [(4.0, 2.132), (10.0, 1.812), (f64::INFINITY, 1.645)] {
            assert!((drop_of(0.9, df).sqrt() - t).abs() < 1e-3);
        }
    }
}
