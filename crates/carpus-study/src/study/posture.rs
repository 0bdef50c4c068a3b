//! The posture in which trials are recorded.

/// A coordinate held at a value: in every trial (`study.toml`), or in one (`trials.csv`).
#[derive(Clone, Debug, PartialEq)]
pub struct PostureCoordinate {
    /// OpenSim coordinate.
    pub coordinate: String,
    /// Line of its file.
    pub line: usize,
    /// The value as written: degrees if the coordinate is a rotation, metres if a translation. Which of the two it
    /// is only the model knows: see [`Self::value`].
    pub value_deg_or_m: f64,
}

impl PostureCoordinate {
    /// The value in internal units [rad or m].
    pub fn value(&self, is_translation: bool) -> f64 {
        if is_translation { self.value_deg_or_m } else { self.value_deg_or_m.to_radians() }
    }
}

/// What a coordinate is held at in a trial.
pub(super) const POSTURE_EXPECTED: &str = "an angle in degrees (metres for a translation)";

/// Whether a coordinate can be held at a value in a trial [degrees, or metres].
pub(super) fn is_posture(value: f64) -> bool {
    value.abs() <= 360.0
}

/// Whether two lists hold the same coordinates at the same values, in whatever order.
pub fn is_same_posture(a: &[PostureCoordinate], b: &[PostureCoordinate]) -> bool {
    let is_in = |held: &PostureCoordinate, other: &[PostureCoordinate]| {
        other.iter().any(|o| o.coordinate == held.coordinate && o.value_deg_or_m == held.value_deg_or_m)
    };
    a.len() == b.len() && a.iter().all(|held| is_in(held, b)) && b.iter().all(|held| is_in(held, a))
}

/// Why a posture in degrees looks like radians: it is a multiple of 15° written in radians.
pub(super) fn radian_evidence(value: f64) -> Option<String> {
    let in_degrees = value.to_degrees();
    let nearest = (in_degrees / 15.0).round() * 15.0;
    let round_in_degrees = (value * 4.0).fract() == 0.0;
    (value != 0.0 && !round_in_degrees && value.abs() < 3.2 && nearest != 0.0 && (in_degrees - nearest).abs() < 0.1)
        .then(|| format!("{value} rad are {nearest}°"))
}
