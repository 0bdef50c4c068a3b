//! The joint mode of a session: point, noise, discrepancy and the sets of effects that the data call for
//! (`docs/src/theory/many-small-errors.md`, equation (20)).

mod amplitudes;
mod assessing;
mod before_a_fit;
mod columns;
mod emg_iteration;
mod further_trials;
mod generic_discrepancy;
mod handing_over;
mod noise_along_the_way;
mod other_minima;
mod predicting;
mod sets;
mod state;
mod steps;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use web_time::Instant;

use super::discrepancy::Ranges;
use super::linear_model::Sizes;
use super::muscle_prior::MusclePrior;
use super::resting_fiber::RestingFiber;
use super::search::{Budget, search};
use crate::effect::Effect;
use crate::fit::{Analysis, Fit};
use crate::forward_model::{FITTED_PER_MUSCLE, ForwardModel, Setting};
use crate::noise::{self, NoiseLevels};
pub use before_a_fit::Determinable;
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::ParameterBounds;
use noise_along_the_way::factors;
use state::{Around, ODDS, Reached, Start};
pub use state::{Begun, HandedOver, OtherMinimum, Session, State};

/// Sets whose neighbours are looked at around the model as given.
const FIRST_EXPANSIONS: usize = 6;
/// Effects that are tried alone from there: those that the linear model has lower the deviance most.
const ALONE: usize = 16;
/// Gauss–Newton steps from there.
const FIRST_STEPS: usize = 4;
/// Rounds of search, simulation of other sets, noise and relinearization, at most.
const ROUNDS: usize = 8;
/// Times that a descent goes on with the directions and the noise where it came to, at most.
const PASSES: usize = 2;
/// Share of the sizes' scales that is as good as nothing.
const NOTHING_ELSE: f64 = 0.02;
/// A set is the next only if it lowers −2 log posterior by more than this; a descent that promises less has settled, and
/// so has the EMG when a correction changes it by less.
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

    /// Estimates the session: many starts, of which the most probable is followed to its end.
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
        let found = starts.into_iter().find_map(|start| self.assessed(start, &candidates, &always).ok());
        let mut state = found.ok_or(SimulationError::NoiseCovariance)?;
        report(&format!("start {} {:.1?}", self.in_words(&state), clock.elapsed()));
        if !self.noise_is_final {
            let (set, sizes) = (self.places(&state.point.effects), self.sizes(&state).clone());
            self.choose_kernels(&mut state, &set, &sizes);
            self.noise_is_final = true;
            report(&format!("kernels {:?} {:.1?}", self.analysis.kernels, clock.elapsed()));
            let State { point, levels, directions, .. } = state;
            state = self.assessed(Start { point, levels, set, sizes, directions }, &candidates, &always)?;
            self.levels = state.levels;
        }
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
        mut state: State,
        candidates: &[usize],
        always: &[usize],
        report: &dyn Fn(&str),
    ) -> Result<(State, bool), SimulationError> {
        let (here, others) = self.other_minima(&state)?;
        let behind: Vec<f64> = others.iter().map(|other| other.deviance - here).collect();
        report(&format!("other minima {behind:.1?} behind"));
        let ahead = (0..others.len()).min_by(|a, b| behind[*a].total_cmp(&behind[*b]));
        if let Some(ahead) = ahead.filter(|i| behind[*i] < -SETTLED) {
            let start = others.into_iter().nth(ahead).map(|reached| reached.start(state.levels));
            let next = start.map(|start| self.assessed(start, candidates, always));
            if let Some(Ok(next)) = next {
                let (candidates, always) = (candidates.to_vec(), always.to_vec());
                return Ok((self.rounds(Begun { state: next, candidates, always }, report)?, true));
            }
            return Ok((state, false));
        }
        state.others =
            others.iter().zip(behind).map(|(other, behind)| self.other(&other.point, &state, behind)).collect();
        Ok((state, false))
    }

    /// Rounds from where an estimate has begun. Of the sets that are reached with a state's noise the most probable is
    /// the next whose noise is estimated; it is the state of the next round if it is ahead of the present one. The
    /// rounds end where the state's own set is the most probable.
    fn rounds(&self, begun: Begun, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let Begun { mut state, candidates, always } = begun;
        let clock = Instant::now();
        let mut visited: Vec<Vec<usize>> = Vec::new();
        'rounds: while visited.len() < ROUNDS {
            let own = self.places(&state.point.effects);
            let reached = self.advanced(&state, &candidates, &always)?;
            let of_own = reached.iter().find(|r| r.set == own).map_or(f64::INFINITY, |r| r.deviance);
            if !visited.contains(&own) {
                visited.push(own);
            }
            for next in reached.into_iter().take_while(|r| r.deviance < of_own) {
                if visited.contains(&next.set) || visited.len() == ROUNDS {
                    continue;
                }
                visited.push(next.set.clone());
                let fall = of_own - next.deviance;
                let next = self.assessed(next.start(state.levels), &candidates, &always)?;
                let (own, set) = (self.places(&state.point.effects), self.places(&next.point.effects));
                let ahead = 0.5 * (fall + self.deviance_with(&next, &own)? - self.deviance_with(&next, &set)?);
                report(&format!("round {} {:.1?}, ahead by {ahead:.1}", self.in_words(&next), clock.elapsed()));
                if ahead > 0.0 {
                    state = next;
                    continue 'rounds;
                }
            }
            break;
        }
        Ok(state)
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
        Ok(reached.into_iter().map(|r| r.start(levels)).collect())
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
