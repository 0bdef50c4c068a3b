//! What of the difference between measured and simulated moment is noise: of the moment, and of the EMG as it passes
//! through the muscles (errors in variables).
//!
//! ```text
//! V = σ_w² I + σ_s² C_s + σ_e² G K Gᵀ + σ_g² G 1 1ᵀ Gᵀ + σ_f² G D K D Gᵀ
//! ```
//! G: moment by the logarithm of excitation on knots; K, C_s: Matérn-3/2 correlation over knots and over samples (EMG
//! envelope and slow disturbances of the moment); the fourth term is a gain per trial and muscle; D = 1/e turns the last
//! one into noise that adds to the EMG.
//!
//! # References
//! Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal,
//! doi:10.1093/biomet/58.3.545.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

/// Distance between knots of the EMG's noise [s].
pub const KNOT_SPACING: f64 = 0.04;
/// Correlation length of the EMG envelope's noise [s].
const ENVELOPE_LENGTH: f64 = 0.12;
/// Correlation length of slow disturbances of the moment [s].
const SLOW_LENGTH: f64 = 0.36;
/// EMG below this counts as this when additive noise is expressed relative to it.
const SMALLEST_EXCITATION: f64 = 0.005;
/// Iterations of the variance estimate.
const ITERATIONS: usize = 6;

/// Number of variance components.
pub const COMPONENTS: usize = 5;

/// Variances: white [(N·m)²], slow [(N·m)²], relative EMG envelope, relative EMG gain per trial, additive EMG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseLevels(pub [f64; COMPONENTS]);

impl Default for NoiseLevels {
    /// Usual laboratory noise: 0.05 N·m white, 0.07 N·m slow, EMG 10 % envelope, 5 % gain, 0.002 additive.
    fn default() -> Self {
        NoiseLevels([0.05, 0.07, 0.10, 0.05, 0.002].map(|sd: f64| sd * sd))
    }
}

impl NoiseLevels {
    /// Geometric means of both.
    pub fn between(&self, other: &NoiseLevels) -> NoiseLevels {
        let mut out = *self;
        out.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a = (*a * b).sqrt());
        out
    }
}

/// Matérn-3/2 correlation at a distance.
fn matern(distance: f64, length: f64) -> f64 {
    let x = 3f64.sqrt() * distance.abs() / length;
    (1.0 + x) * (-x).exp()
}

/// How noise enters one trial.
#[derive(Clone, Debug)]
pub struct TrialNoise {
    /// Variance of white noise per block, relative to that of a sample.
    white: DVector<f64>,
    /// Covariances of the other components for unit variance.
    shared: Vec<DMatrix<f64>>,
    /// Per muscle: moment by log excitation on knots.
    response: Vec<DMatrix<f64>>,
    /// Per muscle: reciprocal excitation on knots.
    reciprocal: Vec<DVector<f64>>,
    kernel: DMatrix<f64>,
}

impl TrialNoise {
    /// - `times`: of the blocks [s]; `counts`: samples in each
    /// - `response`: per muscle, moment by log excitation, blocks × knots
    /// - `excitation`: per muscle, at the knots
    pub fn new(times: &[f64], counts: &[usize], response: Vec<DMatrix<f64>>, excitation: &[Vec<f64>]) -> TrialNoise {
        let n = times.len();
        let knots = excitation.first().map_or(0, Vec::len);
        let kernel =
            DMatrix::from_fn(knots, knots, |i, j| matern(KNOT_SPACING * (i as f64 - j as f64), ENVELOPE_LENGTH));
        let slow = DMatrix::from_fn(n, n, |i, j| matern(times[i] - times[j], SLOW_LENGTH));
        let reciprocal: Vec<DVector<f64>> = excitation
            .iter()
            .map(|e| DVector::from_iterator(knots, e.iter().map(|v| 1.0 / v.max(SMALLEST_EXCITATION))))
            .collect();
        let mut envelope = DMatrix::zeros(n, n);
        let mut gain = DMatrix::zeros(n, n);
        let mut floor = DMatrix::zeros(n, n);
        for (g, d) in response.iter().zip(&reciprocal) {
            let gk = g * &kernel;
            envelope += &gk * g.transpose();
            let whole = g.column_sum();
            gain += &whole * whole.transpose();
            let mut scaled = g.clone();
            for (mut column, d) in scaled.column_iter_mut().zip(d.iter()) {
                column *= *d;
            }
            floor += (&scaled * &kernel) * scaled.transpose();
        }
        let white = DVector::from_iterator(n, counts.iter().map(|c| 1.0 / *c as f64));
        TrialNoise { white, shared: vec![slow, envelope, gain, floor], response, reciprocal, kernel }
    }

    /// V.
    pub fn covariance(&self, levels: &NoiseLevels) -> DMatrix<f64> {
        let mut v = DMatrix::from_diagonal(&(&self.white * levels.0[0]));
        for (component, level) in self.shared.iter().zip(&levels.0[1..]) {
            v += component * *level;
        }
        v
    }

    /// Sum of V's diagonal for single samples instead of blocks [(N·m)²].
    pub fn variance_of_samples(&self, levels: &NoiseLevels) -> f64 {
        let shared: f64 = self.shared.iter().zip(&levels.0[1..]).map(|(c, l)| l * c.trace()).sum();
        shared + levels.0[0] * self.white.len() as f64
    }

    /// Expected noise of log excitation on knots, per muscle, given V⁻¹(residual).
    pub fn expected_noise(&self, levels: &NoiseLevels, weighted_residual: &DVector<f64>) -> Vec<DVector<f64>> {
        let [_, _, envelope, gain, floor] = levels.0;
        self.response
            .iter()
            .zip(&self.reciprocal)
            .map(|(g, d)| {
                let back = g.tr_mul(weighted_residual);
                let mut w = &self.kernel * &back * envelope;
                w.add_scalar_mut(gain * back.sum());
                w += (&self.kernel * back.component_mul(d)).component_mul(d) * floor;
                w
            })
            .collect()
    }

    /// Moment that a change of log excitation on knots causes, to first order.
    pub fn respond(&self, change: &[DVector<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(self.white.len());
        for (g, w) in self.response.iter().zip(change) {
            out += g * w;
        }
        out
    }

    /// Moment that one more unit of EMG baseline of a muscle causes.
    pub fn respond_to_baseline(&self, muscle: usize) -> DVector<f64> {
        &self.response[muscle] * &self.reciprocal[muscle]
    }

    fn times_component(&self, component: usize, right: &DMatrix<f64>) -> DMatrix<f64> {
        match component.checked_sub(1) {
            Some(i) => &self.shared[i] * right,
            None => {
                let mut out = right.clone();
                for (mut row, w) in out.row_iter_mut().zip(self.white.iter()) {
                    row *= *w;
                }
                out
            }
        }
    }

    fn trace_with(&self, component: usize, inverse: &DMatrix<f64>) -> f64 {
        match component.checked_sub(1) {
            Some(i) => self.shared[i].dot(inverse),
            None => self.white.iter().enumerate().map(|(k, w)| w * inverse[(k, k)]).sum(),
        }
    }
}

/// Cholesky factor of V.
pub fn factor(noise: &TrialNoise, levels: &NoiseLevels) -> Option<Cholesky<f64, Dyn>> {
    noise.covariance(levels).cholesky()
}

/// Restricted maximum likelihood of the variances, by Fisher scoring with the exact gradient.
///
/// ```text
/// ∂ℓ/∂σᵢ² = ½ (rᵀ P Vᵢ P r − tr(P Vᵢ)),   Iᵢⱼ ≈ ½ tr(V⁻¹ Vᵢ V⁻¹ Vⱼ)
/// ```
/// - `trials`: noise structure, regressors X and residual of every trial
/// - `precision`: prior precision of the regressors' coefficients (mean 0)
pub fn estimate(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    start: NoiseLevels,
) -> NoiseLevels {
    let mut levels = start;
    for _ in 0..ITERATIONS {
        let Some((gradient, information)) = gradient(trials, precision, &levels) else { return levels };
        let mut largest = 0.0_f64;
        let Some(solver) = information.cholesky() else { return levels };
        let step = solver.solve(&gradient);
        for i in 0..COMPONENTS {
            let old = levels.0[i];
            levels.0[i] = (old + step[i]).clamp(0.25 * old, 4.0 * old).max(SMALLEST[i]);
            largest = largest.max((levels.0[i] / old).ln().abs());
        }
        if largest < 0.02 {
            break;
        }
    }
    levels
}

/// Gradient of the restricted log likelihood by the variances, and its approximate information.
fn gradient(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let parts: Vec<_> = trials
        .par_iter()
        .filter_map(|(noise, x, r)| {
            let inverse = factor(noise, levels)?.inverse();
            let ax = &inverse * *x;
            let ar = &inverse * *r;
            Some((x.tr_mul(&ax), ax.tr_mul(*r), inverse, ax, ar))
        })
        .collect();
    if parts.len() < trials.len() {
        return None;
    }
    let mut information = DMatrix::from_diagonal(precision);
    let mut right = DVector::zeros(precision.len());
    for part in &parts {
        information += &part.0;
        right += &part.1;
    }
    let information = information.cholesky()?;
    let coefficients = information.solve(&right);
    let covariance = information.inverse();
    let sums: Vec<_> = parts
        .par_iter()
        .zip(trials)
        .map(|((_, _, inverse, ax, ar), (noise, _, _))| {
            let residual = ar - ax * &coefficients;
            let spread = ax * &covariance;
            let column = DMatrix::from_column_slice(residual.len(), 1, residual.as_slice());
            let mut gradient = DVector::zeros(COMPONENTS);
            for i in 0..COMPONENTS {
                let found = noise.times_component(i, &column).dot(&column);
                let expected = noise.trace_with(i, inverse) - noise.times_component(i, ax).dot(&spread);
                gradient[i] = 0.5 * (found - expected);
            }
            let products: Vec<DMatrix<f64>> = (0..COMPONENTS).map(|i| noise.times_component(i, inverse)).collect();
            let information =
                DMatrix::from_fn(COMPONENTS, COMPONENTS, |i, j| 0.5 * products[i].dot(&products[j].transpose()));
            (gradient, information)
        })
        .collect();
    let mut gradient = DVector::zeros(COMPONENTS);
    let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
    for (g, i) in &sums {
        gradient += g;
        information += i;
    }
    Some((gradient, information))
}

/// Least variances: what no laboratory goes below, so that a lucky fit does not make the rest look certain.
const SMALLEST: [f64; COMPONENTS] = [0.005 * 0.005, 0.005 * 0.005, 0.01 * 0.01, 0.01 * 0.01, 0.0005 * 0.0005];
