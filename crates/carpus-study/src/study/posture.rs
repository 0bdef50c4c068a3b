//! The posture in which trials are recorded.

/// A coordinate held at a value in every trial.
#[derive(Clone, Debug, PartialEq)]
pub struct PostureCoordinate {
    /// OpenSim coordinate.
    pub coordinate: String,
    /// Line of `study.toml`.
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
