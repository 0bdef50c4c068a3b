//! Why a model cannot be compiled.

use carpus_osim::functions::FunctionError;
use carpus_osim::osim::spec::Location;

/// Why a [`ModelSpec`](carpus_osim::osim::spec::ModelSpec) cannot be compiled into a [`Model`](super::Model).
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CompileError {
    /// A component refers to another one that does not exist.
    #[error("{}: refers to {what} {index}, but there are only {count}", .at.path)]
    BadReference {
        /// Where.
        at: Location,
        /// What is referred to: "frame", "body", "coordinate" or "joint".
        what: &'static str,
        /// The index referred to.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// An offset frame is, through its parents, fixed to itself.
    #[error("{}: the frame's parents lead back to itself, expected them to end at a body or ground", .at.path)]
    FrameCycle {
        /// The frame.
        at: Location,
    },
    /// A joint connects a body with itself.
    #[error("{}: both frames of the joint are fixed to the same body {body:?}, expected two bodies", .at.path)]
    JointWithinBody {
        /// The joint.
        at: Location,
        /// The body.
        body: String,
    },
    /// A joint has another number of coordinates than its class.
    #[error("{}: expected {expected} coordinates, found {found}", .at.path)]
    CoordinateCount {
        /// The joint.
        at: Location,
        /// Number that the joint class has.
        expected: usize,
        /// Number found.
        found: usize,
    },
    /// Two axes of a CustomJoint are parallel (OpenSim refuses them too).
    #[error("{}: {} axes {first} and {second} of the SpatialTransform are parallel", .at.path, .kind)]
    ParallelAxes {
        /// The joint.
        at: Location,
        /// "rotation" or "translation".
        kind: &'static str,
        /// Number of the first axis, counted from 1.
        first: usize,
        /// Number of the second axis, counted from 1.
        second: usize,
    },
    /// An axis of a CustomJoint has no direction.
    #[error("{}: axis {axis} of the SpatialTransform has no direction: {x} {y} {z}", .at.path)]
    DegenerateAxis {
        /// The joint.
        at: Location,
        /// Number of the axis, 1 to 6.
        axis: usize,
        /// x component found.
        x: f64,
        /// y component found.
        y: f64,
        /// z component found.
        z: f64,
    },
    /// An axis of a CustomJoint is a function of more than one coordinate, which OpenSim computes and this program does
    /// not.
    #[error(
        "{}: {axis} of the SpatialTransform is a function of several coordinates ({coordinates}), which is not \
         supported; expected \
         a function of one",
        .at.path
    )]
    SeveralCoordinates {
        /// The joint.
        at: Location,
        /// The axis.
        axis: &'static str,
        /// Names of the coordinates.
        coordinates: String,
    },
    /// A function cannot be built.
    #[error("{}: {property}: {source}", .at.path)]
    Function {
        /// Owner of the function.
        at: Location,
        /// What the function is for.
        property: String,
        /// What is wrong with it.
        source: FunctionError,
    },
    /// A function of one variable was given another number of coordinates.
    #[error("{}: {property}: expected a function of one coordinate, found {found} coordinates", .at.path)]
    ArgumentCount {
        /// Owner of the function.
        at: Location,
        /// What the function is for.
        property: String,
        /// Number of coordinates.
        found: usize,
    },
    /// A coordinate is the dependent one of two couplers, or of a coupler that (perhaps through others) depends on it.
    #[error("{}: coordinate {coordinate:?} {problem}", .at.path)]
    Coupler {
        /// The coupler constraint.
        at: Location,
        /// The dependent coordinate.
        coordinate: String,
        /// What is wrong.
        problem: CouplerProblem,
    },
    /// A number is NaN or infinite.
    #[error("{}: expected finite {property}, found {found}", .at.path)]
    NotFinite {
        /// Where.
        at: Location,
        /// Property name.
        property: &'static str,
        /// The value found.
        found: f64,
    },
}

impl CompileError {
    /// Where it is wrong.
    pub fn at(&self) -> &Location {
        match self {
            CompileError::BadReference { at, .. }
            | CompileError::FrameCycle { at }
            | CompileError::JointWithinBody { at, .. }
            | CompileError::CoordinateCount { at, .. }
            | CompileError::ParallelAxes { at, .. }
            | CompileError::DegenerateAxis { at, .. }
            | CompileError::Function { at, .. }
            | CompileError::ArgumentCount { at, .. }
            | CompileError::SeveralCoordinates { at, .. }
            | CompileError::Coupler { at, .. }
            | CompileError::NotFinite { at, .. } => at,
        }
    }
}

/// What is wrong with a coupler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CouplerProblem {
    /// Two couplers drive one coordinate.
    DrivenTwice,
    /// Couplers form a cycle.
    Cycle,
}

impl std::fmt::Display for CouplerProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            CouplerProblem::DrivenTwice => "is already the dependent coordinate of another coupler",
            CouplerProblem::Cycle => "depends on itself through a cycle of couplers",
        })
    }
}
