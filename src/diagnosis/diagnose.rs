//! The diagnosis of one participant: which single effects, or pairs, explain what the model misses.

mod account;
mod search;

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::baselines::Ingredients;
use super::catalogue::CATALOGUE;
use super::effect::{Effect, Role};
use super::fit::{Analysis, Fit};
use super::forward_model::{ForwardModel, Setting};
use super::noise::NoiseLevels;
use super::score_test::{BlockScore, Omnibus};
use super::separation::{Laboratory, Separation, most_useful, separations};
use super::several::{self, Several};
use super::what_remains::formulas;
use super::where_it_fails::along_axes;
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::{Direction, ParameterBounds, TrialUse};

pub use account::{
    Candidate, Confusion, Diagnosis, Errors, Explanation, Left, NotListed, ParameterEstimate, Steps, Verdict,
    is_determined,
};

/// A null model with a smaller p-value is rejected. That is 5 in 100 where nothing is missing: the p-value is the larger of two, and a fit
/// that is rejected gives way to a more probable one from elsewhere (`docs/src/evidence/diagnosis.md`).
const REJECT_NULL: f64 = 0.08;
/// An effect that is so much farther from the data than another explains nothing, whatever it leaves.
const MUCH_NEARER: f64 = 25.0;
/// A direction with a smaller p-value (that knows the variances to be estimates, times the number of directions) is no matter of
/// misjudged variances.
pub(super) const BEYOND_DOUBT: f64 = 1e-4;
/// An explanation with a smaller p-value is rejected: laxer than 0.05, so that the true one stays in at least 95 of 100 times.
pub const REJECT_EXPLANATION: f64 = 0.02;
/// Where all single effects are rejected and no pair is much nearer to the data, those with a larger p-value stay nevertheless, if they
/// lower the error, that of trials that were not fitted, too: what one effect leaves by chance once in 500 times calls for no second one
/// that takes up little of it.
const REJECT_BESIDE_NOTHING: f64 = 0.002;
/// An explanation whose p-value is less than this share of the largest is rejected beside it, unless moments and EMG are nearer to it.
/// Small, so that a true one of a modest p-value stays.
pub const LEAST_SHARE: f64 = 0.05;
/// An effect whose signature keeps less than this share once muscle parameters are fitted cannot be tested.
const TESTABLE: f64 = 0.01;
/// Where the model without effects leaves a larger score than this, its muscles may have gone astray to make up for it.
const LARGE: f64 = 40.0;
/// z that an effect needs to be found with a probability of about 80 % among all others.
const DETECTABLE_Z: f64 = 4.2;
/// A detected effect that lowers the training error by less than this share is negligible.
const NEGLIGIBLE: f64 = 0.02;
/// Candidates that are held against each other.
const CONFUSED: usize = 6;
/// By this factor intervals are wider than the fit's standard errors say. Estimates of simulated studies are 1.2 to
/// 1.6 times as far off (`docs/src/evidence/diagnosis.md`): effects are not linear as far as their errors reach, and what the EMG is
/// expected to be is taken for known.
const WIDENED: f64 = 1.5;
/// So many effects are told apart by further trials where the data cannot: those of the first explanations.
const TOLD_APART: usize = 4;
/// Directions that are reported as left over.
const SHOWN: usize = 3;

/// What to diagnose.
pub struct Request<'a> {
    /// Name of the participant.
    pub participant: String,
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// What further trials are simulated with, where these cannot tell explanations apart; without it none are.
    pub laboratory: Option<Laboratory<'a>>,
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
    /// What is missing where many things are a little wrong at once.
    pub several: Option<Several>,
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
    let mut first = blocks_of(&analysis, &null, &[])?;
    let not_testable: Vec<&'static str> = analysis
        .candidates
        .iter()
        .map(|e| e.description())
        .filter(|d| {
            d.unidentifiable.is_some() || named_block(&first, d.id).is_none_or(|b| b.kept < TESTABLE || b.rank == 0)
        })
        .map(|d| d.id)
        .collect();
    let TestedFit { fit: null, left, p_value: null_p_value, elsewhere } = tested_null(&analysis, null, &not_testable)?;
    if elsewhere {
        first = blocks_of(&analysis, &null, &[])?;
    }
    let uncentred = analysis.blocks_left_uncentred(&null, &not_testable).unwrap_or_else(|| left.blocks.clone());
    let refitted = simulate(forward, &null.point.parameters, &[], TrialUse::Train)?;
    let refit_error = rmse(forward, &refitted).unwrap_or(0.0).max(f64::MIN_POSITIVE) / request.mvc;
    let is_far_off = left.blocks.iter().chain(&uncentred).any(|b| b.statistic > LARGE);
    let near = (!is_far_off).then_some(&null);
    let judge =
        Judge { request, analysis: &analysis, null: &null, near, not_testable: &not_testable, uncentred, refit_error };
    let rejected = null_p_value < REJECT_NULL;
    // Where many things are a little wrong, no single effect leaves nothing: none is looked for. Where that cannot be found out, because a
    // trial cannot be simulated at some point of the search, single effects are.
    let several = if rejected { several::several(request).unwrap_or_default() } else { None };
    let one_may_do = |s: &Several| s.effects.is_empty() || s.effects.len() <= several::FEW && !s.leaves_something;
    let alone = rejected && several.as_ref().is_none_or(one_may_do);
    let singles = if alone { judge.singles(&left)? } else { Vec::new() };
    let above = |p_value: f64| -> Vec<(Fit, Explanation)> {
        singles.iter().filter(|s| s.1.p_value > p_value).cloned().collect()
    };
    let mut explanations = above(REJECT_EXPLANATION);
    let survivors: Vec<&'static str> = explanations.iter().filter(|e| e.1.plausible).map(|e| e.1.effects[0]).collect();
    let stays = |s: &&(Fit, Explanation)| {
        judge.goes_with(&left, &survivors, &s.1)
            || judge.is_nearer_than_survivors(s, &singles)
            || judge.stays_beside_the_implausible(s, &singles)
    };
    explanations.extend(singles.iter().filter(stays).cloned());
    let mut farther = judge.keep_the_near(&mut explanations, &singles);
    if alone && explanations.is_empty() {
        let pairs = judge.pairs(&singles)?;
        let explain = |pair: &(Fit, Explanation)| pair.1.explains() && judge.needs_both(pair, &singles);
        explanations = pairs.iter().filter(|pair| explain(pair)).cloned().collect();
        explanations.extend(judge.exchanged(&explanations, &pairs)?.into_iter().filter(explain));
    }
    if explanations.is_empty() {
        explanations = above(REJECT_BESIDE_NOTHING);
        let without = judge.error_of(&null, TrialUse::Test)?;
        // If no trials are held out, they say nothing against it.
        let lowers_held_out =
            |e: &Explanation| without.zip(e.held_out_error).is_none_or(|(without, with)| with < without);
        explanations.retain(|e| e.1.lowers_error() && lowers_held_out(&e.1));
        farther.extend(judge.keep_the_near(&mut explanations, &singles));
    }
    // What leaves nothing needs nothing beside it.
    let several = several.filter(|_| explanations.is_empty());
    let implausible = !explanations.is_empty() && explanations.iter().all(|e| !e.1.plausible);
    if !implausible {
        explanations.retain(|e| e.1.plausible);
    }
    farther.extend(judge.drop_the_farther(&mut explanations));
    judge.drop_the_improbable(&left, &mut explanations);
    let best = explanations.first().map(|e| e.0.clone());
    let fall = explanations.first().map_or(0.0, |e| e.1.error_fall);
    let error = match &several {
        Some(several) => judge.errors_of(several)?,
        None => judge.errors(&null, best.as_ref())?,
    };
    let dominant = several.as_ref().map_or(0, |s| s.effects.iter().filter(|e| e.dominant).count());
    let verdict = match explanations.as_slice() {
        _ if !rejected => Verdict::NothingDetectable,
        _ if dominant == 1 => Verdict::Dominant,
        _ if several.as_ref().is_some_and(|s| !s.effects.is_empty()) => Verdict::Several,
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
    let missing: Vec<&str> = several.iter().flat_map(|s| &s.effects).map(|e| e.effect).collect();
    let not_fitted = ids()
        .filter(|id| ![&fitted, &kept, &missing].iter().any(|list| list.contains(id)) && !not_testable.contains(id));
    let not_fitted = not_fitted.collect();
    let residuals = judge.residuals(&null)?;
    let separating_experiments = match verdict {
        // Trials that nobody recorded must not cost the diagnosis: where one cannot be simulated, `carpus plan` says why.
        Verdict::CannotTell => judge.experiments(&explanations).unwrap_or_default(),
        _ => Vec::new(),
    };
    let judged = explanations.iter().map(|e| &e.1).chain(&farther).filter(|e| e.effects.len() == 1);
    let behind: BTreeMap<&'static str, f64> = judged.map(|e| (e.effects[0], e.misfit_behind)).collect();
    let line = REJECT_EXPLANATION.max(LEAST_SHARE * explanations.iter().map(|e| e.1.p_value).fold(0.0, f64::max));
    let mut not_listed = NotListed::default();
    for id in ids().filter(|id| !kept.contains(id)) {
        let Some(single) = singles.iter().find(|s| s.1.effects == [id]) else { continue };
        match () {
            () if single.1.p_value <= line => not_listed.ruled_out.push(id),
            () if behind.contains_key(id) => not_listed.less_likely.push(id),
            () => not_listed.implausible.push(id),
        }
    }
    let proposals = match (&several, verdict) {
        (Some(several), _) => several.proposals.clone(),
        (None, Verdict::Unknown) => {
            let of_muscles = null.whitened.iter().map(|w| w.columns(0, analysis.n_nuisance()).into_owned());
            formulas(forward, &refitted, &null.factors, &of_muscles.collect::<Vec<_>>(), request.seed)
        }
        _ => Vec::new(),
    };
    let diagnosis = Diagnosis {
        schema: "carpus.diagnosis/2",
        participant: request.participant.clone(),
        verdict,
        null_p_value,
        null_sign_flip_p_value: left.sign_flip_p_value,
        candidates: judge.candidates(&first, &singles, &behind),
        confusion: judge.confusion(&null, &left, &kept),
        separating_experiments,
        explanations: explanations.into_iter().map(|e| e.1).collect(),
        effects: several.as_ref().map(|s| s.effects.clone()).unwrap_or_default(),
        account: several.as_ref().map(|s| s.account.clone()).unwrap_or_default(),
        part_of_the_way: several.as_ref().map(|s| s.handed_over.part),
        proposals,
        not_listed,
        not_fitted,
        not_testable,
        error,
        where_it_fails: along_axes(forward, &residuals, &left),
        noise: named(&best.as_ref().unwrap_or(&null).levels, &analysis),
        noise_correlation: analysis.kernels,
    };
    let ingredients = Ingredients::of(&analysis, &null);
    Ok(Outcome { diagnosis, refit: null, best, several, ingredients })
}

/// The fit without effects, tested.
pub(super) struct TestedFit {
    pub(super) fit: Fit,
    left: Omnibus,
    p_value: f64,
    /// Whether it is not the fit from the model as given.
    elsewhere: bool,
}

/// Tests the fit without effects; one that is rejected gives way to a more probable one from elsewhere, if there is any: muscles that
/// trade their shares of a moment have several valleys, and what a wrong one leaves is no effect.
///
/// - `skip`: names of blocks to leave out
pub(super) fn tested_null(analysis: &Analysis, null: Fit, skip: &[&str]) -> Result<TestedFit, SimulationError> {
    let tested = |fit: Fit, elsewhere: bool| {
        let left = test(analysis, &fit, skip)?;
        // To say that something is missing both laws of the scores must agree: where variances are misjudged one of them cries wolf.
        // Flips of few trials cannot give small p-values, though: what no misjudged variance explains needs them not.
        let surely = left.blocks.iter().any(|b| b.p_value * (left.blocks.len() as f64) < BEYOND_DOUBT);
        let p_value = if surely { left.p_value } else { left.p_value.max(left.sign_flip_p_value) };
        Ok::<_, SimulationError>(TestedFit { fit, left, p_value, elsewhere })
    };
    let first = tested(null, false)?;
    if first.p_value >= REJECT_NULL {
        return Ok(first);
    }
    match analysis.fitted_elsewhere(&first.fit)? {
        Some(better) => tested(better, true),
        None => Ok(first),
    }
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
    analysis.anything_left(fit, skip).ok_or(SimulationError::NoiseCovariance)
}

/// As [`test`], every block by itself.
fn blocks_of(analysis: &Analysis, fit: &Fit, skip: &[&str]) -> Result<Vec<BlockScore>, SimulationError> {
    analysis.blocks_left(fit, skip).ok_or(SimulationError::NoiseCovariance)
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

fn named_block<'a>(blocks: &'a [BlockScore], name: &str) -> Option<&'a BlockScore> {
    blocks.iter().find(|b| b.name == name)
}

fn block<'a>(omnibus: &'a Omnibus, name: &str) -> Option<&'a BlockScore> {
    named_block(&omnibus.blocks, name)
}

struct Judge<'a> {
    request: &'a Request<'a>,
    analysis: &'a Analysis<'a>,
    null: &'a Fit,
    /// The null, if it is so near to what explains that its scores have nearly the same mean there.
    near: Option<&'a Fit>,
    not_testable: &'a [&'static str],
    /// Scores of the null, their means left in.
    uncentred: Vec<BlockScore>,
    /// Training error of the null: RMSE / session MVC moment.
    refit_error: f64,
}

impl Judge<'_> {
    fn testable(&self) -> impl Iterator<Item = &'static dyn Effect> + '_ {
        self.analysis.candidates.iter().copied().filter(|e| !self.not_testable.contains(&e.description().id))
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

    /// Errors of what is handed over where many things are a little wrong.
    fn errors_of(&self, several: &Several) -> Result<Errors, SimulationError> {
        let forward = self.request.forward;
        let steps = |usage| -> Result<Option<Steps>, SimulationError> {
            let error = |parameters: &[MuscleParameters], effects: &[Setting]| {
                Ok::<_, SimulationError>(self.rmse(&simulate(forward, parameters, effects, usage)?))
            };
            let base = error(&forward.nominal_parameters(), &[])?;
            let refit = error(&several.recalibrated.parameters, &several.recalibrated.effects)?;
            let with = error(&several.handed_over.parameters, &several.handed_over.effects)?;
            let with_effect = with.filter(|_| !several.handed_over.effects.is_empty());
            Ok(base.zip(refit).map(|(base, refit_only)| Steps { base, refit_only, with_effect }))
        };
        let nothing = Steps { base: 0.0, refit_only: 0.0, with_effect: None };
        Ok(Errors {
            train: steps(TrialUse::Train)?.unwrap_or(nothing),
            held_out: steps(TrialUse::Test)?,
            noise_floor: several.noise_floor / self.request.mvc,
            measure: "RMSE / session MVC moment",
        })
    }

    /// - `behind`: how much farther the data are from an effect than from the nearest explanation
    fn candidates(
        &self,
        first: &[BlockScore],
        singles: &[(Fit, Explanation)],
        behind: &BTreeMap<&'static str, f64>,
    ) -> Vec<Candidate> {
        let mut out: Vec<Candidate> = self
            .analysis
            .candidates
            .iter()
            .filter_map(|effect| {
                let description = effect.description();
                let score = named_block(first, description.id)?;
                let fitted = singles.iter().find(|s| s.1.effects == [description.id]).map(|s| &s.1);
                let detectable_size = description
                    .amplitudes()
                    .enumerate()
                    .filter(|(i, _)| score.information[(*i, *i)] > 1e-9)
                    .map(|(i, p)| {
                        let size = DETECTABLE_Z / score.information[(i, i)].sqrt();
                        (description.parameters[p].name, self.change(*effect, p, size))
                    })
                    .collect();
                let plausible =
                    description.parameters.iter().map(|p| (p.name, self.request.forward.joint.plausible(p))).collect();
                Some(Candidate {
                    effect: description.id,
                    p_value: fitted.map(|f| f.p_value),
                    score_p_value: score.p_value,
                    score: score.statistic,
                    kept: score.kept,
                    deviance_fall: fitted.map(|f| f.deviance_fall),
                    misfit_fall: fitted.map(|f| f.misfit_fall),
                    misfit_behind: behind.get(description.id).copied(),
                    detectable_size,
                    plausible,
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

    /// By how much an effect of a size in scales changes one of its parameters, in the parameter's unit.
    fn change(&self, effect: &'static dyn Effect, parameter: usize, size: f64) -> f64 {
        let forward = self.request.forward;
        let absent = Setting::absent(effect).values;
        let mut present = absent.clone();
        present[parameter] += size * forward.joint.scale(&effect.description().parameters[parameter]);
        let reported = |values: &[f64]| effect.reported(values, &forward.muscles)[parameter];
        (reported(&present) - reported(&absent)).abs()
    }

    /// The most useful experiments that would tell the effects of the first explanations apart.
    fn experiments(&self, explanations: &[(Fit, Explanation)]) -> Result<Vec<Separation>, SimulationError> {
        let mut rivals: Vec<&'static str> = Vec::new();
        for id in explanations.iter().flat_map(|e| &e.1.effects) {
            if rivals.len() < TOLD_APART && !rivals.contains(id) {
                rivals.push(id);
            }
        }
        let Some(laboratory) = self.request.laboratory else { return Ok(Vec::new()) };
        let mut all = separations(self.analysis, self.null, laboratory, &self.request.bounds, &rivals, &|_, _| {})?;
        // Two effects are rivals where one stands in the other's place, beside the same second effect if there is one.
        let beside = |id: &str| -> Vec<Vec<&str>> {
            let others = |e: &Explanation| e.effects.iter().copied().filter(|x| *x != id).collect();
            explanations.iter().filter(|e| e.1.effects.contains(&id)).map(|e| others(&e.1)).collect()
        };
        all.retain(|s| beside(s.separates[0]).iter().any(|others| beside(s.separates[1]).contains(others)));
        Ok(most_useful(&all).into_iter().cloned().collect())
    }

    /// Pairwise z of the explanations' effects and of the leading candidates at their one-step sizes.
    ///
    /// - `explaining`: effects of the explanations
    fn confusion(&self, null: &Fit, left: &Omnibus, explaining: &[&str]) -> Vec<Confusion> {
        let mut leaders: Vec<&BlockScore> =
            left.blocks.iter().filter(|b| !b.name.starts_with("axis:") && b.rank > 0).collect();
        let explains = |b: &BlockScore| explaining.contains(&b.name.as_str());
        leaders.sort_by(|a, b| explains(b).cmp(&explains(a)).then(b.statistic.total_cmp(&a.statistic)));
        leaders.truncate(CONFUSED.max(leaders.iter().filter(|b| explains(b)).count()));
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

/// The effects' parameters after a fit, by `effect.parameter`, with 95 % intervals as wide as experience asks for.
///
/// - `forward`: the model that was fitted
pub fn estimates(fit: &Fit, forward: &ForwardModel) -> BTreeMap<String, ParameterEstimate> {
    let mut out = BTreeMap::new();
    let mut column = 0;
    for setting in &fit.point.effects {
        let description = setting.effect.description();
        let reported = setting.effect.reported(&setting.values, &forward.muscles);
        for (i, p) in description.parameters.iter().enumerate() {
            let half = WIDENED * 1.96 * fit.covariance[(column, column)].max(0.0).sqrt() * forward.joint.scale(p);
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
                    plausible: forward.joint.plausible(p),
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
    parameters: &[MuscleParameters],
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
