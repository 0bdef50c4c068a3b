//! What a step of a fibre is taken from, and what it gives.

use super::equation::{Drive, PARAMETERS};
use super::radau::{Reference, STAGES, StepInput, StepSolution, dot, stage_weight_slopes};

/// Accuracy of the integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberAccuracy {
    /// Largest estimate of the local error of fibre length, in optimal fibre lengths.
    pub tolerance: f64,
    /// Largest step [s].
    pub max_step: f64,
}

impl Default for FiberAccuracy {
    /// Forces within about 1e-5 of maximum isometric force.
    fn default() -> Self {
        FiberAccuracy { tolerance: 2e-6, max_step: 0.02 }
    }
}

/// Where a fibre cannot be integrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stuck {
    /// Time [s].
    pub(crate) time: f64,
}

/// What drives a fibre, as functions of time.
pub(crate) trait DriveSource {
    /// Activation and path length at `time`; `cursor` remembers the neighbourhood between calls.
    fn drive(&self, time: f64, cursor: &mut Cursor) -> Drive;

    /// Speed of the path [m/s], with which some classes of muscles start.
    fn speed(&self, time: f64) -> f64;
}

/// Positions in the tables of a drive source.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cursor {
    pub(crate) activation: usize,
    pub(crate) angle: usize,
    pub(crate) path: usize,
}

/// A fibre's state at a sample.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FiberSample {
    /// Normalized fibre length.
    pub(crate) x: f64,
    /// Its rate [1/s].
    pub(crate) rate: f64,
    /// dx/dp.
    pub(crate) by_parameters: [f64; PARAMETERS],
}

/// A step as it was taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepTaken {
    /// Time at its start [s].
    pub(crate) start: f64,
    /// Its size and what drives the fibre at the stages.
    pub(crate) input: StepInput,
    /// Normalized fibre length at its start, and stage increments; `None` for a fibre that rests at its shortest
    /// length.
    pub(crate) path: Option<(f64, [f64; 3])>,
    /// Whether the fibre is at its shortest length at the end.
    pub(crate) ends_shortest: bool,
}

impl StepTaken {
    pub(super) fn resting(start: f64, input: &StepInput) -> StepTaken {
        StepTaken { start, input: *input, path: None, ends_shortest: true }
    }

    pub(super) fn moving(start: f64, input: &StepInput, from: f64, z: [f64; 3], end: f64) -> StepTaken {
        StepTaken { start, input: *input, path: Some((from, z)), ends_shortest: end != from + z[2] }
    }
}

/// What became of an attempt to take a step.
pub(super) enum Attempt {
    /// The fibre stays at its shortest length.
    Stays,
    /// The step is solved.
    Moves(StepSolution),
    /// The step must be divided.
    Divide,
}

/// Fibre length and rate within a step of size `h` from `start`, from its stage increments and their weights.
#[inline]
pub(super) fn within(start: f64, z: [f64; 3], weights: [f64; 3], h: f64) -> FiberSample {
    let slopes = stage_weight_slopes(local_time(weights));
    FiberSample { x: start + dot(weights, z), rate: dot(slopes, z) / h, by_parameters: [0.0; PARAMETERS] }
}

/// The local time θ that stage weights belong to: the polynomial that is θ itself has stage increments cᵢ.
fn local_time(weights: [f64; 3]) -> f64 {
    weights[0] * STAGES[0] + weights[1] * STAGES[1] + weights[2] * STAGES[2]
}

/// Inputs of the step between two times.
pub(super) fn step_input(source: &impl DriveSource, start: f64, end: f64, cursor: &mut Cursor) -> StepInput {
    let h = end - start;
    let at = |i: usize| if i == 2 { end } else { start + STAGES[i] * h };
    let drive = [0, 1, 2].map(|i| source.drive(at(i), cursor));
    StepInput { h, drive, reference: Reference::default() }
}
