//! Which column of a trial file is what.

/// Names of the columns of trial files.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    /// Time \[s\].
    pub time: String,
    /// Angle of the dynamometer's coordinate, in `angle_unit`.
    pub angle: String,
    /// Angular velocity, in `angle_unit` per second.
    pub velocity: String,
    /// Whether `study.toml` names the velocity column, so that its absence is an error.
    pub velocity_required: bool,
    /// Measured moment [N·m].
    pub moment: String,
    /// Moments about further coordinates, if the machine measures them.
    pub further_moments: Vec<FurtherMoment>,
    /// Column of the EMG of each active muscle (same order); one column may serve several muscles.
    pub emg: Vec<String>,
    /// Columns that are there and not used.
    pub ignore: Vec<String>,
    /// Unit of angle and velocity in the files.
    pub angle_unit: AngleUnit,
}

/// A moment that is measured about a coordinate beside the dynamometer's, which stays at its posture.
#[derive(Clone, Debug, PartialEq)]
pub struct FurtherMoment {
    /// OpenSim coordinate; the moment is positive in its positive direction.
    pub coordinate: String,
    /// Column of trial files [N·m].
    pub column: String,
    /// Line of `study.toml`.
    pub line: usize,
}

/// Unit of angles in trial files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AngleUnit {
    /// Degrees.
    #[default]
    Degrees,
    /// Radians.
    Radians,
}

impl AngleUnit {
    /// Converts a value of this unit to radians.
    pub fn to_radians(self, value: f64) -> f64 {
        match self {
            AngleUnit::Degrees => value.to_radians(),
            AngleUnit::Radians => value,
        }
    }
}
