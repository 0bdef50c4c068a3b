//! What goes with a point: its EMG, columns, noise and sets; and which of several points is the most probable
//! (`docs/src/theory/many-small-errors.md`, equations (10), (12) and (20)).

use std::collections::BTreeMap;

use super::super::linear_model::Sizes;
use super::super::search::{NEGLIGIBLE, Sets, search};
use super::emg_iteration::EmgIteration;
use super::expected_residual::beyond_the_linear_model;
use super::noise_along_the_way::{factors, weighted};
use super::state::{ODDS, Session, Start, State};
use super::steps::{STEPS, profiled};
use super::{PASSES, SETTLED};
use crate::fit::Point;
use crate::fit::linearization::Linear;
use crate::noise::{self, NoiseLevels, TrialNoise};
use carpus_simulation::simulation::SimulationError;

/// Corrections of the EMG at a point, at most: each passes through the muscles anew, equation (10).
const CORRECTIONS: usize = 8;

/// A start with the EMG that goes with its point, variances and directions as they were.
pub(super) struct Prepared {
    pub(super) set: Vec<usize>,
    sizes: Sizes,
    levels: NoiseLevels,
    point: Point,
    linear: Vec<Linear>,
    noise: Vec<TrialNoise>,
    /// −2 log posterior, equation (18), at the sizes that go with it.
    pub(super) deviance: f64,
}

impl Session<'_> {
    /// The starts with their EMG, less those that are behind the first of them, or behind what is known, by more
    /// than [`NEGLIGIBLE`]. All have the same variances. Starts that cannot be simulated are left out.
    ///
    /// - `known`: −2 log posterior of a state with these variances
    pub(super) fn raced(&self, starts: impl IntoIterator<Item = Start>, known: f64) -> Vec<Prepared> {
        let mut out: Vec<Prepared> = starts.into_iter().filter_map(|start| self.prepared(start).ok()).collect();
        out.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        let least = out.first().map_or(known, |first| first.deviance.min(known));
        out.retain(|prepared| prepared.deviance < least + NEGLIGIBLE);
        out
    }

    /// −2 log posterior of a state, equation (18), to be held against starts with its variances.
    pub(super) fn deviance_here(&self, state: &State) -> f64 {
        let set = self.places(&state.point.effects);
        state.model.sizes_for(&set, self.sizes(state)).1 + 2.0 * ODDS.ln() * set.len() as f64
    }

    /// A start with the EMG that goes with its point.
    fn prepared(&self, start: Start) -> Result<Prepared, SimulationError> {
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
        let (sizes, deviance) = model.sizes_for(&set, &sizes);
        let deviance = deviance + 2.0 * ODDS.ln() * set.len() as f64;
        if !deviance.is_finite() {
            return Err(SimulationError::NoiseCovariance);
        }
        Ok(Prepared { set, sizes, levels, point, linear, noise, deviance })
    }

    /// Directions, variances and linear model at a point with its EMG.
    fn with_directions(&self, prepared: Prepared) -> Result<State, SimulationError> {
        let Prepared { set, sizes, levels, point, linear, noise, .. } = prepared;
        let directions = self.analysis.calc_directions(&linear, &point)?.0;
        let columns = self.all_columns(&point, &linear, &directions);
        let model = self.model(&point, &columns, &factors(&noise, &levels)?);
        let regressors = Self::regressors(&model, &columns, &model.sds(&set, &sizes));
        let levels = self.levels(&noise, &regressors, levels);
        let factors = factors(&noise, &levels)?;
        Ok(State {
            model: self.model(&point, &columns, &factors),
            factors,
            sets: Sets::none(),
            expected: Vec::new(),
            stand_ins: BTreeMap::new(),
            others: Vec::new(),
            point,
            levels,
            noise,
            linear,
            directions,
        })
    }

    /// Noise, linear model and sets at a point.
    pub(super) fn assessed(
        &self,
        start: Start,
        candidates: &[usize],
        always: &[usize],
    ) -> Result<State, SimulationError> {
        self.settled(self.prepared(start)?, candidates, always)
    }

    /// As [`Session::assessed`], the EMG being known.
    pub(super) fn settled(
        &self,
        prepared: Prepared,
        candidates: &[usize],
        always: &[usize],
    ) -> Result<State, SimulationError> {
        let (set, sizes) = (prepared.set.clone(), prepared.sizes.clone());
        let state = self.with_directions(prepared)?;
        let mut state = self.at_rest(state, &set, &sizes)?;
        self.weigh(&mut state, &set, &sizes, candidates, always);
        if !state.sets.best().deviance.is_finite() {
            return Err(SimulationError::NoiseCovariance);
        }
        Ok(state)
    }

    /// As [`Session::settled`], where the point stays.
    pub(super) fn in_place(
        &self,
        prepared: Prepared,
        candidates: &[usize],
        always: &[usize],
    ) -> Result<State, SimulationError> {
        let (set, sizes) = (prepared.set.clone(), prepared.sizes.clone());
        let mut state = self.with_directions(prepared)?;
        self.weigh(&mut state, &set, &sizes, candidates, always);
        Ok(state)
    }

    /// The state moved on until directions and noise at its point are those that it is a minimum with, equation (21).
    fn at_rest(&self, mut state: State, set: &[usize], sizes: &Sizes) -> Result<State, SimulationError> {
        self.weigh(&mut state, set, sizes, &[], set);
        for _ in 0..PASSES {
            let own = self.columns_of_point(&state.point);
            let promised = profiled(&state.model, own, set, sizes) - state.model.posterior(set, sizes).squares;
            if promised < SETTLED || self.places(&state.point.effects) != set {
                break;
            }
            let from = state.around(sizes);
            let reached = self.reach_from(&from, state.point.clone(), set, STEPS)?;
            let mut next = self.with_directions(self.prepared(reached.start(state.levels))?)?;
            self.weigh(&mut next, set, sizes, &[], set);
            if self.behind(&next, &state) > 0.0 {
                break;
            }
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
        let before = (!state.expected.is_empty()).then(|| self.sizes(state).clone());
        state.sets = search(&state.model, candidates, always, 2.0 * ODDS.ln(), &starts, sizes, self.budget);
        if before.as_ref() != Some(self.sizes(state)) {
            state.expected = self.expected_residuals(state);
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
                let beyond = beyond_the_linear_model(&state.expected, &factors);
                of(factors).deviance + beyond + cost
            })
        };
        let difference = deviance(a) - deviance(b);
        let scatter = noise::scatter_of_all(&a.noise, &b.noise, &levels).unwrap_or(0.0).max(0.0);
        let known = difference.abs() / (difference.abs() + scatter).max(f64::MIN_POSITIVE);
        if difference.is_finite() { difference * known } else { difference }
    }

    /// The most probable of several states.
    pub(super) fn most_probable(&self, states: impl IntoIterator<Item = State>) -> Option<State> {
        states.into_iter().reduce(|known, other| if self.behind(&other, &known) < 0.0 { other } else { known })
    }
}
