//! Joint fit of muscle parameters and effects to a participant's training trials.
//!
//! The true excitation is the recorded one times exp(w), w unknown. Around the present estimate ŵ the moment is linear in
//! w, so that with G = ∂τ/∂w
//!
//! ```text
//! r = y − τ(θ, φ, ŵ) + G ŵ ~ N(0, V),   ŵ ← E[w | data] = K Gᵀ V⁻¹ r
//! ```
//! (first-order conditional linearization). Sensitivities taken at ŵ are, to first order, independent of the residual: EMG noise that is in both would otherwise make time constants, delays and
//! nonlinearities look significant.
//!
//! # References
//! Lindstrom & Bates (1990), Nonlinear mixed effects models for repeated measures data, doi:10.2307/2532087.

mod information;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use std::sync::Arc;

use super::descent::Descent;
use super::effect::{Effect, Role, Stage};
use super::forward_model::{Core, FITTED_PER_MUSCLE, ForwardModel, Setting, TrialInput, matters};
use super::kernel::Kernel;
use super::noise::{
    self, BASELINE_SD, COMPONENTS, KNOT_SPACING, Kernels, NoiseLevels, Response, TrialNoise, TrialTimes,
};
use super::score_test::{self, Block, Nuisance, Omnibus, Variances};
use super::trial_record::TrialRecord;
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::ParameterBounds;

/// Most blocks that the samples of a trial are averaged to.
const MOST_BLOCKS: usize = 80;
/// Largest mean of a score [standard deviations]: noise of the EMG causes 1 to 3; beyond that an EMG was bent to make up for a
/// model that is far off.
pub(super) const LARGEST_MEAN: f64 = 4.0;
/// Pairs of draws for the mean of scores where nothing is known to be missing yet: there it decides on false alarms.
const MOST_PAIRS: usize = 4;
/// Moments per unit of log excitation below this are nothing [N·m].
const SMALLEST_RESPONSE: f64 = 1e-9;
/// Size of disturbances of the log excitation that are passed through effects.
const DISTURBANCE: f64 = 1e-3;
/// Scale of lack-of-fit directions at a wrist [N·m].
const LACK_SCALE: f64 = 0.1;

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
    pub(super) level_spread: DMatrix<f64>,
    pub(super) noise: Vec<TrialNoise>,
    pub(super) factors: Vec<Cholesky<f64, Dyn>>,
    /// Per training trial: whitened columns [nuisance | effects' parameters | residual].
    pub(super) whitened: Vec<DMatrix<f64>>,
    /// Distance of nuisance and effects from the prior's mean, and prior precision.
    pub(super) offset: Vec<f64>,
    pub(super) precision: Vec<f64>,
    /// Per training trial: directions at this fit, averaged over blocks.
    pub(super) directions: Arc<Vec<DMatrix<f64>>>,
    /// Per training trial: mean score of nuisance, effects and directions when nothing else is missing.
    pub(super) bias: Arc<Vec<DVector<f64>>>,
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
    pub(super) prior_sd: [f64; FITTED_PER_MUSCLE],
    /// Blocks of directions and their columns among all directions.
    pub blocks: Vec<Block>,
    /// Per training trial.
    pub(super) times: Vec<Arc<TrialTimes>>,
    /// How the noise goes with itself in time.
    pub(super) kernels: Kernels,
    pub(super) seed: u64,
}

/// The noise of all training trials.
pub(super) struct Noise {
    pub(super) structure: Vec<TrialNoise>,
    pub(super) levels: NoiseLevels,
    pub(super) factors: Vec<Cholesky<f64, Dyn>>,
}

impl Noise {
    pub(super) fn log_determinant(&self) -> f64 {
        self.factors.iter().map(|f| f.l_dirty().diagonal().map(|d| 2.0 * d.ln()).sum()).sum()
    }
}

/// A point's objective and its derivatives.
pub(super) struct Account {
    pub(super) whitened: Vec<DMatrix<f64>>,
    pub(super) information: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
    /// −2 log posterior without the determinant.
    pub(super) objective: f64,
    /// Decrease of the objective that a full step promises.
    pub(super) gain: f64,
    pub(super) precision: Vec<f64>,
    pub(super) offset: Vec<f64>,
}

/// One trial at a point, averaged over blocks of samples.
pub(super) struct Linear {
    pub(super) nuisance: DMatrix<f64>,
    pub(super) effects: DMatrix<f64>,
    /// Measured minus simulated moment.
    pub(super) bare: DVector<f64>,
    /// The same, expected EMG noise and baselines taken into account.
    pub(super) residual: DVector<f64>,
    /// The trial's core, for directions.
    pub(super) core: Core,
}

#[derive(Clone, Copy)]
enum Kind {
    Emg,
    Moment,
}

/// What of a trial's noise depends on its times and direction alone.
///
/// - `kernel`: of slow disturbances
fn trial_times(trial: &TrialRecord, kernel: &Kernel) -> Arc<TrialTimes> {
    let starts = block_starts(trial.time.len());
    let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
    let times = block_means(&trial.time, &starts);
    Arc::new(TrialTimes::correlated(trial.info.direction, times.as_slice(), &counts, kernel))
}

/// Start of every block of samples, and the end.
pub(crate) fn block_starts(samples: usize) -> Vec<usize> {
    let blocks = samples.min(MOST_BLOCKS);
    (0..=blocks).map(|b| b * samples / blocks).collect()
}

pub(crate) fn block_means(series: &[f64], starts: &[usize]) -> DVector<f64> {
    DVector::from_iterator(
        starts.len() - 1,
        starts.windows(2).map(|w| series[w[0]..w[1]].iter().sum::<f64>() / (w[1] - w[0]) as f64),
    )
}

pub(super) fn knot_count(time: &[f64]) -> usize {
    ((time[time.len() - 1] - time[0]) / KNOT_SPACING).ceil() as usize + 1
}

/// A value between knots.
///
/// - `t`: time since the first [s]
pub(super) fn between_knots(values: &DVector<f64>, t: f64) -> f64 {
    let x = t / KNOT_SPACING;
    let i = (x as usize).min(values.len() - 2);
    values[i] + (x - i as f64) * (values[i + 1] - values[i])
}

/// Recorded excitation times exp(correction).
pub(super) fn corrected(time: &[f64], excitation: &[Vec<f64>], correction: &[DVector<f64>]) -> Vec<Vec<f64>> {
    let corrected = |(e, w): (&Vec<f64>, &DVector<f64>)| {
        e.iter().zip(time).map(|(e, t)| (e * between_knots(w, t - time[0]).exp()).min(1.0)).collect()
    };
    excitation.iter().zip(correction).map(corrected).collect()
}

impl<'a> Analysis<'a> {
    /// Fits the muscle parameters without effects, estimates the noise, and computes all directions.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn new(
        forward: &'a ForwardModel,
        train: Vec<usize>,
        candidates: Vec<&'static dyn Effect>,
        bounds: &ParameterBounds,
        seed: u64,
    ) -> Result<(Analysis<'a>, Fit), SimulationError> {
        let mut analysis = Analysis::without_data(forward, train, candidates, bounds, seed);
        let rough = analysis.rough_fit(analysis.nominal_point())?;
        // Before the EMG's noise is allowed for, what it does would be taken for more of it.
        let mut descent = analysis.settle(rough, false)?;
        descent = analysis.settle(descent, false)?;
        analysis.blocks = analysis.calc_directions(&descent.linear, &descent.point)?.1;
        descent = analysis.settle(descent, true)?;
        analysis.choose_kernels(&mut descent)?;
        descent = analysis.follow(descent, f64::INFINITY)?;
        let fit = analysis.finish(descent, MOST_PAIRS)?;
        Ok((analysis, fit))
    }

    pub(super) fn n_muscles(&self) -> usize {
        self.forward.muscles.len()
    }

    /// Columns of nuisance: muscle parameters, and a baseline of every EMG channel.
    pub fn n_nuisance(&self) -> usize {
        self.n_muscles() * (FITTED_PER_MUSCLE + 1)
    }

    /// The model as given, without effects and with the EMG as recorded.
    pub fn nominal_point(&self) -> Point {
        Point {
            parameters: self.forward.nominal_parameters(),
            effects: Vec::new(),
            baseline: vec![0.0; self.n_muscles()],
            correction: self.no_correction(),
            inputs: self.train.iter().map(|g| Arc::new(self.forward.recorded_input(*g))).collect(),
        }
    }

    /// No noise in the EMG, per training trial and muscle on knots.
    pub(super) fn no_correction(&self) -> Vec<Vec<DVector<f64>>> {
        let none = |g: &usize| vec![DVector::zeros(knot_count(&self.forward.trials[*g].time)); self.n_muscles()];
        self.train.iter().map(none).collect()
    }

    pub(super) fn linearize(&self, point: &Point, noise: &[TrialNoise]) -> Result<Vec<Linear>, SimulationError> {
        let variant = self.forward.variant(&point.effects)?;
        let variants = (0..point.effects.len())
            .map(|i| self.forward.difference_variants(&point.effects, i))
            .collect::<Result<Vec<_>, _>>()?;
        (0..self.train.len())
            .into_par_iter()
            .map(|position| {
                let g = self.train[position];
                let record = &self.forward.trials[g];
                let starts = block_starts(record.time.len());
                let input = &*point.inputs[position];
                let core = self.forward.core(&variant, g, input, &point.parameters, &point.effects, true)?;
                let simulated = self.forward.recorded_moment(g, &core, &point.effects);
                let difference: Vec<f64> = record.moment.iter().zip(&simulated).map(|(y, s)| y - s).collect();
                let bare = block_means(&difference, &starts);
                let blocks = bare.len();
                let mut nuisance = DMatrix::zeros(blocks, self.n_nuisance());
                for (j, by) in self.forward.sensed_derivatives(g, &core, &point.effects).iter().enumerate() {
                    nuisance.set_column(j, &block_means(by, &starts));
                }
                let count: usize = point.effects.iter().map(|s| s.values.len()).sum();
                let mut effects = DMatrix::zeros(blocks, count);
                let mut column = 0;
                for (i, setting) in point.effects.iter().enumerate() {
                    for p in 0..setting.values.len() {
                        if matters(setting, p) {
                            let by = self.forward.effect_derivative(
                                g,
                                &core,
                                input,
                                &point.parameters,
                                &point.effects,
                                i,
                                &variants[i],
                                p,
                            )?;
                            effects.set_column(column, &block_means(&by, &starts));
                        }
                        column += 1;
                    }
                }
                let mut linear = Linear { nuisance, effects, residual: bare.clone(), bare, core };
                if let Some(noise) = noise.get(position) {
                    self.attach(&mut linear, position, point, noise);
                }
                Ok(linear)
            })
            .collect::<Vec<_>>()
            .into_iter()
            .collect()
    }

    /// Takes the noise of a trial into account in a linearization.
    pub(super) fn attach(&self, linear: &mut Linear, position: usize, point: &Point, noise: &TrialNoise) {
        linear.residual = &linear.bare + noise.respond(&point.correction[position]);
        for m in 0..self.n_muscles() {
            let column = noise.respond_to_baseline(m) * BASELINE_SD;
            linear.residual -= &column * point.baseline[m];
            linear.nuisance.set_column(self.n_muscles() * FITTED_PER_MUSCLE + m, &column);
        }
    }

    pub(super) fn noise_structure(&self, linear: &[Linear], point: &Point) -> Vec<TrialNoise> {
        let of_trial = |(position, l): (usize, &Linear)| self.trial_noise(position, &l.core, point);
        linear.par_iter().enumerate().map(of_trial).collect()
    }

    /// How noise enters a trial.
    ///
    /// - `core`: at the point, with derivatives
    fn trial_noise(&self, position: usize, core: &Core, point: &Point) -> TrialNoise {
        let g = self.train[position];
        let record = &self.forward.trials[g];
        let starts = block_starts(record.time.len());
        let blocks = starts.len() - 1;
        let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
        let knots = knot_count(&record.time);
        let block_of: Vec<usize> = counts.iter().enumerate().flat_map(|(b, c)| std::iter::repeat_n(b, *c)).collect();
        let response = |m: usize| {
            let factor = self.forward.moment_factor(g, core, &point.inputs[position], &point.effects, m);
            core.prepared.scaled_excitation_response(m, &core.solutions[m], &core.excitation[m], &factor)
        };
        let muscles: Vec<_> = (0..self.n_muscles()).map(response).collect();
        // Forces may have moved since the muscles were followed.
        let scale =
            |m: usize| point.parameters[m].max_isometric_force / core.solutions[m].parameters.max_isometric_force;
        let before = &point.inputs[position].excitation;
        let changed = self.forward.excitation_changes(&point.effects);
        let reshaped = self.forward.reshapes_moment(&point.effects);
        let mut responses = Vec::new();
        for (m, e) in before.iter().enumerate() {
            let mut g_of_muscle = Response::new(blocks, knots);
            let mut by_knots = vec![vec![0.0; if reshaped { record.time.len() } else { 0 }]; knots];
            for (j, by_knot) in by_knots.iter_mut().enumerate() {
                let (first, disturbance) = hat(&record.time, e, j);
                let mut show = |m: usize, first: usize, disturbance: &[f64]| {
                    muscles[m].respond(first, disturbance, |k, moment| match by_knot.get_mut(k) {
                        Some(to) => *to += scale(m) * moment,
                        None => g_of_muscle.add(block_of[k], j, scale(m) * moment / counts[block_of[k]] as f64),
                    });
                };
                if !changed {
                    show(m, first, &disturbance);
                    continue;
                }
                // Through the effects on excitation: later, bent, or into a neighbour.
                let mut disturbed = before.clone();
                disturbed[m][first..].iter_mut().zip(&disturbance).for_each(|(e, d)| *e += DISTURBANCE * d);
                let after = self.forward.excited(g, &disturbed, &point.effects);
                for (other, (after, was)) in after.iter().zip(&core.excitation).enumerate() {
                    let differs = |k: &usize| after[*k] != was[*k];
                    let (Some(first), Some(last)) = ((0..was.len()).find(differs), (0..was.len()).rfind(differs))
                    else {
                        continue;
                    };
                    let change: Vec<f64> = (first..=last).map(|k| (after[k] - was[k]) / DISTURBANCE).collect();
                    show(other, first, &change);
                }
            }
            if reshaped {
                // Through the sensor, and what on the joint depends on the muscles' moment.
                let recorded = self.forward.recorded_changes(g, core, &point.effects, &by_knots);
                for (j, by_knot) in recorded.iter().enumerate() {
                    for (k, moment) in by_knot.iter().enumerate().filter(|(_, moment)| moment.abs() > SMALLEST_RESPONSE)
                    {
                        g_of_muscle.add(block_of[k], j, moment / counts[block_of[k]] as f64);
                    }
                }
            }
            responses.push(g_of_muscle);
        }
        let start = record.time[0];
        let at_knot =
            |e: &[f64], j: usize| super::effect::interpolate(&record.time, e, start + KNOT_SPACING * j as f64);
        let at_knots: Vec<Vec<f64>> = before.iter().map(|e| (0..knots).map(|j| at_knot(e, j)).collect()).collect();
        let average = |series: &[f64]| block_means(series, &starts).as_slice().to_vec();
        let of_angle = self.forward.angle_covariance(g, core, &point.effects, average, &average(&record.time));
        TrialNoise::correlated(&self.times[position], responses, &at_knots, &self.kernels.emg).with_angle(of_angle)
    }

    /// Variances of the noise, all directions being among the regressors.
    pub(super) fn estimate_noise(
        &self,
        linear: &[Linear],
        noise: &[TrialNoise],
        point: &Point,
        start: NoiseLevels,
    ) -> Result<NoiseLevels, SimulationError> {
        let (columns, precision) = self.regressors(linear, point)?;
        let trials: Vec<_> = noise.iter().zip(&columns).zip(linear).map(|((n, x), l)| (n, x, &l.residual)).collect();
        Ok(noise::estimate(&trials, &precision, start))
    }

    /// Per trial all that a residual is regressed on while noise is estimated, and prior precisions.
    ///
    /// With all directions among them what an effect does is not taken for noise. They are those at the very point: others,
    /// from another estimate of the EMG, go with what differs between the estimates, and take a tenth of the noise away.
    fn regressors(
        &self,
        linear: &[Linear],
        point: &Point,
    ) -> Result<(Vec<DMatrix<f64>>, DVector<f64>), SimulationError> {
        let (directions, _) = self.calc_directions(linear, point)?;
        Ok(self.with_directions(linear, point, &directions))
    }

    /// Per trial nuisance, effects and directions, and prior precisions.
    fn with_directions(
        &self,
        linear: &[Linear],
        point: &Point,
        directions: &[DMatrix<f64>],
    ) -> (Vec<DMatrix<f64>>, DVector<f64>) {
        let extra = directions.first().map_or(0, DMatrix::ncols);
        let columns = linear
            .iter()
            .enumerate()
            .map(|(i, l)| {
                let (n, e) = (l.nuisance.ncols(), l.effects.ncols());
                let mut x = DMatrix::zeros(l.residual.len(), n + e + extra);
                x.columns_mut(0, n).copy_from(&l.nuisance);
                x.columns_mut(n, e).copy_from(&l.effects);
                x.columns_mut(n + e, extra).copy_from(&directions[i]);
                x
            })
            .collect();
        let (mut precision, _) = self.prior(point);
        // Directions are in units of their scale; ten times that is wide.
        precision.extend(std::iter::repeat_n(0.01, extra));
        (columns, DVector::from_vec(precision))
    }

    /// Covariance of the logarithms of the noise's variances.
    pub(super) fn level_spread(
        &self,
        linear: &[Linear],
        noise: &Noise,
        point: &Point,
        directions: &[DMatrix<f64>],
    ) -> DMatrix<f64> {
        let (columns, precision) = self.with_directions(linear, point, directions);
        let trials: Vec<_> =
            noise.structure.iter().zip(&columns).zip(linear).map(|((n, x), l)| (n, x, &l.residual)).collect();
        noise::spread(&trials, &precision, &noise.levels).unwrap_or_else(|| DMatrix::zeros(COMPONENTS, COMPONENTS))
    }

    /// Chooses the correlations of the noise by restricted likelihood: of the EMG's, then of the moment's, then again.
    fn choose_kernels(&mut self, descent: &mut Descent) -> Result<(), SimulationError> {
        let (columns, precision) = self.regressors(&descent.linear, &descent.point)?;
        let residuals: Vec<&DVector<f64>> = descent.linear.iter().map(|l| &l.residual).collect();
        let mut levels = descent.noise.levels;
        let mut structure = descent.noise.structure.clone();
        for kind in [Kind::Emg, Kind::Moment, Kind::Emg] {
            let known = self.kernels;
            let changed = |kernel: &Kernel| match kind {
                Kind::Emg => Kernels { emg: *kernel, ..known },
                Kind::Moment => Kernels { moment: *kernel, ..known },
            };
            let with = |structure: &[TrialNoise], kernels: &Kernels| -> Vec<TrialNoise> {
                structure
                    .par_iter()
                    .zip(&self.train)
                    .map(|(n, g)| {
                        n.clone().with_kernel(&trial_times(&self.forward.trials[*g], &kernels.moment), &kernels.emg)
                    })
                    .collect()
            };
            let start = match kind {
                Kind::Emg => known.emg,
                Kind::Moment => known.moment,
            };
            let best = noise::best_kernel(&start, |kernel| {
                let noise = with(&structure, &changed(kernel));
                let trials: Vec<_> = noise.iter().zip(&columns).zip(&residuals).map(|((n, x), r)| (n, x, *r)).collect();
                let levels = noise::estimate_within(2, &trials, &precision, levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            self.kernels = changed(&best);
            structure = with(&structure, &self.kernels);
            let trials: Vec<_> = structure.iter().zip(&columns).zip(&residuals).map(|((n, x), r)| (n, x, *r)).collect();
            levels = noise::estimate(&trials, &precision, levels);
        }
        self.times = self.train.iter().map(|g| trial_times(&self.forward.trials[*g], &self.kernels.moment)).collect();
        descent.noise.levels = levels;
        Ok(())
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
    fn prior(&self, point: &Point) -> (Vec<f64>, Vec<f64>) {
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
                offset.push((value - p.start) / self.forward.strength.scale(p));
            }
        }
        (precision, offset)
    }

    /// Whitened columns [nuisance | effects | residual] of every trial.
    fn whitened(&self, linear: &[Linear], factors: &[Cholesky<f64, Dyn>]) -> Vec<DMatrix<f64>> {
        linear
            .par_iter()
            .zip(factors)
            .map(|(l, factor)| {
                let (n, e) = (l.nuisance.ncols(), l.effects.ncols());
                let mut all = DMatrix::zeros(l.residual.len(), n + e + 1);
                all.columns_mut(0, n).copy_from(&l.nuisance);
                all.columns_mut(n, e).copy_from(&l.effects);
                all.set_column(n + e, &l.residual);
                whiten(factor, &all)
            })
            .collect()
    }

    /// A point moved by a step, as a whole shortened to what the linearization may be trusted for.
    pub(super) fn moved(&self, point: &Point, step: &DVector<f64>) -> Point {
        let mut point = point.clone();
        let muscles = self.n_muscles() * FITTED_PER_MUSCLE;
        let most = |i: usize| if i < muscles { [0.7, 0.1, 0.03][i % FITTED_PER_MUSCLE] } else { 6.0 };
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
            let stage = setting.effect.description().stage;
            for (p, value) in setting.effect.description().parameters.iter().zip(&mut setting.values) {
                let scale = self.forward.strength.scale(p);
                let limit = scale
                    * match (p.role, stage) {
                        (Role::Shape, _) => 3.0,
                        // Logarithms of ratios of a muscle's property.
                        (_, Stage::Muscle | Stage::Activation) => 5.0,
                        _ => 30.0,
                    };
                *value = (*value + step[column] * scale).clamp(p.start - limit, p.start + limit);
                column += 1;
            }
        }
        point
    }

    /// Objective, gradient and information at a point.
    pub(super) fn account(&self, linear: &[Linear], point: &Point, noise: &Noise) -> Account {
        let whitened = self.whitened(linear, &noise.factors);
        let (precision, offset) = self.prior(point);
        let p = precision.len();
        let mut information = DMatrix::from_diagonal(&DVector::from_vec(precision.clone()));
        let mut gradient = DVector::from_iterator(p, precision.iter().zip(&offset).map(|(a, b)| -a * b));
        let mut objective = precision.iter().zip(&offset).map(|(a, b)| a * b * b).sum::<f64>();
        for w in &whitened {
            let x = w.columns(0, p);
            information += x.tr_mul(&x);
            gradient += x.tr_mul(&w.column(p));
            objective += w.column(p).norm_squared();
        }
        let gain = information.clone().cholesky().map_or(0.0, |c| gradient.dot(&c.solve(&gradient)));
        Account { whitened, information, gradient, objective, gain, precision, offset }
    }

    /// Directions of all candidates' amplitudes and of lack of fit, in units of their scales, and the blocks that they form;
    /// 0 for an effect that is on.
    pub(super) fn calc_directions(
        &self,
        linear: &[Linear],
        point: &Point,
    ) -> Result<(Vec<DMatrix<f64>>, Vec<Block>), SimulationError> {
        let mut per_trial: Vec<Vec<DVector<f64>>> = vec![Vec::new(); self.train.len()];
        let mut blocks = Vec::new();
        let mut next = 0;
        for effect in &self.candidates {
            let amplitudes: Vec<usize> = effect.description().amplitudes().collect();
            let columns = (next..next + amplitudes.len()).collect();
            blocks.push(Block { name: effect.description().id.to_string(), columns });
            next += amplitudes.len();
            if point.effects.iter().any(|s| s.effect.description().id == effect.description().id) {
                for (all, l) in per_trial.iter_mut().zip(linear) {
                    all.extend(amplitudes.iter().map(|_| DVector::zeros(l.residual.len())));
                }
                continue;
            }
            let mut settings = point.effects.clone();
            settings.push(Setting::absent(*effect));
            let which = settings.len() - 1;
            let variants = self.forward.difference_variants(&settings, which)?;
            let columns = self
                .train
                .par_iter()
                .zip(linear)
                .zip(&point.inputs)
                .map(|((g, l), input)| {
                    let starts = block_starts(self.forward.trials[*g].time.len());
                    amplitudes
                        .iter()
                        .map(|p| {
                            let by = self.forward.effect_derivative(
                                *g,
                                &l.core,
                                input,
                                &point.parameters,
                                &settings,
                                which,
                                &variants,
                                *p,
                            )?;
                            Ok(block_means(&by, &starts))
                        })
                        .collect::<Result<Vec<_>, SimulationError>>()
                })
                .collect::<Vec<_>>();
            for (all, new) in per_trial.iter_mut().zip(columns) {
                all.extend(new?);
            }
        }
        for (axis, series) in super::where_it_fails::AXES.iter().zip(0..) {
            let mut count = 0;
            for (position, all) in per_trial.iter_mut().enumerate() {
                let g = self.train[position];
                let starts = block_starts(self.forward.trials[g].time.len());
                let columns =
                    super::where_it_fails::directions(self.forward, g, &linear[position].core.prepared, series);
                count = columns.len();
                all.extend(columns.iter().map(|c| block_means(c, &starts) * LACK_SCALE * self.forward.strength.0));
            }
            blocks.push(Block { name: format!("axis:{axis}"), columns: (next..next + count).collect() });
            next += count;
        }
        Ok((per_trial.into_iter().map(|columns| DMatrix::from_columns(&columns)).collect(), blocks))
    }

    /// Is anything left after a fit? Effects that are on are not tested again.
    ///
    /// - `skip`: names of further blocks to leave out
    pub fn anything_left(&self, fit: &Fit, skip: &[&str]) -> Option<Omnibus> {
        self.scores_left(fit, skip, true)
    }

    /// As [`Analysis::anything_left`], with scores as they are: where a model is far off, their means would be those of an
    /// EMG that was bent to make up for it.
    pub fn anything_left_uncentred(&self, fit: &Fit, skip: &[&str]) -> Option<Omnibus> {
        self.scores_left(fit, skip, false)
    }

    fn scores_left(&self, fit: &Fit, skip: &[&str], centred: bool) -> Option<Omnibus> {
        let p = fit.precision.len();
        let columns = fit.directions.first()?.ncols();
        let (mut normal, parts): (Vec<DMatrix<f64>>, Vec<Vec<DMatrix<f64>>>) = fit
            .whitened
            .par_iter()
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
        let blocks: Vec<Block> = self
            .blocks
            .iter()
            .filter(|b| !on(&b.name) && !skip.contains(&b.name.as_str()))
            .map(|b| Block { name: b.name.clone(), columns: b.columns.iter().map(|c| c + p + 1).collect() })
            .collect();
        let nuisance: Vec<usize> = (0..p).collect();
        if centred {
            let means = fit.bias.iter().fold(DVector::zeros(p + columns), |sum, bias| sum + bias).insert_row(p, 0.0);
            let profile = Nuisance { columns: &nuisance, precision: &fit.precision, offset: &vec![0.0; p] };
            let largest = score_test::largest_statistic(&normal, &profile, &blocks, &means);
            let share = (LARGEST_MEAN / largest.max(1e-300).sqrt()).min(1.0);
            for (normal, bias) in normal.iter_mut().zip(&*fit.bias) {
                for (i, mean) in bias.iter().enumerate() {
                    normal[(if i < p { i } else { i + 1 }, p)] -= share * mean;
                }
            }
        }
        let nuisance = Nuisance { columns: &nuisance, precision: &fit.precision, offset: &fit.offset };
        let variances = Variances { products: &by_variance, spread: &fit.level_spread };
        score_test::omnibus(&normal, &nuisance, &variances, &blocks, p, self.seed)
    }

    /// Standard deviation of the noise of a sample of the training trials [N·m].
    pub fn noise_floor(&self, fit: &Fit) -> f64 {
        let total: f64 = fit.noise.iter().map(|n| n.variance_of_samples(&fit.levels)).sum();
        let count: usize = self.train.iter().map(|g| block_starts(self.forward.trials[*g].time.len()).len() - 1).sum();
        (total / count.max(1) as f64).sqrt()
    }
}

/// Prior precision of amplitudes in units of their scale: 20 scales are one standard deviation.
pub(super) const AMPLITUDE_PRECISION: f64 = 1.0 / 400.0;
pub(super) fn whiten(factor: &Cholesky<f64, Dyn>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = columns.clone();
    // The factor has a positive diagonal, so that this always succeeds.
    let solved = factor.l_dirty().solve_lower_triangular_mut(&mut out);
    debug_assert!(solved);
    out
}

fn prior_sd(bounds: &ParameterBounds) -> [f64; FITTED_PER_MUSCLE] {
    let width = |b: &crate::study::RelativeBounds, sds: f64| ((b.upper / b.lower).ln() / (2.0 * sds)).max(1e-3);
    [
        width(&bounds.max_isometric_force, 2.0),
        width(&bounds.optimal_fiber_length, 3.0),
        width(&bounds.tendon_slack_length, 3.0),
    ]
}

/// Disturbance of an excitation by one unit of its logarithm on a knot: first sample and values.
fn hat(time: &[f64], excitation: &[f64], knot: usize) -> (usize, Vec<f64>) {
    let center = time[0] + KNOT_SPACING * knot as f64;
    let first = time.partition_point(|t| *t <= center - KNOT_SPACING);
    let end = time.partition_point(|t| *t < center + KNOT_SPACING);
    let weight = |t: f64| (1.0 - (t - center).abs() / KNOT_SPACING).max(0.0);
    (first.min(time.len()), (first..end).map(|k| excitation[k] * weight(time[k])).collect())
}
