//! What is handed over: muscles and effects, estimates, what stands in an effect's place
//! (`docs/src/theory/many-small-errors.md`, equations (22) to (26)).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::linear_model::{Posterior, Prior};
use super::super::muscle_columns::COLUMNS;
use super::super::search::Candidate;
use super::predicting::{End, PRIOR_WEIGHTS};
use super::state::{HandedOver, Session, State};
use crate::diagnose::ParameterEstimate;
use crate::fit::{Point, whiten};
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, Setting};
use carpus_simulation::simulation::{MuscleParameters, Property, SimulationError};

/// Sets of less probability do not widen intervals.
const LEAST_PROBABILITY: f64 = 0.001;
/// Parts of the way that are simulated, equation (26).
const PARTS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// An effect may stand in another's place where the set with it has more than this share of the probability,
/// equation (22).
pub(super) const STANDS_IN: f64 = 0.1;

impl Session<'_> {
    /// What is handed over: muscles and effects, of those on the ways from the model as given to the joint
    /// mode and to the least error the ones that predict trials left out one at a time best, equations (24)
    /// to (26).
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn handed_over(&self, state: &State) -> Result<HandedOver, SimulationError> {
        let least = |weight: f64| self.least_error(state, weight);
        let [one, ten] = PRIOR_WEIGHTS.map(least);
        self.most_predictive(state, &[self.joint_mode(state), one?, ten?])
    }

    fn most_predictive(&self, state: &State, ends: &[End]) -> Result<HandedOver, SimulationError> {
        let square = |residuals: &[DVector<f64>]| residuals.iter().map(|r| r.norm_squared()).sum::<f64>();
        let as_given = square(&self.residuals(&self.forward().nominal_parameters(), &[])?);
        let (parameters, effects) = self.part_of_the_way(&state.point, 0.0);
        let mut best = HandedOver { parameters, effects, part: 0.0, left_out_ratio: 1.0 };
        let mut least = as_given;
        for end in ends {
            for part in PARTS {
                let (parameters, effects) = self.part_of_the_way(&end.point, part);
                // A part of the way that cannot be simulated is none.
                let Ok(residuals) = self.residuals(&parameters, &effects) else { continue };
                let left_out: Vec<DVector<f64>> =
                    residuals.iter().zip(&end.left_out).map(|(r, change)| r - change * part).collect();
                let square = square(&left_out);
                if square < least {
                    least = square;
                    let left_out_ratio = (square / as_given.max(f64::MIN_POSITIVE)).sqrt();
                    best = HandedOver { parameters, effects, part, left_out_ratio };
                }
            }
        }
        Ok(best)
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

    /// Standard deviations of muscles, baselines and the parameters of effects at the joint mode, in the
    /// units of their columns: those of the posterior over all sets (16), (19), or of the jackknife over
    /// trials where trials differ by more than noise and discrepancy say, equation (29), and the distance of
    /// other minima, equation (34).
    pub fn deviations(&self, state: &State) -> DVector<f64> {
        let own = self.columns_of_point(&state.point);
        let (set, sizes) = (self.places(&state.point.effects), self.sizes(state));
        let mean_of = |posterior: &Posterior| posterior.mean.rows(0, own).into_owned();
        let at_all = mean_of(&state.model.posterior(&set, sizes));
        // Sizes are not known either: those a standard deviation above the most probable ones say how far
        // values may be.
        let wide = state.model.sizes_above(&set, sizes);
        let of_set = |(found, probability): (&Candidate, &f64)| {
            let posterior = state.model.posterior(&found.effects, &wide);
            let away = mean_of(&posterior) - &at_all;
            let square = DVector::from_fn(own, |j, _| posterior.sd_of(j).powi(2) + away[j] * away[j]);
            // An effect's size is asked for where it is there.
            let counts = |j: usize| match state.model.priors[j] {
                Prior::Amplitude { effect, .. } | Prior::Shape { effect, .. } => found.effects.contains(&effect),
                _ => true,
            };
            let weight = DVector::from_fn(own, |j, _| if counts(j) { *probability } else { 0.0 });
            (square.component_mul(&weight), weight)
        };
        let own_set = Candidate::of(&set, sizes);
        let mut sets: Vec<(&Candidate, &f64)> =
            state.sets.found.iter().zip(&state.sets.probability).filter(|(_, p)| **p > LEAST_PROBABILITY).collect();
        if sets.iter().all(|(found, _)| found.effects != set) {
            sets.push((&own_set, &LEAST_PROBABILITY));
        }
        let (squares, weights) = sets
            .par_iter()
            .map(|(found, probability)| of_set((*found, *probability)))
            .collect::<Vec<_>>()
            .into_iter()
            .fold((DVector::zeros(own), DVector::zeros(own)), |sum, of| (sum.0 + of.0, sum.1 + of.1));
        let n = state.model.by_trial.len() as f64;
        let without = |of_trial: &DMatrix<f64>| {
            mean_of(&state.model.posterior_of(&(&state.model.products - of_trial), &set, sizes))
        };
        let means: Vec<DVector<f64>> = state.model.by_trial.par_iter().map(without).collect();
        let center = means.iter().fold(DVector::zeros(own), |sum, m| sum + m) / n.max(1.0);
        let spread = means.iter().fold(DVector::zeros(own), |sum, m| sum + (m - &center).map(|d| d * d));
        let over_sets = |j: usize| if weights[j] > 0.0 { squares[j] / weights[j] } else { 0.0 };
        let over_minima = |j: usize| {
            let having = || state.others.iter().filter(|other| other.away[j].is_finite());
            let total: f64 = 1.0 + having().map(|other| other.odds).sum::<f64>();
            having().map(|other| other.odds / total * other.away[j].powi(2)).sum::<f64>()
        };
        let of_mode = |j: usize| over_sets(j).max(spread[j] * (n - 1.0) / n.max(1.0)).max(0.0);
        DVector::from_fn(own, |j, _| (of_mode(j) + over_minima(j)).sqrt())
    }

    /// Puts muscle parameters that are beyond their bounds there, and the others where they are expected
    /// then, effects held.
    ///
    /// - `effects`: columns of the point's effects
    pub(super) fn put_within_bounds(&self, parameters: &mut [MuscleParameters], posterior: &Posterior, effects: usize) {
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
            let more: Vec<usize> = (0..columns.len()).filter(|j| !held.contains(j) && is_beyond(*j, &moved)).collect();
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

    /// Estimates of the effects at the joint mode, by `effect.parameter`, with 95 % intervals.
    pub fn estimates(&self, state: &State) -> BTreeMap<String, ParameterEstimate> {
        let forward = self.forward();
        let deviations = self.deviations(state);
        let mut column = self.analysis.n_nuisance();
        let mut out = BTreeMap::new();
        for setting in &state.point.effects {
            let description = setting.effect.description();
            let reported = |values: &[f64]| setting.effect.reported(values, &forward.muscles);
            let value = reported(&setting.values);
            for (i, p) in description.parameters.iter().enumerate() {
                let half = 1.96 * deviations[column] * forward.joint.scale(p);
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

    /// How large an effect of the point is, in units of the larger end of its plausible range: the largest of
    /// its amplitudes.
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

    /// Effects that may stand in an effect's place, equation (22), and the probability that one of them is
    /// missing, equation (23).
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
        let without: Vec<usize> = set.iter().copied().filter(|e| *e != effect).collect();
        // Where the linear model does not ask for the effect, it cannot say what else would do.
        if own > probability(&without) {
            group.extend(self.testable().into_iter().filter(stands_in));
        }
        let simulated = state.stand_ins.get(&effect).into_iter().flatten();
        group.extend(simulated.filter(|e| !set.contains(e)).copied());
        let first = group.remove(0);
        group.sort_unstable();
        group.dedup();
        group.insert(0, first);
        let together = state.sets.of_any(&group);
        (group, together)
    }
}
