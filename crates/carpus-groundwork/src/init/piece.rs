//! Columns of a study.

use super::columns::{Column, EmgKind};
use carpus_numerics::plausible::NamedUnit;

/// A column of the study: its name in the files, and how its numbers are read.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Its name.
    pub name: String,
    /// The unit that the file states.
    pub unit: Option<&'static NamedUnit>,
    /// 1 or −1.
    pub sign: f64,
    /// Added after conversion, in the study's unit.
    pub offset: f64,
}

impl Piece {
    pub(super) fn of(column: &Column) -> Piece {
        Piece { name: column.name.clone(), unit: column.unit, sign: 1.0, offset: 0.0 }
    }
}

/// How the clock of the EMG's recorder is set.
#[derive(Clone, Debug, PartialEq)]
pub enum Clock {
    /// One file.
    Same,
    /// One trigger.
    Trigger,
    /// By the dynamometer's torque, which the EMG's recorder took, too.
    Shared(String),
}

/// Which columns the study has.
#[derive(Clone, Debug)]
pub struct Pieces {
    /// Time.
    pub time: Piece,
    /// Angle.
    pub angle: Piece,
    /// Whether angles are in radians though no unit says so.
    pub is_radians: bool,
    /// Speed.
    pub velocity: Option<Piece>,
    /// Moment.
    pub moment: Piece,
    /// Muscle and column of its EMG.
    pub emg: Vec<(String, String)>,
    /// The muscles.
    pub muscles: Vec<String>,
    /// How EMG was recorded.
    pub emg_kind: EmgKind,
    /// Columns that are there and not used.
    pub ignore: Vec<String>,
    /// How the recorders' clocks are set.
    pub clock: Clock,
    /// Rates of the dynamometer and the EMG [Hz].
    pub rates_hz: [f64; 2],
    /// Whether a participant has maximum contractions for raw EMG.
    pub has_mvc: bool,
}
