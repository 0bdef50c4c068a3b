//! The least noise that moments have.

use super::Analysis;
use crate::noise;

/// Least white noise of the moment at a wrist [N·m].
///
/// A torque that was filtered has none, and less of what the muscles did, too: with 0.003 N·m or less, a filter of 6 Hz
/// alone can raise an alarm.
const LEAST_WHITE_AT_WRIST: f64 = 0.01;

impl Analysis<'_> {
    /// Least white noise of the moment, which goes with the joint's strength [N·m].
    pub(crate) fn least_white(&self) -> f64 {
        (LEAST_WHITE_AT_WRIST * self.forward.joint.strength).max(noise::LEAST_WHITE)
    }
}
