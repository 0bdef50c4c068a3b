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

use super::likelihood::{Fit, Problem};
use crate::diagnosis::noise::{COMPONENTS, NoiseLevels};
use crate::simulation::SimulationError;
use crate::statistics::t_quantile;

/// Standard deviation of a variance's logarithm before the data: laboratories' noise differs by factors, not by powers of
/// ten.
const LOG_VARIANCE_SD: f64 = 1.5;
/// Fewer degrees of freedom than this are not believed: the estimate of so few is itself no more than a guess.
const FEWEST: f64 = 4.0;

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
    let parts: Vec<(DMatrix<f64>, Vec<DMatrix<f64>>)> = fit
        .held
        .trials
        .par_iter()
        .zip(&columns)
        .filter_map(|(held, columns)| {
            let noise = held.noise.as_ref()?;
            let ax = held.factor.solve(&columns.columns(0, n).into_owned());
            let mut products = Vec::with_capacity(COMPONENTS);
            let mut by_variance = Vec::with_capacity(COMPONENTS);
            for k in 0..COMPONENTS {
                let own = noise.covariance(&only(k));
                by_variance.push(ax.tr_mul(&(&own * &ax)));
                products.push(held.factor.solve(&own));
            }
            let information =
                DMatrix::from_fn(COMPONENTS, COMPONENTS, |k, l| 0.5 * products[k].dot(&products[l].transpose()));
            Some((information, by_variance))
        })
        .collect();
    let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
    let mut by_variance = vec![DMatrix::zeros(n, n); COMPONENTS];
    for (own, by) in &parts {
        information += own;
        by_variance.iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
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
