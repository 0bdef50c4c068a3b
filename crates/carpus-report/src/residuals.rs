//! A model's residual along axes, as results files keep it.

use serde::{Deserialize, Serialize};

/// Measured minus simulated moment of a model along every axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualResult {
    /// Model id.
    pub model: String,
    /// Root mean square over the trials, maximal contractions left out [N·m].
    pub rms_n_m: f64,
    /// Noise that repetitions of the same condition show [N·m]; absent without repetitions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repetition_noise_n_m: Option<f64>,
    /// Pairs of repetitions behind it.
    pub repetition_pairs: usize,
    /// Along every axis.
    pub axes: Vec<AxisCurve>,
    /// By frequency.
    pub bands: Vec<FrequencyBand>,
}

/// The residual along an axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisCurve {
    /// The axis: `angle`, `velocity`, …, `muscle:ECRL`.
    pub axis: String,
    /// Unit of the axis.
    pub unit: String,
    /// Share of the residual's mean square that the curve explains, less what chance would.
    pub share_of_error: f64,
    /// Per bin: place on the axis, mean residual [N·m], and its 95 % interval over trials (absent from a single trial).
    pub curve: Vec<(f64, f64, Option<[f64; 2]>)>,
}

/// A band of frequencies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrequencyBand {
    /// Lower edge [Hz].
    pub low_hz: f64,
    /// Upper edge [Hz]; absent for the last band.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high_hz: Option<f64>,
    /// Share of the residual's mean square.
    pub share_of_error: f64,
    /// Its 95 % interval over trials; absent from a single trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<[f64; 2]>,
}

impl AxisCurve {
    /// The place on the axis whose mean residual is the largest, the residual, and its interval.
    pub fn largest(&self) -> (f64, f64, Option<[f64; 2]>) {
        let largest = self.curve.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        largest.copied().unwrap_or((0.0, 0.0, None))
    }
}

impl ResidualResult {
    /// The axes, those that explain most of the error first.
    pub fn axes_by_share(&self) -> Vec<&AxisCurve> {
        let mut axes: Vec<&AxisCurve> = self.axes.iter().collect();
        axes.sort_by(|a, b| b.share_of_error.total_cmp(&a.share_of_error));
        axes
    }

    /// The curve along an axis.
    pub fn axis(&self, axis: &str) -> Option<&AxisCurve> {
        self.axes.iter().find(|a| a.axis == axis)
    }
}
