//! Single sets of effects: those that are more likely missing than not, and the same state with another set.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicUsize;

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::super::linear_model::{Prior, Sizes};
use super::super::muscles::Muscles;
use super::super::search::{Budget, NEGLIGIBLE};
use super::handing_over::STANDS_IN;
use super::state::{Begun, ODDS, OtherMinimum, Session, Start, State};
use super::steps::{STEPS, profiled};
use super::{ROUNDS, SETTLED};
use crate::ONE_BY_ONE;
use crate::addition::unidentifiable;
use crate::diagnose::LEVEL;
use crate::fit::{Analysis, Point};
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, ForwardModel};
use carpus_simulation::simulation::SimulationError;

/// Gauss–Newton steps towards moments that another model made.
const DISTANT_STEPS: usize = 12;

/// Whether it is more likely than not that an effect, or one that may stand in its place, is missing,
/// equation (30): the odds are at least what the odds of a single effect have to be, times by how much more
/// probable one of several is before the data.
///
/// - `group`: how many effects, `probability`: that one of them is missing
fn is_likely(group: usize, probability: f64) -> bool {
    probability >= least_odds(group) * (1.0 - probability)
}

/// The same by simulation, equation (33): −2 log posterior is larger by `behind` without the effect.
///
/// - `in_place`: how much more probable one of the group is than the effect itself
fn is_likely_by_simulation(group: usize, behind: f64, in_place: f64) -> bool {
    0.5 * behind + in_place.ln() >= least_odds(group).ln()
}

/// Odds that are asked of a group, equation (30).
fn least_odds(group: usize) -> f64 {
    ODDS * ((1.0 + 1.0 / ODDS).powi(i32::try_from(group).unwrap_or(i32::MAX)) - 1.0)
}

/// What rivals do in the place of a state's effects.
struct StandIns {
    /// Of effects: rivals that may stand in their place.
    of_effects: BTreeMap<usize, Vec<usize>>,
    /// Where they are.
    minima: Vec<OtherMinimum>,
    /// The most probable state of these, if it is ahead of that of the effects by more than rounds settle for.
    ahead: Option<State>,
}

impl Session<'_> {
    /// The state with the effects that are more likely missing than not, and no others (the median
    /// probability model; Barbieri & Berger 2004, doi:10.1214/009053604000000238), less those without which a
    /// state is ahead. And for each of the others, the strongest first, by how much −2 log posterior is
    /// larger where it is taken out and everything else is fitted anew. Where a rival in the place of one is
    /// ahead, rounds go on from there.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn likely(
        &self,
        mut state: State,
        report: &dyn Fn(&str),
    ) -> Result<(State, Vec<(usize, f64)>), SimulationError> {
        let candidates = self.testable();
        let (mut has_minima, mut exchanges) = (false, 0);
        let (mut evidence, stand_ins) = 'again: loop {
            let of = |effect: usize| {
                let (group, probability) = self.group(&state, effect);
                (probability, group.len(), effect)
            };
            let mut set: Vec<(f64, usize, usize)> = self.places(&state.point.effects).into_iter().map(of).collect();
            set.sort_by(|a, b| is_likely(a.1, a.0).cmp(&is_likely(b.1, b.0)).then(a.0.total_cmp(&b.0)));
            let (mut evidence, mut others) = (Vec::new(), Vec::new());
            for (probability, group, effect) in set {
                let rest: Vec<usize> = self.places(&state.point.effects).into_iter().filter(|e| *e != effect).collect();
                let mut without = self.with_set(&state, &rest, &[])?;
                let behind = self.behind(&without, &state);
                report(&format!("without {:?} ({probability:.2}) {behind:.1} behind", self.ids(&[effect])));
                let in_place = probability / state.sets.of_effect(effect).max(f64::MIN_POSITIVE);
                let is_likely =
                    is_likely(group, probability) || is_likely_by_simulation(group, behind, in_place.max(1.0));
                if (!is_likely || behind < 0.0) && !self.takes_what_is_left(&state, &without) {
                    let sizes = self.sizes(&without).clone();
                    self.weigh(&mut without, &rest, &sizes, &candidates, &[]);
                    (state, has_minima) = (without, false);
                    continue 'again;
                }
                others.push(self.other(&without, &state, behind));
                evidence.push((effect, behind));
            }
            let mut goes_on = false;
            if !has_minima {
                (state, goes_on) = self.beside_minima(state, &candidates, &[], report)?;
                has_minima = true;
            }
            if goes_on {
                continue;
            }
            state.others.extend(others);
            let mut stand_ins = self.stand_ins(&state, &candidates);
            let Some(mut ahead) = stand_ins.ahead.take().filter(|_| exchanges < ROUNDS) else {
                break (evidence, stand_ins);
            };
            report(&format!("exchanged for {:?}", self.ids(&self.places(&ahead.point.effects))));
            let (set, sizes) = (self.places(&ahead.point.effects), self.sizes(&ahead).clone());
            self.weigh(&mut ahead, &set, &sizes, &candidates, &[]);
            let begun = Begun { state: ahead, candidates: candidates.clone(), always: Vec::new() };
            state = self.rounds(begun, report)?;
            (has_minima, exchanges) = (false, exchanges + 1);
        };
        evidence.sort_by(|a, b| b.1.total_cmp(&a.1));
        state.stand_ins = stand_ins.of_effects;
        state.others.extend(stand_ins.minima);
        Ok((state, evidence))
    }

    /// The muscles alone, from where a session of the same trials has them, with the noise and the
    /// autocorrelations of this one if it has estimated them.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn taken_up(&mut self, muscles: &Muscles, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let Muscles { session, state, .. } = muscles;
        if !self.noise_is_final {
            let Analysis { kernels, times, blocks, .. } = &session.analysis;
            (self.analysis.kernels, self.analysis.times) = (*kernels, times.clone());
            self.analysis.blocks = blocks.clone();
            (self.levels, self.noise_is_final) = (state.levels, true);
        }
        let start = Start {
            point: state.point.clone(),
            levels: self.levels,
            set: Vec::new(),
            sizes: self.sizes(state).clone(),
            directions: state.directions.clone(),
        };
        let state = self.assessed(start, &[], &[])?;
        self.rounds(Begun { state, candidates: Vec::new(), always: Vec::new() }, report)
    }

    /// Whether something is left beside a state that is not left beside another.
    fn takes_what_is_left(&self, with: &State, without: &State) -> bool {
        let skip = unidentifiable(&self.analysis);
        let is_left = |state: &State| {
            self.analysis.anything_left(&self.as_fit(state), &skip).is_some_and(|left| left.p_value < LEVEL)
        };
        is_left(without) && !is_left(with)
    }

    /// Rivals of a state's effects that may stand in their place: with one of them instead, everything else
    /// estimated anew, −2 log posterior is larger by no more than the least probability of a group says.
    fn stand_ins(&self, state: &State, candidates: &[usize]) -> StandIns {
        let set = self.places(&state.point.effects);
        let rivals = |effect: usize| {
            let names = self.analysis.candidates[effect].description().rivals;
            let is_rival = |e: &usize| names.contains(&self.analysis.candidates[*e].description().id);
            candidates.iter().copied().filter(|e| !set.contains(e)).filter(is_rival).collect::<Vec<usize>>()
        };
        let pairs: Vec<(usize, usize)> =
            set.iter().flat_map(|effect| rivals(*effect).into_iter().map(|rival| (*effect, rival))).collect();
        let (sizes, here) = (self.sizes(state), state.model.posterior(&set, self.sizes(state)).deviance);
        let stands_in = |(effect, rival): &(usize, usize)| {
            let mut exchanged: Vec<usize> = set.iter().copied().filter(|e| e != effect).chain([*rival]).collect();
            exchanged.sort_unstable();
            if state.model.posterior(&exchanged, sizes).deviance - here > NEGLIGIBLE {
                return None;
            }
            // One that cannot be simulated in its place does not stand there.
            let other = self.with_set(state, &exchanged, &[]).ok()?;
            let behind = self.behind(&other, state);
            let minimum = (behind < -2.0 * STANDS_IN.ln()).then(|| self.other(&other, state, behind))?;
            Some((minimum, (behind < -SETTLED).then_some((behind, other))))
        };
        let found: Vec<Option<(OtherMinimum, Option<(f64, State)>)>> =
            pairs.par_iter().with_max_len(ONE_BY_ONE).map(stands_in).collect();
        let mut out = StandIns { of_effects: BTreeMap::new(), minima: Vec::new(), ahead: None };
        let mut least = 0.0;
        for ((effect, rival), found) in pairs.into_iter().zip(found) {
            let Some((minimum, ahead)) = found else { continue };
            out.of_effects.entry(effect).or_default().push(rival);
            out.minima.push(minimum);
            if let Some((behind, state)) = ahead.filter(|(behind, _)| *behind < least) {
                (least, out.ahead) = (behind, Some(state));
            }
        }
        out
    }

    /// The state with these effects and no others: muscles, effects and noise estimated anew.
    ///
    /// - `set`: places of the effects, ascending; `others`: of those that are weighed beside them
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn with_set(&self, state: &State, set: &[usize], others: &[usize]) -> Result<State, SimulationError> {
        let from = state.around(self.sizes(state));
        let reached = self.reach(&from, set, STEPS)?;
        self.assessed(reached.start(state.levels), others, if others.is_empty() { set } else { &[] })
    }

    /// Sizes that go with the effects of the point.
    pub(crate) fn sizes<'s>(&self, state: &'s State) -> &'s Sizes {
        let set = self.places(&state.point.effects);
        &state.sets.found.iter().find(|s| s.effects == set).unwrap_or(state.sets.best()).sizes
    }

    /// The same trials with other moments, of a model with effects that are on: nothing is estimated but
    /// these and the muscles.
    ///
    /// - `forward`: the model; `targets`: moments of every training trial [N·m]
    pub fn beside<'b>(
        &self,
        forward: &'b ForwardModel,
        effects: Vec<&'static dyn Effect>,
        targets: Vec<Vec<f64>>,
    ) -> Session<'b> {
        let analysis = Analysis {
            forward,
            train: self.analysis.train.clone(),
            candidates: effects,
            prior_sd: self.analysis.prior_sd,
            log_bounds: self.analysis.log_bounds,
            tied: self.analysis.tied.clone(),
            blocks: Vec::new(),
            times: self.analysis.times.clone(),
            kernels: self.analysis.kernels,
            seed: self.analysis.seed,
            targets: Some(targets),
            linearized: AtomicUsize::new(0),
        };
        Session::of(analysis, Budget::none())
    }

    /// Least distance of the session's moments from what its model can do: muscles and effects are fitted,
    /// the noise is a state's. Penalized sum of squares, beyond that of the state's muscles; its root
    /// [standard deviations].
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn distance(&self, start: Point, at: &State) -> Result<f64, SimulationError> {
        let set: Vec<usize> = (0..self.analysis.candidates.len()).collect();
        let sizes = Sizes { everything: 0.0, discrepancy: vec![0.0; self.analysis.n_muscles() + 1] };
        let mut point = start;
        let mut linear = self.linearized(&point, &at.noise, None)?;
        let amplitudes: usize = self.analysis.candidates.iter().map(|e| e.description().amplitudes().count()).sum();
        let directions: Vec<DMatrix<f64>> =
            linear.iter().map(|l| DMatrix::zeros(l.residual.len(), amplitudes)).collect();
        let (noise, factors) = (&at.noise, &at.factors);
        let model = self.descend(&mut point, &mut linear, noise, factors, &directions, &set, &sizes, DISTANT_STEPS)?;
        let own = self.analysis.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>();
        let muscles = 0..self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let of_state: f64 = muscles
            .map(|j| match at.model.priors[j] {
                Prior::Known(sd) => (at.model.offset[j] / sd).powi(2),
                _ => 0.0,
            })
            .sum();
        Ok((profiled(&model, own, &set, &sizes) - of_state).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_odds_by_simulation_are_those_of_a_single_effect() {
        assert!(is_likely_by_simulation(1, 0.01, 1.0) && !is_likely_by_simulation(1, -0.01, 1.0));
        // Of three that stand in each other's place each has a third of the probability.
        assert!(!is_likely_by_simulation(3, 0.01, 1.0) && is_likely_by_simulation(3, 0.2, 3.0));
    }

    #[test]
    fn verif_one_of_many_has_to_be_more_probable_than_one() {
        assert!(is_likely(1, 0.501) && !is_likely(1, 0.499));
        // Of thirty effects one is missing with 77 % before the data.
        assert!(!is_likely(30, 0.98) && is_likely(30, 0.99));
        assert!(is_likely(3, 1.0));
    }
}
