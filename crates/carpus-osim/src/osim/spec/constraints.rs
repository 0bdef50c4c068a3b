//! Constraints.

use nalgebra::Vector3;

use super::functions::FunctionSpec;
use super::location::{CoordinateIndex, FrameIndex, Location};

/// A constraint.
#[derive(Clone, Debug)]
pub struct ConstraintSpec {
    /// Constraint name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Whether it is enforced (`isEnforced`, or not `isDisabled` in old files).
    pub is_enforced: bool,
    /// Which constraint.
    pub kind: ConstraintKind,
}

/// Constraint classes.
#[derive(Clone, Debug)]
pub enum ConstraintKind {
    /// `CoordinateCouplerConstraint`: dependent = scale_factor·function(independents).
    CoordinateCoupler {
        /// Arguments of the function.
        independent_coordinates: Vec<CoordinateIndex>,
        /// The coordinate that follows.
        dependent_coordinate: CoordinateIndex,
        /// The coupling function.
        function: FunctionSpec,
        /// Multiplies the function's value.
        scale_factor: f64,
    },
    /// `WeldConstraint`: two frames coincide.
    Weld {
        /// First frame.
        frame1: FrameIndex,
        /// Second frame.
        frame2: FrameIndex,
    },
    /// `PointConstraint`: two points coincide.
    ///
    /// Here and below OpenSim takes points and directions in the body (or ground) that a frame is fixed to, even where
    /// the socket names an offset frame.
    Point {
        /// Frame whose body has the first point.
        body_1: FrameIndex,
        /// Frame whose body has the second point.
        body_2: FrameIndex,
        /// First point in its body [m].
        location_body_1: Vector3<f64>,
        /// Second point in its body [m].
        location_body_2: Vector3<f64>,
    },
    /// `ConstantDistanceConstraint`: a massless rod between two points.
    ConstantDistance {
        /// Frame whose body has the first point.
        body_1: FrameIndex,
        /// Frame whose body has the second point.
        body_2: FrameIndex,
        /// First point in its body [m].
        location_body_1: Vector3<f64>,
        /// Second point in its body [m].
        location_body_2: Vector3<f64>,
        /// Length of the rod [m].
        constant_distance: f64,
    },
    /// `PointOnLineConstraint`: a point stays on a line.
    PointOnLine {
        /// Frame whose body has the line.
        line_body: FrameIndex,
        /// Frame whose body has the point.
        follower_body: FrameIndex,
        /// Direction of the line, as the file gives it (not normalized).
        line_direction_vec: Vector3<f64>,
        /// A point of the line [m].
        point_on_line: Vector3<f64>,
        /// The point that follows [m].
        point_on_follower: Vector3<f64>,
    },
    /// Understood as a constraint, not enforced by this program (class name).
    Unsupported {
        /// OpenSim class name.
        class: String,
    },
}

impl ConstraintKind {
    /// OpenSim's name of the class.
    pub fn class(&self) -> &str {
        match self {
            ConstraintKind::CoordinateCoupler { .. } => "CoordinateCouplerConstraint",
            ConstraintKind::Weld { .. } => "WeldConstraint",
            ConstraintKind::Point { .. } => "PointConstraint",
            ConstraintKind::ConstantDistance { .. } => "ConstantDistanceConstraint",
            ConstraintKind::PointOnLine { .. } => "PointOnLineConstraint",
            ConstraintKind::Unsupported { class } => class,
        }
    }
}
