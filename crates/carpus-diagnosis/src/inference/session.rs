//! The joint mode of a session: point, noise, discrepancy and the sets of effects that the data call for
//! (`docs/src/theory/many-small-errors.md`, equation (20)).

mod amplitudes;
mod before_a_fit;
mod columns;
mod expected_residual;
mod further_trials;
mod generic_discrepancy;
mod handing_over;
mod noise_along_the_way;
mod other_minima;
mod predicting;
mod sets;
mod state;
mod steps;

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use web_time::Instant;

use super::discrepancy::Ranges;
use super::linear_model::Sizes;
use super::muscle_prior::MusclePrior;
use super::resting_fiber::RestingFiber;
use super::search::{Budget, Sets, search};
use crate::fit::{Analysis, Fit};
use crate::noise::{self, NoiseLevels};
pub use before_a_fit::Determinable;
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, ForwardModel, Setting};
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::ParameterBounds;
use expected_residual::beyond_the_linear_model;
use noise_along_the_way::{factors, weighted};
use state::{Around, ODDS, Reached, Start};
pub use state::{Begun, HandedOver, OtherMinimum, Session, State};
use steps::{STEPS, profiled};

/// Points that are followed from the model as given.
const STARTS: usize = 3;
/// Sets whose neighbours are looked at around the model as given.
const FIRST_EXPANSIONS: usize = 6;
/// Effects that are tried alone from there: those that the linear model has lower the deviance most.
const ALONE: usize = 16;
/// Gauss–Newton steps from there.
const FIRST_STEPS: usize = 4;
/// Rounds of search, simulation of other sets, noise and relinearization, at most.
const ROUNDS: usize = 6;
/// Times that a descent goes on with the directions and the noise where it came to, at most.
const PASSES: usize = 2;
/// Share of the sizes' scales that is as good as nothing.
const NOTHING_ELSE: f64 = 0.02;
/// Corrections of the EMG at a point, at most: each passes through the muscles anew, equation (10) …
const CORRECTIONS: usize = 4;
/// … and one that changes −2 log posterior by less is the last.
const SETTLED_EMG: f64 = 1.0;
/// Of the sets that were tried in a round, so many at a time have their noise estimated anew, until one is ahead.
const ASSESSED: usize = 2;
/// The estimate has settled when a round lowers −2 log posterior, equation (20), by less than this.
const SETTLED: f64 = 3.0;

impl<'a> Session<'a> {
    /// A session of training trials.
    pub fn new(
        forward: &'a ForwardModel,
        train: Vec<usize>,
        candidates: Vec<&'static dyn Effect>,
        bounds: &ParameterBounds,
        budget: Budget,
        seed: u64,
    ) -> Session<'a> {
        Session::of(Analysis::without_data(forward, train, candidates, bounds, seed), budget)
    }

    fn of(analysis: Analysis<'a>, budget: Budget) -> Session<'a> {
        let ranges = Ranges::of(analysis.train.iter().map(|g| {
            let kinematics = analysis.forward.base(*g).kinematics();
            (&kinematics.angle[..], &kinematics.speed[..])
        }));
        Session {
            levels: NoiseLevels::usual(analysis.forward.joint.strength),
            nameable: (0..analysis.candidates.len()).collect(),
            analysis,
            ranges,
            budget,
            noise_is_final: false,
            images: Vec::new(),
            muscle_priors: Vec::new(),
            further_start: None,
        }
    }

    /// The session in which only some effects may be named.
    pub fn naming(mut self, effects: &[&'static dyn Effect]) -> Session<'a> {
        let known = |c: &&'static dyn Effect| effects.iter().any(|e| e.description().id == c.description().id);
        let places = self.analysis.candidates.iter().enumerate().filter(|(_, c)| known(c));
        self.nameable = places.map(|(place, _)| place).collect();
        self
    }

    /// The session with fascicle lengths of images as further data.
    pub fn with_images(self, images: Vec<RestingFiber>) -> Session<'a> {
        Session { images, ..self }
    }

    /// The session with prior knowledge of muscle parameters beside the bounds, and with muscles that have
    /// one factor of a property.
    pub fn with_muscle_priors(mut self, known: &[MusclePrior]) -> Session<'a> {
        let own = |column: usize| [0.0, self.analysis.prior_sd[column % FITTED_PER_MUSCLE]];
        self.muscle_priors = (0..self.analysis.n_muscles() * FITTED_PER_MUSCLE).map(own).collect();
        for prior in known {
            let mut columns = prior.columns();
            let Some(first) = columns.next() else { continue };
            self.muscle_priors[first] = [prior.log_mean, prior.log_sd];
            for other in columns {
                // What the first does, it does: it has no prior of its own.
                self.muscle_priors[other] = [0.0, 0.0];
                self.analysis.tied.push([first, other]);
            }
        }
        self
    }

    /// Whether an effect may be named.
    pub fn may_name(&self, id: &str) -> bool {
        self.nameable.iter().any(|e| self.analysis.candidates[*e].description().id == id)
    }

    fn forward(&self) -> &'a ForwardModel {
        self.analysis.forward
    }

    /// Estimates the session: many starts, of which the most probable are followed to their end.
    ///
    /// - `always`: identifiers of effects that are missing for certain; `only`: no others are
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn estimate(&mut self, always: &[&str], only: bool, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let begun = self.begin(always, only, report)?;
        self.settle(begun, report)
    }

    /// The most probable of many starts, with the noise that goes with it.
    ///
    /// - `always`, `only`: as for [`Session::estimate`]
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn begin(&mut self, always: &[&str], only: bool, report: &dyn Fn(&str)) -> Result<Begun, SimulationError> {
        let place = |id: &&str| self.analysis.candidates.iter().position(|c| c.description().id == *id);
        let always: Vec<usize> = always.iter().filter_map(place).collect();
        let candidates = if only { Vec::new() } else { self.testable() };
        let clock = Instant::now();
        let starts = self.starts(&candidates, &always, report)?;
        report(&format!("{} starts, {:.1?}", starts.len(), clock.elapsed()));
        let mut followed: Vec<State> = Vec::new();
        for start in starts {
            let Ok(mut state) = self.with_noise(start.clone()) else { continue };
            self.weigh(&mut state, &start.set, &start.sizes, &candidates, &always);
            let next = self.advanced(&state, None)?.into_iter().next();
            if let Some(Ok(next)) = next.map(|start| self.assessed(start, &candidates, &always)) {
                state = if self.behind(&next, &state) < 0.0 { next } else { state };
            }
            report(&format!("start {} {:.1?}", self.in_words(&state), clock.elapsed()));
            followed.push(state);
        }
        let mut best = self.most_probable(followed);
        if let Some(state) = best.as_mut().filter(|_| !self.noise_is_final) {
            let found = state.sets.best().clone();
            self.choose_kernels(state, &found.effects, &found.sizes);
            self.noise_is_final = true;
            report(&format!("kernels {:?} {:.1?}", self.analysis.kernels, clock.elapsed()));
            let (point, levels) = (state.point.clone(), state.levels);
            let directions = state.directions.clone();
            let start = Start { point, levels, set: found.effects, sizes: found.sizes, directions };
            let state = self.assessed(start, &candidates, &always)?;
            self.levels = state.levels;
            best = Some(state);
        }
        let state = best.ok_or(SimulationError::NoiseCovariance)?;
        Ok(Begun { state, candidates, always })
    }

    /// Rounds of search, simulation of other sets and noise, until nothing more probable is found, not from
    /// other muscles either.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn settle(&self, begun: Begun, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let (candidates, always) = (begun.candidates.clone(), begun.always.clone());
        let state = self.rounds(begun, report)?;
        // Where effects are still to be left out, other minima are looked for afterwards.
        if candidates.is_empty() { Ok(self.beside_minima(state, &[], &always, report)?.0) } else { Ok(state) }
    }

    /// The state beside other minima with the same effects; rounds go on from one that is ahead. And whether one was.
    fn beside_minima(
        &self,
        state: State,
        candidates: &[usize],
        always: &[usize],
        report: &dyn Fn(&str),
    ) -> Result<(State, bool), SimulationError> {
        let mut others = self.other_minima(&state)?;
        let behind: Vec<f64> = others.iter().map(|other| self.behind(other, &state)).collect();
        report(&format!("other minima {behind:.1?} behind"));
        let ahead = (0..others.len()).min_by(|a, b| behind[*a].total_cmp(&behind[*b]));
        let Some(ahead) = ahead.filter(|i| behind[*i] < -SETTLED) else {
            return Ok((self.beside_others(state, &others), false));
        };
        let mut next = std::mem::replace(&mut others[ahead], state);
        let (set, sizes) = (self.places(&next.point.effects), self.sizes(&next).clone());
        self.weigh(&mut next, &set, &sizes, candidates, always);
        let (candidates, always) = (candidates.to_vec(), always.to_vec());
        let state = self.rounds(Begun { state: next, candidates, always }, report)?;
        let others = if self.places(&state.point.effects) == set { others } else { self.other_minima(&state)? };
        Ok((self.beside_others(state, &others), true))
    }

    /// Rounds from where an estimate has begun.
    fn rounds(&self, begun: Begun, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let Begun { state: mut best, candidates, always } = begun;
        let clock = Instant::now();
        for _ in 0..ROUNDS {
            let sets = self.advanced(&best, Some((&candidates, &always)))?;
            let (mut next, mut fall) = (None, 0.0);
            for some in sets.chunks(ASSESSED) {
                let tried = some.iter().filter_map(|start| self.assessed(start.clone(), &[], &start.set).ok());
                next = self.most_probable(next.into_iter().chain(tried));
                fall = next.as_ref().map_or(0.0, |next| self.behind(&best, next));
                if fall >= SETTLED {
                    break;
                }
            }
            let Some(mut next) = next else { break };
            let (set, sizes) = (self.places(&next.point.effects), self.sizes(&next).clone());
            self.weigh(&mut next, &set, &sizes, &candidates, &always);
            report(&format!("round {} {:.1?}, lower by {fall:.1}", self.in_words(&next), clock.elapsed()));
            if fall > 0.0 {
                best = next;
            }
            if fall < SETTLED {
                break;
            }
        }
        Ok(best)
    }

    /// An estimate in the form that tests of what is left take.
    pub fn as_fit(&self, state: &State) -> Fit {
        let set = self.places(&state.point.effects);
        let posterior = state.model.posterior(&set, self.sizes(state));
        let columns = self.all_columns(&state.point, &state.linear, &state.directions);
        let regressors = Self::regressors(&state.model, &columns, &posterior.sd);
        let trials: Vec<_> = state.noise.iter().zip(&regressors).map(|(n, (x, r))| (n, x, r)).collect();
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        let level_spread = noise::spread(&trials, &DVector::from_element(count, 1.0), &state.levels)
            .unwrap_or_else(|| DMatrix::zeros(noise::COMPONENTS, noise::COMPONENTS));
        let first = self.analysis.n_nuisance();
        let effects: usize = state.point.effects.iter().map(|s| s.values.len()).sum();
        let covariance = posterior.covariance().view((first, first), (effects, effects)).into_owned();
        let (precision, offset) = self.analysis.prior(&state.point);
        Fit {
            deviance: state.sets.best().deviance,
            covariance,
            levels: state.levels,
            level_spread,
            noise: state.noise.clone(),
            factors: state.factors.clone(),
            whitened: self.analysis.whitened(&state.linear, &state.factors),
            offset,
            precision,
            directions: std::sync::Arc::new(state.directions.clone()),
            point: state.point.clone(),
        }
    }

    fn ids(&self, set: &[usize]) -> Vec<&'static str> {
        set.iter().map(|e| self.analysis.candidates[*e].description().id).collect()
    }

    fn in_words(&self, state: &State) -> String {
        let best = state.sets.best();
        format!(
            "{:?} at {:?} {:.1} κ {:.3} σ {:.3?} levels {:.3?}",
            self.ids(&best.effects),
            self.ids(&self.places(&state.point.effects)),
            best.deviance,
            best.sizes.everything,
            best.sizes.discrepancy,
            state.levels.0.map(f64::sqrt)
        )
    }

    /// Where to begin: from the model as given every effect alone, none, and what the linear model at that
    /// point calls for, each fitted with the same usual noise; the most probable first.
    fn starts(
        &mut self,
        candidates: &[usize],
        always: &[usize],
        report: &dyn Fn(&str),
    ) -> Result<Vec<Start>, SimulationError> {
        let levels = self.levels;
        // With the EMG as recorded: that expected beside everything at once may have been bent to make up for
        // what is missing.
        let point = self.analysis.nominal_point();
        let mut linear = self.analysis.linearize(&point, &[])?;
        let noise = self.structure(&mut linear, &point);
        let directions;
        (directions, self.analysis.blocks) = self.analysis.calc_directions(&linear, &point)?;
        let factors = factors(&noise, &levels)?;
        let model = self.model(&point, &self.all_columns(&point, &linear, &directions), &factors);
        let sizes = model.usual_sizes();
        let found =
            search(&model, candidates, always, 2.0 * ODDS.ln(), &[], &sizes, Budget { expansions: FIRST_EXPANSIONS });
        // Each effect alone, as if nothing else were wrong: a little of everything would make up for any of them.
        let nothing = sizes.scaled(NOTHING_ELSE);
        let sorted = |mut set: Vec<usize>| {
            set.sort_unstable();
            set
        };
        let with = |e: &usize| sorted([always, &[*e]].concat());
        let others = candidates.iter().filter(|e| !always.contains(e));
        let mut alone: Vec<(f64, Vec<usize>)> =
            others.map(with).map(|set| (model.posterior(&set, &nothing).deviance, set)).collect();
        alone.sort_by(|a, b| a.0.total_cmp(&b.0));
        alone.truncate(ALONE);
        let none = sorted(always.to_vec());
        let mut sets: Vec<(Vec<usize>, &Sizes)> = vec![(none.clone(), &sizes), (none.clone(), &nothing)];
        if found.best().effects != none {
            sets.push((found.best().effects.clone(), &sizes));
        }
        sets.extend(alone.into_iter().map(|(_, set)| (set, &nothing)));
        let from = Around {
            point: &point,
            model: &model,
            sizes: &sizes,
            noise: &noise,
            factors: &factors,
            directions: &directions,
        };
        let reach = |(set, sizes): &(Vec<usize>, &Sizes)| self.reach(&Around { sizes, ..from }, set, FIRST_STEPS).ok();
        let mut reached: Vec<Reached> = sets.par_iter().with_max_len(1).filter_map(reach).collect();
        reached.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        for r in &reached {
            report(&format!(
                "from the model as given {:?} {:.1} κ {:.3}",
                self.ids(&r.set),
                r.deviance,
                r.sizes.everything
            ));
        }
        reached.truncate(STARTS);
        let mut starts: Vec<Start> = reached.into_iter().map(|r| r.start(levels)).collect();
        if let Some(point) = self.further_start.clone() {
            starts.push(Start { point, levels, set: none, sizes, directions });
        }
        Ok(starts)
    }

    /// Noise, linear model and sets at a point.
    fn assessed(&self, start: Start, candidates: &[usize], always: &[usize]) -> Result<State, SimulationError> {
        let (set, sizes) = (start.set.clone(), start.sizes.clone());
        let state = self.with_noise(start)?;
        let mut state = self.at_rest(state, &set, &sizes)?;
        self.weigh(&mut state, &set, &sizes, candidates, always);
        if !state.sets.best().deviance.is_finite() {
            return Err(SimulationError::NoiseCovariance);
        }
        Ok(state)
    }

    /// The state moved on until directions and noise at its point are those that it is a minimum with, equation (21).
    fn at_rest(&self, mut state: State, set: &[usize], sizes: &Sizes) -> Result<State, SimulationError> {
        self.weigh(&mut state, set, sizes, &[], set);
        for _ in 0..PASSES {
            let own = self.columns_of_point(&state.point);
            let promised = profiled(&state.model, own, set, sizes) - state.model.posterior(set, sizes).squares;
            if promised < SETTLED_EMG || self.places(&state.point.effects) != set {
                break;
            }
            let from = state.around(sizes);
            let reached = self.reach_from(&from, state.point.clone(), set, STEPS)?;
            let mut next = self.with_noise(reached.start(state.levels))?;
            self.weigh(&mut next, set, sizes, &[], set);
            if self.behind(&next, &state) > 0.0 {
                break;
            }
            state = next;
        }
        Ok(state)
    }

    /// Noise and linear model at a point.
    fn with_noise(&self, start: Start) -> Result<State, SimulationError> {
        let Start { mut point, levels, set, sizes, directions } = start;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let mut noise = self.structure(&mut linear, &point);
        let mut columns = self.all_columns(&point, &linear, &directions);
        let mut passing = factors(&noise, &levels)?;
        let mut model = self.model(&point, &columns, &passing);
        let mut posterior = model.posterior(&set, &sizes);
        for _ in 0..CORRECTIONS {
            let step = &posterior.mean - &model.offset;
            let expected = self.expected_emg(&noise, &weighted(&columns, &step, &passing), &levels);
            point = self.with_emg(&point, expected)?;
            // Muscles and effects stay: the EMG's corrections hardly change what effects do.
            linear = self.analysis.linearize_beside(&point, &linear)?;
            noise = self.structure(&mut linear, &point);
            columns = self.all_columns(&point, &linear, &directions);
            passing = factors(&noise, &levels)?;
            model = self.model(&point, &columns, &passing);
            let before = posterior.deviance;
            posterior = model.posterior(&set, &sizes);
            if (posterior.deviance - before).abs() < SETTLED_EMG {
                break;
            }
        }
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

    /// The linear model with the noise as it is, its sets and deviance.
    fn weigh(&self, state: &mut State, set: &[usize], sizes: &Sizes, candidates: &[usize], always: &[usize]) {
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
    fn most_probable(&self, states: impl IntoIterator<Item = State>) -> Option<State> {
        states.into_iter().reduce(|known, other| if self.behind(&other, &known) < 0.0 { other } else { known })
    }

    /// Places of effects among the candidates, ascending.
    pub(crate) fn places(&self, effects: &[Setting]) -> Vec<usize> {
        let place =
            |s: &Setting| self.analysis.candidates.iter().position(|c| c.description().id == s.effect.description().id);
        let mut out: Vec<usize> = effects.iter().filter_map(place).collect();
        out.sort_unstable();
        out
    }
}
