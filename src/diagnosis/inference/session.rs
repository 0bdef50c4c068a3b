//! The joint mode of a session: point, noise, discrepancy and the sets of effects that the data call for.

mod columns;
mod handing_over;
mod noise_along_the_way;
mod steps;

use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

use super::discrepancy::Ranges;
use super::excitation::Expected;
use super::linear_model::{LinearModel, Sizes};
use super::search::{Budget, Sets, search};
use crate::diagnosis::effect::Effect;
use crate::diagnosis::fit::{Analysis, Linear, Point};
use crate::diagnosis::forward_model::{ForwardModel, Setting};
use crate::diagnosis::noise::{self, NoiseLevels, TrialNoise};
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::ParameterBounds;

/// Prior scale of κ: what a laboratory has of every effect, as a share of what is plausible.
const EVERYTHING: f64 = 0.15;
/// Prior scale of the relative error of a muscle's moment.
const OF_MUSCLES: f64 = 0.08;
/// Prior scale of the moment that is left beside the muscles, in tenths of a newton metre at a wrist.
const OF_MOMENT: f64 = 0.5;
/// Prior odds that an effect is not missing.
const ODDS: f64 = 20.0;
/// Points that are followed from the model as given.
const STARTS: usize = 4;
/// Sets whose neighbours are looked at around the model as given.
const FIRST_EXPANSIONS: usize = 6;
/// Effects that are tried alone from there, those first that the linear model calls for most.
const SCREENED: usize = 12;
/// Gauss–Newton steps of these.
const FIRST_STEPS: usize = 3;
/// Rounds of search, simulation of other sets, noise and relinearization, at most.
const ROUNDS: usize = 4;
/// Gauss–Newton steps with a set of effects.
const STEPS: usize = 5;
/// Most probable sets beside the best that are tried by simulation.
const OTHERS: usize = 4;
/// Largest expected error of the logarithm of the EMG.
const LARGEST_NOISE: f64 = 0.7;
/// An effect may stand in another's place where the set with it has more than this share of the probability.
const STANDS_IN: f64 = 0.1;
/// Beyond this part of the way the joint mode itself is handed over.
const ALL_OF_IT: f64 = 0.9;
/// Of the sets that were tried in a round, those first whose noise is estimated anew.
const ASSESSED: usize = 3;
/// The estimate has settled when a round lowers −2 log posterior by less than this.
const SETTLED: f64 = 1.0;

/// An effect's columns in the linear model.
struct EffectColumns {
    amplitudes: Vec<usize>,
}

/// How noise enters all trials.
pub(crate) struct Passage {
    /// The EMG's by its response alone.
    bare: Vec<TrialNoise>,
    /// Per trial and muscle: what is expected of the EMG's error.
    expected: Vec<Vec<Expected>>,
    /// As the expected excitations leave it.
    noise: Vec<TrialNoise>,
}

/// What descents with several sets of effects start from.
struct Around<'s> {
    point: &'s Point,
    model: &'s LinearModel,
    sizes: &'s Sizes,
    noise: &'s Passage,
    factors: &'s [Cholesky<f64, Dyn>],
    directions: &'s [DMatrix<f64>],
}

/// Directions of a trial with the noise whitened, and their products.
struct WhitenedDirections {
    columns: DMatrix<f64>,
    products: DMatrix<f64>,
}

/// Where a descent with a set of effects has come to.
struct Reached {
    set: Vec<usize>,
    point: Point,
    sizes: Sizes,
    /// −2 log posterior, the noise held, up to a constant.
    deviance: f64,
}

/// A session being estimated.
pub struct Session<'a> {
    /// Trials, linearization.
    pub analysis: Analysis<'a>,
    ranges: Ranges,
    budget: Budget,
}

/// What is handed over to the user.
#[derive(Clone, Debug)]
pub struct HandedOver {
    /// Muscles.
    pub parameters: Vec<MuscleParameters>,
    /// Effects.
    pub effects: Vec<Setting>,
    /// How far it is from the model as given (0) to the joint mode (1).
    pub part: f64,
    /// Error of trials that were left out one at a time, at the joint mode, over that of the model as given.
    pub left_out_ratio: f64,
}

/// Where a round begins.
struct Start {
    point: Point,
    levels: NoiseLevels,
    set: Vec<usize>,
    sizes: Sizes,
}

/// Where the estimate stands.
pub struct State {
    /// −2 log posterior of the most probable set, up to a constant.
    pub deviance: f64,
    /// Muscles, effects, EMG.
    pub point: Point,
    /// Variances of the noise.
    pub levels: NoiseLevels,
    /// How noise enters every trial.
    pub(crate) noise: Passage,
    /// Factors of V.
    pub factors: Vec<Cholesky<f64, Dyn>>,
    /// Around the point.
    pub(crate) linear: Vec<Linear>,
    /// Directions of effects that are absent, and of the moment's discrepancy.
    pub directions: Vec<DMatrix<f64>>,
    /// The linear model.
    pub model: LinearModel,
    /// Sets of effects.
    pub sets: Sets,
}

impl<'a> Session<'a> {
    /// A session of training trials.
    pub fn new(
        forward: &'a ForwardModel,
        train: Vec<usize>,
        candidates: Vec<&'static dyn Effect>,
        bounds: &ParameterBounds,
        budget: Budget,
    ) -> Session<'a> {
        let ranges = Ranges::of(train.iter().map(|g| {
            let kinematics = forward.base(*g).kinematics();
            (&kinematics.angle[..], &kinematics.speed[..])
        }));
        let analysis = Analysis::without_data(forward, train, candidates, bounds, 0);
        Session { analysis, ranges, budget }
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
        let place = |id: &&str| self.analysis.candidates.iter().position(|c| c.description().id == *id);
        let always: Vec<usize> = always.iter().filter_map(place).collect();
        let candidates = if only { Vec::new() } else { self.testable() };
        let clock = std::time::Instant::now();
        let starts = self.starts(&candidates, &always)?;
        report(&format!("{} starts, {:.1?}", starts.len(), clock.elapsed()));
        let mut followed: Vec<State> = Vec::new();
        let mut kernels_are_known = false;
        for start in starts {
            let Ok(mut state) = self.assessed(start, &candidates, &always) else { continue };
            if !kernels_are_known {
                self.choose_kernels(&mut state);
                kernels_are_known = true;
                report(&format!("kernels {:?} {:.1?}", self.analysis.kernels, clock.elapsed()));
            }
            let next = self.advanced(&state, None)?.into_iter().next();
            if let Some(Ok(next)) = next.map(|start| self.assessed(start, &candidates, &always)) {
                state = next;
            }
            report(&format!("start {} {:.1?}", self.in_words(&state), clock.elapsed()));
            followed.push(state);
        }
        let mut best = followed.into_iter().min_by(|a, b| a.deviance.total_cmp(&b.deviance));
        for _ in 0..ROUNDS {
            let Some(state) = &best else { break };
            let next = self
                .advanced(state, Some((&candidates, &always)))?
                .into_iter()
                .filter_map(|start| self.assessed(start, &candidates, &always).ok())
                .min_by(|a, b| a.deviance.total_cmp(&b.deviance));
            let Some(next) = next else { break };
            report(&format!("round {} {:.1?}", self.in_words(&next), clock.elapsed()));
            let fall = state.deviance - next.deviance;
            if fall > 0.0 {
                best = Some(next);
            }
            if fall < SETTLED {
                break;
            }
        }
        best.ok_or(SimulationError::ParameterCount { found: 0, expected: 1 })
    }

    fn ids(&self, set: &[usize]) -> Vec<&'static str> {
        set.iter().map(|e| self.analysis.candidates[*e].description().id).collect()
    }

    fn in_words(&self, state: &State) -> String {
        let best = state.sets.best();
        format!(
            "{:?} deviance {:.1} of set {:.1} κ {:.3} σ {:.3?} levels {:.3?}",
            self.ids(&best.effects),
            state.deviance,
            best.deviance,
            best.sizes.everything,
            best.sizes.discrepancy,
            state.levels.0.map(f64::sqrt)
        )
    }

    /// Where to begin: from the model as given every effect alone, none, and what the linear model at that point calls for, each fitted with
    /// the same usual noise; the most probable first.
    fn starts(&mut self, candidates: &[usize], always: &[usize]) -> Result<Vec<Start>, SimulationError> {
        let levels = NoiseLevels::usual(self.forward().joint.strength);
        let mut point = self.analysis.nominal_point();
        self.start_at_expected(&mut point, &levels)?;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let passage = self.structure(&mut linear, &point, &levels);
        let directions;
        (directions, self.analysis.blocks) = self.analysis.calc_directions(&linear, &point)?;
        let factors = factors(&passage.noise, &levels);
        let model = self.model(&point, &self.all_columns(&linear, &directions), &factors);
        let sizes = model.usual_sizes();
        let found =
            search(&model, candidates, always, 2.0 * ODDS.ln(), &[], &sizes, Budget { expansions: FIRST_EXPANSIONS });
        let mut sets: Vec<Vec<usize>> = vec![always.to_vec(), found.best().effects.clone()];
        let with = |e: &usize| [always, &[*e]].concat();
        let mut alone: Vec<(f64, Vec<usize>)> = candidates
            .par_iter()
            .filter(|e| !always.contains(e))
            .map(|e| (model.posterior(&with(e), &sizes).deviance, with(e)))
            .collect();
        alone.sort_by(|a, b| a.0.total_cmp(&b.0));
        sets.extend(alone.into_iter().take(SCREENED).map(|(_, set)| set));
        sets.iter_mut().for_each(|s| s.sort_unstable());
        sets.dedup();
        let from = Around {
            point: &point,
            model: &model,
            sizes: &sizes,
            noise: &passage,
            factors: &factors,
            directions: &directions,
        };
        let mut reached: Vec<Reached> =
            sets.par_iter().with_max_len(1).filter_map(|set| self.reach(&from, set, FIRST_STEPS).ok()).collect();
        reached.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        reached.truncate(STARTS);
        Ok(reached.into_iter().map(|r| Start { point: r.point, levels, set: r.set, sizes: r.sizes }).collect())
    }

    /// Noise, linear model and sets at a point.
    fn assessed(&self, start: Start, candidates: &[usize], always: &[usize]) -> Result<State, SimulationError> {
        let Start { point, levels, set, sizes } = start;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let passage = self.structure(&mut linear, &point, &levels);
        let directions = self.analysis.calc_directions(&linear, &point)?.0;
        let columns = self.all_columns(&linear, &directions);
        let mut state = State {
            deviance: f64::INFINITY,
            model: self.model(&point, &columns, &factors(&passage.noise, &levels)),
            factors: Vec::new(),
            sets: Sets::none(),
            point,
            levels,
            noise: passage,
            linear,
            directions,
        };
        let regressors = Self::regressors(&state.model, &columns, &state.model.sds(&set, &sizes));
        state.levels = self.levels(&state.noise.noise, &regressors, levels);
        self.weigh(&mut state, &columns, &set, &sizes, candidates, always);
        Ok(state)
    }

    /// The linear model with the noise as it is, its sets and deviance.
    fn weigh(
        &self,
        state: &mut State,
        columns: &[DMatrix<f64>],
        set: &[usize],
        sizes: &Sizes,
        candidates: &[usize],
        always: &[usize],
    ) {
        state.factors = factors(&state.noise.noise, &state.levels);
        state.model = self.model(&state.point, columns, &state.factors);
        state.sets = search(&state.model, candidates, always, 2.0 * ODDS.ln(), &[set.to_vec()], sizes, self.budget);
        let determinant: f64 = state
            .factors
            .iter()
            .flat_map(|f| f.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).collect::<Vec<_>>())
            .sum();
        state.deviance = determinant + state.sets.best().deviance + noise::prior_deviance(&state.levels);
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

fn factors(noise: &[TrialNoise], levels: &NoiseLevels) -> Vec<Cholesky<f64, Dyn>> {
    noise.par_iter().filter_map(|n| noise::factor(n, levels)).collect()
}
