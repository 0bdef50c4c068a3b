//! What goes with a point: its EMG, columns, noise and sets; and which of several points is the most probable
//! (`docs/src/theory/many-small-errors.md`, equations (10), (12) and (20)).

use std::collections::BTreeMap;

use super::super::linear_model::Sizes;
use super::super::search::{Sets, search};
use super::emg_iteration::EmgIteration;
use super::noise_along_the_way::{factors, weighted};
use super::state::{ODDS, Reached, Session, Start, State};
use super::steps::{STEPS, profiled};
use super::{PASSES, SETTLED};
use crate::fit::Point;
use crate::noise::{self, NoiseLevels};
use carpus_simulation::simulation::SimulationError;
use nalgebra::DVector;

/// Corrections of the EMG at a point, at most: each passes through the muscles anew, equation (10).
const CORRECTIONS: usize = 5;

impl Session<'_> {
    /// A start with the EMG that goes with its point, directions and variances as they were, and with its own set alone.
    fn prepared(&self, start: Start) -> Result<State, SimulationError> {
        let Start { mut point, levels, set, sizes, directions } = start;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let mut noise = self.structure(&mut linear, &point);
        let mut columns = self.all_columns(&point, &linear, &directions);
        let mut passing = factors(&noise, &levels)?;
        let mut model = self.model(&point, &columns, &passing);
        let mut posterior = model.posterior(&set, &sizes);
        let mut iteration = EmgIteration::default();
        for _ in 0..CORRECTIONS {
            let step = &posterior.mean - &model.offset;
            let expected = self.expected_emg(&noise, &weighted(&columns, &step, &passing), &levels);
            let next = iteration.next(&point.correction, expected, &noise, &passing);
            point = self.with_emg(&point, next)?;
            // Muscles and effects stay: the EMG's corrections hardly change what effects do.
            linear = self.analysis.linearize_beside(&point, &linear)?;
            noise = self.structure(&mut linear, &point);
            columns = self.all_columns(&point, &linear, &directions);
            passing = factors(&noise, &levels)?;
            model = self.model(&point, &columns, &passing);
            let before = posterior.deviance;
            posterior = model.posterior(&set, &sizes);
            if (posterior.deviance - before).abs() < SETTLED {
                break;
            }
        }
        let mut state = State {
            model,
            factors: passing,
            sets: Sets::none(),
            stand_ins: BTreeMap::new(),
            others: Vec::new(),
            point,
            levels,
            noise,
            linear,
            directions,
        };
        state.sets = search(&state.model, &[], &set, 2.0 * ODDS.ln(), &[], &sizes, self.budget);
        match state.sets.best().deviance.is_finite() {
            true => Ok(state),
            false => Err(SimulationError::NoiseCovariance),
        }
    }

    /// The state with the directions and the variances that go with its point and its EMG.
    fn with_noise(&self, state: State, set: &[usize], sizes: &Sizes) -> Result<State, SimulationError> {
        let State { point, linear, noise, levels, .. } = state;
        let directions = self.analysis.calc_directions(&linear, &point)?.0;
        let columns = self.all_columns(&point, &linear, &directions);
        let model = self.model(&point, &columns, &factors(&noise, &levels)?);
        let regressors = Self::regressors(&model, &columns, &model.sds(set, sizes));
        let levels = self.levels(&noise, &regressors, levels);
        let factors = factors(&noise, &levels)?;
        Ok(State {
            model: self.model(&point, &columns, &factors),
            factors,
            sets: Sets::none(),
            stand_ins: BTreeMap::new(),
            others: Vec::new(),
            point,
            levels,
            noise,
            linear,
            directions,
        })
    }

    /// EMG, noise, linear model and sets at a point, brought to convergence.
    pub(super) fn assessed(
        &self,
        start: Start,
        candidates: &[usize],
        always: &[usize],
    ) -> Result<State, SimulationError> {
        let (set, sizes) = (start.set.clone(), start.sizes.clone());
        let state = self.with_noise(self.prepared(start)?, &set, &sizes)?;
        let mut state = self.converged(state, &set, &sizes)?;
        self.weigh(&mut state, &set, &sizes, candidates, always);
        match state.sets.best().deviance.is_finite() {
            true => Ok(state),
            false => Err(SimulationError::NoiseCovariance),
        }
    }

    /// The state moved on until directions and noise at its point are those that it is a minimum with, equation (21).
    fn converged(&self, mut state: State, set: &[usize], sizes: &Sizes) -> Result<State, SimulationError> {
        self.weigh(&mut state, set, sizes, &[], set);
        for _ in 0..PASSES {
            let own = self.columns_of_point(&state.point);
            let promised = profiled(&state.model, own, set, sizes) - state.model.posterior(set, sizes).squares;
            if promised < SETTLED || self.places(&state.point.effects) != set {
                break;
            }
            let from = state.around(sizes);
            let reached = self.reach_from(&from, state.point.clone(), set, STEPS)?;
            let next = self.prepared(reached.start(state.levels))?;
            let mut next = self.with_noise(next, set, sizes)?;
            self.weigh(&mut next, set, sizes, &[], set);
            state = next;
        }
        Ok(state)
    }

    /// The linear model with the noise as it is, its sets and deviance.
    pub(super) fn weigh(
        &self,
        state: &mut State,
        set: &[usize],
        sizes: &Sizes,
        candidates: &[usize],
        always: &[usize],
    ) {
        let starts = [set.to_vec(), self.places(&state.point.effects)];
        state.sets = search(&state.model, candidates, always, 2.0 * ODDS.ln(), &starts, sizes, self.budget);
    }

    /// By how much −2 log posterior is larger with some effects than with a state's own, equation (20): the mean of what
    /// is found with the EMG of the state, and with that which goes with the other effects; each with the variances
    /// that are the most probable with it.
    pub(crate) fn behind(&self, state: &State, set: &[usize]) -> Result<f64, SimulationError> {
        let there = self.reach(&state.around(self.sizes(state)), set, STEPS)?;
        let here = self.deviance_with(state, &self.places(&state.point.effects))?;
        self.behind_from(state, here, there)
    }

    /// As [`Session::behind`].
    ///
    /// - `here`: the state's own, `other`: where a descent with the others has come to
    pub(super) fn behind_from(&self, state: &State, here: f64, other: Reached) -> Result<f64, SimulationError> {
        let from_here = self.deviance_of(state, &other)? - here;
        let (own, set) = (self.places(&state.point.effects), other.set.clone());
        let other = self.prepared(other.start(state.levels))?;
        // With the state's muscles and effects to begin with.
        let Point { correction, inputs, .. } = other.point.clone();
        let point = Point { correction, inputs, ..state.point.clone() };
        let back = self.reach_from(&other.around(self.sizes(state)), point, &own, STEPS)?;
        let from_there = self.deviance_with(&other, &set)? - self.deviance_of(&other, &back)?;
        // What holds the other effects is at most as much less probable as one more effect is before the data.
        let holds = set.iter().all(|e| own.contains(e));
        let from_there = if holds { from_there.max(-2.0 * ODDS.ln()) } else { from_there };
        Ok(0.5 * (from_here + from_there))
    }

    /// −2 log posterior with a set of effects, reached from a state.
    pub(super) fn deviance_with(&self, state: &State, set: &[usize]) -> Result<f64, SimulationError> {
        self.deviance_of(state, &self.reach(&state.around(self.sizes(state)), set, STEPS)?)
    }

    /// −2 log posterior where a descent from a state has come to, with the variances that are the most probable there.
    pub(super) fn deviance_of(&self, state: &State, reached: &Reached) -> Result<f64, SimulationError> {
        let Reached { set, point, sizes, deviance, directions } = reached;
        let linear = self.linearized(point, &state.noise, None)?;
        let columns = self.all_columns(point, &linear, directions);
        let model = self.model(point, &columns, &state.factors);
        let regressors = Self::regressors(&model, &columns, &model.sds(set, sizes));
        let levels = self.levels(&state.noise, &regressors, state.levels);
        let trials: Vec<_> = state.noise.iter().zip(&regressors).map(|(n, (x, r))| (n, x, r)).collect();
        let precision = DVector::from_element(regressors.first().map_or(0, |(x, _)| x.ncols()), 1.0);
        let of = |levels: &NoiseLevels| {
            noise::restricted_deviance(&trials, &precision, levels) + noise::prior_deviance(levels)
        };
        Ok(deviance + of(&levels) - of(&state.levels))
    }
}
