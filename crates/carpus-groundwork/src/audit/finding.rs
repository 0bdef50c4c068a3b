//! What an audit finds.

use serde::Serialize;

use super::super::model::LoadedModel;
use carpus_osim::osim::spec::{CoordinateIndex, Location, MotionType};

/// How sure it is that something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// No body has it, or nothing can be computed with it.
    Error,
    /// Probably not what the author meant.
    Warning,
    /// True of many good models; to be known by who uses the model there.
    Note,
}

/// What was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Check {
    /// A value against its plausible range.
    Value,
    /// Masses and inertias.
    Inertia,
    /// Range and default of a coordinate.
    Range,
    /// A coupler against the range of the coordinate that follows.
    Coupler,
    /// Path points against the surfaces that the path wraps around.
    Wrap,
    /// Jumps of a path's length.
    PathJump,
    /// Wrapping the long way round.
    LongWay,
    /// A muscle that no coordinate moves.
    NoJoint,
    /// Tendons that are always slack.
    SlackTendon,
    /// Fibre lengths over the ranges.
    FiberLength,
    /// Moment arms that change sign.
    MomentArmSign,
    /// Moment arms against the anatomical action.
    Action,
    /// Forces and lengths against published architecture, the model's other muscles and the other side.
    Architecture,
}

impl Check {
    /// A title for people.
    pub fn title(self) -> &'static str {
        match self {
            Check::Value => "implausible value",
            Check::Inertia => "mass and inertia",
            Check::Range => "range of a coordinate",
            Check::Coupler => "coupler",
            Check::Wrap => "wrapping surface",
            Check::PathJump => "path jumps",
            Check::LongWay => "path wraps the long way round",
            Check::NoJoint => "muscle crosses no joint",
            Check::SlackTendon => "tendon is always slack",
            Check::FiberLength => "fibre length",
            Check::MomentArmSign => "moment arm changes sign",
            Check::Action => "moment arm against anatomy",
            Check::Architecture => "architecture",
        }
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// How sure it is.
    pub level: Level,
    /// What was looked at.
    pub check: Check,
    /// Absolute path of the component.
    pub path: String,
    /// Its line in the file; 0 if it is not known.
    pub line: usize,
    /// The coordinate that was moved.
    pub coordinate: Option<String>,
    /// How much, in `unit`.
    pub value: Option<f64>,
    /// Unit of `value`; empty for a ratio.
    pub unit: &'static str,
    /// What is wrong.
    pub text: String,
    /// What to do.
    pub hint: String,
}

impl Finding {
    /// A finding without a coordinate and a number.
    pub fn new(level: Level, check: Check, at: &Location, text: impl Into<String>, hint: impl Into<String>) -> Finding {
        Finding {
            level,
            check,
            path: at.path.clone(),
            line: at.line,
            coordinate: None,
            value: None,
            unit: "",
            text: text.into(),
            hint: hint.into(),
        }
    }

    /// The same with how much it is.
    pub fn of_size(self, value: f64, unit: &'static str) -> Finding {
        Finding { value: Some(value), unit, ..self }
    }

    /// The same about a coordinate.
    pub fn over(self, loaded: &LoadedModel, coordinate: CoordinateIndex) -> Finding {
        Finding { coordinate: Some(loaded.model.coordinates[coordinate.0].name.clone()), ..self }
    }
}

/// A value of a coordinate, with its unit.
pub(super) fn shown(loaded: &LoadedModel, coordinate: CoordinateIndex, value: f64) -> String {
    match loaded.model.coordinates[coordinate.0].motion_type {
        MotionType::Translational => format!("{value:.4} m"),
        _ => format!("{:.1}°", value.to_degrees()),
    }
}
