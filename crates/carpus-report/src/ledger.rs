//! The ledger of effects that were added to a model: one step after the other, with what each did to the error.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Name and version of the ledger's schema.
pub const LEDGER_SCHEMA: &str = "carpus.ledger/1";

/// Steps from the model as given to the model with effects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ledger {
    /// [`LEDGER_SCHEMA`].
    pub schema: String,
    /// The participant.
    pub participant: String,
    /// What the errors measure.
    pub measure: String,
    /// Error that noise alone would leave.
    pub noise_floor: f64,
    /// What the diagnosis said, and who chose the effects.
    pub choice: Choice,
    /// The step that `model.osim` is now.
    pub current: usize,
    /// The steps; the first one is the model as given.
    pub steps: Vec<Step>,
}

/// What the diagnosis said, and who chose the effects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// Verdict of the diagnosis of the same data.
    pub verdict: String,
    /// Explanations that the data do not rule out.
    pub explanations: Vec<Vec<String>>,
    /// Effects that were added.
    pub chosen: Vec<String>,
    /// Whether they are one of the explanations.
    pub supported: bool,
    /// Whether a person chose them although the diagnosis could not (`--i-choose`).
    pub i_choose: bool,
}

/// One step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Key, also of the model in the results file.
    pub id: String,
    /// How people call it.
    pub label: String,
    /// Effects in the model.
    pub effects: Vec<String>,
    /// The step's model, relative to the ledger.
    pub model: String,
    /// Effects beside the model that no component of OpenSim does, relative to the ledger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side_car: Option<String>,
    /// Error over training trials.
    pub train: f64,
    /// Error over held-out trials.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<f64>,
    /// p-value of “nothing is left”.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p_value: Option<f64>,
    /// Largest difference between the moments that were fitted and those that the written model gives [N·m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub written_differs_n_m: Option<f64>,
    /// Parameters of the effects by `effect.parameter`.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
}

/// An estimated parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Estimate.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Plausible range.
    pub plausible: [f64; 2],
}

impl Estimate {
    /// Whether the interval reaches into the plausible range.
    pub fn is_plausible(&self) -> bool {
        self.ci95[1] >= self.plausible[0] && self.ci95[0] <= self.plausible[1]
    }
}

impl Ledger {
    /// The step that `model.osim` is now.
    pub fn now(&self) -> Option<&Step> {
        self.steps.get(self.current)
    }
}
