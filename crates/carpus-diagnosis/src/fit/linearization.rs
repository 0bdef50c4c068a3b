//! A trial around a point: what moments do when parameters, effects, excitations and everything that is tested change.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::super::ONE_BY_ONE;
use super::super::where_it_fails;
use super::grid::{block_means, block_starts, knot_count, slope_of_bounded};
use super::{Analysis, Point, whiten};
use crate::noise::{KNOT_SPACING, Response, TrialNoise};
use crate::score_test::Block;
use carpus_effects::effect::Effect;
use carpus_effects::effects::emg_floor::BASELINE_SD;
use carpus_effects::forward_model::recorded_changes::{Change, ExcitationChange};
use carpus_effects::forward_model::{Core, FITTED_PER_MUSCLE, Setting, matters};
use carpus_effects::series::interpolate;
use carpus_simulation::simulation::{ExcitationResponse, MusculoskeletalModel, SimulationError};

/// Moments per unit of log excitation below this are nothing [N·m].
const SMALLEST_RESPONSE: f64 = 1e-9;
/// Size of disturbances of the log excitation that are passed through effects.
const DISTURBANCE: f64 = 1e-3;
/// Scale of lack-of-fit directions at a wrist [N·m].
const LACK_SCALE: f64 = 0.1;

/// One trial at a point, averaged over blocks of samples.
pub(crate) struct Linear {
    pub(crate) nuisance: DMatrix<f64>,
    pub(crate) effects: DMatrix<f64>,
    /// Measured minus simulated moment.
    pub(crate) bare: DVector<f64>,
    /// The same, expected EMG noise and baselines taken into account.
    pub(crate) residual: DVector<f64>,
    /// The trial's core, for directions.
    pub(crate) core: Arc<Core>,
}

/// Models on both sides of the differences by an effect's parameters: see [`ForwardModel::difference_variants`].
type Variants<'m> = Vec<[Cow<'m, MusculoskeletalModel>; 2]>;

impl Analysis<'_> {
    pub(crate) fn linearize(&self, point: &Point, noise: &[TrialNoise]) -> Result<Vec<Linear>, SimulationError> {
        let variants = (0..point.effects.len())
            .map(|i| self.forward.difference_variants(&point.effects, i))
            .collect::<Result<Vec<_>, _>>()?;
        self.linearized(point, noise, &variants)
    }

    /// The same near a point with the same effects: derivatives by their parameters stay as they were there.
    pub(crate) fn linearize_beside(&self, point: &Point, before: &[Linear]) -> Result<Vec<Linear>, SimulationError> {
        let linear = self.linearized(point, &[], &[])?;
        let with_effects = |(linear, before): (Linear, &Linear)| Linear { effects: before.effects.clone(), ..linear };
        Ok(linear.into_iter().zip(before).map(with_effects).collect())
    }

    /// - `variants`: of every effect of which derivatives are asked for, those of the point in their order
    fn linearized(
        &self,
        point: &Point,
        noise: &[TrialNoise],
        variants: &[Variants],
    ) -> Result<Vec<Linear>, SimulationError> {
        self.linearized.fetch_add(1, Ordering::Relaxed);
        let variant = self.forward.variant(&point.effects)?;
        (0..self.train.len())
            .into_par_iter()
            .with_max_len(ONE_BY_ONE)
            .map(|position| {
                let g = self.train[position];
                let record = &self.forward.trials[g];
                let starts = block_starts(&record.time);
                let input = &*point.inputs[position];
                let core = self.forward.core(&variant, g, input, &point.parameters, &point.effects, true)?;
                let simulated = self.forward.recorded_moment(g, &core, &point.effects);
                let difference: Vec<f64> = self.target(position).iter().zip(&simulated).map(|(y, s)| y - s).collect();
                let bare = block_means(&difference, &starts);
                let blocks = bare.len();
                let mut nuisance = DMatrix::zeros(blocks, self.n_nuisance());
                for (j, by) in self.forward.sensed_derivatives(g, &core, &point.effects).iter().enumerate() {
                    nuisance.set_column(j, &block_means(by, &starts));
                }
                for [first, other] in &self.tied {
                    let by = nuisance.column(*other).clone_owned();
                    nuisance.column_mut(*first).axpy(1.0, &by, 1.0);
                    nuisance.column_mut(*other).fill(0.0);
                }
                let count: usize = point.effects[..variants.len()].iter().map(|s| s.values.len()).sum();
                let mut effects = DMatrix::zeros(blocks, count);
                let mut column = 0;
                for (which, variants) in variants.iter().enumerate() {
                    for by in self.by_effect(position, &core, point, &point.effects, which, variants)? {
                        effects.set_column(column, &by);
                        column += 1;
                    }
                }
                let core = Arc::new(core);
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

    /// Measured minus simulated moment of every trial at a point, expected EMG noise and baselines taken into
    /// account, averaged over blocks [N·m].
    ///
    /// - `noise`: how it passes
    pub(crate) fn residuals(&self, point: &Point, noise: &[TrialNoise]) -> Result<Vec<DVector<f64>>, SimulationError> {
        let variant = self.forward.variant(&point.effects)?;
        let of = |position: usize| {
            let g = self.train[position];
            let input = &*point.inputs[position];
            let core = self.forward.core(&variant, g, input, &point.parameters, &point.effects, false)?;
            let simulated = self.forward.recorded_moment(g, &core, &point.effects);
            let difference: Vec<f64> = self.target(position).iter().zip(&simulated).map(|(y, s)| y - s).collect();
            let bare = block_means(&difference, &block_starts(&self.forward.trials[g].time));
            let noise = &noise[position];
            let by_baselines = |residual: DVector<f64>, m: usize| {
                residual - noise.respond_to_baseline(m) * (BASELINE_SD * point.baseline[m])
            };
            Ok((0..self.n_muscles()).fold(bare + noise.respond(&point.correction[position]), by_baselines))
        };
        (0..self.train.len()).into_par_iter().with_max_len(ONE_BY_ONE).map(of).collect::<Vec<_>>().into_iter().collect()
    }

    /// Derivatives of a trial's recorded moment by the parameters of an effect, averaged over blocks [N·m per
    /// unit of their scales]; 0 for those that do not matter.
    ///
    /// - `effects`: those of the point, or one more that is absent; `which` of them is asked for, `variants`
    ///   are its own
    fn by_effect(
        &self,
        position: usize,
        core: &Core,
        point: &Point,
        effects: &[Setting],
        which: usize,
        variants: &Variants,
    ) -> Result<Vec<DVector<f64>>, SimulationError> {
        let (g, input) = (self.train[position], &*point.inputs[position]);
        let starts = block_starts(&self.forward.trials[g].time);
        let parameters = &point.parameters;
        let by = |p: usize| {
            if !matters(&effects[which], p) {
                return Ok(DVector::zeros(starts.len() - 1));
            }
            let by = self.forward.effect_derivative(g, core, input, parameters, effects, which, variants, p)?;
            Ok(block_means(&by, &starts))
        };
        (0..effects[which].values.len()).map(by).collect()
    }

    /// Takes the noise of a trial into account in a linearization.
    pub(crate) fn attach(&self, linear: &mut Linear, position: usize, point: &Point, noise: &TrialNoise) {
        linear.residual = &linear.bare + noise.respond(&point.correction[position]);
        for m in 0..self.n_muscles() {
            let column = noise.respond_to_baseline(m) * BASELINE_SD;
            linear.residual -= &column * point.baseline[m];
            linear.nuisance.set_column(self.n_muscles() * FITTED_PER_MUSCLE + m, &column);
        }
    }

    pub(crate) fn noise_structure(&self, linear: &[Linear], point: &Point) -> Vec<TrialNoise> {
        let of_trial = |(position, l): (usize, &Linear)| self.trial_noise(position, &l.core, point);
        linear.par_iter().with_max_len(ONE_BY_ONE).enumerate().map(of_trial).collect()
    }

    /// How noise enters a trial.
    ///
    /// - `core`: at the point, with derivatives
    fn trial_noise(&self, position: usize, core: &Core, point: &Point) -> TrialNoise {
        let g = self.train[position];
        let record = &self.forward.trials[g];
        let starts = block_starts(&record.time);
        let blocks = starts.len() - 1;
        let counts: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
        let knots = knot_count(&record.time);
        let block_of: Vec<usize> = counts.iter().enumerate().flat_map(|(b, c)| std::iter::repeat_n(b, *c)).collect();
        let reshaped = self.forward.reshapes_moment(&point.effects);
        let rounds = if reshaped { core.rounds() } else { vec![core] };
        let muscles_of = |core: &&Core| -> Vec<ExcitationResponse> {
            let response = |m: usize| {
                core.prepared.scaled_excitation_response(m, &core.solutions[m], &core.excitation[m], &core.factors[m])
            };
            (0..self.n_muscles()).map(response).collect()
        };
        let muscles: Vec<_> = rounds.iter().map(muscles_of).collect();
        // Forces may have moved since the muscles were followed.
        let scale =
            |m: usize| point.parameters[m].max_isometric_force / core.solutions[m].parameters.max_isometric_force;
        let before = &point.inputs[position].excitation;
        let changed = self.forward.excitation_changes(&point.effects);
        let instantaneous = self.forward.excites_instantaneously(&point.effects);
        let mixed = self.forward.mixes_muscles(&point.effects);
        let follows = self.forward.follows_excitation(&point.effects);
        let mut responses = Vec::new();
        for (m, e) in before.iter().enumerate() {
            let mut g_of_muscle = Response::new(blocks, knots);
            // Per knot and round of the moment's feedback.
            let series = vec![0.0; if reshaped { record.time.len() } else { 0 }];
            let mut by_knots = vec![vec![series; rounds.len()]; knots];
            for (j, by_knot) in by_knots.iter_mut().enumerate() {
                let (first, disturbance) = hat(&record.time, e, j);
                let mut show = |m: usize, first: usize, disturbance: &[f64]| {
                    let scale = scale(m);
                    if reshaped {
                        for (muscles, by_knot) in muscles.iter().zip(by_knot.iter_mut()) {
                            muscles[m].respond(first, disturbance, |k, moment| by_knot[k] += scale * moment);
                        }
                        return;
                    }
                    let (mut block, mut sum) = (0, None);
                    let mut mean = |block: usize, sum: Option<f64>| {
                        sum.into_iter().for_each(|sum| g_of_muscle.add(block, j, scale * sum / counts[block] as f64));
                    };
                    muscles[0][m].respond(first, disturbance, |k, moment| {
                        if block_of[k] != block {
                            mean(block, sum.take());
                            block = block_of[k];
                        }
                        sum = Some(sum.unwrap_or(0.0) + moment);
                    });
                    mean(block, sum);
                };
                let beside = |g_of_muscle: &mut Response, changes: &[ExcitationChange]| {
                    let found = self.forward.recorded_beside_muscles(g, core, &point.effects, changes);
                    let Some((first, moments)) = found else { return };
                    for (k, moment) in (first..).zip(moments).filter(|(_, moment)| moment.abs() > SMALLEST_RESPONSE) {
                        g_of_muscle.add(block_of[k], j, moment / counts[block_of[k]] as f64);
                    }
                };
                if !changed {
                    show(m, first, &disturbance);
                    if follows {
                        beside(&mut g_of_muscle, &[ExcitationChange { muscle: m, first, values: disturbance }]);
                    }
                    continue;
                }
                // Through the effects on excitation: later, bent, or into a neighbour.
                let samples = if instantaneous { first..first + disturbance.len() } else { 0..e.len() };
                let of_muscle = |(other, e): (usize, &Vec<f64>)| {
                    if mixed || other == m { e[samples.clone()].to_vec() } else { Vec::new() }
                };
                let mut disturbed: Vec<Vec<f64>> = before.iter().enumerate().map(of_muscle).collect();
                let own = disturbed[m][first - samples.start..].iter_mut();
                own.zip(&disturbance).for_each(|(e, d)| *e += DISTURBANCE * d);
                let after = self.forward.excited(g, samples.clone(), &disturbed, &point.effects);
                let known = after.iter().zip(&core.excitation).enumerate().filter(|(_, (after, _))| !after.is_empty());
                let mut changes = Vec::new();
                for (other, (after, was)) in known {
                    let was = &was[samples.clone()];
                    let differs = |k: &usize| after[*k] != was[*k];
                    let (Some(first), Some(last)) = ((0..was.len()).find(differs), (0..was.len()).rfind(differs))
                    else {
                        continue;
                    };
                    let change: Vec<f64> = (first..=last).map(|k| (after[k] - was[k]) / DISTURBANCE).collect();
                    let first = samples.start + first;
                    show(other, first, &change);
                    if follows {
                        changes.push(ExcitationChange { muscle: other, first, values: change });
                    }
                }
                if follows {
                    beside(&mut g_of_muscle, &changes);
                }
            }
            if reshaped {
                // Through the sensor, and what at the joint depends on the muscles' moment.
                let changes = by_knots.iter().map(|rounds| Change::OfRounds(rounds));
                let recorded = self.forward.recorded_changes(g, core, &point.effects, changes);
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
        let at_knot = |e: &[f64], j: usize| interpolate(&record.time, e, start + KNOT_SPACING * j as f64);
        let at_knots: Vec<Vec<f64>> = before.iter().map(|e| (0..knots).map(|j| at_knot(e, j)).collect()).collect();
        let average = |series: &[f64]| block_means(series, &starts).as_slice().to_vec();
        let of_angle = self.forward.angle_covariance(g, core, &point.effects, average, &average(&record.time));
        TrialNoise::correlated(&self.times[position], responses, &at_knots, &self.kernels.emg).with_angle(of_angle)
    }

    /// Whitened columns [nuisance | effects | residual] of every trial.
    pub(crate) fn whitened(&self, linear: &[Linear], factors: &[Cholesky<f64, Dyn>]) -> Vec<DMatrix<f64>> {
        linear
            .par_iter()
            .with_max_len(ONE_BY_ONE)
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

    /// Directions of all candidates' amplitudes and of lack of fit, in units of their scales, and the blocks
    /// that they form; 0 for an effect that is on.
    pub(crate) fn calc_directions(
        &self,
        linear: &[Linear],
        point: &Point,
    ) -> Result<(Vec<DMatrix<f64>>, Vec<Block>), SimulationError> {
        self.calc_directions_of(linear, point, &|_| true)
    }

    /// As [`Analysis::calc_directions`], 0 for an effect that is not wanted.
    pub(crate) fn calc_directions_of(
        &self,
        linear: &[Linear],
        point: &Point,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Result<(Vec<DMatrix<f64>>, Vec<Block>), SimulationError> {
        let is_on = |id: &str| point.effects.iter().any(|s| s.effect.description().id == id);
        let which = point.effects.len();
        let beside = |effect: &&'static dyn Effect| {
            if is_on(effect.description().id) || !wanted(effect.description().id) {
                return Ok(None);
            }
            let mut settings = point.effects.clone();
            settings.push(self.forward.joint.absent(*effect));
            let variants = self.forward.difference_variants(&settings, which)?;
            Ok(Some((settings, variants)))
        };
        let beside: Vec<Result<_, SimulationError>> = self.candidates.par_iter().map(beside).collect();
        let beside = beside.into_iter().collect::<Result<Vec<_>, _>>()?;
        // Per block its columns.
        let of_trial = |(position, l): (usize, &Linear)| {
            let of_effect = |(effect, beside): (&&'static dyn Effect, &Option<(Vec<Setting>, Variants)>)| {
                let amplitudes = effect.description().amplitudes();
                let Some((settings, variants)) = beside else {
                    return Ok(amplitudes.map(|_| DVector::zeros(l.residual.len())).collect());
                };
                let by = self.by_effect(position, &l.core, point, settings, which, variants)?;
                Ok(amplitudes.map(|p| by[p].clone()).collect())
            };
            let g = self.train[position];
            let starts = block_starts(&self.forward.trials[g].time);
            let moment = self.forward.recorded_moment(g, &l.core, &point.effects);
            let of_axis = |axis: usize| -> Vec<DVector<f64>> {
                let columns = where_it_fails::directions(self.forward, g, &l.core.prepared, &moment, axis);
                columns.iter().map(|c| block_means(c, &starts) * LACK_SCALE * self.forward.joint.strength).collect()
            };
            let of_effects = self.candidates.iter().zip(&beside).map(of_effect);
            let of_axes = (0..where_it_fails::AXES.len()).map(of_axis);
            of_effects.chain(of_axes.map(Ok)).collect::<Result<Vec<_>, SimulationError>>()
        };
        let trials: Vec<Result<_, SimulationError>> =
            linear.par_iter().with_max_len(ONE_BY_ONE).enumerate().map(of_trial).collect();
        let trials = trials.into_iter().collect::<Result<Vec<_>, _>>()?;
        let names = self.candidates.iter().map(|e| e.description().id.to_string());
        let names = names.chain(where_it_fails::AXES.iter().map(|axis| format!("axis:{axis}")));
        let mut next = 0;
        let block = |(i, name): (usize, String)| {
            let first = next;
            next += trials.first().map_or(0, |blocks| blocks[i].len());
            Block { name, columns: (first..next).collect() }
        };
        let blocks = names.enumerate().map(block).collect();
        Ok((trials.into_iter().map(|blocks| DMatrix::from_columns(&blocks.concat())).collect(), blocks))
    }
}

/// Disturbance of an excitation by one unit of its logarithm on a knot: first sample and values.
fn hat(time: &[f64], excitation: &[f64], knot: usize) -> (usize, Vec<f64>) {
    let center = time[0] + KNOT_SPACING * knot as f64;
    let first = time.partition_point(|t| *t <= center - KNOT_SPACING);
    let end = time.partition_point(|t| *t < center + KNOT_SPACING);
    let weight = |t: f64| (1.0 - (t - center).abs() / KNOT_SPACING).max(0.0);
    let change = |k: usize| excitation[k] * slope_of_bounded(excitation[k]) * weight(time[k]);
    (first.min(time.len()), (first..end).map(change).collect())
}

#[cfg(test)]
mod tests {
    use super::super::grid::corrected;
    use super::*;
    use crate::two_silent_muscles::with_two_silent_muscles;
    use carpus_effects::catalogue::effect;
    use carpus_effects::forward_model::ForwardModel;
    use carpus_study::study::ParameterBounds;

    /// What silent muscles add to the response to the EMG's noise, and to the difference of whole simulations.
    #[test]
    fn verif_the_noise_of_the_emg_passes_through_silent_muscles() {
        /// Of the difference of log excitations.
        const STEP: f64 = 1e-3;
        let forward = with_two_silent_muscles();
        let train: Vec<usize> = (0..forward.trials.len()).collect();
        let analysis = Analysis::without_data(&forward, train, Vec::new(), &ParameterBounds::default(), 1);
        let sized = |id: &str, values: &[f64]| {
            let mut setting = Setting::absent(effect(id).unwrap());
            setting.values[..values.len()].copy_from_slice(values);
            setting
        };
        let bent = [
            sized("electromechanical_delay", &[0.013]),
            sized("emg_nonlinearity", &[-1.0]),
            sized("emg_crosstalk", &[0.1]),
            sized("time_shift", &[0.01]),
            sized("stretch_reflex", &[0.05]),
        ];
        for (others, limit) in [(&[][..], 1e-4), (&bent[1..2], 5e-3), (&bent[..], 0.02)] {
            let with = [others, &[sized("unmodelled_muscles", &[0.5, 0.4])]].concat();
            let responses = |effects: &[Setting]| {
                let point = Point { effects: effects.to_vec(), ..analysis.nominal_point() };
                let linear = analysis.linearize(&point, &[]).unwrap();
                analysis.noise_structure(&linear, &point)
            };
            let [of_with, of_others] = [&with[..], others].map(responses);
            for (g, record) in forward.trials.iter().enumerate() {
                let noise = waves(forward.muscles.len(), knot_count(&record.time), 1.0);
                let found = of_with[g].respond(&noise) - of_others[g].respond(&noise);
                let expected = difference(&forward, g, &with, STEP) - difference(&forward, g, others, STEP);
                let error = (&found - &expected).norm() / expected.norm();
                println!("{} effects, trial {g}: {error:.1e} of {:.1e} N·m", others.len(), expected.amax());
                assert!(expected.amax() > 0.01 && error < limit, "{} effects, trial {g}: {error:.1e}", others.len());
            }
        }
    }

    /// Noise of the logarithm of the EMG on knots.
    fn waves(muscles: usize, knots: usize, size: f64) -> Vec<DVector<f64>> {
        (0..muscles).map(|m| DVector::from_fn(knots, |j, _| size * (0.9 * j as f64 + m as f64).sin())).collect()
    }

    /// Change of a trial's moment with [`waves`] by whole simulations.
    fn difference(forward: &ForwardModel, trial: usize, effects: &[Setting], step: f64) -> DVector<f64> {
        let record = &forward.trials[trial];
        let side = |step: f64| {
            let noise = waves(forward.muscles.len(), knot_count(&record.time), step);
            let excitation = corrected(&record.time, &record.excitation, &noise);
            let (input, variant) = (forward.input(trial, excitation).unwrap(), forward.variant(effects).unwrap());
            let parameters = forward.nominal_parameters();
            let core = forward.core(&variant, trial, &input, &parameters, effects, false).unwrap();
            block_means(&forward.recorded_moment(trial, &core, effects), &block_starts(&record.time))
        };
        (side(step) - side(-step)) / (2.0 * step)
    }

    /// Of EMG at its bound what the linearization says of a correction is what it does: little.
    #[test]
    fn verif_the_noise_of_emg_at_its_bound_passes_as_in_simulations() {
        let mut forward = with_two_silent_muscles();
        for e in forward.trials.iter_mut().flat_map(|t| &mut t.excitation) {
            let most = e.iter().copied().fold(0.0, f64::max);
            e.iter_mut().for_each(|e| *e = (*e * 1.15 / most).min(1.0));
        }
        let train: Vec<usize> = (0..forward.trials.len()).collect();
        let analysis = Analysis::without_data(&forward, train, Vec::new(), &ParameterBounds::default(), 1);
        // A curve ends where it began: at 1.
        let mut curved = Setting::absent(effect("emg_nonlinearity").unwrap());
        curved.values[0] = -1.0;
        for effects in [vec![], vec![curved]] {
            let point = Point { effects, ..analysis.nominal_point() };
            let linear = analysis.linearize(&point, &[]).unwrap();
            let noise = analysis.noise_structure(&linear, &point);
            for (g, record) in forward.trials.iter().enumerate() {
                let found = noise[g].respond(&waves(forward.muscles.len(), knot_count(&record.time), 1.0));
                let expected = difference(&forward, g, &point.effects, 1e-4);
                let error = (&found - &expected).norm() / expected.norm();
                println!("{} effects, trial {g}: {error:.1e}", point.effects.len());
                assert!(expected.amax() > 0.01 && error < 0.01, "trial {g}: {error:.1e}");
            }
        }
    }
}
