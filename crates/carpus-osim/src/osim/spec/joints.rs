//! Joints and their coordinates.

use nalgebra::Vector3;

use super::functions::FunctionSpec;
use super::location::{CoordinateIndex, FrameIndex, JointIndex, Location};

/// A joint between two frames.
#[derive(Clone, Debug)]
pub struct JointSpec {
    /// Joint name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Parent frame (`socket_parent_frame`).
    pub parent_frame: FrameIndex,
    /// Child frame (`socket_child_frame`).
    pub child_frame: FrameIndex,
    /// Coordinates of the joint, in OpenSim's order.
    pub coordinates: Vec<CoordinateIndex>,
    /// Which joint.
    pub kind: JointKind,
}

/// Joint classes.
#[derive(Clone, Debug)]
pub enum JointKind {
    /// `WeldJoint`, no coordinates.
    Weld,
    /// `PinJoint`, rotation about z.
    Pin,
    /// `SliderJoint`, translation along x.
    Slider,
    /// `UniversalJoint`, rotations about x then y.
    Universal,
    /// `BallJoint`, three rotations (quaternion or x-y-z angles in OpenSim).
    Ball,
    /// `GimbalJoint`, body-fixed x-y-z rotations.
    Gimbal,
    /// `PlanarJoint`, rotation about z, translations along x and y.
    Planar,
    /// `FreeJoint`, three rotations and three translations.
    Free,
    /// `EllipsoidJoint`: the child's origin on an ellipsoid in the parent frame, its z axis normal to it; three
    /// rotations.
    Ellipsoid {
        /// Semi-axes [m].
        radii_x_y_z: Vector3<f64>,
    },
    /// `ScapulothoracicJoint`: abduction, elevation and upward rotation on an ellipsoid, then winging (internal
    /// rotation) about an axis tangent to it.
    Scapulothoracic {
        /// Semi-axes of the thoracic ellipsoid [m].
        thoracic_ellipsoid_radii_x_y_z: Vector3<f64>,
        /// Point on the winging axis in the x-y plane of the scapula's joint frame [m].
        scapula_winging_axis_origin: [f64; 2],
        /// Direction of the winging axis in that plane, from the y axis [rad].
        scapula_winging_axis_direction: f64,
    },
    /// `ConstantCurvatureJoint`: a bar of given length that bends to an arc of a circle; rotations about x, z, y.
    ConstantCurvature {
        /// Angles that the coordinates count from [rad].
        neutral_angle_x_z_y: Vector3<f64>,
        /// Length of the bar [m].
        length: f64,
    },
    /// `CustomJoint`: six axes (rotation1..3, translation1..3).
    Custom(Box<[TransformAxisSpec; 6]>),
}

/// One axis of a `SpatialTransform`.
#[derive(Clone, Debug)]
pub struct TransformAxisSpec {
    /// Axis direction as the file gives it (not normalized).
    pub axis: Vector3<f64>,
    /// Coordinates that are the function's arguments.
    pub coordinates: Vec<CoordinateIndex>,
    /// Angle [rad] or displacement [m] as a function of the coordinates.
    pub function: FunctionSpec,
}

/// How OpenSim classifies a coordinate; decides the unit of everything that refers to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionType {
    /// An angle: degrees in OpenSim's files where OpenSim says so.
    Rotational,
    /// A displacement [m].
    Translational,
    /// Neither: never converted to degrees.
    Coupled,
}

/// A generalized coordinate.
#[derive(Clone, Debug)]
pub struct CoordinateSpec {
    /// Coordinate name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// The joint that owns it.
    pub joint: JointIndex,
    /// Default value [rad or m].
    pub default_value: f64,
    /// Default speed [rad/s or m/s].
    pub default_speed_value: f64,
    /// Range [rad or m].
    pub range: [f64; 2],
    /// Whether values are clamped to the range.
    pub clamped: bool,
    /// Whether the coordinate is locked at its default value.
    pub locked: bool,
    /// Whether `prescribed_function` is enforced.
    pub prescribed: bool,
    /// Prescribed value as a function of time [s].
    pub prescribed_function: Option<FunctionSpec>,
    /// Whether assembly moves it as constraints ask, without drawing it to its value.
    pub is_free_to_satisfy_constraints: bool,
    /// OpenSim's motion type, as OpenSim itself would determine it.
    pub motion_type: MotionType,
}
