//! Why a path cannot be compiled.

use carpus_osim::functions::FunctionError;
use carpus_osim::osim::spec::Location;

/// Why a [`PathSpec`](carpus_osim::osim::spec::PathSpec) cannot be compiled into a [`Path`](super::Path).
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PathError {
    /// Fewer than two points.
    #[error("{}: expected at least 2 path points, found {found}", .at.path)]
    TooFewPoints {
        /// The path.
        at: Location,
        /// Number of points found.
        found: usize,
    },
    /// A path of functions without coordinates.
    #[error("{}: coordinate_paths: expected at least one coordinate, found none", .at.path)]
    NoCoordinates {
        /// The path.
        at: Location,
    },
    /// Moment arm functions for some of the coordinates only.
    #[error("{}: moment_arm_functions: expected {expected}, one for each coordinate, or none, found {found}", .at.path)]
    MomentArmFunctions {
        /// The path.
        at: Location,
        /// Number of coordinates.
        expected: usize,
        /// Number of functions.
        found: usize,
    },
    /// A lengthening speed that is no speed of a length.
    #[error(
        "{}: lengthening_speed_function: expected a speed that is 0 at rest and proportional to the coordinates' \
         speeds, found another", .at.path
    )]
    NotProportional {
        /// The path.
        at: Location,
    },
    /// A point or wrap refers to something that the model does not have.
    #[error("{}: refers to {what} {index}, but there are only {count}", .at.path)]
    BadReference {
        /// The point or wrap.
        at: Location,
        /// What is referred to: "frame", "coordinate" or "wrap object".
        what: &'static str,
        /// The index referred to.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// The `range` of a wrap ends beyond the last point (OpenSim fails when it evaluates such a path).
    #[error("{}: range {first} {last} goes beyond the {points} points of the path", .at.path)]
    WrapRange {
        /// The wrap.
        at: Location,
        /// First point of the range, counted from 1.
        first: i32,
        /// Last point of the range, counted from 1.
        last: i32,
        /// Number of points.
        points: usize,
    },
    /// A dimension of a wrap object is impossible (OpenSim refuses it too).
    #[error("{}: {property}: expected {expected}, found {found}", .at.path)]
    WrapDimension {
        /// The wrap object.
        at: Location,
        /// OpenSim's property name.
        property: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// The value found [m].
        found: f64,
    },
    /// A number is NaN or infinite.
    #[error("{}: expected finite {property}, found {found}", .at.path)]
    NotFinite {
        /// The point or wrap object.
        at: Location,
        /// OpenSim's property name.
        property: &'static str,
        /// The value found.
        found: f64,
    },
    /// A function of a moving point cannot be built.
    #[error("{}: {property}: {source}", .at.path)]
    Function {
        /// The point.
        at: Location,
        /// OpenSim's property name.
        property: &'static str,
        /// What is wrong with it.
        source: FunctionError,
    },
}
