//! What is handed over: muscles and effects, estimates, what stands in an effect's place
//! (`docs/src/theory/many-small-errors.md`, equations (22) to (26)).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::linear_model::Posterior;
use super::super::muscles::COLUMNS;
use super::{ALL_OF_IT, HandedOver, NOTHING_ELSE, STANDS_IN, Session, State};
use crate::diagnose::ParameterEstimate;
use crate::fit::{Point, block_means, block_starts, whiten};
use crate::forward_model::{FITTED_PER_MUSCLE, Setting};
use carpus_simulation::simulation::{MuscleParameters, Property, SimulationError};

impl Session<'_> {
    /// What is handed over: muscles and effects, as far from the model as given as trials left out one at a time are predicted best.
    ///
    /// The step to what the other trials say of a trial is linear, equation (24); the residuals at both ends are simulated.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn handed_over(&self, state: &State) -> Result<HandedOver, SimulationError> {
        let forward = self.forward();
        let given = forward.nominal_parameters();
        let residuals =
            |parameters: &[MuscleParameters], effects: &[Setting]| -> Result<Vec<DVector<f64>>, SimulationError> {
                let variant = forward.variant(effects)?;
                let of = |g: &usize| {
                    let record = &forward.trials[*g];
                    let core = forward.core(&variant, *g, &forward.recorded_input(*g), parameters, effects, false)?;
                    let moment = forward.recorded_moment(*g, &core, effects);
                    let left: Vec<f64> = record.moment.iter().zip(&moment).map(|(y, m)| y - m).collect();
                    Ok(block_means(&left, &block_starts(&record.time)))
                };
                self.analysis.train.par_iter().map(of).collect::<Vec<_>>().into_iter().collect()
            };
        let of_given = residuals(&given, &[])?;
        let of_fit = residuals(&state.point.parameters, &state.point.effects)?;
        let set = self.places(&state.point.effects);
        let sizes = self.sizes(state);
        let muscles = self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let posterior = state.model.posterior(&set, sizes);
        let at_all = &posterior.mean;
        let left_out = |(i, of_fit): (usize, &DVector<f64>)| {
            let without = &state.model.products - &state.model.by_trial[i];
            let change = state.model.posterior_of(&without, &set, sizes).mean - at_all;
            let linear = &state.linear[i];
            let of_effects = change.rows(self.analysis.n_nuisance(), linear.effects.ncols());
            of_fit - linear.nuisance.columns(0, muscles) * change.rows(0, muscles) - &linear.effects * of_effects
        };
        let left_out: Vec<DVector<f64>> = of_fit.par_iter().enumerate().map(left_out).collect();
        // Mean square at a part of the way: a parabola, least at `vertex`.
        let mut sums = [0.0; 3];
        for (a, b) in of_given.iter().zip(&left_out) {
            sums[0] += a.norm_squared();
            sums[1] += a.dot(&(b - a));
            sums[2] += (b - a).norm_squared();
        }
        let part = if sums[2] > 0.0 { (-sums[1] / sums[2]).clamp(0.0, 1.0) } else { 0.0 };
        // A single trial cannot be left out.
        let part = if part > ALL_OF_IT || left_out.len() < 2 { 1.0 } else { part };
        let (mut parameters, effects) = self.part_of_the_way(&state.point, part);
        self.put_within_bounds(&mut parameters, &posterior, state.linear.first().map_or(0, |l| l.effects.ncols()));
        let left = sums[0] + 2.0 * part * sums[1] + part * part * sums[2];
        let left_out_ratio = (left / sums[0].max(f64::MIN_POSITIVE)).max(0.0).sqrt();
        Ok(HandedOver { parameters, effects, part, left_out_ratio })
    }

    /// Muscles and effects at a part of the way from the model as given to a point, equation (26).
    pub(super) fn part_of_the_way(&self, point: &Point, part: f64) -> (Vec<MuscleParameters>, Vec<Setting>) {
        let forward = self.forward();
        let between = |from: f64, to: f64| from * (to / from).powf(part);
        let given = forward.nominal_parameters();
        let parameters = given.iter().zip(&point.parameters).map(|(from, to)| MuscleParameters {
            max_isometric_force: between(from.max_isometric_force, to.max_isometric_force),
            optimal_fiber_length: between(from.optimal_fiber_length, to.optimal_fiber_length),
            tendon_slack_length: between(from.tendon_slack_length, to.tendon_slack_length),
            ..*to
        });
        let shortened = |setting: &Setting| {
            let mut setting = setting.clone();
            for i in setting.effect.description().amplitudes() {
                let start = forward.joint.start(&setting.effect.description().parameters[i]);
                setting.values[i] = start + part * (setting.values[i] - start);
            }
            setting
        };
        (parameters.collect(), point.effects.iter().map(shortened).collect())
    }

    /// Puts muscle parameters that are beyond their bounds there, and the others where they are expected then, effects held.
    ///
    /// - `effects`: columns of the point's effects
    fn put_within_bounds(&self, parameters: &mut [MuscleParameters], posterior: &Posterior, effects: usize) {
        let given = self.forward().nominal_parameters();
        let columns: Vec<(usize, Property)> =
            (0..given.len()).flat_map(|m| COLUMNS.map(|property| (m, property))).collect();
        let start = DVector::from_iterator(
            columns.len(),
            columns.iter().map(|(m, p)| (p.of(&parameters[*m]) / p.of(&given[*m])).ln()),
        );
        let bounds = |j: usize| self.analysis.log_bounds[j % FITTED_PER_MUSCLE];
        let is_beyond = |j: usize, x: &DVector<f64>| x[j] < bounds(j)[0] || x[j] > bounds(j)[1];
        let mut held: Vec<usize> = (0..columns.len()).filter(|j| is_beyond(*j, &start)).collect();
        if held.is_empty() {
            return;
        }
        let all = posterior.covariance();
        let of = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| all[(rows[i], columns[j])])
        };
        let muscles: Vec<usize> = (0..columns.len()).collect();
        let first = self.analysis.n_nuisance();
        let effects: Vec<usize> = (first..first + effects).collect();
        let mut covariance = of(&muscles, &muscles);
        if let Some(factor) = of(&effects, &effects).cholesky().filter(|_| !effects.is_empty()) {
            covariance -= of(&muscles, &effects) * factor.solve(&of(&effects, &muscles));
        }
        let mut moved = start.clone();
        // Each round holds at least one more.
        loop {
            let wanted = DVector::from_fn(held.len(), |k, _| {
                start[held[k]].clamp(bounds(held[k])[0], bounds(held[k])[1]) - start[held[k]]
            });
            let Some(factor) = covariance.select_columns(&held).select_rows(&held).cholesky() else { break };
            moved = &start + covariance.select_columns(&held) * factor.solve(&wanted);
            let more: Vec<usize> =
                (0..columns.len()).filter(|j| !held.contains(j) && is_beyond(*j, &moved)).collect();
            if more.is_empty() {
                break;
            }
            held.extend(more);
        }
        for (j, (m, property)) in columns.into_iter().enumerate() {
            let within = moved[j].clamp(bounds(j)[0], bounds(j)[1]);
            *property.of_mut(&mut parameters[m]) = property.of(&given[m]) * within.exp();
        }
    }

    /// The model with some of the effects, as if nothing else were wrong: muscles and these take, to first order, all that they can.
    /// Equation (27) compares such models.
    ///
    /// - `kept`: places of the effects that stay
    pub fn with_some(&self, state: &State, kept: &[usize], part: f64) -> (Vec<MuscleParameters>, Vec<Setting>) {
        let set = self.places(&state.point.effects);
        let (kept, others): (Vec<usize>, Vec<usize>) = set.into_iter().partition(|e| kept.contains(e));
        let posterior = state.model.without(&others).posterior(&kept, &self.sizes(state).scaled(NOTHING_ELSE));
        let own = self.analysis.n_nuisance() + state.point.effects.iter().map(|s| s.values.len()).sum::<usize>();
        let step = (&posterior.mean - &state.model.offset).rows(0, own).into_owned();
        let mut point = self.analysis.moved(&state.point, &step);
        let stays = |s: &Setting| self.places(std::slice::from_ref(s)).iter().all(|place| kept.contains(place));
        point.effects.retain(stays);
        self.part_of_the_way(&point, part)
    }

    /// Estimates of the effects at the joint mode, by `effect.parameter`, with 95 % intervals.
    pub fn estimates(&self, state: &State) -> BTreeMap<String, ParameterEstimate> {
        let forward = self.forward();
        let posterior = state.model.posterior(&self.places(&state.point.effects), self.sizes(state));
        let mut column = self.analysis.n_nuisance();
        let mut out = BTreeMap::new();
        for setting in &state.point.effects {
            let description = setting.effect.description();
            let reported = |values: &[f64]| setting.effect.reported(values, &forward.muscles);
            let value = reported(&setting.values);
            for (i, p) in description.parameters.iter().enumerate() {
                let half = 1.96 * posterior.sd_of(column) * forward.joint.scale(p);
                let side = |sign: f64| {
                    let mut values = setting.values.clone();
                    values[i] += sign * half;
                    reported(&values)[i]
                };
                let (a, b) = (side(-1.0), side(1.0));
                let estimate = ParameterEstimate {
                    value: value[i],
                    unit: p.unit,
                    ci95: [a.min(b), a.max(b)],
                    plausible: forward.joint.plausible(p),
                };
                out.insert(format!("{}.{}", description.id, p.name), estimate);
                column += 1;
            }
        }
        out
    }

    /// How large an effect of the point is, in units of the larger end of its plausible range: the largest of its amplitudes.
    ///
    /// - `effect`: its place
    pub fn share_of_plausible(&self, state: &State, effect: usize) -> f64 {
        let of = |setting: &Setting| {
            let description = setting.effect.description();
            let of_amplitude = |i: usize| {
                let p = &description.parameters[i];
                let size = (setting.values[i] - self.forward().joint.start(p)).abs() / self.forward().joint.scale(p);
                0.5 * size / self.plausible(setting.effect, i).0.max(f64::MIN_POSITIVE)
            };
            description.amplitudes().map(of_amplitude).fold(0.0, f64::max)
        };
        let own = state.point.effects.iter().filter(|s| self.places(std::slice::from_ref(s)).contains(&effect));
        own.map(of).fold(0.0, f64::max)
    }

    /// What muscle parameters do to every trial's moment, averaged over blocks, the noise whitened.
    pub fn of_muscle_parameters(&self, state: &State) -> Vec<DMatrix<f64>> {
        let muscles = self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let columns = state.linear.iter().map(|l| l.nuisance.columns(0, muscles).into_owned());
        columns.zip(&state.factors).map(|(c, factor)| whiten(factor, &c)).collect()
    }

    /// Standard deviation of the noise of a sample of the training trials [N·m].
    pub fn noise_floor(&self, state: &State) -> f64 {
        let total: f64 = state.noise.iter().map(|n| n.variance_of_samples(&state.levels)).sum();
        let blocks: usize = state.linear.iter().map(|l| l.bare.len()).sum();
        (total / blocks.max(1) as f64).sqrt()
    }

    /// Effects that may stand in an effect's place, equation (22), and the probability that one of them is missing, equation (23).
    ///
    /// - `effect`: place of one of the point's effects
    pub fn group(&self, state: &State, effect: usize) -> (Vec<usize>, f64) {
        let set = self.places(&state.point.effects);
        let probability = |candidate: &[usize]| {
            let found = state.sets.found.iter().zip(&state.sets.probability).find(|(s, _)| s.effects == candidate);
            found.map_or(0.0, |(_, p)| *p)
        };
        let own = probability(&set);
        let exchanged = |other: usize| {
            let mut set: Vec<usize> = set.iter().copied().filter(|e| *e != effect).chain([other]).collect();
            set.sort_unstable();
            set
        };
        let stands_in = |other: &usize| !set.contains(other) && probability(&exchanged(*other)) > own * STANDS_IN;
        let mut group = vec![effect];
        if own > 0.0 {
            group.extend(self.testable().into_iter().filter(stands_in));
        }
        let together = state.sets.of_any(&group);
        (group, together)
    }
}
