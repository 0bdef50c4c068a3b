//! What goes with a point: its EMG, columns, noise and sets; and which of two states is the more probable
//! (`docs/src/theory/many-small-errors.md`, equations (10), (12) and (20)).

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::super::linear_model::Sizes;
use super::super::search::{Sets, search};
use super::emg_iteration::EmgIteration;
use super::noise_along_the_way::{factors, weighted};
use super::state::{ODDS, Session, Start, State};
use super::steps::{STEPS, profiled};
use super::{PASSES, SETTLED};
use crate::noise;
use carpus_simulation::simulation::SimulationError;

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
            expected: OnceLock::new(),
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
            expected: OnceLock::new(),
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
        let before = (!state.sets.found.is_empty()).then(|| self.sizes(state).clone());
        state.sets = search(&state.model, candidates, always, 2.0 * ODDS.ln(), &starts, sizes, self.budget);
        if before.as_ref() != Some(self.sizes(state)) {
            state.expected = OnceLock::new();
        }
    }

    /// How much larger −2 log posterior is at one state than at another, each with its point's effects,
    /// equation (20): both at the geometric means of their noise's variances, true excitations being
    /// parameters as all others are. That a model lets less of the EMG's noise pass is no evidence for it,
    /// and where two let different parts of it pass, their difference is in part chance.
    pub(crate) fn behind(&self, a: &State, b: &State) -> f64 {
        let levels = a.levels.between(&b.levels);
        let deviance = |state: &State| {
            let columns = self.all_columns(&state.point, &state.linear, &state.directions);
            let set = self.places(&state.point.effects);
            let of = |factors: Vec<_>| self.model(&state.point, &columns, &factors).posterior(&set, self.sizes(state));
            let cost = 2.0 * ODDS.ln() * set.len() as f64;
            factors(&state.noise, &levels).map_or(f64::INFINITY, |factors| {
                let beyond = self.beyond_the_linear_model(state, &factors);
                of(factors).deviance + beyond + cost
            })
        };
        let difference = deviance(a) - deviance(b);
        let scatter = noise::scatter_of_all(&a.noise, &b.noise, &levels).unwrap_or(0.0).max(0.0);
        let known = difference.abs() / (difference.abs() + scatter).max(f64::MIN_POSITIVE);
        if difference.is_finite() { difference * known } else { difference }
    }
}
