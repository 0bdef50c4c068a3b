//! What of a trial is looked at.

use nalgebra::DMatrix;

/// A trial: its residual and what was recorded.
#[derive(Clone, Copy, Debug)]
pub struct TrialTable<'a> {
    /// Recorded moment minus simulated [N·m].
    pub residual: &'a [f64],
    /// Time in the trial [s].
    pub time: &'a [f64],
    /// Place in the session, 0 to 1.
    pub session: f64,
    /// Angle [rad].
    pub angle: &'a [f64],
    /// Speed [rad/s].
    pub speed: &'a [f64],
    /// Acceleration [rad/s²].
    pub acceleration: &'a [f64],
    /// Activation of each active muscle.
    pub activation: &'a [Vec<f64>],
    /// Columns that are fitted beside every formula, the noise whitened: what muscle parameters do.
    pub beside: Option<&'a DMatrix<f64>>,
}
