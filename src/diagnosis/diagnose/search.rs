//! The search for explanations: which effects, and which pairs, are fitted, and what that leaves.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::DVector;
use rayon::prelude::*;

use super::super::descent::Hopeless;
use super::super::effect::Effect;
use super::super::fit::{Fit, Point};
use super::super::forward_model::Setting;
use super::super::misfit::FARTHER;
use super::super::noise::NoiseLevels;
use super::super::score_test::{BlockScore, Omnibus};
use super::{
    Explanation, Judge, LEAST_SHARE, MUCH_NEARER, NEGLIGIBLE, REJECT_EXPLANATION, WIDENED, block, blocks_of, estimates,
    left_over, named_block, test,
};
use crate::simulation::SimulationError;
use crate::study::TrialUse;

/// An explanation with a smaller p-value is rejected although it cannot be told from one that is not.
const REJECT_IN_ANY_CASE: f64 = 0.002;
/// A pair explains what neither of its effects does if Q falls by more than this beside either: as for [`FARTHER`], and the second
/// effect is the best of thirty (2 ln 30).
const NEEDS_BOTH: f64 = FARTHER + 7.0;
/// A fit whose misfit is this much larger than the best is not followed to its end; a deeper valley beside one gains ten.
const FAR: f64 = 40.0;
/// A fit whose misfit is this much larger may as well be the best.
const HARDLY_WORSE: f64 = 20.0;
/// Below this pairwise z two effects cannot be told apart.
const INSEPARABLE: f64 = 2.0;
/// Candidates whose one-step fit leaves this much more misfit than the best are not fitted.
const HOPELESS: f64 = 0.4;
/// Single effects that pairs are made with: those of least misfit.
const PAIRED: usize = 10;
/// Pairs of which is foreseen what they leave: those of least misfit.
const FORESEEN_PAIRS: usize = 24;
/// Pairs that are fitted in any case: those of least misfit.
const FITTED_PAIRS: usize = 2;
/// So are so many of those that are foreseen to leave least …
const PROMISING_PAIRS: usize = 3;
/// … if they leave no direction of a smaller p-value.
const PROMISING: f64 = 1e-7;
/// Single effects that are fitted in any case, those of the highest scores …
const FITTED_SINGLES: usize = 4;
/// … and of so many those beside which, to first order, nothing of a p-value below `PROMISING` is left.
const PROMISING_SINGLES: usize = 8;
/// So are those whose own score has a smaller p-value …
const CALLED_FOR: f64 = 0.05;
/// … and beside which, to first order, what is left has a larger one: half of what an explanation is rejected at.
const MAY_SURVIVE: f64 = 0.5 * REJECT_EXPLANATION;
/// What the muscles or the noise have taken up of an effect its score does not show: all effects are fitted roughly from the model as
/// given, and of so many, those of the least misfit, what promises more than those that survived is fitted to the end.
const SECOND_CHOICE: usize = 5;
/// Explanations that are fitted from where the muscles of the nearest lie, at most.
const EXCHANGED_MUSCLES: usize = 3;
/// Effects that are fitted because they cannot be told from an explanation, at most.
const NEAR_RIVALS: usize = 4;
/// The same of seconds of a pair.
const SECOND_CHOICE_OF_PAIRS: usize = 2;
/// Pairs in which an effect is exchanged for one that cannot be told from it, at most.
const EXCHANGED: usize = 4;
/// Explanations that are fitted at the same time: none of them is given up early because another is much better.
const SIDE_BY_SIDE: usize = 2;

/// Adds an explanation; of two by the same effects the nearer stays.
fn keep_better(found: &mut Vec<(Fit, Explanation)>, explained: (Fit, Explanation)) {
    let of = |effects: &[&'static str]| BTreeSet::from_iter(effects.iter().copied());
    let same = |f: &&mut (Fit, Explanation)| of(&f.1.effects) == of(&explained.1.effects);
    match found.iter_mut().find(same) {
        Some(known) if known.1.misfit_fall >= explained.1.misfit_fall => {}
        Some(known) => *known = explained,
        None => found.push(explained),
    }
}

/// Least p-value of directions, each taken by itself.
fn least_p_value(left: &[BlockScore]) -> f64 {
    left.iter().map(|b| b.p_value).fold(1.0, f64::min)
}

/// An effect that was fitted, and a second that may be beside it.
struct Pair<'a> {
    /// How much nearer than without effects, to first order of both.
    misfit_fall: f64,
    /// Of the first.
    fit: &'a Fit,
    /// What the first leaves.
    left: Arc<[BlockScore]>,
    second: &'static dyn Effect,
}

impl Pair<'_> {
    fn is_reverse_of(&self, other: &Pair) -> bool {
        id_of_first(self.fit) == other.second.description().id && self.second.description().id == id_of_first(other.fit)
    }
}

fn id_of_first(fit: &Fit) -> &'static str {
    fit.point.effects[0].effect.description().id
}

impl Explanation {
    /// Whether nothing is left.
    pub(super) fn survives(&self) -> bool {
        self.p_value > REJECT_EXPLANATION
    }

    /// Whether it is of a plausible size and rejected, but by no more than chance does at times.
    fn is_rejected_within_chance(&self) -> bool {
        self.plausible && !self.survives() && self.p_value > REJECT_IN_ANY_CASE
    }

    /// Whether a pair explains what was missing: two effects of any size bend to much that is neither, so that one of implausible
    /// sizes, or one that hardly lowers the error, explains nothing.
    pub(super) fn explains(&self) -> bool {
        self.survives() && self.lowers_error()
    }

    /// Whether it lowers the error, its sizes being plausible.
    pub(super) fn lowers_error(&self) -> bool {
        self.plausible && self.error_fall >= NEGLIGIBLE
    }
}

impl Judge<'_> {
    /// Whether a rejected explanation cannot be told from one that survived: chance must not come between them.
    pub(super) fn goes_with(&self, left: &Omnibus, survivors: &[&'static str], rejected: &Explanation) -> bool {
        let rival = rejected.effects[0];
        rejected.p_value > REJECT_IN_ANY_CASE
            && !survivors.contains(&rival)
            && survivors.iter().any(|survivor| self.is_inseparable(left, survivor, rival))
    }

    /// Whether a rejected explanation is as near to moments and EMG as any that survived: the little that it leaves does not speak for those.
    pub(super) fn is_nearer_than_survivors(&self, own: &(Fit, Explanation), singles: &[(Fit, Explanation)]) -> bool {
        let mut survivors = singles.iter().filter(|s| s.1.survives() && s.1.plausible).peekable();
        let is_nearer = |s: &(Fit, Explanation)| self.analysis.farther_from(&own.0, &s.0).is_some_and(|f| f <= 0.0);
        own.1.is_rejected_within_chance() && survivors.peek().is_some() && survivors.all(is_nearer)
    }

    /// Whether a rejected explanation is not much farther from moments and EMG than those that survived, all of which are implausible.
    pub(super) fn stays_beside_the_implausible(
        &self,
        own: &(Fit, Explanation),
        singles: &[(Fit, Explanation)],
    ) -> bool {
        let mut survivors = singles.iter().filter(|s| s.1.survives()).peekable();
        let goes_beside = |s: &(Fit, Explanation)| !s.1.plausible && !self.analysis.is_farther(&own.0, &s.0, FARTHER);
        own.1.is_rejected_within_chance() && survivors.peek().is_some() && survivors.all(goes_beside)
    }

    /// Whether to first order an effect, of the size that its score asks for, cannot be told from a rival.
    fn is_inseparable(&self, left: &Omnibus, effect: &'static str, rival: &'static str) -> bool {
        self.one_step_z(left, effect, rival).is_some_and(|z| z < INSEPARABLE)
    }

    /// How far to first order an effect, of the size that its score asks for, is from a rival [standard deviations].
    fn one_step_z(&self, left: &Omnibus, effect: &'static str, rival: &'static str) -> Option<f64> {
        let size = block(left, effect).map(|b| &b.one_step)?;
        self.analysis.pairwise_z(self.null, effect, size, rival)
    }

    /// Leaves of explanations those whose p-value is not much smaller than the largest, or that cannot be told from the one of the
    /// largest, or that moments and EMG are nearer to.
    pub(super) fn drop_the_improbable(&self, left: &Omnibus, explanations: &mut Vec<(Fit, Explanation)>) {
        let most = explanations.iter().max_by(|a, b| a.1.p_value.total_cmp(&b.1.p_value));
        let Some((most, behind, best)) = most.map(|(_, e)| (e.p_value, e.misfit_behind, e.effects.clone())) else {
            return;
        };
        explanations.retain(|(_, e)| {
            let near = || match (best.as_slice(), e.effects.as_slice()) {
                ([best], [own]) => self.is_inseparable(left, best, own),
                _ => false,
            };
            e.p_value > LEAST_SHARE * most || e.misfit_behind < behind || near()
        });
    }

    /// Leaves of explanations those that moments and EMG are not much farther from than from any that no test rejects; these come first, of
    /// the same kind the nearest. Returns those that go.
    pub(super) fn drop_the_farther(&self, explanations: &mut Vec<(Fit, Explanation)>) -> Vec<Explanation> {
        let behind = |fit: &Fit, other: &Fit| self.analysis.farther_from(fit, other).unwrap_or(0.0);
        let farthest = |fit: &Fit| explanations.iter().map(|(other, _)| behind(fit, other)).fold(0.0, f64::max);
        let all: Vec<f64> = explanations.par_iter().map(|(fit, _)| farthest(fit)).collect();
        let Some(nearest) = (0..all.len()).min_by(|i, j| all[*i].total_cmp(&all[*j])) else {
            return Vec::new();
        };
        let nearest = explanations[nearest].0.clone();
        explanations.par_iter_mut().for_each(|(fit, e)| e.misfit_behind = behind(fit, &nearest));
        // One that is rejected, and is here for what it cannot be told from, drives out none that is not.
        let survivors: Vec<Fit> =
            explanations.iter().filter(|(_, e)| e.survives()).map(|(fit, _)| fit.clone()).collect();
        let others = if survivors.is_empty() { vec![nearest] } else { survivors };
        let is_farther = |fit: &Fit| others.iter().any(|other| self.analysis.is_farther(fit, other, FARTHER));
        let farther: Vec<bool> = explanations.par_iter().map(|(fit, _)| is_farther(fit)).collect();
        let mut farther = farther.into_iter();
        let gone = explanations.extract_if(.., |_| farther.next() == Some(true)).map(|(_, e)| e).collect();
        explanations.sort_by(|(_, a), (_, b)| {
            let nearer = a.misfit_behind.total_cmp(&b.misfit_behind).then(b.p_value.total_cmp(&a.p_value));
            b.survives().cmp(&a.survives()).then(nearer)
        });
        gone
    }

    /// Keeps of explanations by single effects those that moments and EMG are not much nearer to another of, even if that leaves
    /// something: what leaves nothing only because its noise may be larger explains nothing. Returns those that go.
    pub(super) fn keep_the_near(
        &self,
        explanations: &mut Vec<(Fit, Explanation)>,
        singles: &[(Fit, Explanation)],
    ) -> Vec<Explanation> {
        let Some((nearest, _)) = singles.iter().max_by(|a, b| a.1.misfit_fall.total_cmp(&b.1.misfit_fall)) else {
            return Vec::new();
        };
        for (fit, explanation) in explanations.iter_mut() {
            explanation.misfit_behind = self.analysis.farther_from(fit, nearest).unwrap_or(0.0);
        }
        let is_farther = |fit: &Fit| singles.iter().any(|(other, _)| self.analysis.is_farther(fit, other, MUCH_NEARER));
        explanations.extract_if(.., |(fit, _)| is_farther(fit)).map(|(_, e)| e).collect()
    }

    /// Whether a pair is nearer to moments and EMG than either of its effects alone, as far as that was fitted: much nearer than one that
    /// leaves only what chance may leave. Where noise passes so differently that the misfit alone may be chance, one that leaves more is
    /// farther if moments given the EMG say so, too: what lets more noise pass gains by the one and loses by the other.
    pub(super) fn needs_both(&self, pair: &(Fit, Explanation), singles: &[(Fit, Explanation)]) -> bool {
        let mut members = singles.iter().filter(|s| pair.1.effects.contains(&s.1.effects[0]));
        members.all(|(fit, e)| {
            let may_be_chance = e.p_value > REJECT_IN_ANY_CASE;
            let both = || {
                let by_misfit = self.analysis.farther_from(fit, &pair.0).unwrap_or(0.0);
                by_misfit.min(fit.deviance - pair.0.deviance) > MUCH_NEARER
            };
            self.analysis.is_farther(fit, &pair.0, if may_be_chance { MUCH_NEARER } else { NEEDS_BOTH })
                || (!may_be_chance && both())
        })
    }

    /// Every single effect that has a chance, fitted.
    pub(super) fn singles(&self, left: &Omnibus) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let mut found = Vec::new();
        let of = |blocks: &[BlockScore], e: &&'static dyn Effect| {
            named_block(blocks, e.description().id).map_or(0.0, |b| b.statistic)
        };
        let score = |e: &&'static dyn Effect| of(&left.blocks, e).max(of(&self.uncentred, e));
        let best = self.testable().map(|e| score(&e)).fold(0.0, f64::max);
        let mut ordered: Vec<_> = self.testable().collect();
        ordered.sort_by(|a, b| score(b).total_cmp(&score(a)));
        let hopeful = ordered.iter().take_while(|e| score(e) >= HOPELESS * best - 30.0).count().min(PROMISING_SINGLES);
        let promising = |e: &&'static dyn Effect| {
            let left = self.analysis.blocks_left_beside(self.null, e.description().id, self.not_testable);
            left.is_some_and(|left| least_p_value(&left) > PROMISING)
        };
        let (certain, others) = ordered[..hopeful].split_at(hopeful.min(FITTED_SINGLES));
        let others: Vec<_> = others.par_iter().copied().filter(promising).collect();
        // What may be far ahead of those of the highest scores comes first: they need not be followed to their end then.
        let screened = self.screened_anew(&[], SECOND_CHOICE);
        let comes_soon = |point: &Point| {
            let soon = certain.iter().take(SIDE_BY_SIDE);
            soon.map(|e| e.description().id).any(|id| id == point.effects[0].effect.description().id)
        };
        let ahead = usize::from(self.near.is_none() && screened.first().is_some_and(|first| !comes_soon(first)));
        let (ahead, others_anew) = screened.split_at(ahead);
        let go_on = self.explain_anew(ahead, &mut found)?;
        let wanted = certain.iter().chain(&others).map(|e| (&self.null.point, &left.blocks[..], *e)).collect();
        self.explain_all(wanted, &mut found)?;
        // Of the others, those that are called for and beside which to first order nothing is left: where little is missing, much
        // explains it.
        let beside = |e: &&'static dyn Effect| {
            self.analysis.anything_left_beside(self.null, e.description().id, self.not_testable)
        };
        let survives = |e: &&'static dyn Effect| {
            block(left, e.description().id).is_some_and(|b| b.p_value < CALLED_FOR)
                && beside(e).is_some_and(|left| left.p_value > MAY_SURVIVE)
        };
        let chosen: Vec<_> = ordered[hopeful..].par_iter().copied().filter(survives).collect();
        self.explain_near(left, chosen, &mut found)?;
        if go_on {
            self.explain_anew(others_anew, &mut found)?;
        }
        // Nor may the list lack what cannot be told from an explanation because its own score calls for it less.
        let near_rivals = self.unfitted_rivals(left, &found);
        self.explain_near(left, near_rivals, &mut found)?;
        if self.near.is_none() {
            self.exchange_muscles(&mut found)?;
        }
        Ok(found)
    }

    /// Fits explanations that are farther from moments and EMG than the nearest, though not by much, from where the muscles of that lie:
    /// moments bend with the lengths of muscles, and what lies between two fits may be that they came to rest in different valleys.
    fn exchange_muscles(&self, found: &mut Vec<(Fit, Explanation)>) -> Result<(), SimulationError> {
        let by_fall = |a: &&(Fit, Explanation), b: &&(Fit, Explanation)| a.1.misfit_fall.total_cmp(&b.1.misfit_fall);
        let Some((nearest, _)) = found.iter().max_by(by_fall).cloned() else { return Ok(()) };
        let best = self.analysis.misfit(&nearest, &self.null.levels);
        let behind = |(fit, e): &(Fit, Explanation)| {
            let behind = if e.survives() { self.analysis.farther_from(fit, &nearest)? } else { return None };
            let start = Point { effects: fit.point.effects.clone(), ..nearest.point.clone() };
            (behind > FARTHER && behind < FAR).then_some((behind, start))
        };
        let mut behind: Vec<(f64, Point)> = found.iter().filter_map(behind).collect();
        behind.sort_by(|a, b| a.0.total_cmp(&b.0));
        let starts: Vec<Point> = behind.into_iter().take(EXCHANGED_MUSCLES).map(|(_, start)| start).collect();
        for wave in starts.chunks(SIDE_BY_SIDE) {
            for explained in self.explain_side_by_side(wave, nearest.levels, best)? {
                keep_better(found, explained);
            }
        }
        Ok(())
    }

    /// Explanations by single effects beside the fit without any, of the sizes that their scores ask for.
    ///
    /// - `found`: explanations so far; of two by the same effects the nearer stays
    fn explain_near(
        &self,
        left: &Omnibus,
        wanted: Vec<&'static dyn Effect>,
        found: &mut Vec<(Fit, Explanation)>,
    ) -> Result<(), SimulationError> {
        let best = self.least_misfit(found);
        let explain = |effect: &'static dyn Effect| {
            let start = self.beside(&self.null.point, &left.blocks, effect);
            self.explain(start, self.null.levels, best)
        };
        for explained in wanted.into_par_iter().map(explain).collect::<Vec<_>>() {
            explained?.into_iter().for_each(|explained| keep_better(found, explained));
        }
        Ok(())
    }

    /// Effects that were not fitted and cannot, to first order, be told from one that survived: of so many the nearest.
    fn unfitted_rivals(&self, left: &Omnibus, found: &[(Fit, Explanation)]) -> Vec<&'static dyn Effect> {
        let survivors: Vec<&'static str> =
            found.iter().filter(|f| f.1.survives() && f.1.plausible).map(|f| f.1.effects[0]).collect();
        let z = |rival: &'static dyn Effect| {
            let of = |survivor: &&'static str| self.one_step_z(left, survivor, rival.description().id);
            survivors.iter().filter_map(of).fold(f64::INFINITY, f64::min)
        };
        let unfitted: Vec<_> =
            self.testable().filter(|e| !found.iter().any(|f| f.1.effects == [e.description().id])).collect();
        let mut near: Vec<_> = unfitted.into_par_iter().map(|e| (z(e), e)).filter(|(z, _)| *z < INSEPARABLE).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.into_iter().take(NEAR_RIVALS).map(|(_, e)| e).collect()
    }

    /// Explanations by an effect beside those at a point each, fitted on from there; from each shape that the effect names, the best.
    ///
    /// - `wanted`: point, what is left there, effect
    /// - `found`: explanations so far; of two by the same effects the nearer stays
    fn explain_all(
        &self,
        wanted: Vec<(&Point, &[BlockScore], &'static dyn Effect)>,
        found: &mut Vec<(Fit, Explanation)>,
    ) -> Result<(), SimulationError> {
        let starts = |(point, left, effect): (&Point, &[BlockScore], &'static dyn Effect)| {
            let further = effect.further_starts().iter().map(|values| {
                let mut start = point.clone();
                start.effects.push(self.request.forward.joint.at_neutral_angle(effect, values));
                start
            });
            std::iter::once(self.beside(point, left, effect)).chain(further).collect::<Vec<_>>()
        };
        let starts: Vec<Point> = wanted.into_iter().flat_map(starts).collect();
        for wave in starts.chunks(SIDE_BY_SIDE) {
            for explained in self.explain_side_by_side(wave, self.null.levels, self.least_misfit(found))? {
                keep_better(found, explained);
            }
        }
        Ok(())
    }

    /// Of explanations, where the noise is that of the fit without effects.
    fn least_misfit(&self, found: &[(Fit, Explanation)]) -> f64 {
        let misfits = found.par_iter().map(|(fit, _)| self.analysis.misfit(fit, &self.null.levels));
        misfits.reduce(|| f64::INFINITY, f64::min)
    }

    /// Explanations from points at the same time, those that can be fitted.
    fn explain_side_by_side(
        &self,
        starts: &[Point],
        levels: NoiseLevels,
        best: f64,
    ) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let explain = |start: &Point| self.explain(start.clone(), levels, best);
        let explained = starts.par_iter().with_max_len(1).map(explain).collect::<Vec<_>>();
        Ok(explained.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
    }

    /// Points with any effect beside others, fitted roughly from the model as given: without the effect the muscles may have gone far to
    /// make up for it, or what it does was taken for noise, and its score says little. The most promising first.
    ///
    /// - `others`: effects that are on, at sizes to start from
    /// - `count`: points, at most
    fn screened_anew(&self, others: &[Setting], count: usize) -> Vec<Point> {
        let is_on = |e: &&'static dyn Effect| others.iter().any(|s| s.effect.description().id == e.description().id);
        let start = Point { effects: others.to_vec(), ..self.analysis.nominal_point() };
        let further = self
            .testable()
            .filter(|e| !is_on(e))
            .flat_map(|e| Setting::starts(e, &self.request.forward.joint))
            .collect();
        self.analysis.screened(&start, further, count).into_iter().take(count).collect()
    }

    /// Explanations from such points, followed to their end: those that promise more than what survived so far. Returns whether further
    /// ones may.
    ///
    /// - `found`: explanations so far; of two by the same effects the nearer stays
    fn explain_anew(&self, screened: &[Point], found: &mut Vec<(Fit, Explanation)>) -> Result<bool, SimulationError> {
        let levels = NoiseLevels::usual(self.request.forward.joint.strength);
        let same = |f: &Explanation, point: &Point| {
            let has = |s: &Setting| f.effects.contains(&s.effect.description().id);
            f.effects.len() == point.effects.len() && point.effects.iter().all(has)
        };
        let survived =
            |found: &[(Fit, Explanation)], point: &Point| found.iter().any(|f| f.1.survives() && same(&f.1, point));
        // What is left of a pair that chance may have rejected may be the muscles' doing that it was fitted beside.
        let is_doubtful = |f: &Explanation| f.effects.len() > 1 && f.is_rejected_within_chance();
        let known = |found: &[(Fit, Explanation)], point: &Point| {
            found.iter().any(|f| same(&f.1, point) && !is_doubtful(&f.1) && self.is_near(&f.0, point))
        };
        for wave in screened.chunks(SIDE_BY_SIDE) {
            let promising = wave.iter().take_while(|point| !survived(found, point)).count();
            let wanted: Vec<Point> = wave[..promising].iter().filter(|point| !known(found, point)).cloned().collect();
            for anew in self.explain_side_by_side(&wanted, levels, self.least_misfit(found))? {
                keep_better(found, anew);
            }
            if promising < wave.len() {
                return Ok(false);
            }
        }
        // Of those that come next none promises more than one that survives by now.
        Ok(screened.last().is_none_or(|last| !survived(found, last)))
    }

    /// Whether a point's effects, the same as a fit's, are of the sizes that the fit found, to within its standard errors.
    fn is_near(&self, fit: &Fit, point: &Point) -> bool {
        let errors = fit.covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
        let parameters = |s: &'_ Setting| s.effect.description().parameters.iter().enumerate();
        let columns = fit.point.effects.iter().flat_map(|s| parameters(s).map(move |(i, p)| (s, i, p)));
        columns.zip(errors.iter()).all(|((own, i, p), error)| {
            let same = |s: &&Setting| s.effect.description().id == own.effect.description().id;
            let reach = error * self.request.forward.joint.scale(p);
            point.effects.iter().find(same).is_some_and(|other| (own.values[i] - other.values[i]).abs() <= reach)
        })
    }

    /// A point with a further effect, of the size that its score asks for.
    fn beside(&self, point: &Point, left: &[BlockScore], effect: &'static dyn Effect) -> Point {
        let mut setting = self.request.forward.joint.absent(effect);
        let description = effect.description();
        if let Some(score) = named_block(left, description.id) {
            for (i, p) in description.amplitudes().enumerate() {
                setting.values[p] =
                    score.one_step[i].clamp(-5.0, 5.0) * self.request.forward.joint.scale(&description.parameters[p]);
            }
        }
        let mut start = point.clone();
        start.effects.push(setting);
        start
    }

    /// Pairs of the leading candidates, where the first was fitted and the second is asked for by its score: those beside which to
    /// first order least is left.
    pub(super) fn pairs<'a>(
        &self,
        singles: &'a [(Fit, Explanation)],
    ) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let mut leaders: Vec<&(Fit, Explanation)> = singles.iter().collect();
        leaders.sort_by(|a, b| b.1.misfit_fall.total_cmp(&a.1.misfit_fall));
        leaders.truncate(PAIRED);
        let left_of: Vec<_> =
            leaders.par_iter().map(|(fit, _)| blocks_of(self.analysis, fit, self.not_testable)).collect();
        let mut pairs: Vec<Pair<'a>> = Vec::new();
        for ((fit, explanation), blocks) in leaders.iter().zip(left_of) {
            let blocks: Arc<[BlockScore]> = blocks?.into();
            for second in self.testable().filter(|e| e.description().id != id_of_first(fit)) {
                let gain = named_block(&blocks, second.description().id).map_or(0.0, |b| b.statistic);
                let pair = Pair { misfit_fall: explanation.misfit_fall + gain, fit, left: Arc::clone(&blocks), second };
                match pairs.iter_mut().find(|p| p.is_reverse_of(&pair)) {
                    Some(known) if known.misfit_fall >= pair.misfit_fall => {}
                    Some(known) => *known = pair,
                    None => pairs.push(pair),
                }
            }
        }
        pairs.sort_by(|a, b| b.misfit_fall.total_cmp(&a.misfit_fall));
        pairs.truncate(FORESEEN_PAIRS);
        let foreseen = |pair: Pair<'a>| {
            let id = pair.second.description().id;
            let left = self.analysis.blocks_left_beside(pair.fit, id, self.not_testable);
            (left.map_or(0.0, |left| least_p_value(&left)), pair)
        };
        let mut pairs: Vec<_> = pairs.into_par_iter().map(foreseen).collect();
        let mut others = pairs.split_off(FITTED_PAIRS.min(pairs.len()));
        others.retain(|p| p.0 > PROMISING);
        others.sort_by(|a, b| b.0.total_cmp(&a.0));
        let wanted = pairs.iter().chain(others.iter().take(PROMISING_PAIRS));
        let wanted = wanted.map(|(_, pair)| (&pair.fit.point, &*pair.left, pair.second)).collect();
        let mut found = Vec::new();
        self.explain_all(wanted, &mut found)?;
        // One that feeds back takes several times as long to fit.
        let quick = leaders.iter().find(|l| {
            !l.0.point.effects[0].effect.feeds_back() && l.1.misfit_fall > leaders[0].1.misfit_fall - HARDLY_WORSE
        });
        if let Some((leader, _)) = quick.or(leaders.first())
            && self.near.is_none()
            && !found.iter().any(|f| f.1.explains())
        {
            let screened = self.screened_anew(&leader.point.effects, SECOND_CHOICE_OF_PAIRS);
            self.explain_anew(&screened, &mut found)?;
        }
        Ok(found)
    }

    /// Pairs in which one effect of a pair that explains is exchanged for one that cannot be told from it.
    ///
    /// - `pairs`: that explain; `fitted`: all that were fitted
    pub(super) fn exchanged(
        &self,
        pairs: &[(Fit, Explanation)],
        fitted: &[(Fit, Explanation)],
    ) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let mut starts: Vec<Point> = Vec::new();
        let ids = |effects: &[Setting]| BTreeSet::from_iter(effects.iter().map(|s| s.effect.description().id));
        for (fit, explanation) in pairs {
            for (i, own) in fit.point.effects.iter().enumerate() {
                let is_rival = |e: &&'static dyn Effect| {
                    let rival = e.description().id;
                    !explanation.effects.contains(&rival) && self.cannot_be_told_from(own, rival)
                };
                for rival in self.testable().filter(is_rival) {
                    let mut start = fit.point.clone();
                    start.effects[i] = self.request.forward.joint.absent(rival);
                    let wanted = ids(&start.effects);
                    let known = fitted.iter().any(|f| ids(&f.0.point.effects) == wanted)
                        || starts.iter().any(|s| ids(&s.effects) == wanted);
                    if !known {
                        starts.push(start);
                    }
                }
            }
        }
        starts.truncate(EXCHANGED);
        let mut found = Vec::new();
        for wave in starts.chunks(SIDE_BY_SIDE) {
            found.extend(self.explain_side_by_side(wave, self.null.levels, f64::INFINITY)?);
        }
        Ok(found)
    }

    /// Whether to first order an effect of the size that was found for it cannot be told from a rival.
    fn cannot_be_told_from(&self, own: &Setting, rival: &'static str) -> bool {
        let description = own.effect.description();
        let joint = &self.request.forward.joint;
        let sizes = description.amplitudes().map(|i| {
            let p = &description.parameters[i];
            own.values[i] / joint.scale(p)
        });
        let size = DVector::from_iterator(description.amplitudes().count(), sizes);
        self.analysis.pairwise_z(self.null, description.id, &size, rival).is_some_and(|z| z < INSEPARABLE)
    }

    /// Fits the effects at a point jointly with the muscles and asks what is left; `None` if they cannot be fitted, or if one of
    /// them is no larger than what noise has of it in any case.
    ///
    /// - `best`: least misfit of an explanation so far; one that stays far behind it is not followed to its end
    fn explain(
        &self,
        start: Point,
        levels: NoiseLevels,
        best: f64,
    ) -> Result<Option<(Fit, Explanation)>, SimulationError> {
        let effects = start.effects.iter().map(|s| s.effect.description().id).collect();
        // Sizes at which a muscle cannot be simulated explain nothing.
        let hopeless = Hopeless { best, by: FAR, levels: self.null.levels, skip: self.not_testable };
        // One that feeds back takes several times as long to fit: only if it is ahead of all.
        let deeper = match start.effects.as_slice() {
            [only] if only.effect.feeds_back() => best,
            [_] => best + FAR,
            _ => f64::NEG_INFINITY,
        };
        let Ok(fit) = self.analysis.refit(start, levels, self.near, Some(hopeless), deeper) else { return Ok(None) };
        if fit.is_within_noise() {
            return Ok(None);
        }
        let Ok(with) = test(self.analysis, &fit, self.not_testable) else { return Ok(None) };
        let parameters = estimates(&fit, self.request.forward);
        // An implausible size is not excused by what makes intervals wide.
        let plausible = parameters.values().all(|p| p.reaches_plausible(1.0 / WIDENED));
        // Nor do those at which a trial cannot be simulated that was not fitted.
        let (Ok(held_out_error), Ok(train_error)) =
            (self.error_of(&fit, TrialUse::Test), self.error_of(&fit, TrialUse::Train))
        else {
            return Ok(None);
        };
        let (p_value, left) = (with.p_value, left_over(&with));
        let deviance_fall = self.null.deviance - fit.deviance;
        let misfit_fall = self.analysis.farther_from(self.null, &fit).unwrap_or(f64::NEG_INFINITY);
        let error_fall = 1.0 - train_error.unwrap_or(self.refit_error) / self.refit_error;
        let explanation = Explanation {
            effects,
            p_value,
            deviance_fall,
            misfit_fall,
            misfit_behind: 0.0,
            error_fall,
            held_out_error,
            plausible,
            parameters,
            left,
        };
        Ok(Some((fit, explanation)))
    }
}
