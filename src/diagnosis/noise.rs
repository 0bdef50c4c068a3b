//! What of the difference between measured and simulated moment is noise: of the moment, and of the EMG as it passes
//! through the muscles (errors in variables).
//!
//! ```text
//! V = σ_w² I + σ_s² C_s + σ_e² G K Gᵀ + σ_g² G 1 1ᵀ Gᵀ + σ_f² G D K D Gᵀ + C_q
//! ```
//! G: moment by the log excitation on knots; K, C_s: correlation over knots and over samples (EMG envelope and slow
//! disturbances of the moment), of the family and length that the data prefer; σ_s differs between trials of flexion, of
//! extension and of neither, because a harder push moves the limb more in its fixation; the fourth term is a gain per trial and
//! muscle; D = 1/e turns the fifth into noise that adds to the EMG; C_q, of known size, is the noise of the angle as forces on
//! the joint show it.
//!
//! # References
//! Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal,
//! doi:10.1093/biomet/58.3.545.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::kernel::{FAMILIES, Family, Kernel, correlated, root};
use crate::study::Direction;

/// Distance between knots of the EMG's noise [s].
pub const KNOT_SPACING: f64 = 0.04;
/// Standard deviation expected of an EMG channel's baseline: what a channel at rest shows of its maximum is 0 to 2 %. Narrower, and
/// baselines that are there are taken for passive forces, drag or reflexes.
pub const BASELINE_SD: f64 = 0.01;
/// EMG below this counts as this when additive noise is expressed relative to it.
const SMALLEST_EXCITATION: f64 = 0.005;
/// Iterations of the variance estimate.
const ITERATIONS: usize = 6;

/// Number of variance components.
pub const COMPONENTS: usize = 7;
/// Those of slow disturbances, by the direction of effort.
const SLOW: Range<usize> = 1..4;
/// Those of the EMG.
const EMG: Range<usize> = 4..COMPONENTS;
/// Number of components that a trial has: white, slow, three of the EMG.
const OF_TRIAL: usize = 5;
/// A step of the variances is never shortened to less than this share: after a short step the secant says little.
const LEAST_SHARE: f64 = 0.3;
/// Standard deviation of the EMG's noise between laboratories and sessions, as a factor.
const USUAL_FACTOR: f64 = 1.5;
/// Standard deviation of slow disturbances between directions of effort, as a factor.
const DIRECTION_FACTOR: f64 = 1.5;

/// Variances: white [(N·m)²], slow in flexion, in extension and without direction [(N·m)²], relative EMG envelope, relative EMG
/// gain per trial, additive EMG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseLevels(pub [f64; COMPONENTS]);

impl Default for NoiseLevels {
    /// Usual laboratory noise: 0.05 N·m white, 0.07 N·m slow, EMG 10 % envelope, 5 % gain, 0.002 additive.
    fn default() -> Self {
        NoiseLevels([0.05, 0.07, 0.07, 0.07, 0.10, 0.05, 0.002].map(|sd: f64| sd * sd))
    }
}

/// Which component is that of slow disturbances in trials of a direction.
fn slow_component(direction: Direction) -> usize {
    SLOW.start
        + match direction {
            Direction::Flexion => 0,
            Direction::Extension => 1,
            Direction::None => 2,
        }
}

impl NoiseLevels {
    /// The step from these variances to those estimated next, in logarithms, shortened where it turns back: variances and the
    /// EMG that is expected with them, taken in turns, otherwise swing between two answers.
    ///
    /// - `last`: what was asked for and what was taken the time before, per variance; 0 at first; becomes this step
    pub fn towards(&self, estimated: &NoiseLevels, last: &mut [[f64; 2]; COMPONENTS]) -> NoiseLevels {
        let mut out = *self;
        for ((level, to), last) in out.0.iter_mut().zip(&estimated.0).zip(last) {
            let asked = (to / *level).ln();
            // Where the secant through both requests is 0, but no further than was asked for.
            let share = last[1] / (last[0] - asked);
            let taken = if share > 0.0 { asked * share.clamp(LEAST_SHARE, 1.0) } else { asked };
            *last = [asked, taken];
            *level *= taken.exp();
        }
        out
    }

    /// Of slow disturbances in trials of a direction [(N·m)²].
    pub fn slow(&self, direction: Direction) -> f64 {
        self.0[slow_component(direction)]
    }

    /// Of white noise [(N·m)²].
    pub fn white(&self) -> f64 {
        self.0[0]
    }

    /// Of the EMG: relative envelope, relative gain per trial, additive.
    pub fn of_emg(&self) -> [f64; 3] {
        let [.., envelope, gain, floor] = self.0;
        [envelope, gain, floor]
    }

    /// Geometric means of both.
    pub fn between(&self, other: &NoiseLevels) -> NoiseLevels {
        let mut out = *self;
        out.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a = (*a * b).sqrt());
        out
    }
}

/// How noise goes with itself in time.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Kernels {
    /// Envelope of the EMG.
    pub emg: Kernel,
    /// Slow disturbances of the moment.
    pub moment: Kernel,
}

impl Default for Kernels {
    fn default() -> Self {
        Kernels {
            emg: Kernel { family: Family::Matern32, length: 0.12 },
            moment: Kernel { family: Family::Matern32, length: 0.36 },
        }
    }
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
    ///
    /// - `by_step`: correlations over knots
    fn add_covariance(&self, by_step: &[f64], factors: Option<&DVector<f64>>, covariance: &mut DMatrix<f64>) {
        let factor = |knot: usize| factors.map_or(1.0, |f| f[knot]);
        let (n, knots) = self.by_knots.shape();
        let mut spread = vec![0.0; n];
        for (knot, rows) in self.rows.iter().enumerate() {
            if rows.is_empty() {
                continue;
            }
            // Column `knot` of G D K.
            spread.fill(0.0);
            for other in knot.saturating_sub(by_step.len() - 1)..(knot + by_step.len()).min(knots) {
                let weight = by_step[knot.abs_diff(other)] * factor(other);
                let column = &self.by_knots.as_slice()[other * n..(other + 1) * n];
                let shown = self.rows[other].clone();
                spread[shown.clone()].iter_mut().zip(&column[shown]).for_each(|(s, g)| *s += weight * g);
            }
            for row in rows.clone() {
                let weight = self.by_knots[(row, knot)] * factor(knot);
                let to = &mut covariance.as_mut_slice()[row * n..(row + 1) * n];
                to[row..].iter_mut().zip(&spread[row..]).for_each(|(to, from)| *to += weight * from);
            }
        }
    }
}

/// What of a trial's noise depends on its times and its direction alone.
#[derive(Debug)]
pub struct TrialTimes {
    direction: Direction,
    /// Variance of white noise per block, relative to that of a sample.
    white: DVector<f64>,
    /// Correlation of slow disturbances.
    slow: DMatrix<f64>,
}

impl TrialTimes {
    /// With the usual correlation of slow disturbances.
    ///
    /// - `direction`: of the effort
    /// - `times`: of the blocks [s]; `counts`: samples in each
    pub fn new(direction: Direction, times: &[f64], counts: &[usize]) -> TrialTimes {
        Self::correlated(direction, times, counts, &Kernels::default().moment)
    }

    /// - `direction`: of the effort
    /// - `times`: of the blocks [s]; `counts`: samples in each; `kernel`: of slow disturbances
    pub fn correlated(direction: Direction, times: &[f64], counts: &[usize], kernel: &Kernel) -> TrialTimes {
        let white = DVector::from_iterator(times.len(), counts.iter().map(|c| 1.0 / *c as f64));
        TrialTimes { direction, white, slow: kernel.matrix(times) }
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
    /// Correlation of the EMG's noise over knots.
    by_step: Arc<[f64]>,
    /// Covariance of known size: noise of the angle as forces on the joint show it [(N·m)²].
    of_angle: Option<DMatrix<f64>>,
}

impl TrialNoise {
    /// With the usual correlation of the EMG's noise.
    ///
    /// - `response`: per muscle, moment by log excitation
    /// - `excitation`: per muscle, at the knots
    pub fn new(times: &Arc<TrialTimes>, response: Vec<Response>, excitation: &[Vec<f64>]) -> TrialNoise {
        Self::correlated(times, response, excitation, &Kernels::default().emg)
    }

    /// - `response`: per muscle, moment by log excitation
    /// - `excitation`: per muscle, at the knots
    /// - `kernel`: of the EMG's noise
    pub fn correlated(
        times: &Arc<TrialTimes>,
        response: Vec<Response>,
        excitation: &[Vec<f64>],
        kernel: &Kernel,
    ) -> TrialNoise {
        let n = times.white.len();
        let reciprocal: Vec<DVector<f64>> = excitation
            .iter()
            .map(|e| DVector::from_iterator(e.len(), e.iter().map(|v| 1.0 / v.max(SMALLEST_EXCITATION))))
            .collect();
        let mut whole = DMatrix::zeros(n, response.len());
        for (g, mut whole) in response.iter().zip(whole.column_iter_mut()) {
            whole.copy_from(&g.by_knots.column_sum());
        }
        let gain = &whole * whole.transpose();
        let emg = [DMatrix::zeros(0, 0), gain, DMatrix::zeros(0, 0)];
        let by_step = Arc::from([]);
        let bare = TrialNoise { times: Arc::clone(times), emg, response, reciprocal, whole, by_step, of_angle: None };
        bare.with_kernel(times, kernel)
    }

    /// The same noise and that of the angle.
    ///
    /// - `covariance`: of blocks [(N·m)²]
    pub fn with_angle(self, covariance: Option<DMatrix<f64>>) -> TrialNoise {
        TrialNoise { of_angle: covariance, ..self }
    }

    /// The same noise with other correlations in time.
    pub fn with_kernel(mut self, times: &Arc<TrialTimes>, kernel: &Kernel) -> TrialNoise {
        let n = times.white.len();
        self.times = Arc::clone(times);
        self.by_step = kernel.by_step(KNOT_SPACING).into();
        let (mut envelope, mut floor) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (g, d) in self.response.iter().zip(&self.reciprocal) {
            g.add_covariance(&self.by_step, None, &mut envelope);
            g.add_covariance(&self.by_step, Some(d), &mut floor);
        }
        envelope.fill_upper_triangle_with_lower_triangle();
        floor.fill_upper_triangle_with_lower_triangle();
        [self.emg[0], self.emg[2]] = [envelope, floor];
        self
    }

    /// Of its components, in order, the places among all.
    pub fn components(&self) -> [usize; OF_TRIAL] {
        [0, slow_component(self.times.direction), EMG.start, EMG.start + 1, EMG.start + 2]
    }

    /// Of its components, in order, the variances.
    fn levels(&self, levels: &NoiseLevels) -> [f64; OF_TRIAL] {
        self.components().map(|i| levels.0[i])
    }

    fn shared(&self) -> [&DMatrix<f64>; OF_TRIAL - 1] {
        [&self.times.slow, &self.emg[0], &self.emg[1], &self.emg[2]]
    }

    /// V.
    pub fn covariance(&self, levels: &NoiseLevels) -> DMatrix<f64> {
        let [white, slow, envelope, gain, floor] = self.levels(levels);
        let mut v = self.times.slow.clone();
        let [of_envelope, of_gain, of_floor] = &self.emg;
        for (((v, e), g), f) in v.iter_mut().zip(of_envelope.iter()).zip(of_gain.iter()).zip(of_floor.iter()) {
            *v = slow * *v + envelope * e + gain * g + floor * f;
        }
        for (k, w) in self.times.white.iter().enumerate() {
            v[(k, k)] += white * w;
        }
        if let Some(of_angle) = &self.of_angle {
            v += of_angle;
        }
        v
    }

    /// The part of V that is noise of one muscle's EMG.
    pub fn covariance_of_muscle(&self, muscle: usize, levels: &NoiseLevels) -> DMatrix<f64> {
        let n = self.times.white.len();
        let [envelope, gain, floor] = levels.of_emg();
        let (mut by_envelope, mut by_floor) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        let response = &self.response[muscle];
        response.add_covariance(&self.by_step, None, &mut by_envelope);
        response.add_covariance(&self.by_step, Some(&self.reciprocal[muscle]), &mut by_floor);
        let mut out = by_envelope * envelope + by_floor * floor;
        out.fill_upper_triangle_with_lower_triangle();
        let whole = self.whole.column(muscle);
        out.ger(gain, &whole, &whole, 1.0);
        out
    }

    /// Sum of V's diagonal for single samples instead of blocks [(N·m)²].
    pub fn variance_of_samples(&self, levels: &NoiseLevels) -> f64 {
        let [white, rest @ ..] = self.levels(levels);
        let shared: f64 = self.shared().iter().zip(rest).map(|(c, l)| l * c.trace()).sum();
        let of_angle = self.of_angle.as_ref().map_or(0.0, DMatrix::trace);
        shared + of_angle + white * self.times.white.len() as f64
    }

    /// Expected noise of log excitation on knots, per muscle, given V⁻¹(residual).
    pub fn expected_noise(&self, levels: &NoiseLevels, weighted_residual: &DVector<f64>) -> Vec<DVector<f64>> {
        let [envelope, gain, floor] = levels.of_emg();
        self.response
            .iter()
            .zip(&self.reciprocal)
            .map(|(g, d)| {
                let back = g.by_knots.tr_mul(weighted_residual);
                let mut w = correlated(&self.by_step, &back) * envelope;
                w.add_scalar_mut(gain * back.sum());
                w += correlated(&self.by_step, &back.component_mul(d)).component_mul(d) * floor;
                w
            })
            .collect()
    }

    /// A draw of the noise of the EMG on knots, per muscle: of its logarithm, and what adds to it.
    ///
    /// - `normal`: standard normal numbers
    pub fn draw(&self, levels: &NoiseLevels, mut normal: impl FnMut() -> f64) -> Vec<[DVector<f64>; 2]> {
        let [envelope, gain, floor] = levels.of_emg().map(f64::sqrt);
        let knots = self.reciprocal.first().map_or(0, |r| r.len());
        let correlation =
            DMatrix::from_fn(knots, knots, |i, j| self.by_step.get(i.abs_diff(j)).copied().unwrap_or(0.0));
        let root = root(&correlation);
        let mut draw = |n: usize| DVector::from_fn(n, |_, _| normal());
        self.reciprocal
            .iter()
            .map(|_| {
                let mut w = &root * draw(knots) * envelope;
                let added = &root * draw(knots) * floor;
                w.add_scalar_mut(gain * draw(1)[0]);
                [w, added]
            })
            .collect()
    }

    /// A draw of the noise of the moment, averaged over blocks [N·m].
    ///
    /// - `normal`: standard normal numbers
    pub fn draw_moment(&self, levels: &NoiseLevels, mut normal: impl FnMut() -> f64) -> DVector<f64> {
        let n = self.times.white.len();
        let mut draw = || DVector::from_fn(n, |_, _| normal());
        let slow = root(&self.times.slow) * draw();
        let of_angle = self.of_angle.as_ref().map_or_else(|| DVector::zeros(n), |c| root(c) * draw());
        let [of_white, of_slow, ..] = self.levels(levels);
        of_angle + slow * of_slow.sqrt() + draw().component_mul(&self.times.white.map(|w| (of_white * w).sqrt()))
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

    /// Covariance of one of its components, for unit variance, times a matrix.
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

    /// Trace of the covariance of one of its components, for unit variance, times a symmetric matrix.
    fn trace_with(&self, component: usize, matrix: &DMatrix<f64>) -> f64 {
        match component.checked_sub(1) {
            Some(i) => self.shared()[i].dot(matrix),
            None => self.times.white.iter().enumerate().map(|(k, w)| w * matrix[(k, k)]).sum(),
        }
    }

    /// ½ tr(A Vᵢ A Vⱼ) for all components.
    ///
    /// - `weight`: A, symmetric
    fn information(&self, weight: &DMatrix<f64>) -> DMatrix<f64> {
        let products: Vec<DMatrix<f64>> = (0..OF_TRIAL).map(|i| self.times_component(i, weight)).collect();
        let turned: Vec<DMatrix<f64>> = products.iter().map(DMatrix::transpose).collect();
        let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
        let places = self.components();
        for (i, place) in places.into_iter().enumerate() {
            for (j, other) in places.into_iter().enumerate() {
                information[(place, other)] = 0.5 * products[i.max(j)].dot(&turned[i.min(j)]);
            }
        }
        information
    }

    /// Xᵀ Vᵢ X for all components there are, each with its variance.
    pub fn by_component(&self, levels: &NoiseLevels, x: &DMatrix<f64>) -> Vec<DMatrix<f64>> {
        let mut out = vec![DMatrix::zeros(x.ncols(), x.ncols()); COMPONENTS];
        for (i, place) in self.components().into_iter().enumerate() {
            out[place] = x.transpose() * self.times_component(i, x) * levels.0[place];
        }
        out
    }
}

/// Cholesky factor of V.
pub fn factor(noise: &TrialNoise, levels: &NoiseLevels) -> Option<Cholesky<f64, Dyn>> {
    noise.covariance(levels).cholesky()
}

/// Restricted maximum likelihood of the variances, by Fisher scoring with the exact gradient. The EMG's have a prior, what
/// laboratories usually see ([`NoiseLevels::default`]; standard deviations times or over 2.25 in 95 of 100): of the gain per
/// trial a session says little, because it has few trials and many directions compete for what differs between them. Slow
/// disturbances of one direction of effort are expected to be those of the others, times or over a factor.
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
    estimate_within(ITERATIONS, trials, precision, start)
}

/// As [`estimate`], with at most this many iterations.
pub fn estimate_within(
    iterations: usize,
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    start: NoiseLevels,
) -> NoiseLevels {
    let mut levels = start;
    for _ in 0..iterations {
        let Some((mut gradient, mut information)) = gradient(trials, precision, &levels) else { return levels };
        for (i, mean, precision) in priors(&levels) {
            let level = levels.0[i];
            gradient[i] += precision * (mean - level.ln()) / level;
            information[(i, i)] += precision / (level * level);
        }
        let mut largest = 0.0_f64;
        let Some(solver) = information.cholesky() else { return levels };
        let step = solver.solve(&gradient);
        for i in 0..COMPONENTS {
            let old = levels.0[i];
            levels.0[i] = (old + step[i]).clamp(0.25 * old, 4.0 * old).clamp(SMALLEST[i], LARGEST[i]);
            largest = largest.max((levels.0[i] / old).ln().abs());
        }
        if largest < 0.02 {
            break;
        }
    }
    levels
}

/// What is expected of variances before the data: which, mean of the logarithm, precision of the logarithm.
fn priors(levels: &NoiseLevels) -> impl Iterator<Item = (usize, f64, f64)> {
    let of_directions = SLOW.map(|i| levels.0[i].ln()).sum::<f64>() / SLOW.len() as f64;
    let usual = NoiseLevels::default().0;
    let precision = |factor: f64| (2.0 * factor.ln()).powi(-2);
    let of_emg = EMG.map(move |i| (i, usual[i].ln(), precision(USUAL_FACTOR)));
    of_emg.chain(SLOW.map(move |i| (i, of_directions, precision(DIRECTION_FACTOR))))
}

/// How well the variances are known: covariance of their logarithms, from `½ tr(P Vᵢ P Vⱼ)` of the trials' own blocks of P and
/// what is expected before the data.
///
/// - `trials`, `precision`: as for [`estimate`]
pub fn spread(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<DMatrix<f64>> {
    let parts: Vec<DMatrix<f64>> = projected(trials, precision, levels)?
        .iter()
        .zip(trials)
        .map(|(p, (noise, ..))| noise.information(&p.projection))
        .collect();
    let mut of_logarithms = DMatrix::zeros(COMPONENTS, COMPONENTS);
    parts.iter().for_each(|part| of_logarithms += part);
    for ((i, j), v) in
        (0..COMPONENTS * COMPONENTS).map(|k| (k / COMPONENTS, k % COMPONENTS)).zip(of_logarithms.as_mut_slice())
    {
        *v *= levels.0[i] * levels.0[j];
    }
    for (i, _, precision) in priors(levels) {
        of_logarithms[(i, i)] += precision;
    }
    Some(of_logarithms.cholesky()?.inverse())
}

/// −2 log of the restricted likelihood, up to a constant; infinite where V cannot be factored.
pub fn restricted_deviance(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> f64 {
    let parts: Vec<_> = trials
        .par_iter()
        .filter_map(|(noise, x, r)| {
            let factor = factor(noise, levels)?;
            let lower = factor.l_dirty();
            let determinant: f64 = lower.diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            let mut all = DMatrix::zeros(r.len(), x.ncols() + 1);
            all.columns_mut(0, x.ncols()).copy_from(x);
            all.set_column(x.ncols(), r);
            lower.solve_lower_triangular_mut(&mut all);
            Some((determinant, all.tr_mul(&all)))
        })
        .collect();
    if parts.len() < trials.len() {
        return f64::INFINITY;
    }
    let n = precision.len();
    let mut total = DMatrix::zeros(n + 1, n + 1);
    let mut deviance = 0.0;
    for (determinant, products) in parts {
        deviance += determinant;
        total += products;
    }
    let information = total.view((0, 0), (n, n)) + DMatrix::from_diagonal(precision);
    let right = total.view((0, n), (n, 1)).into_owned();
    let Some(solver) = information.cholesky() else { return f64::INFINITY };
    let fitted = right.dot(&solver.solve(&right));
    deviance + solver.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>() + total[(n, n)] - fitted
}

/// Longest and shortest correlation that is considered [s].
const LENGTHS: [f64; 2] = [0.02, 1.5];
/// Ratio of neighbouring lengths that are compared.
const LENGTH_RATIO: f64 = 1.4;

/// The kernel of least `deviance`: of every family the best length, found by steps from the length at hand and then where the
/// parabola through the best and its neighbours is least.
pub fn best_kernel(start: &Kernel, mut deviance: impl FnMut(&Kernel) -> f64) -> Kernel {
    let mut best = (f64::INFINITY, *start);
    let mut length = start.length;
    for family in FAMILIES {
        let mut at = |steps: f64| {
            let length = (length * LENGTH_RATIO.powf(steps)).clamp(LENGTHS[0], LENGTHS[1]);
            let kernel = Kernel { family, length };
            (deviance(&kernel), kernel)
        };
        let (mut here, mut steps) = (at(0.0), 0.0);
        let (up, down) = (at(1.0), at(-1.0));
        let direction = if up.0 < here.0 && up.0 <= down.0 { 1.0 } else { -1.0 };
        let (mut before, mut next) = if direction > 0.0 { (down, up) } else { (up, down) };
        while next.0 < here.0 && next.1.length != here.1.length {
            steps += direction;
            (before, here) = (here, next);
            next = at(steps + direction);
        }
        let bend = before.0 - 2.0 * here.0 + next.0;
        if bend > 0.0 && bend.is_finite() {
            let vertex = at(steps + direction * 0.5 * (before.0 - next.0) / bend);
            here = if vertex.0 < here.0 { vertex } else { here };
        }
        if here.0 < best.0 {
            best = here;
        }
        // Families are in an order in which the best length changes little.
        length = here.1.length;
    }
    best.1
}

/// A trial's share of a regression.
struct Projected {
    /// V⁻¹.
    inverse: DMatrix<f64>,
    /// The trial's own block of P.
    projection: DMatrix<f64>,
    /// P r.
    residual: DVector<f64>,
}

fn projected(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<Vec<Projected>> {
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
    let of_trial = |(_, _, inverse, ax, ar): (_, _, DMatrix<f64>, DMatrix<f64>, DVector<f64>)| {
        let residual = ar - &ax * &coefficients;
        let projection = &inverse - (&ax * &covariance) * ax.transpose();
        Projected { inverse, projection, residual }
    };
    Some(parts.into_par_iter().map(of_trial).collect())
}

/// Gradient of the restricted log likelihood by the variances, and its approximate information.
fn gradient(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let sums: Vec<_> = projected(trials, precision, levels)?
        .par_iter()
        .zip(trials)
        .map(|(Projected { inverse, projection, residual }, (noise, ..))| {
            let column = DMatrix::from_column_slice(residual.len(), 1, residual.as_slice());
            let mut gradient = DVector::zeros(COMPONENTS);
            for (i, place) in noise.components().into_iter().enumerate() {
                let found = noise.times_component(i, &column).dot(&column);
                gradient[place] = 0.5 * (found - noise.trace_with(i, projection));
            }
            (gradient, noise.information(inverse))
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
const SMALLEST: [f64; COMPONENTS] =
    [0.005 * 0.005, 0.005 * 0.005, 0.005 * 0.005, 0.005 * 0.005, 0.01 * 0.01, 0.01 * 0.01, 0.0005 * 0.0005];

/// Largest variances: beyond these it is not noise of the EMG (30 % envelope, 15 % gain, 0.01 added), whatever it is.
const LARGEST: [f64; COMPONENTS] =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::INFINITY, 0.3 * 0.3, 0.15 * 0.15, 0.01 * 0.01];

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn verif_covariances_are_those_of_the_dense_matrices() {
        let (blocks, knots) = (9, 14);
        let kernel = Kernels::default().emg;
        let times: Vec<f64> = (0..blocks).map(|b| 0.06 * b as f64).collect();
        let times = Arc::new(TrialTimes::correlated(Direction::None, &times, &[6; 9], &kernel));
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
        let at: Vec<f64> = (0..knots).map(|j| KNOT_SPACING * j as f64).collect();
        let ones = DMatrix::from_element(knots, knots, 1.0);
        let noise = TrialNoise::correlated(&times, responses, &excitation, &kernel);
        let kernel = kernel.matrix(&at);
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
        let levels = NoiseLevels([0.1, 0.2, 0.2, 0.2, 0.3, 0.4, 0.5]);
        let residual = DVector::from_fn(blocks, |i, _| (1.7 * i as f64).cos());
        for ((found, g), e) in noise.expected_noise(&levels, &residual).iter().zip(&dense).zip(&excitation) {
            let d = DMatrix::from_diagonal(&DVector::from_iterator(knots, e.iter().map(|e| 1.0 / e)));
            let prior = &kernel * 0.3 + &ones * 0.4 + &d * &kernel * &d * 0.5;
            let expected = prior * g.tr_mul(&residual);
            assert!((found - &expected).amax() < 1e-12 * expected.amax());
        }
    }

    #[test]
    fn verif_variances_that_swing_come_to_rest() {
        // What is estimated next, of a variance whose logarithm is x: 0.3 - 2 x swings ever further when taken at its word.
        let estimated = |levels: &NoiseLevels| NoiseLevels(levels.0.map(|v| (0.3 - 2.0 * v.ln()).exp()));
        let mut plain = NoiseLevels([0.5; COMPONENTS]);
        let (mut shortened, mut last) = (plain, [[0.0; 2]; COMPONENTS]);
        for _ in 0..6 {
            plain = estimated(&plain);
            shortened = shortened.towards(&estimated(&shortened), &mut last);
        }
        assert!((plain.0[0].ln() - 0.1).abs() > 10.0);
        assert!(shortened.0.iter().all(|v| (v.ln() - 0.1).abs() < 1e-3), "{shortened:?}");
    }

    #[test]
    fn verif_correlation_of_the_noise_is_found() {
        let times: Vec<f64> = (0..80).map(|b| 0.044 * f64::from(b)).collect();
        for truth in
            [Kernel { family: Family::Gaussian, length: 0.3 }, Kernel { family: Family::Exponential, length: 0.15 }]
        {
            let structure = |kernel: &Kernel| {
                let times = Arc::new(TrialTimes::correlated(Direction::None, &times, &[4; 80], kernel));
                TrialNoise::correlated(&times, vec![Response::new(80, 3)], &[vec![0.1; 3]], kernel)
            };
            let levels = NoiseLevels([0.0025, 0.005, 0.005, 0.005, 1e-4, 1e-4, 2.5e-7]);
            let mut rng = rand_chacha::ChaCha8Rng::from_seed([7; 32]);
            let drawn = structure(&truth);
            let draws: Vec<DVector<f64>> =
                (0..30).map(|_| drawn.draw_moment(&levels, || super::super::score_test::normal(&mut rng))).collect();
            let regressors = DMatrix::from_element(80, 1, 1.0);
            let precision = DVector::from_element(1, 1e-6);
            let best = best_kernel(&Kernels::default().moment, |kernel| {
                let noise = structure(kernel);
                let trials: Vec<_> = draws.iter().map(|d| (&noise, &regressors, d)).collect();
                let found = estimate(&trials, &precision, levels);
                restricted_deviance(&trials, &precision, &found)
            });
            let rough = |k: &Kernel| FAMILIES.iter().position(|f| *f == k.family).unwrap_or(9);
            assert!(rough(&best).abs_diff(rough(&truth)) <= 1, "{best:?} of {truth:?}");
            assert!((best.length / truth.length).ln().abs() < 0.5, "{best:?} of {truth:?}");
        }
    }

    #[test]
    fn verif_every_direction_has_its_slow_noise_and_one_without_trials_that_of_the_others() {
        let times: Vec<f64> = (0..80).map(|b| 0.044 * f64::from(b)).collect();
        let Kernels { emg, moment } = Kernels::default();
        let truth = NoiseLevels([0.0025, 0.04, 0.005, 0.0, 1e-4, 1e-4, 2.5e-7]);
        let mut rng = rand_chacha::ChaCha8Rng::from_seed([8; 32]);
        let drawn: Vec<(TrialNoise, DVector<f64>)> = (0..24)
            .map(|k| {
                let direction = if k % 2 == 0 { Direction::Flexion } else { Direction::Extension };
                let times = Arc::new(TrialTimes::correlated(direction, &times, &[4; 80], &moment));
                let noise = TrialNoise::correlated(&times, vec![Response::new(80, 3)], &[vec![0.1; 3]], &emg);
                let draw = noise.draw_moment(&truth, || super::super::score_test::normal(&mut rng));
                (noise, draw)
            })
            .collect();
        let regressors = DMatrix::from_element(80, 1, 1.0);
        let trials: Vec<_> = drawn.iter().map(|(noise, draw)| (noise, &regressors, draw)).collect();
        let found = estimate_within(30, &trials, &DVector::from_element(1, 1e-6), NoiseLevels::default());
        let off = |direction| (found.slow(direction) / truth.slow(direction)).ln().abs();
        assert!(off(Direction::Flexion) < 0.3 && off(Direction::Extension) < 0.3, "{found:?}");
        let between = (found.slow(Direction::Flexion) * found.slow(Direction::Extension)).sqrt();
        assert!((found.slow(Direction::None) / between).ln().abs() < 0.05, "{found:?}");
    }
}
