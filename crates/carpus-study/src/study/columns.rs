//! Which column of a trial file is what.

/// Names of the columns of trial files.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    /// The table in trial files that have several, by title or number; `None`: the one that has the columns.
    pub table: Option<String>,
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
    /// How numbers of the files become what the columns are said to hold.
    pub conversions: Conversions,
}

/// How the numbers of every column become those that a study takes: seconds, `angle_unit`, N·m, parts of 1 or raw EMG.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Conversions {
    /// Of time.
    pub time: Conversion,
    /// Of the angle.
    pub angle: Conversion,
    /// Of the angular velocity.
    pub velocity: Conversion,
    /// Of the moment.
    pub moment: Conversion,
    /// Of the EMG of each active muscle; empty: all as they are.
    pub emg: Vec<Conversion>,
}

impl Conversions {
    /// Of a muscle's EMG.
    pub fn emg(&self, muscle: usize) -> Conversion {
        self.emg.get(muscle).copied().unwrap_or_default()
    }
}

/// ```text
/// value = factor · number + offset
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conversion {
    /// `sign` times `scale` times what one of `unit` is.
    pub factor: f64,
    /// Added afterwards, in the unit that the study takes.
    pub offset: f64,
}

impl Default for Conversion {
    fn default() -> Self {
        Conversion { factor: 1.0, offset: 0.0 }
    }
}

impl Conversion {
    /// The value that a number of the file stands for.
    pub fn of(self, number: f64) -> f64 {
        if self == Conversion::default() { number } else { self.factor * number + self.offset }
    }
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
