//! Which of two fits moments and EMG together are nearer to.
//!
//! ```text
//! Q = min over w of  Σ_g ‖y_g − τ_g(θ, φ, w)‖²_W + ‖w‖²_K + ‖θ − θ₀‖²_Λ  =  Σ_g r_gᵀ V_g⁻¹ r_g + ‖θ − θ₀‖²_Λ
//! ```
//! −2 log likelihood of moments *and* EMG, at given variances, true excitations being parameters as all others are (the functional
//! model of errors in variables, of which Deming's regression is the linear case). That of moments given the EMG, which has log |V|
//! in addition, prefers whatever lets less of the EMG's noise pass, as a regression on a noisy x prefers too small a slope.
//!
//! What the bending of moments with excitations does to scores (see [`super::centring`]) it does to Q, of which they are the
//! gradient. Between two fits a and b it is, by the trapezoidal rule, taken out:
//!
//! ```text
//! Q_a − Q_b + (b_a + b_b)ᵀ (x_a − x_b),   b: mean scores where nothing is missing, x: muscles and effects
//! ```
//!
//! Every parameter of an effect that is free to follow the noise lowers Q by 1 on average, with a variance of 2: so many more parameters
//! as one of two fits has, as far as no prior holds them, are added.
//!
//! Where noise of the EMG passes through two fits alike, the difference is that of two normal likelihoods: under the one it is on average
//! −D, with a variance of 4 D. Where it does not (cross-talk unmixes, and so amplifies it), its own chance comes on top:
//!
//! ```text
//! var(Q_a − Q_b) = 4 D + 4 S,   S = Σ_g n_g − ‖L_a⁻¹ C_ab L_b⁻ᵀ‖²,   V = L Lᵀ, C_ab: covariance of the two fits' residuals
//! ```
//! (variance of a quadratic form of normal variables). What a difference says is measured by that: see `allowed`.
//!
//! # References
//! Fuller (1987), Measurement Error Models, sections 1.3 and 3.1, doi:10.1002/9780470316665.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::ONE_BY_ONE;
use super::fit::{Analysis, Fit, LARGEST_MEAN, whiten};
use super::noise::{self, NoiseLevels};

/// Of two fits one is no explanation beside the other if Q differs by more than what is `allowed` by this: the other is 20 times as
/// likely, or more where noise passes through them differently. The true effect is that far behind a rival with a probability below
/// Φ(-√6) = 0.7 %, wherever the rival is; a rival at z = 5 stays beside it with one of 3 %.
pub(super) const FARTHER: f64 = 6.0;

/// How far the truth may be behind a rival, so that it is farther with a probability below Φ(-√limit), whatever D is: the least of
/// (f + D) / √(4 D + 4 S) over D is √limit.
///
/// - `scatter`: S; a variance beside 4 D, over 4
pub(super) fn allowed(limit: f64, scatter: f64) -> f64 {
    if scatter <= limit { limit + scatter } else { 2.0 * (limit * scatter).sqrt() }
}

/// What a fit's trials say of its parameters.
struct Sums {
    information: DMatrix<f64>,
    misfit: f64,
    /// Effects' parameters that are free to follow the noise.
    free: f64,
}

/// How much farther the data are from one fit than from another.
struct Farther {
    /// Difference of Q, parameters that are free allowed for.
    by: f64,
    /// What parameters add to S: a quarter of the variance of what noise makes of them.
    scatter: f64,
}

impl Analysis<'_> {
    /// By how much moments and EMG are farther from one fit than from another [units of −2 log likelihood]; below 0: nearer.
    ///
    /// - `a`, `b`: the one and the other, judged at the geometric means of their variances
    pub(super) fn farther_from(&self, a: &Fit, b: &Fit) -> Option<f64> {
        self.farther(a, b).map(|farther| farther.by)
    }

    /// Means of scores are drawn a few times only: of the difference with and without them, what both agree on.
    fn farther(&self, a: &Fit, b: &Fit) -> Option<Farther> {
        let levels = a.levels.between(&b.levels);
        let (of_a, of_b) = (self.sums(a, &levels)?, self.sums(b, &levels)?);
        // Without effects an EMG may have been bent to make up for them, which says nothing of means.
        let fits = [(a, &of_a), (b, &of_b)].into_iter().filter(|(fit, _)| !fit.point.effects.is_empty());
        let along: Vec<f64> = fits.map(|(fit, sums)| self.mean_along(fit, sums, b, a)).collect();
        let bent = 2.0 * along.iter().sum::<f64>() / along.len().max(1) as f64;
        let further = of_a.free - of_b.free;
        let plain = of_a.misfit - of_b.misfit + further;
        Some(Farther { by: agreed(plain, plain + bent), scatter: 0.5 * further.abs() })
    }

    /// How far moments and EMG are from a fit, where these are the variances of the noise; infinite if that cannot be said.
    pub(super) fn misfit(&self, fit: &Fit, levels: &NoiseLevels) -> f64 {
        self.sums(fit, levels).map_or(f64::INFINITY, |sums| sums.misfit)
    }

    /// Whether moments and EMG are farther from one fit than from another by more than chance allows, at the geometric means of their
    /// variances.
    ///
    /// - `limit`: squared standard deviations of what counts as chance
    pub(super) fn is_farther(&self, a: &Fit, b: &Fit, limit: f64) -> bool {
        let Some(Farther { by, scatter: of_parameters }) = self.farther(a, b) else { return false };
        let scatter = || noise::scatter_of_all(&a.noise, &b.noise, &a.levels.between(&b.levels));
        by > limit && by > allowed(limit, scatter().unwrap_or(f64::INFINITY) + of_parameters)
    }

    fn sums(&self, fit: &Fit, levels: &NoiseLevels) -> Option<Sums> {
        let p = fit.precision.len();
        let prior = || fit.precision.iter().zip(&fit.offset);
        let mut information = DMatrix::from_diagonal(&DVector::from_column_slice(&fit.precision));
        let mut gradient = DVector::from_iterator(p, prior().map(|(precision, offset)| -precision * offset));
        let mut sum: f64 = prior().map(|(precision, offset)| precision * offset * offset).sum();
        let of_trial = |((whitened, own), structure): ((&DMatrix<f64>, &nalgebra::Cholesky<f64, _>), _)| {
            let all = whiten(&noise::factor(structure, levels)?, &(own.l() * whitened));
            let x = all.columns(0, p);
            Some((x.tr_mul(&x), x.tr_mul(&all.column(p)), all.column(p).norm_squared()))
        };
        let trials = fit.whitened.par_iter().with_max_len(ONE_BY_ONE).zip(&fit.factors).zip(&fit.noise);
        for products in trials.map(of_trial).collect::<Vec<_>>() {
            let (of_information, of_gradient, of_sum) = products?;
            information += of_information;
            gradient += of_gradient;
            sum += of_sum;
        }
        let factor = information.clone().cholesky()?;
        let gain = gradient.dot(&factor.solve(&gradient));
        let free = free_parameters(&fit.precision, &factor.inverse(), self.n_nuisance());
        Some(Sums { information, misfit: sum - gain, free })
    }

    /// A fit's mean scores along the way from one fit to another; no longer than the mean of a score that noise of the EMG causes.
    fn mean_along(&self, of: &Fit, sums: &Sums, from: &Fit, to: &Fit) -> f64 {
        let p = of.precision.len();
        let rows = of.bias.first().map_or(0, DVector::len);
        let mean = of.bias.iter().fold(DVector::zeros(rows), |sum, bias| sum + bias);
        let own = mean.rows(0, p).into_owned();
        let length = sums.information.clone().cholesky().map_or(0.0, |c| own.dot(&c.solve(&own))).sqrt();
        let share = (LARGEST_MEAN / length.max(f64::MIN_POSITIVE)).min(1.0);
        let along = |i: usize| mean[i] * (to.offset[i] - from.offset[i]);
        let of_muscles: f64 = (0..self.n_nuisance()).map(along).sum();
        share * (of_muscles + self.mean_of_effects(of, &mean, to) - self.mean_of_effects(of, &mean, from))
    }

    /// Product of a fit's mean scores and another's effects; shapes of effects that are not on in the first have no scores.
    fn mean_of_effects(&self, of: &Fit, mean: &DVector<f64>, fit: &Fit) -> f64 {
        let first_column = |fit: &Fit, id: &str| {
            let mut column = self.n_nuisance();
            fit.point.effects.iter().find_map(|s| {
                let first = column;
                column += s.values.len();
                (s.effect.description().id == id).then_some(first)
            })
        };
        let mut sum = 0.0;
        for setting in &fit.point.effects {
            let description = setting.effect.description();
            let Some(first) = first_column(fit, description.id) else { continue };
            if let Some(own) = first_column(of, description.id) {
                sum += (0..setting.values.len()).map(|i| mean[own + i] * fit.offset[first + i]).sum::<f64>();
            } else if let Some(block) = self.blocks.iter().find(|b| b.name == description.id) {
                let scores = block.columns.iter().map(|c| mean[of.precision.len() + c]);
                sum +=
                    description.amplitudes().zip(scores).map(|(i, score)| score * fit.offset[first + i]).sum::<f64>();
            }
        }
        sum
    }
}

/// How many parameters are free to follow the noise: of each the share that its prior does not hold, which is its variance over that of
/// the prior.
///
/// - `precision`: of priors; `covariance`: of all parameters, priors included; `first`: parameters before this one do not count
fn free_parameters(precision: &[f64], covariance: &DMatrix<f64>, first: usize) -> f64 {
    (first..precision.len()).map(|i| 1.0 - precision[i] * covariance[(i, i)]).sum()
}

/// The number between two that is nearest to 0.
fn agreed(a: f64, b: f64) -> f64 {
    match (a > 0.0, b > 0.0) {
        (true, true) => a.min(b),
        (false, false) => a.max(b),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_allowed_is_exceeded_by_chance_alike_wherever_the_rival_is() {
        for scatter in [0.0, 2.0, 5.0, 40.0, 120.0] {
            let sds = |d: f64| (allowed(FARTHER, scatter) + d) / (4.0 * (d + scatter)).sqrt();
            let least = (0..4000).map(|i| sds(0.05 * f64::from(i).max(1e-9))).fold(f64::INFINITY, f64::min);
            assert!((least - FARTHER.sqrt()).abs() < 1e-3, "{scatter}: {least}");
        }
    }

    #[test]
    fn verif_parameters_lower_a_misfit_by_as_much_as_they_are_free() {
        // Q = |y − X x|² + Σ λ x² where y is noise: on average tr X (XᵀX + Λ)⁻¹ Xᵀ less than |y|².
        let x = DMatrix::from_row_slice(4, 3, &[1.0, 0.5, 0.0, 0.0, 1.0, 0.1, 0.3, 0.0, 0.0, 0.0, 2.0, 0.2]);
        let fall_with = |precision: [f64; 3]| {
            let prior = DMatrix::from_diagonal(&DVector::from_row_slice(&precision));
            let covariance = (x.tr_mul(&x) + prior).try_inverse().unwrap();
            ((&x * &covariance * x.transpose()).trace(), free_parameters(&precision, &covariance, 0))
        };
        for precision in [[0.0; 3], [0.0, 3.0, 1.0], [1e9; 3]] {
            let (fall, free) = fall_with(precision);
            assert!((fall - free).abs() < 1e-6, "{precision:?}: {fall}, {free}");
        }
        let covariance = DMatrix::from_diagonal(&DVector::from_row_slice(&[0.1, 0.5, 0.25]));
        assert!((free_parameters(&[10.0, 1.0, 2.0], &covariance, 1) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn verif_agreed_is_what_both_say() {
        assert_eq!(agreed(3.0, 5.0), 3.0);
        assert_eq!(agreed(-3.0, -5.0), -3.0);
        assert_eq!(agreed(-3.0, 5.0), 0.0);
        assert_eq!(agreed(0.0, 5.0), 0.0);
    }
}
