//! A participant's training trials around a point of muscle parameters, effects and excitations.
//!
//! The true excitation is the recorded one times exp(w), w unknown. Around the present estimate ŵ the moment
//! is linear in w, so that with G = ∂τ/∂w
//!
//! ```text
//! r = y − τ(θ, φ, ŵ) + G ŵ ~ N(0, V),   ŵ ← E[w | data] = K Gᵀ V⁻¹ r
//! ```
//! (first-order conditional linearization). Sensitivities taken at ŵ are, to first order, independent of the
//! residual: EMG noise that is in both would otherwise make time constants, delays and nonlinearities look
//! significant.
//!
//! # References
//! Lindstrom & Bates (1990), Nonlinear mixed effects models for repeated measures data, doi:10.2307/2532087.

mod grid;
mod information;
pub(crate) mod linearization;
mod noise_estimate;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::ONE_BY_ONE;
use crate::kernel::Kernel;
use crate::noise::{COMPONENTS, Kernels, NoiseLevels, TrialNoise, TrialTimes};
use crate::score_test::{self, Block, BlockScore, Nuisance, Omnibus, Tested, Variances};
use carpus_effects::effect::{Effect, Role};
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, ForwardModel, Setting, TrialInput};
use carpus_effects::trial_record::TrialRecord;
use carpus_simulation::simulation::MuscleParameters;
use carpus_study::study::ParameterBounds;

pub use grid::memory_of_noise;
pub use grid::{block_means, block_starts};
pub(crate) use grid::{corrected, knot_count};

/// Where a fit stands.
#[derive(Clone)]
pub struct Point {
    /// Muscle parameters.
    pub parameters: Vec<MuscleParameters>,
    /// Effects that are on.
    pub effects: Vec<Setting>,
    /// Baseline of every EMG channel, in units of its expected size.
    pub baseline: Vec<f64>,
    /// Per training trial and muscle: log of true over recorded excitation, on knots.
    pub correction: Vec<Vec<DVector<f64>>>,
    /// Per training trial: the excitation so corrected.
    pub inputs: Vec<Arc<TrialInput>>,
}

/// A finished fit.
#[derive(Clone)]
pub struct Fit {
    /// Where it ended.
    pub point: Point,
    /// −2 log posterior, up to a constant.
    pub deviance: f64,
    /// Covariance of the effects' parameters, in units of their scales, in the order of effects and parameters.
    pub covariance: DMatrix<f64>,
    /// Variances of the noise.
    pub levels: NoiseLevels,
    /// Covariance of their logarithms.
    pub(crate) level_spread: DMatrix<f64>,
    pub(crate) noise: Vec<TrialNoise>,
    pub(crate) factors: Vec<Cholesky<f64, Dyn>>,
    /// Per training trial: whitened columns [nuisance | effects' parameters | residual].
    pub(crate) whitened: Vec<DMatrix<f64>>,
    /// Distance of nuisance and effects from the prior's mean, and prior precision.
    pub(crate) offset: Vec<f64>,
    pub(crate) precision: Vec<f64>,
    /// Per training trial: directions at this fit, averaged over blocks.
    pub(crate) directions: Arc<Vec<DMatrix<f64>>>,
}

/// A participant's training data, the noise in it, and the directions to test.
pub struct Analysis<'a> {
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// Training trials.
    pub train: Vec<usize>,
    /// Effects under test.
    pub candidates: Vec<&'static dyn Effect>,
    /// Prior standard deviation of log F_max, log l_opt, log l_slack.
    pub(crate) prior_sd: [f64; FITTED_PER_MUSCLE],
    /// Bounds of their changes.
    pub(crate) log_bounds: [[f64; 2]; FITTED_PER_MUSCLE],
    /// Columns of muscle parameters, the second of which changes with the first.
    pub(crate) tied: Vec<[usize; 2]>,
    /// Blocks of directions and their columns among all directions.
    pub blocks: Vec<Block>,
    /// Per training trial.
    pub(crate) times: Vec<Arc<TrialTimes>>,
    /// How the noise goes with itself in time.
    pub(crate) kernels: Kernels,
    pub(crate) seed: u64,
    /// Per training trial: moments to fit in place of the recorded ones [N·m].
    pub(crate) targets: Option<Vec<Vec<f64>>>,
    /// Times that the trials were linearized.
    pub(crate) linearized: AtomicUsize,
}

/// What of a trial's noise depends on its times and direction alone.
///
/// - `kernel`: of slow disturbances
pub(crate) fn trial_times(trial: &TrialRecord, kernel: &Kernel) -> Arc<TrialTimes> {
    let starts = block_starts(&trial.time);
    let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
    let times = block_means(&trial.time, &starts);
    let times = TrialTimes::correlated(trial.info.direction, times.as_slice(), &counts, kernel);
    Arc::new(times.sampled_every(trial.rows_per_moment))
}

impl<'a> Analysis<'a> {
    /// The moment that a training trial is fitted to [N·m].
    pub(crate) fn target(&self, position: usize) -> &[f64] {
        match &self.targets {
            Some(targets) => &targets[position],
            None => &self.forward.trials[self.train[position]].moment,
        }
    }

    /// Parameter sets with which all trials were simulated so far, with derivatives.
    pub fn linearizations(&self) -> usize {
        self.linearized.load(Ordering::Relaxed)
    }

    pub(crate) fn n_muscles(&self) -> usize {
        self.forward.muscles.len()
    }

    /// Columns of nuisance: muscle parameters, and a baseline of every EMG channel.
    pub fn n_nuisance(&self) -> usize {
        self.n_muscles() * (FITTED_PER_MUSCLE + 1)
    }

    /// The model as given, without effects and with the EMG as recorded, below 1.
    pub fn nominal_point(&self) -> Point {
        let correction = self.no_correction();
        let input = |(g, none): (&usize, &Vec<DVector<f64>>)| {
            let record = &self.forward.trials[*g];
            let excitation = corrected(&record.time, &record.excitation, none);
            Arc::new(self.forward.input(*g, excitation).unwrap_or_else(|_| self.forward.recorded_input(*g)))
        };
        Point {
            parameters: self.forward.nominal_parameters(),
            effects: Vec::new(),
            baseline: vec![0.0; self.n_muscles()],
            inputs: self.train.iter().zip(&correction).map(input).collect(),
            correction,
        }
    }

    /// No noise in the EMG, per training trial and muscle on knots.
    pub(crate) fn no_correction(&self) -> Vec<Vec<DVector<f64>>> {
        let none = |g: &usize| vec![DVector::zeros(knot_count(&self.forward.trials[*g].time)); self.n_muscles()];
        self.train.iter().map(none).collect()
    }

    fn nuisance_precision(&self) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.n_nuisance());
        for _ in 0..self.n_muscles() {
            out.extend(self.prior_sd.iter().map(|sd| 1.0 / (sd * sd)));
        }
        // Baselines are in units of their standard deviation.
        out.extend(std::iter::repeat_n(1.0, self.n_muscles()));
        out
    }

    /// Prior precision and present distance from the prior's mean, of nuisance and effects.
    pub(crate) fn prior(&self, point: &Point) -> (Vec<f64>, Vec<f64>) {
        let mut precision = self.nuisance_precision();
        let mut offset = Vec::new();
        for (p, nominal) in point.parameters.iter().zip(self.forward.nominal_parameters()) {
            offset.push((p.max_isometric_force / nominal.max_isometric_force).ln());
            offset.push((p.optimal_fiber_length / nominal.optimal_fiber_length).ln());
            offset.push((p.tendon_slack_length / nominal.tendon_slack_length).ln());
        }
        offset.extend(&point.baseline);
        for setting in &point.effects {
            for (p, value) in setting.effect.description().parameters.iter().zip(&setting.values) {
                precision.push(if p.role == Role::Shape { 1.0 } else { AMPLITUDE_PRECISION });
                offset.push((value - self.forward.joint.start(p)) / self.forward.joint.scale(p));
            }
        }
        (precision, offset)
    }

    /// A point moved by a step, as a whole shortened to what the linearization may be trusted for.
    pub(crate) fn moved(&self, point: &Point, step: &DVector<f64>) -> Point {
        let mut point = point.clone();
        let muscles = self.n_muscles() * FITTED_PER_MUSCLE;
        let most = |i: usize| if i < muscles { [0.7, 0.1, 0.03][i % FITTED_PER_MUSCLE] } else { 6.0 };
        let mut step = step.clone();
        self.tied.iter().for_each(|[first, other]| step[*other] = step[*first]);
        let excess = step.iter().enumerate().map(|(i, s)| s.abs() / most(i)).fold(1.0, f64::max);
        let step = step / excess;
        for (m, p) in point.parameters.iter_mut().enumerate() {
            let factor = |i: usize| step[m * FITTED_PER_MUSCLE + i].exp();
            p.max_isometric_force *= factor(0);
            p.optimal_fiber_length *= factor(1);
            p.tendon_slack_length *= factor(2);
        }
        for (m, baseline) in point.baseline.iter_mut().enumerate() {
            *baseline += step[muscles + m];
        }
        let mut column = self.n_nuisance();
        for setting in &mut point.effects {
            for (p, value) in setting.effect.description().parameters.iter().zip(&mut setting.values) {
                let scale = self.forward.joint.scale(p);
                let limit = scale * p.reach;
                let start = self.forward.joint.start(p);
                let [mut low, mut high] = [start - limit, start + limit];
                if p.role == Role::Shape {
                    let [least, most] = self.forward.joint.plausible(p);
                    // What is always positive stays so.
                    let zero = start - p.start;
                    let least_of_all = if least > zero { zero } else { f64::NEG_INFINITY };
                    (low, high) = (low.max(least_of_all).min(least), high.max(most));
                }
                *value = (*value + step[column] * scale).clamp(low, high);
                column += 1;
            }
        }
        point
    }

    /// Is anything left after a fit? Effects that are on are not tested again.
    ///
    /// - `skip`: names of further blocks to leave out
    pub fn anything_left(&self, fit: &Fit, skip: &[&str]) -> Option<Omnibus> {
        Some(self.scores_left(fit, skip)?.omnibus(self.seed))
    }

    /// As [`Analysis::anything_left`], every block by itself.
    pub fn blocks_left(&self, fit: &Fit, skip: &[&str]) -> Option<Vec<BlockScore>> {
        Some(self.scores_left(fit, skip)?.blocks)
    }

    fn scores_left(&self, fit: &Fit, skip: &[&str]) -> Option<Tested> {
        let p = fit.precision.len();
        let columns = fit.directions.first()?.ncols();
        let (normal, parts): (Vec<DMatrix<f64>>, Vec<Vec<DMatrix<f64>>>) = fit
            .whitened
            .par_iter()
            .with_max_len(ONE_BY_ONE)
            .zip(&*fit.directions)
            .zip(fit.factors.par_iter().zip(&fit.noise))
            .map(|((w, d), (factor, noise))| {
                let mut all = w.clone().resize_horizontally(p + 1 + columns, 0.0);
                all.columns_mut(p + 1, columns).copy_from(&whiten(factor, d));
                let normal = all.transpose() * &all;
                // V⁻¹ X.
                factor.l_dirty().tr_solve_lower_triangular_mut(&mut all);
                (normal, noise.by_component(&fit.levels, &all))
            })
            .unzip();
        let mut by_variance = vec![DMatrix::zeros(p + 1 + columns, p + 1 + columns); COMPONENTS];
        for parts in &parts {
            by_variance.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        }
        let on = |name: &str| fit.point.effects.iter().any(|s| s.effect.description().id == name);
        let columns_of = |b: &Block| b.columns.iter().map(|c| c + p + 1).collect::<Vec<usize>>();
        let blocks: Vec<Block> = self
            .blocks
            .iter()
            .filter(|b| !on(&b.name) && !skip.contains(&b.name.as_str()))
            .map(|b| Block { name: b.name.clone(), columns: columns_of(b) })
            .collect();
        let nuisance: Vec<usize> = (0..p).collect();
        let nuisance = Nuisance { columns: &nuisance, precision: &fit.precision, offset: &fit.offset };
        let variances = Variances { products: &by_variance, spread: &fit.level_spread };
        score_test::tested(&normal, &nuisance, &variances, &blocks, p)
    }
}

/// Prior precision of amplitudes in units of their scale: 20 scales are one standard deviation.
pub(crate) const AMPLITUDE_PRECISION: f64 = 1.0 / 400.0;

/// Rows that are solved for at a time: what is below them takes them as a product of matrices, which is
/// several times as fast.
const ROWS: usize = 24;

/// L⁻¹ times columns, V = L Lᵀ.
pub(crate) fn whiten(factor: &Cholesky<f64, Dyn>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = columns.clone();
    let l = factor.l_dirty();
    let n = l.nrows();
    for start in (0..n).step_by(ROWS) {
        let size = ROWS.min(n - start);
        let rest = n - start - size;
        // The factor has a positive diagonal, so that this always succeeds.
        let solved = l.view((start, start), (size, size)).solve_lower_triangular_mut(&mut out.rows_mut(start, size));
        debug_assert!(solved);
        if rest > 0 {
            let above = out.rows(start, size).into_owned();
            out.rows_mut(start + size, rest).gemm(-1.0, &l.view((start + size, start), (rest, size)), &above, 1.0);
        }
    }
    out
}

/// Aᵀ B.
pub(crate) fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    a.transpose() * b
}

/// Bounds of the changes of log F_max, log l_opt and log l_slack.
fn log_bounds(bounds: &ParameterBounds) -> [[f64; 2]; FITTED_PER_MUSCLE] {
    [bounds.max_isometric_force, bounds.optimal_fiber_length, bounds.tendon_slack_length]
        .map(|b| [b.lower.ln(), b.upper.ln()])
}

fn prior_sd(bounds: &ParameterBounds) -> [f64; FITTED_PER_MUSCLE] {
    let width = |b: &carpus_study::study::RelativeBounds, sds: f64| ((b.upper / b.lower).ln() / (2.0 * sds)).max(1e-3);
    [
        width(&bounds.max_isometric_force, 2.0),
        width(&bounds.optimal_fiber_length, 3.0),
        width(&bounds.tendon_slack_length, 3.0),
    ]
}
