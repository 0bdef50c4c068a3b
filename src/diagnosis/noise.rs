//! What of the difference between measured and simulated moment is noise: of the moment, and of the EMG as it passes
//! through the muscles (errors in variables).
//!
//! ```text
//! V = σ_w² I + σ_s² C_s + σ_e² G K Gᵀ + σ_g² G 1 1ᵀ Gᵀ + σ_f² G D K D Gᵀ
//! ```
//! G: moment by the log excitation on knots; K, C_s: Matérn-3/2 correlation over knots and over samples (EMG
//! envelope and slow disturbances of the moment); the fourth term is a gain per trial and muscle; D = 1/e turns the last
//! one into noise that adds to the EMG.
//!
//! # References
//! Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal,
//! doi:10.1093/biomet/58.3.545.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::centring::root;

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

/// Moment of one muscle by the logarithm of its excitation on knots, blocks × knots.
#[derive(Clone, Debug)]
pub struct Response {
    by_knots: DMatrix<f64>,
    /// Per knot: the blocks in which it shows.
    rows: Vec<Range<usize>>,
}

impl Response {
    /// - `blocks`, `knots`: how many
    pub fn new(blocks: usize, knots: usize) -> Response {
        Response { by_knots: DMatrix::zeros(blocks, knots), rows: vec![0..0; knots] }
    }

    /// Adds what a knot causes in a block.
    pub fn add(&mut self, block: usize, knot: usize, moment: f64) {
        self.by_knots[(block, knot)] += moment;
        let rows = &mut self.rows[knot];
        *rows = if rows.start == rows.end { block..block + 1 } else { rows.start.min(block)..rows.end.max(block + 1) };
    }

    /// Adds G K Gᵀ to the lower triangle of `covariance`; with `factors` on the knots G D K D Gᵀ.
    fn add_covariance(&self, factors: Option<&DVector<f64>>, covariance: &mut DMatrix<f64>) {
        let factor = |knot: usize| factors.map_or(1.0, |f| f[knot]);
        let n = self.by_knots.nrows();
        let mut spread = self.by_knots.clone();
        if let Some(factors) = factors {
            spread.column_iter_mut().zip(factors.iter()).for_each(|(mut column, f)| column *= *f);
        }
        correlate(&mut spread);
        for (knot, rows) in self.rows.iter().enumerate() {
            let from = &spread.as_slice()[knot * n..(knot + 1) * n];
            for row in rows.clone() {
                let weight = self.by_knots[(row, knot)] * factor(knot);
                let to = &mut covariance.as_mut_slice()[row * n..(row + 1) * n];
                to[row..].iter_mut().zip(&from[row..]).for_each(|(to, from)| *to += weight * from);
            }
        }
    }
}

/// Multiplies every row by the Matérn-3/2 correlation over knots: (1 + c d) ρᵈ with ρ = e⁻ᶜ, a product of which takes two
/// sweeps instead of a dense matrix.
fn correlate(rows: &mut DMatrix<f64>) {
    let c = 3f64.sqrt() * KNOT_SPACING / ENVELOPE_LENGTH;
    let rho = (-c).exp();
    let n = rows.nrows();
    let original = rows.clone();
    // Sums over the knots on one side: ρᵈ x, and c d ρᵈ x.
    let (mut plain, mut sloped) = (vec![0.0; n], vec![0.0; n]);
    for (before, column) in original.as_slice().chunks_exact(n).zip(rows.as_mut_slice().chunks_exact_mut(n)) {
        for i in 0..n {
            sloped[i] = rho * (sloped[i] + c * plain[i]);
            plain[i] = rho * plain[i] + before[i];
            column[i] = plain[i] + sloped[i];
        }
    }
    plain.fill(0.0);
    sloped.fill(0.0);
    for (after, column) in original.as_slice().chunks_exact(n).zip(rows.as_mut_slice().chunks_exact_mut(n)).rev() {
        for i in 0..n {
            column[i] += plain[i] + sloped[i];
            // To the knot before, one step farther from all of these.
            plain[i] = rho * (plain[i] + after[i]);
            sloped[i] = rho * sloped[i] + c * plain[i];
        }
    }
}

/// The same of a single row.
fn correlated(values: &DVector<f64>) -> DVector<f64> {
    let mut row = DMatrix::from_row_slice(1, values.len(), values.as_slice());
    correlate(&mut row);
    DVector::from_column_slice(row.as_slice())
}

/// What of a trial's noise depends on its times alone.
#[derive(Debug)]
pub struct TrialTimes {
    /// Variance of white noise per block, relative to that of a sample.
    white: DVector<f64>,
    /// Correlation of slow disturbances.
    slow: DMatrix<f64>,
}

impl TrialTimes {
    /// - `times`: of the blocks [s]; `counts`: samples in each
    pub fn new(times: &[f64], counts: &[usize]) -> TrialTimes {
        let n = times.len();
        TrialTimes {
            white: DVector::from_iterator(n, counts.iter().map(|c| 1.0 / *c as f64)),
            slow: DMatrix::from_fn(n, n, |i, j| matern(times[i] - times[j], SLOW_LENGTH)),
        }
    }
}

/// How noise enters one trial.
#[derive(Clone, Debug)]
pub struct TrialNoise {
    times: Arc<TrialTimes>,
    /// Covariances of EMG envelope, gain and additive noise for unit variance.
    emg: [DMatrix<f64>; 3],
    /// Per muscle: moment by log excitation on knots.
    response: Vec<Response>,
    /// Per muscle: reciprocal excitation on knots.
    reciprocal: Vec<DVector<f64>>,
    /// Per muscle: moment by the logarithm of all its excitation.
    whole: DMatrix<f64>,
}

impl TrialNoise {
    /// - `response`: per muscle, moment by log excitation
    /// - `excitation`: per muscle, at the knots
    pub fn new(times: &Arc<TrialTimes>, response: Vec<Response>, excitation: &[Vec<f64>]) -> TrialNoise {
        let n = times.white.len();
        let reciprocal: Vec<DVector<f64>> = excitation
            .iter()
            .map(|e| DVector::from_iterator(e.len(), e.iter().map(|v| 1.0 / v.max(SMALLEST_EXCITATION))))
            .collect();
        let mut envelope = DMatrix::zeros(n, n);
        let mut floor = DMatrix::zeros(n, n);
        let mut whole = DMatrix::zeros(n, response.len());
        for ((g, d), mut whole) in response.iter().zip(&reciprocal).zip(whole.column_iter_mut()) {
            g.add_covariance(None, &mut envelope);
            g.add_covariance(Some(d), &mut floor);
            whole.copy_from(&g.by_knots.column_sum());
        }
        envelope.fill_upper_triangle_with_lower_triangle();
        floor.fill_upper_triangle_with_lower_triangle();
        let gain = &whole * whole.transpose();
        TrialNoise { times: Arc::clone(times), emg: [envelope, gain, floor], response, reciprocal, whole }
    }

    fn shared(&self) -> [&DMatrix<f64>; COMPONENTS - 1] {
        [&self.times.slow, &self.emg[0], &self.emg[1], &self.emg[2]]
    }

    /// V.
    pub fn covariance(&self, levels: &NoiseLevels) -> DMatrix<f64> {
        let [white, slow, envelope, gain, floor] = levels.0;
        let mut v = self.times.slow.clone();
        let [of_envelope, of_gain, of_floor] = &self.emg;
        for (((v, e), g), f) in v.iter_mut().zip(of_envelope.iter()).zip(of_gain.iter()).zip(of_floor.iter()) {
            *v = slow * *v + envelope * e + gain * g + floor * f;
        }
        for (k, w) in self.times.white.iter().enumerate() {
            v[(k, k)] += white * w;
        }
        v
    }

    /// Sum of V's diagonal for single samples instead of blocks [(N·m)²].
    pub fn variance_of_samples(&self, levels: &NoiseLevels) -> f64 {
        let shared: f64 = self.shared().iter().zip(&levels.0[1..]).map(|(c, l)| l * c.trace()).sum();
        shared + levels.0[0] * self.times.white.len() as f64
    }

    /// Expected noise of log excitation on knots, per muscle, given V⁻¹(residual).
    pub fn expected_noise(&self, levels: &NoiseLevels, weighted_residual: &DVector<f64>) -> Vec<DVector<f64>> {
        let [_, _, envelope, gain, floor] = levels.0;
        self.response
            .iter()
            .zip(&self.reciprocal)
            .map(|(g, d)| {
                let back = g.by_knots.tr_mul(weighted_residual);
                let mut w = correlated(&back) * envelope;
                w.add_scalar_mut(gain * back.sum());
                w += correlated(&back.component_mul(d)).component_mul(d) * floor;
                w
            })
            .collect()
    }

    /// A draw of the noise of the log EMG on knots, per muscle.
    ///
    /// - `normal`: standard normal numbers
    pub fn draw(&self, levels: &NoiseLevels, mut normal: impl FnMut() -> f64) -> Vec<DVector<f64>> {
        let [_, _, envelope, gain, floor] = levels.0.map(f64::sqrt);
        let knots = self.reciprocal.first().map_or(0, |r| r.len());
        let correlation =
            DMatrix::from_fn(knots, knots, |i, j| matern(KNOT_SPACING * (i as f64 - j as f64), ENVELOPE_LENGTH));
        let root = root(&correlation);
        let mut draw = |n: usize| DVector::from_fn(n, |_, _| normal());
        self.reciprocal
            .iter()
            .map(|d| {
                let mut w = &root * draw(knots) * envelope;
                w += (&root * draw(knots)).component_mul(d) * floor;
                w.add_scalar_mut(gain * draw(1)[0]);
                w
            })
            .collect()
    }

    /// Moment that a change of log excitation on knots causes, to first order.
    pub fn respond(&self, change: &[DVector<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(self.times.white.len());
        for (g, w) in self.response.iter().zip(change) {
            out += &g.by_knots * w;
        }
        out
    }

    /// Moment that one more unit of EMG baseline of a muscle causes.
    pub fn respond_to_baseline(&self, muscle: usize) -> DVector<f64> {
        &self.response[muscle].by_knots * &self.reciprocal[muscle]
    }

    /// This component's covariance times a matrix.
    fn times_component(&self, component: usize, right: &DMatrix<f64>) -> DMatrix<f64> {
        const GAIN: usize = 3;
        match component {
            0 => {
                let mut out = right.clone();
                out.column_iter_mut().for_each(|mut column| column.component_mul_assign(&self.times.white));
                out
            }
            GAIN => &self.whole * self.whole.tr_mul(right),
            _ => self.shared()[component - 1] * right,
        }
    }

    /// Trace of this component's covariance times a symmetric matrix.
    fn trace_with(&self, component: usize, matrix: &DMatrix<f64>) -> f64 {
        match component.checked_sub(1) {
            Some(i) => self.shared()[i].dot(matrix),
            None => self.times.white.iter().enumerate().map(|(k, w)| w * matrix[(k, k)]).sum(),
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
            Some((x.transpose() * &ax, ax.tr_mul(*r), inverse, ax, ar))
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
            // The trial's own block of P.
            let projection = inverse - (ax * &covariance) * ax.transpose();
            let column = DMatrix::from_column_slice(residual.len(), 1, residual.as_slice());
            let mut gradient = DVector::zeros(COMPONENTS);
            for i in 0..COMPONENTS {
                let found = noise.times_component(i, &column).dot(&column);
                gradient[i] = 0.5 * (found - noise.trace_with(i, &projection));
            }
            let products: Vec<DMatrix<f64>> = (0..COMPONENTS).map(|i| noise.times_component(i, inverse)).collect();
            let turned: Vec<DMatrix<f64>> = products.iter().map(DMatrix::transpose).collect();
            let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
            for i in 0..COMPONENTS {
                for j in 0..=i {
                    information[(i, j)] = 0.5 * products[i].dot(&turned[j]);
                    information[(j, i)] = information[(i, j)];
                }
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_covariances_are_those_of_the_dense_matrices() {
        let (blocks, knots) = (9, 14);
        let times: Vec<f64> = (0..blocks).map(|b| 0.06 * b as f64).collect();
        let times = Arc::new(TrialTimes::new(&times, &[6; 9]));
        let excitation: Vec<Vec<f64>> =
            (0..2).map(|m| (0..knots).map(|j| 0.02 + 0.3 * ((j + m) as f64).sin().powi(2)).collect()).collect();
        let mut dense = vec![DMatrix::zeros(blocks, knots); 2];
        let mut responses = vec![Response::new(blocks, knots); 2];
        for m in 0..2 {
            for j in 0..knots {
                for b in (j / 2)..blocks.min(j / 2 + 5) {
                    let moment = (1.0 + m as f64) * (0.7 * b as f64 - 0.3 * j as f64).cos();
                    dense[m][(b, j)] = moment;
                    responses[m].add(b, j, moment);
                }
            }
        }
        let kernel =
            DMatrix::from_fn(knots, knots, |i, j| matern(KNOT_SPACING * (i as f64 - j as f64), ENVELOPE_LENGTH));
        let ones = DMatrix::from_element(knots, knots, 1.0);
        let noise = TrialNoise::new(&times, responses, &excitation);
        let mut expected = [(); 3].map(|()| DMatrix::<f64>::zeros(blocks, blocks));
        for (g, e) in dense.iter().zip(&excitation) {
            let d = DMatrix::from_diagonal(&DVector::from_iterator(knots, e.iter().map(|e| 1.0 / e)));
            expected[0] += g * &kernel * g.transpose();
            expected[1] += g * &ones * g.transpose();
            expected[2] += g * &d * &kernel * &d * g.transpose();
        }
        for (ours, expected) in noise.emg.iter().zip(&expected) {
            assert!((ours - expected).amax() < 1e-12 * expected.amax());
        }
        let right = DMatrix::from_fn(blocks, 3, |i, j| (i as f64 + 2.0 * j as f64).sin());
        let gain = noise.times_component(3, &right);
        assert!((gain - &expected[1] * &right).amax() < 1e-10);
        let levels = NoiseLevels([0.1, 0.2, 0.3, 0.4, 0.5]);
        let residual = DVector::from_fn(blocks, |i, _| (1.7 * i as f64).cos());
        for ((found, g), e) in noise.expected_noise(&levels, &residual).iter().zip(&dense).zip(&excitation) {
            let d = DMatrix::from_diagonal(&DVector::from_iterator(knots, e.iter().map(|e| 1.0 / e)));
            let prior = &kernel * 0.3 + &ones * 0.4 + &d * &kernel * &d * 0.5;
            let expected = prior * g.tr_mul(&residual);
            assert!((found - &expected).amax() < 1e-12 * expected.amax());
        }
    }
}
