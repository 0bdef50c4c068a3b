//! How noise enters a trial: of its moment, and of its EMG.

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::levels::{COMPONENTS, EMG, Kernels, NoiseLevels, slow_component};
use super::response::Response;
use crate::ONE_BY_ONE;
use crate::kernel::{Kernel, correlated, root};
use carpus_numerics::numerics::cholesky;
use carpus_study::study::Direction;

/// Distance between knots of the EMG's noise [s].
pub const KNOT_SPACING: f64 = 0.04;
/// EMG below this counts as this when additive noise is expressed relative to it.
const SMALLEST_EXCITATION: f64 = 0.005;

/// Number of components that a trial has: white, slow, three of the EMG.
const OF_TRIAL: usize = 5;

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

    /// The same of a moment that has fewer samples of its own than there are.
    ///
    /// - `rows`: samples for one of its own, 1 or more
    pub fn sampled_every(mut self, rows: f64) -> TrialTimes {
        self.white *= rows;
        self
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
        bare.with_emg_kernel(kernel)
    }

    /// The same noise and that of the angle.
    ///
    /// - `covariance`: of blocks [(N·m)²]
    pub fn with_angle(self, covariance: Option<DMatrix<f64>>) -> TrialNoise {
        TrialNoise { of_angle: covariance, ..self }
    }

    /// The same noise, slow disturbances correlated otherwise.
    pub fn with_times(self, times: Arc<TrialTimes>) -> TrialNoise {
        TrialNoise { times, ..self }
    }

    /// The same noise, that of the EMG correlated otherwise.
    pub fn with_emg_kernel(mut self, kernel: &Kernel) -> TrialNoise {
        let n = self.times.white.len();
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

    /// Covariance of this model's residuals with those of another of the same trial.
    fn covariance_with(&self, other: &TrialNoise, levels: &NoiseLevels) -> DMatrix<f64> {
        let [white, slow, ..] = self.levels(levels);
        let [envelope, gain, floor] = levels.of_emg();
        let mut v = &self.times.slow * slow + &self.whole * other.whole.transpose() * gain;
        let n = self.times.white.len();
        let (mut of_envelope, mut of_floor) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        let responses = self.response.iter().zip(&other.response);
        for ((own, others), (d, of_other)) in responses.zip(self.reciprocal.iter().zip(&other.reciprocal)) {
            own.add_covariance_with(others, &self.by_step, None, &mut of_envelope);
            own.add_covariance_with(others, &self.by_step, Some([d, of_other]), &mut of_floor);
        }
        v += of_envelope * envelope + of_floor * floor;
        for (k, w) in self.times.white.iter().enumerate() {
            v[(k, k)] += white * w;
        }
        // How the angle's noise passes through both is not known: alike.
        for of_angle in [&self.of_angle, &other.of_angle].into_iter().flatten() {
            v += of_angle * 0.5;
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

    /// Noise of the EMG relative to it, on knots per muscle.
    ///
    /// - `drawn`: from [`TrialNoise::draw`]
    pub fn relative(&self, drawn: &[[DVector<f64>; 2]]) -> Vec<DVector<f64>> {
        drawn.iter().zip(&self.reciprocal).map(|([w, added], d)| w + added.component_mul(d)).collect()
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
    pub(super) fn times_component(&self, component: usize, right: &DMatrix<f64>) -> DMatrix<f64> {
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
    pub(super) fn trace_with(&self, component: usize, matrix: &DMatrix<f64>) -> f64 {
        match component.checked_sub(1) {
            Some(i) => self.shared()[i].dot(matrix),
            None => self.times.white.iter().enumerate().map(|(k, w)| w * matrix[(k, k)]).sum(),
        }
    }

    /// ½ tr(A Vᵢ A Vⱼ) for all components.
    ///
    /// - `weight`: A, symmetric
    pub(super) fn information(&self, weight: &DMatrix<f64>) -> DMatrix<f64> {
        let products: Vec<DMatrix<f64>> = (0..OF_TRIAL).map(|i| self.times_component(i, weight)).collect();
        let turned: Vec<DMatrix<f64>> = products.iter().map(DMatrix::transpose).collect();
        let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
        let places = self.components();
        for (i, place) in places.into_iter().enumerate() {
            for (j, other) in places.into_iter().enumerate().take(i + 1) {
                information[(place, other)] = 0.5 * products[i].dot(&turned[j]);
                information[(other, place)] = information[(place, other)];
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
    cholesky(noise.covariance(levels))
}

/// S: how differently noise passes through two models of the same trials; 0 where it passes alike.
///
/// ```text
/// S = Σ n − ‖L_a⁻¹ C_ab L_b⁻ᵀ‖²,   V = L Lᵀ, C_ab: covariance of the residuals of both
/// ```
pub(crate) fn scatter_of_all(a: &[TrialNoise], b: &[TrialNoise], levels: &NoiseLevels) -> Option<f64> {
    let found: Vec<_> = a.par_iter().with_max_len(ONE_BY_ONE).zip(b).map(|(a, b)| scatter(a, b, levels)).collect();
    found.into_iter().sum::<Option<f64>>().map(|sum| sum.max(0.0))
}

fn scatter(a: &TrialNoise, b: &TrialNoise, levels: &NoiseLevels) -> Option<f64> {
    let mut both = a.covariance_with(b, levels);
    factor(a, levels)?.l_dirty().solve_lower_triangular_mut(&mut both);
    let mut both = both.transpose();
    factor(b, levels)?.l_dirty().solve_lower_triangular_mut(&mut both);
    Some(both.nrows() as f64 - both.norm_squared())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// Noise of a trial of two muscles whose EMG passes by `pass`.
    fn trial(pass: f64) -> TrialNoise {
        let (blocks, knots) = (8, 12);
        let kernel = Kernels::default().emg;
        let times: Vec<f64> = (0..blocks).map(|b| 0.06 * b as f64).collect();
        let times = Arc::new(TrialTimes::correlated(Direction::Flexion, &times, &[6; 8], &kernel));
        let mut responses = vec![Response::new(blocks, knots); 2];
        for (m, response) in responses.iter_mut().enumerate() {
            for j in 0..knots {
                for b in (j / 2)..blocks.min(j / 2 + 3) {
                    response.add(b, j, pass + 0.5 * (m as f64 + 0.7 * b as f64 - 0.3 * j as f64).cos());
                }
            }
        }
        let excitation: Vec<Vec<f64>> =
            (0..2).map(|m| (0..knots).map(|j| 0.1 + 0.02 * (j + m) as f64).collect()).collect();
        TrialNoise::correlated(&times, responses, &excitation, &kernel)
    }

    #[test]
    fn verif_scatter_is_the_variance_of_a_difference_of_misfits() {
        use rand::SeedableRng;
        let levels = NoiseLevels([0.05, 0.04, 0.04, 0.04, 0.1, 0.05, 0.004].map(|sd: f64| sd * sd));
        let (a, b) = (trial(0.2), trial(0.8));
        assert!((a.covariance_with(&a, &levels) - a.covariance(&levels)).amax() < 1e-12);
        assert!(scatter(&a, &a, &levels).unwrap().abs() < 1e-9);
        let expected = 4.0 * scatter(&a, &b, &levels).unwrap();
        // The same noise of EMG and moment, drawn, as residuals of both.
        let factors = [&a, &b].map(|noise| factor(noise, &levels).unwrap());
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let n = 20_000;
        let differences: Vec<f64> = (0..n)
            .map(|_| {
                let mut normal = || carpus_effects::random::normal(&mut rng);
                let (of_emg, of_moment) = (a.draw(&levels, &mut normal), a.draw_moment(&levels, &mut normal));
                let misfit = |noise: &TrialNoise, i: usize| {
                    let residual = noise.respond(&noise.relative(&of_emg)) + &of_moment;
                    residual.dot(&factors[i].solve(&residual))
                };
                misfit(&a, 0) - misfit(&b, 1)
            })
            .collect();
        let mean = differences.iter().sum::<f64>() / n as f64;
        let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n as f64;
        assert!(expected > 1.0 && (variance / expected - 1.0).abs() < 0.05, "{variance} and {expected}");
    }
}
