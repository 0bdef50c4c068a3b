//! Generalized coordinates of a compiled model.

use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{JointIndex, MotionType};

/// A generalized coordinate.
#[derive(Clone, Debug)]
pub struct Coordinate {
    /// Coordinate name.
    pub name: String,
    /// The joint that owns it.
    pub joint: JointIndex,
    /// Default value [rad or m]; not corrected for couplers, see [`Model::default_coordinates`](super::Model).
    pub default_value: f64,
    /// Default speed [rad/s or m/s].
    pub default_speed_value: f64,
    /// Range [rad or m].
    pub range: [f64; 2],
    /// Whether values are clamped to the range.
    pub clamped: bool,
    /// Whether the coordinate is locked at its default value.
    pub locked: bool,
    /// Prescribed value as a function of time [s], if prescribed.
    pub prescribed: Option<Function>,
    /// Whether assembly moves it as constraints ask, without drawing it to its value.
    pub is_free_to_satisfy_constraints: bool,
    /// Rotational, translational or coupled, as OpenSim classifies it.
    pub motion_type: MotionType,
}

impl Coordinate {
    /// Whether `value` lies in the coordinate's range.
    pub fn in_range(&self, value: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&value)
    }
}
