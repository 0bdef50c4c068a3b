//! What a diagnosis reports: `diagnosis.json`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::noise::Kernels;
use super::super::separation::Separation;
use super::super::several::{AccountStep, NamedEffect};
use super::super::what_remains::ProposedFormula;
use super::super::where_it_fails::AxisResult;

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
    /// Many things are a little wrong at once; one effect is missing beyond that.
    Dominant,
    /// Many things are a little wrong at once; several effects are missing beyond that.
    Several,
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

impl ParameterEstimate {
    /// Whether the interval, this many times as wide, reaches the plausible range.
    pub fn reaches_plausible(&self, times: f64) -> bool {
        let [low, high] = self.ci95.map(|end| self.value + times * (end - self.value));
        high >= self.plausible[0] && low <= self.plausible[1]
    }
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
    /// How much nearer moments and EMG are to it than to the model without effects: −2 log likelihood of both, less 1 for every parameter
    /// that is free to follow the noise.
    pub misfit_fall: f64,
    /// How much farther they are from it than from the nearest explanation.
    pub misfit_behind: f64,
    /// Share by which it lowers the training error of the model without effects.
    pub error_fall: f64,
    /// RMSE over held-out trials / session MVC moment.
    pub held_out_error: Option<f64>,
    /// Every interval, as wide as the fit's standard errors say, reaches its plausible range.
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
    /// Once fitted: how much nearer moments and EMG are to it than to the model without effects; see [`Explanation::misfit_fall`].
    pub misfit_fall: Option<f64>,
    /// Where residuals do not reject it: how much farther moments and EMG are from it than from the nearest explanation.
    pub misfit_behind: Option<f64>,
    /// Smallest size that would be found, per amplitude, in the parameter's unit: how far from its value in the model without the
    /// effect.
    pub detectable_size: BTreeMap<&'static str, f64>,
    /// What is plausible of its parameters.
    pub plausible: BTreeMap<&'static str, [f64; 2]>,
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

/// Effects that were fitted jointly with the muscles and are no explanations.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NotListed {
    /// Those that leave something.
    pub ruled_out: Vec<&'static str>,
    /// Those that leave nothing, but make moments and EMG much less likely than an explanation does.
    pub less_likely: Vec<&'static str>,
    /// Those that leave nothing at a size that is not plausible, where another explanation's is.
    pub implausible: Vec<&'static str>,
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
    /// Where many things are a little wrong at once: effects that are missing beyond that, the largest share of the error first.
    pub effects: Vec<NamedEffect>,
    /// There: the error, step by step.
    pub account: Vec<AccountStep>,
    /// There: how far what is handed over is from the model as given (0) to the joint mode (1), as trials left out one at a time
    /// are predicted best.
    pub part_of_the_way: Option<f64>,
    /// Formulas for what remains, where no effect of the catalogue explains it all.
    pub proposals: Vec<ProposedFormula>,
    /// Effects that were fitted jointly with the muscles and are no explanations.
    #[serde(flatten)]
    pub not_listed: NotListed,
    /// Effects that can be tested and were not fitted: nothing was rejected, or their scores leave them no chance; or they came out no
    /// larger than what noise has of them in any case.
    pub not_fitted: Vec<&'static str>,
    /// Effects that these data cannot test.
    pub not_testable: Vec<&'static str>,
    /// Errors.
    pub error: Errors,
    /// All candidates.
    pub candidates: Vec<Candidate>,
    /// Pairwise separability of the explanations' effects and of the leading candidates.
    pub confusion: Vec<Confusion>,
    /// Where the data cannot tell: further trials that would tell the effects of the first explanations apart, the most useful
    /// of every pair.
    pub separating_experiments: Vec<Separation>,
    /// Residual of the refitted model along every axis.
    pub where_it_fails: Vec<AxisResult>,
    /// Standard deviations of the noise: white and slow moment [N·m], EMG envelope, gain per trial (relative), baseline.
    pub noise: BTreeMap<&'static str, f64>,
    /// How noise of the EMG's envelope and of the moment goes with itself in time.
    pub noise_correlation: Kernels,
}

/// Whether a 95 % interval says anything: one of a ratio's logarithm may span a thousandfold and more.
pub fn is_determined(ci95: [f64; 2]) -> bool {
    let [low, high] = ci95;
    !(low > 0.0 && high > 1e3 * low)
}
