//! A diagnosis as results files keep it: what `diagnosis.json` says, as far as pages show it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::ledger::Estimate;

/// The diagnosis of a participant. Keys that are not shown are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisResult {
    /// Schema of the file.
    pub schema: String,
    /// What the data say.
    pub verdict: String,
    /// p-value of the model without effects.
    #[serde(default)]
    pub null_p_value: Option<f64>,
    /// The confidence set.
    #[serde(default)]
    pub explanations: Vec<ExplanationResult>,
    /// Effects that are missing.
    #[serde(default)]
    pub effects: Vec<NamedEffectResult>,
    /// The error, step by step.
    #[serde(default)]
    pub account: Vec<AccountResult>,
    /// Formulas for what remains.
    #[serde(default)]
    pub proposals: Vec<ProposalResult>,
    /// Effects that are hardly missing.
    #[serde(default)]
    pub ruled_out: Vec<String>,
    /// Effects that may be missing, less likely than what is named.
    #[serde(default)]
    pub less_likely: Vec<String>,
    /// Effects that the diagnosis was restricted to; empty: the whole catalogue.
    #[serde(default)]
    pub restricted_to: Vec<String>,
    /// Effects that the trials cannot test.
    #[serde(default)]
    pub not_testable: Vec<String>,
    /// Experiments that would separate explanations.
    #[serde(default)]
    pub separating_experiments: Vec<SeparatingExperiment>,
    /// Errors.
    pub error: ErrorsResult,
    /// All candidates.
    #[serde(default)]
    pub candidates: Vec<CandidateResult>,
    /// Pairwise separability.
    #[serde(default)]
    pub confusion: Vec<ConfusionResult>,
    /// Tests along axes.
    #[serde(default)]
    pub where_it_fails: Vec<AxisTest>,
    /// Standard deviations of the noise.
    #[serde(default)]
    pub noise: BTreeMap<String, Option<f64>>,
}

/// An effect that is missing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NamedEffectResult {
    /// Effect.
    pub effect: String,
    /// Effects that these trials cannot tell from it, itself first.
    #[serde(default)]
    pub group: Vec<String>,
    /// Probability that one of the group is missing.
    pub probability: f64,
    /// Whether it takes more of the error than a little of everything does.
    #[serde(default)]
    pub dominant: bool,
    /// Share of the mean square of the error of the model as given that it takes, the mean over orders in which effects
    /// come in.
    #[serde(default)]
    pub share_of_error: SharesResult,
    /// The part of it that nothing else takes.
    #[serde(default)]
    pub unique_share: SharesResult,
    /// Parameters by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
}

/// A step of the error: RMSE / session MVC moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AccountResult {
    /// `as_given`, `recalibrated`, an effect, `generic_discrepancy`, or `noise`.
    pub step: String,
    /// Training trials.
    pub train: f64,
    /// Held-out trials.
    #[serde(default)]
    pub held_out: Option<f64>,
}

/// A formula for what remains.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProposalResult {
    /// A moment [N·m].
    pub formula: String,
    /// Share of the mean square of what remains that it takes in trials that were left out.
    pub share_of_error: f64,
    /// The text of an effect's file.
    #[serde(default)]
    pub definition: String,
}

/// Shares with 95 % intervals.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SharesResult {
    /// Training trials.
    pub train: [f64; 3],
    /// Held-out trials.
    #[serde(default)]
    pub held_out: Option<[f64; 3]>,
}

/// Effects that leave nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExplanationResult {
    /// Effects.
    pub effects: Vec<String>,
    /// p-value of “nothing is left”.
    #[serde(default)]
    pub p_value: Option<f64>,
    /// Error over held-out trials.
    #[serde(default)]
    pub held_out_error: Option<f64>,
    /// Parameters by `effect.parameter`.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
}

/// An experiment that would separate two explanations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeparatingExperiment {
    /// What to record.
    pub trials: String,
    /// The explanations.
    pub separates: Vec<String>,
    /// z between them now.
    pub z_now: f64,
    /// z with the experiment.
    pub z_then: f64,
}

/// Errors, before and after.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorsResult {
    /// Training trials.
    pub train: StepErrors,
    /// Held-out trials.
    #[serde(default)]
    pub held_out: Option<StepErrors>,
    /// What noise alone would leave.
    #[serde(default)]
    pub noise_floor: Option<f64>,
    /// What is measured.
    #[serde(default)]
    pub measure: String,
}

/// Errors step by step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepErrors {
    /// The model as given.
    pub base: f64,
    /// Muscle parameters fitted.
    pub refit_only: f64,
    /// With the best explanation.
    #[serde(default)]
    pub with_effect: Option<f64>,
}

/// A candidate of the catalogue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CandidateResult {
    /// Effect.
    pub effect: String,
    /// p-value that nothing is left once it is fitted.
    #[serde(default)]
    pub p_value: Option<f64>,
    /// Probability that it is missing.
    #[serde(default)]
    pub probability: f64,
    /// p-value of its own score test.
    #[serde(default)]
    pub score_p_value: Option<f64>,
    /// Its score statistic.
    #[serde(default)]
    pub score: Option<f64>,
    /// Share of its signature that fitting the muscles leaves.
    #[serde(default)]
    pub kept: Option<f64>,
    /// Smallest size that would be found, per amplitude.
    #[serde(default)]
    pub detectable_size: BTreeMap<String, Option<f64>>,
    /// What is plausible of its parameters.
    #[serde(default)]
    pub plausible: BTreeMap<String, [f64; 2]>,
    /// Error over held-out trials.
    #[serde(default)]
    pub held_out_error: Option<f64>,
    /// Parameters, once fitted.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
}

/// How well two effects can be told apart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConfusionResult {
    /// The effect taken to be true.
    pub truth: String,
    /// Its rival.
    pub rival: String,
    /// z.
    #[serde(default)]
    pub z: Option<f64>,
}

/// Whether the residual of the refitted model depends on an axis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AxisTest {
    /// The axis.
    pub axis: String,
    /// p-value, muscle parameters profiled out.
    #[serde(default)]
    pub p_value: Option<f64>,
}
