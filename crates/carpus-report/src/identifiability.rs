//! What trials say about muscle parameters: the results file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::intervals::{NOT_VALID, holds};
use super::results::{Provenance, WarningResult};

/// Name and version of the schema.
pub const IDENTIFIABILITY_SCHEMA: &str = "carpus.identifiability/1";

/// What a participant's trials say. Values are in the unit of the property.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentifiabilityResult {
    /// [`IDENTIFIABILITY_SCHEMA`].
    pub schema: String,
    /// Program, command, seed and inputs.
    pub provenance: Provenance,
    /// The study.
    pub study: String,
    /// The participant.
    pub participant: String,
    /// Training trials.
    pub trials: usize,
    /// Level of all intervals.
    pub level: f64,
    /// The parameters.
    pub parameters: Vec<ParameterKnowledge>,
    /// Combinations of parameters, from the best known to the least known.
    pub combinations: Vec<CombinationResult>,
    /// Correlations of logarithms in the posterior, in the order of the parameters.
    pub correlations: Vec<Vec<f64>>,
    /// Further trials, the most informative first.
    pub next_trials: Vec<NextTrialResult>,
    /// What the fit found of noise.
    pub noise: NoiseResult,
    /// How far personalization goes from the model as given (0) to the most likely values (1), as left-out training
    /// trials are predicted best; of lengths and forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_of_the_way: Option<f64>,
    /// How far to trust the numbers, where they are from profiles and draws of a likelihood.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub soundness: Option<SoundnessResult>,
    /// What the reader must know.
    pub warnings: Vec<WarningResult>,
}

/// A parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterKnowledge {
    /// Muscle or group of tied muscles.
    pub muscle: String,
    /// OpenSim's property.
    pub property: String,
    /// Unit.
    pub unit: String,
    /// Value in the model (of the first muscle of a group).
    pub model: f64,
    /// Bounds.
    pub bounds: [f64; 2],
    /// Value that the data make most likely within the bounds.
    pub most_likely: f64,
    /// `lower` or `upper`, if it stands there.
    pub at_bound: Option<String>,
    /// Interval of lengths and forces: given the trials, with prior knowledge; of other parameters: from data and
    /// bounds alone (profile likelihood).
    pub interval: [f64; 2],
    /// Whether the data set each end.
    pub end_from_data: [bool; 2],
    /// Whether another parameter stands at its bound at an end.
    pub leans_on_bounds: bool,
    /// Degrees of freedom of the noise as far as the interval rests on it, at most 9999.
    pub degrees_of_freedom: f64,
    /// Median of the posterior: data and prior knowledge.
    pub posterior_median: f64,
    /// Its credible interval.
    pub credible: [f64; 2],
    /// Share of the prior variance that the data removed.
    pub share_from_data: f64,
    /// Prior: most probable value and standard deviation of its logarithm.
    pub prior_value: f64,
    /// Standard deviation of the logarithm before the data.
    pub prior_log_sd: f64,
    /// Where the prior is from.
    pub prior_source: String,
}

impl ParameterKnowledge {
    /// Whether its interval holds the most likely value.
    pub fn is_valid(&self) -> bool {
        holds(self.interval, self.most_likely)
    }

    /// Whether the data set both ends of a valid interval.
    pub fn is_determined(&self) -> bool {
        self.end_from_data == [true, true] && self.is_valid()
    }

    /// What the data do for it.
    pub fn verdict(&self) -> &'static str {
        match self.end_from_data {
            _ if !self.is_valid() => NOT_VALID,
            [true, true] => "determined",
            [true, false] => "only bounded below",
            [false, true] => "only bounded above",
            [false, false] => "open",
        }
    }
}

/// A combination.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CombinationResult {
    /// In words.
    pub words: String,
    /// Share of the prior variance that the data removed.
    pub share_from_data: f64,
    /// Standard deviation before the data, in percent.
    pub prior_sd_percent: f64,
    /// And after.
    pub sd_percent: f64,
}

/// A trial that could be recorded next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NextTrialResult {
    /// What it is.
    pub trial: String,
    /// By how much intervals would shrink, in percent, mean over parameters.
    pub mean_shrinkage_percent: f64,
    /// The parameter that gains most.
    pub most: String,
    /// And its gain.
    pub most_percent: f64,
}

/// Standard deviations of the noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseResult {
    /// From sample to sample [N·m].
    pub white_n_m: f64,
    /// Slow disturbances, by the direction of effort (`flexion`, `extension`, `none`) [N·m].
    pub slow_n_m: BTreeMap<String, f64>,
    /// EMG envelope, percent of itself.
    pub emg_percent: f64,
    /// EMG gain from trial to trial, percent.
    pub emg_gain_percent: f64,
    /// EMG that adds, share of MVC.
    pub emg_floor: f64,
}

/// How far the numbers can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoundnessResult {
    /// Largest difference of −2 log likelihood from what the level asks for, by simulation at ends of intervals.
    pub largest_deviance_error: f64,
    /// How much more trials scatter about the fit than the noise explains (variance ratio, at least 1).
    pub dispersion: f64,
    /// Largest split R̂.
    pub largest_r_hat: f64,
    /// Fewest independent draws of any parameter.
    pub fewest_effective_draws: f64,
    /// Paths of the sampler that went astray.
    pub divergent: usize,
    /// Share of draws beyond the polynomials' region.
    pub share_outside: f64,
}
