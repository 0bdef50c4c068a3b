//! What a diagnosis reports: `diagnosis.json`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::separation::Separation;
use super::super::what_remains::ProposedFormula;
use super::super::where_it_fails::AxisResult;
use crate::noise::Kernels;

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
    /// Whether the interval reaches the plausible range.
    pub fn reaches_plausible(&self) -> bool {
        let [low, high] = self.ci95;
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
    /// How much larger −2 log posterior is with it than with the most probable explanation.
    pub deviance_behind: f64,
    /// Share by which it lowers the training error of the model without effects.
    pub error_fall: f64,
    /// RMSE over held-out trials / session MVC moment.
    pub held_out_error: Option<f64>,
    /// Every interval reaches its plausible range.
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
    /// Probability that it is missing from the model.
    pub probability: f64,
    /// p-value that nothing is left beside it; `None` unless it alone is an explanation.
    pub p_value: Option<f64>,
    /// p-value of its own score test on the model without effects.
    pub score_p_value: f64,
    /// Its score statistic T.
    pub score: f64,
    /// Share of its signature that fitting the muscles leaves.
    pub kept: f64,
    /// Smallest size that would be found, per amplitude, in the parameter's unit: how far from its value in the model
    /// without the effect.
    pub detectable_size: BTreeMap<&'static str, f64>,
    /// What is plausible of its parameters.
    pub plausible: BTreeMap<&'static str, [f64; 2]>,
    /// RMSE over held-out trials / session MVC moment, of an explanation.
    pub held_out_error: Option<f64>,
    /// Parameters, of an explanation.
    pub parameters: BTreeMap<String, ParameterEstimate>,
    /// Of an explanation: what the data would rather have beside it.
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

/// Effects that are not named.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NotListed {
    /// Those that are hardly missing: with a probability of less than 1 %.
    pub ruled_out: Vec<&'static str>,
    /// Those that may be missing, and are less likely than what is named.
    pub less_likely: Vec<&'static str>,
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
    /// p-value that nothing is left beside the muscles alone, over all directions.
    pub null_p_value: f64,
    /// The same by sign flips of whole trials.
    pub null_sign_flip_p_value: f64,
    /// p-value that nothing is left beside what is named.
    pub p_value: f64,
    /// The confidence set.
    pub explanations: Vec<Explanation>,
    /// Effects that are missing, that with the strongest evidence first.
    pub effects: Vec<NamedEffect>,
    /// The error, step by step.
    pub account: Vec<AccountStep>,
    /// How far what is handed over is from the model as given (0) to the joint mode (1), as trials left out one at a
    /// time are predicted best.
    pub part_of_the_way: f64,
    /// Formulas for what remains, where no effect of the catalogue explains it all.
    pub proposals: Vec<ProposedFormula>,
    /// Effects that are not named.
    #[serde(flatten)]
    pub not_listed: NotListed,
    /// Effects that these data cannot test.
    pub not_testable: Vec<&'static str>,
    /// Errors.
    pub error: Errors,
    /// All candidates.
    pub candidates: Vec<Candidate>,
    /// Pairwise separability of the explanations' effects and of the leading candidates.
    pub confusion: Vec<Confusion>,
    /// Where the data cannot tell: further trials that would tell the effects of the first explanations apart, the most
    /// useful of every pair.
    pub separating_experiments: Vec<Separation>,
    /// Residual of the refitted model along every axis.
    pub where_it_fails: Vec<AxisResult>,
    /// Standard deviations of the noise: white and slow moment [N·m], EMG envelope, gain per trial (relative),
    /// baseline.
    pub noise: BTreeMap<&'static str, f64>,
    /// How noise of the EMG's envelope and of the moment goes with itself in time.
    pub noise_correlation: Kernels,
}

/// An effect that is missing.
#[derive(Clone, Debug, Serialize)]
pub struct NamedEffect {
    /// Effect.
    pub effect: &'static str,
    /// Effects that these trials cannot tell from it, itself first.
    pub group: Vec<&'static str>,
    /// Probability that one of the group is missing: by the linear model or by simulation, whichever is larger,
    /// equations (23) and (33).
    pub probability: f64,
    /// How much larger −2 log posterior is without it, muscles, the other effects and a little of everything making up
    /// for it as they can.
    pub evidence: f64,
    /// Whether it is large and takes a large part of the error that nothing else takes.
    pub dominant: bool,
    /// Share of the mean square of the error of the model as given that it takes, the mean over orders in which the
    /// effects and the fit of the muscles come in, those that are there making up for what is missing as they can:
    /// value and 95 % interval over trials.
    pub share_of_error: Shares,
    /// The part of it that nothing else takes: by how much the error rises when the effect is taken out, and the others
    /// and the muscles are fitted anew, as a share of the same mean square: value and 95 % interval over trials.
    pub unique_share: Shares,
    /// Parameters by name, at the joint mode.
    pub parameters: BTreeMap<String, ParameterEstimate>,
}

/// Shares of training and held-out trials.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Shares {
    /// Training trials.
    pub train: [f64; 3],
    /// Held-out trials.
    pub held_out: Option<[f64; 3]>,
}

/// A step of the account of the error: RMSE / session MVC moment.
#[derive(Clone, Debug, Serialize)]
pub struct AccountStep {
    /// What the model has: `as_given`, `recalibrated`, an effect, `generic_discrepancy`, or `noise`.
    pub step: String,
    /// Training trials.
    pub train: f64,
    /// Held-out trials.
    pub held_out: Option<f64>,
}
