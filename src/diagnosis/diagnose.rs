//! The diagnosis of one participant: which single effects, or pairs, explain what the model misses.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::baselines::Ingredients;
use super::catalogue::CATALOGUE;
use super::effect::{Effect, Role};
use super::fit::{Analysis, Fit, Point};
use super::forward_model::{ForwardModel, Setting};
use super::noise::{Kernels, NoiseLevels};
use super::score_test::{BlockScore, Omnibus};
use super::where_it_fails::{AxisResult, along_axes};
use crate::simulation::SimulationError;
use crate::study::{Direction, ParameterBounds, TrialUse};

/// A null model with a smaller p-value is rejected.
pub const REJECT_NULL: f64 = 0.05;
/// A direction with a smaller p-value (that knows the variances to be estimates, times the number of directions) is no matter of
/// misjudged variances.
const BEYOND_DOUBT: f64 = 1e-4;
/// An explanation with a smaller p-value is rejected: laxer than 0.05, so that the true one stays in at least 95 of 100 times.
pub const REJECT_EXPLANATION: f64 = 0.02;
/// An explanation with a smaller p-value is rejected although it cannot be told from one that is not.
const REJECT_IN_ANY_CASE: f64 = 0.002;
/// Where the model without effects leaves a larger score than this, fits start from the model as given too.
const LARGE: f64 = 40.0;
/// A fit whose deviance is this much larger than the best is not followed to its end.
const FAR: f64 = 150.0;
/// Explanations that are fitted again from the model as given.
const TRIED_AGAIN: usize = 3;
/// Below this pairwise z two effects cannot be told apart.
const INSEPARABLE: f64 = 2.0;
/// An effect whose signature keeps less than this share once muscle parameters are fitted cannot be tested.
const TESTABLE: f64 = 0.01;
/// z that an effect needs to be found with a probability of about 80 % among all others.
const DETECTABLE_Z: f64 = 4.2;
/// A detected effect that lowers the training error by less than this share is negligible.
const NEGLIGIBLE: f64 = 0.02;
/// Candidates whose one-step fit leaves this much more deviance than the best are not fitted.
const HOPELESS: f64 = 0.4;
/// Candidates for pairs.
const PAIRED: usize = 6;
/// Pairs that are fitted.
const FITTED_PAIRS: usize = 4;
/// Directions that are reported as left over.
const SHOWN: usize = 3;
/// Single effects that are fitted in any case, those of the highest scores.
const FITTED_SINGLES: usize = 8;
/// So are those whose own score has a smaller p-value …
const CALLED_FOR: f64 = 0.05;
/// … and beside which, to first order, what is left has a larger one: half of what an explanation is rejected at.
const MAY_SURVIVE: f64 = 0.5 * REJECT_EXPLANATION;
/// Where all of these are rejected the model without effects is far off, and its scores say little about which effect is
/// missing: all others are fitted roughly, and so many of them, of the least deviance, to the end.
const SECOND_CHOICE: usize = 5;

/// What the data say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// One effect explains the data.
    Identified,
    /// No single effect does; one pair does.
    TwoEffects,
    /// Several explanations survive.
    CannotTell,
    /// The muscle parameters alone explain the data.
    NothingDetectable,
    /// Something is there but hardly matters.
    Negligible,
    /// Nothing in the catalogue explains the data.
    Unknown,
    /// Only with implausible sizes do single effects explain the data.
    Implausible,
}

/// A parameter of an explanation.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterEstimate {
    /// Estimate.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Plausible range.
    pub plausible: [f64; 2],
}

/// Effects that, fitted jointly with the muscles, leave nothing.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// Effects.
    pub effects: Vec<&'static str>,
    /// p-value of "nothing is left".
    pub p_value: f64,
    /// How much less −2 log posterior it leaves than the model without effects.
    pub deviance_fall: f64,
    /// RMSE over held-out trials / session MVC moment.
    pub held_out_error: Option<f64>,
    /// Every interval overlaps its plausible range.
    pub plausible: bool,
    /// Parameters by `effect.parameter`.
    pub parameters: BTreeMap<String, ParameterEstimate>,
    /// What the data would rather have beside it: the directions of smallest p-value.
    pub left: Vec<Left>,
}

/// A direction in which something may be left after a fit.
#[derive(Clone, Debug, Serialize)]
pub struct Left {
    /// Effect, or axis of lack of fit.
    pub direction: String,
    /// p-value of this direction alone.
    pub p_value: f64,
    /// Its one-step sizes, in units of its scales.
    pub size: Vec<f64>,
}

/// A candidate of the catalogue.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Effect.
    pub effect: &'static str,
    /// p-value that nothing is left once it is fitted; `None` if it was not fitted.
    pub p_value: Option<f64>,
    /// p-value of its own score test on the model without effects.
    pub score_p_value: f64,
    /// Its score statistic T.
    pub score: f64,
    /// Share of its signature that fitting the muscles leaves.
    pub kept: f64,
    /// Once fitted: how much less −2 log posterior it leaves than the model without effects.
    pub deviance_fall: Option<f64>,
    /// Smallest size that would be found, per amplitude, in the parameter's unit (for changes of a muscle's property: as
    /// a share of it).
    pub detectable_size: BTreeMap<&'static str, f64>,
    /// RMSE over held-out trials / session MVC moment, once fitted.
    pub held_out_error: Option<f64>,
    /// Parameters, once fitted.
    pub parameters: BTreeMap<String, ParameterEstimate>,
    /// Once fitted: what the data would rather have beside it.
    pub left: Vec<Left>,
}

/// Errors step by step.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Steps {
    /// The model as given.
    pub base: f64,
    /// Muscle parameters fitted.
    pub refit_only: f64,
    /// With the best explanation, if there is one.
    pub with_effect: Option<f64>,
}

/// Errors.
#[derive(Clone, Debug, Serialize)]
pub struct Errors {
    /// Training trials.
    pub train: Steps,
    /// Held-out trials.
    pub held_out: Option<Steps>,
    /// What noise alone would leave.
    pub noise_floor: f64,
    /// What is measured.
    pub measure: &'static str,
}

/// How well two effects can be told apart.
#[derive(Clone, Debug, Serialize)]
pub struct Confusion {
    /// The effect taken to be true.
    pub truth: &'static str,
    /// Its rival.
    pub rival: &'static str,
    /// |effect| · length of its signature once muscles and the rival are fitted, in standard deviations.
    pub z: f64,
}

/// The diagnosis of one participant.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// Version of this format.
    pub schema: &'static str,
    /// Participant.
    pub participant: String,
    /// What the data say.
    pub verdict: Verdict,
    /// p-value of the model without effects: the larger of those by the normal law and by sign flips of whole trials; that by
    /// the normal law alone where a direction is beyond doubt.
    pub null_p_value: f64,
    /// That by sign flips of whole trials alone.
    pub null_sign_flip_p_value: f64,
    /// The confidence set.
    pub explanations: Vec<Explanation>,
    /// Effects that were fitted jointly with the muscles and rejected.
    pub ruled_out: Vec<&'static str>,
    /// Effects that can be tested and were not fitted: nothing was rejected, or their scores leave them no chance.
    pub not_fitted: Vec<&'static str>,
    /// Effects that these data cannot test.
    pub not_testable: Vec<&'static str>,
    /// Errors.
    pub error: Errors,
    /// All candidates.
    pub candidates: Vec<Candidate>,
    /// Pairwise separability of the leading candidates.
    pub confusion: Vec<Confusion>,
    /// Residual of the refitted model along every axis.
    pub where_it_fails: Vec<AxisResult>,
    /// Standard deviations of the noise: white and slow moment [N·m], EMG envelope, gain per trial (relative), baseline.
    pub noise: BTreeMap<&'static str, f64>,
    /// How noise of the EMG's envelope and of the moment goes with itself in time.
    pub noise_correlation: Kernels,
}

/// What to diagnose.
pub struct Request<'a> {
    /// Name of the participant.
    pub participant: String,
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// Bounds of the muscle parameters: priors.
    pub bounds: ParameterBounds,
    /// Effects to consider; empty: all.
    pub candidates: Vec<&'static dyn Effect>,
    /// Largest moment of the session [N·m].
    pub mvc: f64,
    /// Seed of random draws.
    pub seed: u64,
}

/// A diagnosis and the fit of its best explanation.
pub struct Outcome {
    /// The account.
    pub diagnosis: Diagnosis,
    /// Fit without effects.
    pub refit: Fit,
    /// Fit of the first explanation.
    pub best: Option<Fit>,
    /// What baselines need.
    pub ingredients: Ingredients,
}

/// Diagnoses one participant.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn diagnose(request: &Request) -> Result<Outcome, SimulationError> {
    let forward = request.forward;
    let all: Vec<&'static dyn Effect> =
        if request.candidates.is_empty() { CATALOGUE.to_vec() } else { request.candidates.clone() };
    let train = forward.trials_for(TrialUse::Train);
    let (analysis, null) = Analysis::new(forward, train, all, &request.bounds, request.seed)?;
    let first = test(&analysis, &null, &[])?;
    let not_testable: Vec<&'static str> = analysis
        .candidates
        .iter()
        .map(|e| e.description())
        .filter(|d| d.unidentifiable.is_some() || block(&first, d.id).is_none_or(|b| b.kept < TESTABLE || b.rank == 0))
        .map(|d| d.id)
        .collect();
    let left = test(&analysis, &null, &not_testable)?;
    let uncentred = analysis.anything_left_uncentred(&null, &not_testable).unwrap_or_else(|| left.clone());
    let judge = Judge { request, analysis: &analysis, null: &null, not_testable: &not_testable, uncentred };
    // To say that something is missing both laws of the scores must agree: where variances are misjudged one of them cries wolf.
    // Flips of few trials cannot give small p-values, though: what no misjudged variance explains needs them not.
    let surely = left.blocks.iter().any(|b| b.p_value * (left.blocks.len() as f64) < BEYOND_DOUBT);
    let null_p_value = if surely { left.p_value } else { left.p_value.max(left.sign_flip_p_value) };
    let rejected = null_p_value < REJECT_NULL;
    let singles = if rejected { judge.singles(&left)? } else { Vec::new() };
    let mut explanations: Vec<(Fit, Explanation)> =
        singles.iter().filter(|s| s.1.p_value > REJECT_EXPLANATION).cloned().collect();
    let survivors: Vec<&'static str> = explanations.iter().map(|e| e.1.effects[0]).collect();
    explanations.extend(singles.iter().filter(|s| judge.goes_with(&left, &survivors, &s.1)).cloned());
    if rejected && explanations.is_empty() {
        // Two effects of any size bend to much that is neither: a pair of implausible sizes explains nothing.
        let explains = |s: &(Fit, Explanation)| s.1.p_value > REJECT_EXPLANATION && s.1.plausible;
        explanations = judge.pairs(&singles)?.into_iter().filter(explains).collect();
    }
    let implausible = !explanations.is_empty() && explanations.iter().all(|e| !e.1.plausible);
    if !implausible {
        explanations.retain(|e| e.1.plausible);
    }
    explanations.sort_by(|a, b| a.0.deviance.total_cmp(&b.0.deviance));
    let best = explanations.first().map(|e| e.0.clone());
    let error = judge.errors(&null, best.as_ref())?;
    let fall = error.train.with_effect.map_or(0.0, |with| 1.0 - with / error.train.refit_only);
    let verdict = match explanations.as_slice() {
        _ if !rejected => Verdict::NothingDetectable,
        [] => Verdict::Unknown,
        _ if implausible => Verdict::Implausible,
        _ if fall < NEGLIGIBLE => Verdict::Negligible,
        [only] if only.1.effects.len() == 2 => Verdict::TwoEffects,
        [_] => Verdict::Identified,
        _ => Verdict::CannotTell,
    };
    let kept: Vec<&str> = explanations.iter().flat_map(|e| e.1.effects.clone()).collect();
    let ids = || analysis.candidates.iter().map(|e| e.description().id);
    let fitted: Vec<&str> = singles.iter().flat_map(|s| s.1.effects.clone()).collect();
    let ruled_out = ids().filter(|id| fitted.contains(id) && !kept.contains(id)).collect();
    let not_fitted =
        ids().filter(|id| !fitted.contains(id) && !kept.contains(id) && !not_testable.contains(id)).collect();
    let residuals = judge.residuals(&null)?;
    let diagnosis = Diagnosis {
        schema: "carpus.diagnosis/1",
        participant: request.participant.clone(),
        verdict,
        null_p_value,
        null_sign_flip_p_value: left.sign_flip_p_value,
        candidates: judge.candidates(&first, &singles),
        confusion: judge.confusion(&null, &left),
        explanations: explanations.into_iter().map(|e| e.1).collect(),
        ruled_out,
        not_fitted,
        not_testable,
        error,
        where_it_fails: along_axes(forward, &residuals, &left),
        noise: named(&best.as_ref().unwrap_or(&null).levels, &analysis),
        noise_correlation: analysis.kernels,
    };
    let ingredients = Ingredients::of(&analysis, &null);
    Ok(Outcome { diagnosis, refit: null, best, ingredients })
}

/// Standard deviations by name; slow disturbances of the directions of effort that there are trials of.
fn named(levels: &NoiseLevels, analysis: &Analysis) -> BTreeMap<&'static str, f64> {
    let [envelope, gain, floor] = levels.of_emg();
    let named = [
        ("moment_white_n_m", levels.white()),
        ("emg_envelope", envelope),
        ("emg_gain_per_trial", gain),
        ("emg_baseline", floor),
    ];
    let slow = analysis.train.iter().map(|g| {
        let direction = analysis.forward.trials[*g].info.direction;
        let name = match direction {
            Direction::Flexion => "moment_slow_flexion_n_m",
            Direction::Extension => "moment_slow_extension_n_m",
            Direction::None => "moment_slow_no_direction_n_m",
        };
        (name, levels.slow(direction))
    });
    named.into_iter().chain(slow).map(|(name, variance)| (name, variance.sqrt())).collect()
}

fn test(analysis: &Analysis, fit: &Fit, skip: &[&str]) -> Result<Omnibus, SimulationError> {
    analysis.anything_left(fit, skip).ok_or(SimulationError::ParameterCount { found: 0, expected: 1 })
}

/// The directions of smallest p-value.
fn left_over(omnibus: &Omnibus) -> Vec<Left> {
    let mut blocks: Vec<&BlockScore> = omnibus.blocks.iter().filter(|b| b.rank > 0).collect();
    blocks.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let of = |b: &&BlockScore| Left {
        direction: b.name.clone(),
        p_value: b.p_value,
        size: b.one_step.iter().copied().collect(),
    };
    blocks.iter().take(SHOWN).map(of).collect()
}

fn block<'a>(omnibus: &'a Omnibus, name: &str) -> Option<&'a BlockScore> {
    omnibus.blocks.iter().find(|b| b.name == name)
}

struct Judge<'a> {
    request: &'a Request<'a>,
    analysis: &'a Analysis<'a>,
    null: &'a Fit,
    not_testable: &'a [&'static str],
    /// Scores of the null, their means left in.
    uncentred: Omnibus,
}

impl Judge<'_> {
    fn testable(&self) -> impl Iterator<Item = &'static dyn Effect> + '_ {
        self.analysis.candidates.iter().copied().filter(|e| !self.not_testable.contains(&e.description().id))
    }

    /// Whether a rejected explanation cannot be told from one that survived: chance must not come between them.
    fn goes_with(&self, left: &Omnibus, survivors: &[&'static str], rejected: &Explanation) -> bool {
        let rival = rejected.effects[0];
        rejected.p_value > REJECT_IN_ANY_CASE
            && !survivors.contains(&rival)
            && survivors.iter().any(|survivor| {
                let size = block(left, survivor).map(|b| &b.one_step);
                let z = size.and_then(|size| self.analysis.pairwise_z(self.null, survivor, size, rival));
                z.is_some_and(|z| z < INSEPARABLE)
            })
    }

    /// Every single effect that has a chance, fitted.
    fn singles(&self, left: &Omnibus) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let of = |omnibus: &Omnibus, e: &&'static dyn Effect| {
            block(omnibus, e.description().id).map_or(0.0, |b| b.statistic)
        };
        let score = |e: &&'static dyn Effect| of(left, e).max(of(&self.uncentred, e));
        let best = self.testable().map(|e| score(&e)).fold(0.0, f64::max);
        let mut ordered: Vec<_> = self.testable().collect();
        ordered.sort_by(|a, b| score(b).total_cmp(&score(a)));
        let hopeful = ordered.iter().take_while(|e| score(e) >= HOPELESS * best - 30.0).count().min(FITTED_SINGLES);
        let far_off = self.far_off(left);
        let fitted = |some: &[&'static dyn Effect], before: &[(Fit, Explanation)]| {
            let wanted = some.iter().map(|e| (&self.null.point, left, *e)).collect();
            self.explain_all(wanted, far_off, before)
        };
        let mut found = fitted(&ordered[..hopeful], &[])?;
        // Of the others, those that are called for and beside which to first order nothing is left: where little is missing, much
        // explains it.
        let survives = |e: &&'static dyn Effect| {
            let id = e.description().id;
            let beside = || self.analysis.anything_left_beside(self.null, id, self.not_testable);
            block(left, id).is_some_and(|b| b.p_value < CALLED_FOR)
                && beside().is_some_and(|left| left.p_value > MAY_SURVIVE)
        };
        let (chosen, others): (Vec<_>, Vec<_>) = ordered[hopeful..].par_iter().copied().partition(survives);
        let near = (!far_off).then_some(self.null);
        for effect in chosen {
            let start = self.beside(&self.null.point, left, effect);
            found.extend(self.explain(start, self.null.levels, f64::INFINITY, near)?);
        }
        if found.iter().all(|f| f.1.p_value <= REJECT_EXPLANATION) {
            let mut rough: Vec<(f64, &'static dyn Effect)> = Vec::new();
            for effect in &others {
                let start = self.beside(&self.null.point, left, *effect);
                // Sizes at which a muscle cannot be simulated explain nothing.
                let Ok(deviance) = self.analysis.rough_deviance(start, self.null.levels) else { continue };
                rough.push((deviance, *effect));
            }
            rough.sort_by(|a, b| a.0.total_cmp(&b.0));
            let second: Vec<_> = rough.iter().take(SECOND_CHOICE).map(|o| o.1).collect();
            let more = fitted(&second, &found)?;
            found.extend(more);
        }
        Ok(found)
    }

    /// Explanations by an effect beside those at a point each, fitted on from there; where all fail and the model without
    /// effects is far off, the best again from the model as given.
    ///
    /// - `wanted`: point, what is left there, effect
    /// - `before`: explanations that others are measured against
    fn explain_all(
        &self,
        wanted: Vec<(&Point, &Omnibus, &'static dyn Effect)>,
        far_off: bool,
        before: &[(Fit, Explanation)],
    ) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let least = |found: &[(Fit, Explanation)]| {
            before.iter().chain(found).map(|f| f.0.deviance).fold(f64::INFINITY, f64::min)
        };
        let mut found: Vec<(Fit, Explanation)> = Vec::new();
        for (point, left, effect) in wanted {
            found.extend(self.explain(self.beside(point, left, effect), self.null.levels, least(&found), None)?);
        }
        if far_off && found.iter().all(|f| f.1.p_value <= REJECT_EXPLANATION) {
            // Without the effect the muscles went far to make up for it, perhaps into another valley.
            found.sort_by(|a, b| a.0.deviance.total_cmp(&b.0.deviance));
            for i in 0..found.len().min(TRIED_AGAIN) {
                let mut anew = self.analysis.nominal_point();
                anew.effects.extend(found[i].0.point.effects.iter().map(|s| Setting::absent(s.effect)));
                if let Some(other) =
                    self.explain(anew, NoiseLevels::usual(self.request.forward.strength.0), least(&found), None)?
                    && other.0.deviance < found[i].0.deviance
                {
                    found[i] = other;
                }
            }
        }
        Ok(found)
    }

    /// A point with a further effect, of the size that its score asks for.
    fn beside(&self, point: &Point, left: &Omnibus, effect: &'static dyn Effect) -> Point {
        let mut setting = Setting::absent(effect);
        let description = effect.description();
        if let Some(score) = block(left, description.id) {
            for (i, p) in description.amplitudes().enumerate() {
                setting.values[p] = score.one_step[i].clamp(-5.0, 5.0)
                    * self.request.forward.strength.scale(&description.parameters[p]);
            }
        }
        let mut start = point.clone();
        start.effects.push(setting);
        start
    }

    /// Pairs of the leading candidates: the best by the score of the second after the first was fitted.
    fn pairs(&self, singles: &[(Fit, Explanation)]) -> Result<Vec<(Fit, Explanation)>, SimulationError> {
        let mut leaders: Vec<&(Fit, Explanation)> = singles.iter().collect();
        leaders.sort_by(|a, b| a.0.deviance.total_cmp(&b.0.deviance));
        leaders.truncate(PAIRED);
        let mut pairs: Vec<(f64, &Fit, &'static dyn Effect, Omnibus)> = Vec::new();
        for (fit, _) in &leaders {
            let with = test(self.analysis, fit, self.not_testable)?;
            let first = fit.point.effects[0].effect.description().id;
            for second in self.testable().filter(|e| e.description().id != first) {
                let id = second.description().id;
                let same = |p: &(f64, &Fit, &'static dyn Effect, Omnibus)| {
                    p.1.point.effects[0].effect.description().id == id && p.2.description().id == first
                };
                let gain = block(&with, id).map_or(0.0, |b| b.statistic);
                let deviance = fit.deviance - gain;
                match pairs.iter_mut().find(|p| same(p)) {
                    Some(known) if known.0 <= deviance => {}
                    Some(known) => *known = (deviance, fit, second, with.clone()),
                    None => pairs.push((deviance, fit, second, with.clone())),
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        pairs.truncate(FITTED_PAIRS);
        let wanted = pairs.iter().map(|(_, fit, second, with)| (&fit.point, with, *second)).collect();
        self.explain_all(wanted, false, &[])
    }

    /// Fits the effects at a point jointly with the muscles and asks what is left; `None` if they cannot be fitted.
    ///
    /// - `best`: least deviance of an explanation so far; one that stays far behind it is not followed to its end
    /// - `near`: as for [`Analysis::refit`]
    fn explain(
        &self,
        start: Point,
        levels: NoiseLevels,
        best: f64,
        near: Option<&Fit>,
    ) -> Result<Option<(Fit, Explanation)>, SimulationError> {
        let effects = start.effects.iter().map(|s| s.effect.description().id).collect();
        // Sizes at which a muscle cannot be simulated explain nothing.
        let Ok(fit) = self.analysis.refit(start, levels, best + FAR, near) else { return Ok(None) };
        let with = test(self.analysis, &fit, self.not_testable)?;
        let parameters = estimates(&fit, self.request.forward);
        let plausible = parameters.values().all(|p| p.ci95[1] >= p.plausible[0] && p.ci95[0] <= p.plausible[1]);
        let held_out_error = self.error_of(&fit, TrialUse::Test)?;
        let (p_value, left) = (with.p_value, left_over(&with));
        let deviance_fall = self.null.deviance - fit.deviance;
        let explanation = Explanation { effects, p_value, deviance_fall, held_out_error, plausible, parameters, left };
        Ok(Some((fit, explanation)))
    }

    /// Whether the model without effects is so far off that its muscles may have gone astray.
    fn far_off(&self, left: &Omnibus) -> bool {
        left.blocks.iter().chain(&self.uncentred.blocks).any(|b| b.statistic > LARGE)
    }

    /// Simulated moments of the trials of a use, from the EMG as recorded.
    fn simulate(&self, fit: &Fit, usage: TrialUse) -> Result<Vec<(usize, Vec<f64>)>, SimulationError> {
        simulate(self.request.forward, &fit.point.parameters, &fit.point.effects, usage)
    }

    fn error_of(&self, fit: &Fit, usage: TrialUse) -> Result<Option<f64>, SimulationError> {
        Ok(self.rmse(&self.simulate(fit, usage)?))
    }

    fn rmse(&self, simulated: &[(usize, Vec<f64>)]) -> Option<f64> {
        rmse(self.request.forward, simulated).map(|e| e / self.request.mvc)
    }

    fn residuals(&self, fit: &Fit) -> Result<Vec<(usize, Vec<f64>)>, SimulationError> {
        let mut out = self.simulate(fit, TrialUse::Train)?;
        for (g, moment) in &mut out {
            for (m, y) in moment.iter_mut().zip(&self.request.forward.trials[*g].moment) {
                *m = y - *m;
            }
        }
        Ok(out)
    }

    fn errors(&self, null: &Fit, best: Option<&Fit>) -> Result<Errors, SimulationError> {
        let steps = |usage| -> Result<Option<Steps>, SimulationError> {
            let forward = self.request.forward;
            let base = self.rmse(&simulate(forward, &forward.nominal_parameters(), &[], usage)?);
            let refit = self.error_of(null, usage)?;
            let with_effect = best.map(|b| self.error_of(b, usage)).transpose()?.flatten();
            Ok(base.zip(refit).map(|(base, refit_only)| Steps { base, refit_only, with_effect }))
        };
        let nothing = Steps { base: 0.0, refit_only: 0.0, with_effect: None };
        Ok(Errors {
            train: steps(TrialUse::Train)?.unwrap_or(nothing),
            held_out: steps(TrialUse::Test)?,
            noise_floor: self.analysis.noise_floor(best.unwrap_or(null)) / self.request.mvc,
            measure: "RMSE / session MVC moment",
        })
    }

    fn candidates(&self, first: &Omnibus, singles: &[(Fit, Explanation)]) -> Vec<Candidate> {
        let mut out: Vec<Candidate> = self
            .analysis
            .candidates
            .iter()
            .filter_map(|effect| {
                let description = effect.description();
                let score = block(first, description.id)?;
                let fitted = singles.iter().find(|s| s.1.effects == [description.id]).map(|s| &s.1);
                let detectable_size = description
                    .amplitudes()
                    .enumerate()
                    .filter(|(i, _)| score.information[(*i, *i)] > 1e-9)
                    .map(|(i, p)| {
                        let p = &description.parameters[p];
                        (
                            p.name,
                            DETECTABLE_Z * self.request.forward.strength.scale(p) / score.information[(i, i)].sqrt(),
                        )
                    })
                    .collect();
                Some(Candidate {
                    effect: description.id,
                    p_value: fitted.map(|f| f.p_value),
                    score_p_value: score.p_value,
                    score: score.statistic,
                    kept: score.kept,
                    deviance_fall: fitted.map(|f| f.deviance_fall),
                    detectable_size,
                    held_out_error: fitted.and_then(|f| f.held_out_error),
                    parameters: fitted.map(|f| f.parameters.clone()).unwrap_or_default(),
                    left: fitted.map(|f| f.left.clone()).unwrap_or_default(),
                })
            })
            .collect();
        out.sort_by(|a, b| {
            b.p_value.unwrap_or(-1.0).total_cmp(&a.p_value.unwrap_or(-1.0)).then(b.score.total_cmp(&a.score))
        });
        out
    }

    /// Pairwise z of the leading candidates at their one-step sizes.
    fn confusion(&self, null: &Fit, left: &Omnibus) -> Vec<Confusion> {
        let mut leaders: Vec<&BlockScore> =
            left.blocks.iter().filter(|b| !b.name.starts_with("axis:") && b.rank > 0).collect();
        leaders.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
        leaders.truncate(PAIRED);
        let mut out = Vec::new();
        for truth in &leaders {
            for rival in leaders.iter().filter(|r| r.name != truth.name) {
                let Some(z) = self.analysis.pairwise_z(null, &truth.name, &truth.one_step, &rival.name) else {
                    continue;
                };
                let id = |name: &str| super::catalogue::effect(name).map(|e| e.description().id);
                if let Some((truth, rival)) = id(&truth.name).zip(id(&rival.name)) {
                    out.push(Confusion { truth, rival, z });
                }
            }
        }
        out
    }
}

/// The effects' parameters after a fit, by `effect.parameter`, with 95 % intervals.
///
/// - `forward`: the model that was fitted
pub fn estimates(fit: &Fit, forward: &ForwardModel) -> BTreeMap<String, ParameterEstimate> {
    let mut out = BTreeMap::new();
    let mut column = 0;
    for setting in &fit.point.effects {
        let description = setting.effect.description();
        let reported = setting.effect.reported(&setting.values, &forward.muscles);
        for (i, p) in description.parameters.iter().enumerate() {
            let half = 1.96 * fit.covariance[(column, column)].max(0.0).sqrt() * forward.strength.scale(p);
            let side = |sign: f64| {
                let mut values = setting.values.clone();
                values[i] += sign * half;
                setting.effect.reported(&values, &forward.muscles)[i]
            };
            let (a, b) = (side(-1.0), side(1.0));
            out.insert(
                format!("{}.{}", description.id, p.name),
                ParameterEstimate {
                    value: reported[i],
                    unit: p.unit,
                    ci95: [a.min(b), a.max(b)],
                    plausible: forward.strength.plausible(p),
                },
            );
            column += 1;
        }
    }
    out
}

/// Simulated moments [N·m] of the trials of a use, from the EMG as recorded.
///
/// # Errors
/// A muscle whose forces cannot be balanced.
pub fn simulate(
    forward: &ForwardModel,
    parameters: &[crate::simulation::MuscleParameters],
    effects: &[Setting],
    usage: TrialUse,
) -> Result<Vec<(usize, Vec<f64>)>, SimulationError> {
    let variant = forward.variant(effects)?;
    forward
        .trials_for(usage)
        .into_par_iter()
        .map(|g| {
            let core = forward.core(&variant, g, &forward.recorded_input(g), parameters, effects, false)?;
            Ok((g, forward.recorded_moment(g, &core, effects)))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

/// Root mean square of measured minus simulated moment over trials [N·m].
pub fn rmse(forward: &ForwardModel, simulated: &[(usize, Vec<f64>)]) -> Option<f64> {
    let squares =
        simulated.iter().flat_map(|(g, s)| forward.trials[*g].moment.iter().zip(s).map(|(y, s)| (y - s).powi(2)));
    let (sum, count) = squares.fold((0.0, 0usize), |(sum, n), s| (sum + s, n + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// Whether a setting has an amplitude that is not 0: for messages.
pub fn is_on(setting: &Setting) -> bool {
    let parameters = setting.effect.description().parameters;
    parameters.iter().zip(&setting.values).any(|(p, v)| p.role == Role::Amplitude && *v != 0.0)
}
