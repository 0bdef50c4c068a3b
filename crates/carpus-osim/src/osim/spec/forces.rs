//! Forces that are not muscles.

use nalgebra::Vector3;

use super::functions::FunctionSpec;
use super::location::{CoordinateIndex, FrameIndex, Location};
use super::paths::PathSpec;

/// A force that is not a muscle.
#[derive(Clone, Debug)]
pub struct ForceSpec {
    /// Name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// `appliesForce` (not `isDisabled` in old files).
    pub applies_force: bool,
    /// Which force.
    pub kind: ForceKind,
}

impl ForceSpec {
    /// Whether it is a muscle that stands among other forces, because its path is of a class that is not read.
    pub fn is_muscle_without_path(&self) -> bool {
        matches!(&self.kind, ForceKind::Unsupported { class } if class.contains("Muscle"))
    }
}

/// Force classes other than muscles.
#[derive(Clone, Debug)]
pub enum ForceKind {
    /// `CoordinateLimitForce`; limits, stiffness and transition are in the file's units, i.e. per degree and in degrees
    /// for a [`MotionType::Rotational`] coordinate, SI otherwise.
    CoordinateLimit {
        /// The coordinate.
        coordinate: CoordinateIndex,
        /// Stiffness above the upper limit.
        upper_stiffness: f64,
        /// Upper limit.
        upper_limit: f64,
        /// Stiffness below the lower limit.
        lower_stiffness: f64,
        /// Lower limit.
        lower_limit: f64,
        /// Damping beyond the limits.
        damping: f64,
        /// Width of the transition.
        transition: f64,
        /// Whether what the damping takes is a state, `dissipatedEnergy` \[J\].
        computes_dissipation: bool,
    },
    /// `SpringGeneralizedForce`: −stiffness·(q − rest_length) − viscosity·q̇.
    SpringGeneralized {
        /// The coordinate.
        coordinate: CoordinateIndex,
        /// Stiffness.
        stiffness: f64,
        /// Rest value.
        rest_length: f64,
        /// Viscosity.
        viscosity: f64,
    },
    /// `ExpressionBasedCoordinateForce`: a formula in `q` and `qdot`, in SI units.
    ExpressionBasedCoordinate {
        /// The coordinate.
        coordinate: CoordinateIndex,
        /// The formula as written.
        expression: String,
    },
    /// `FunctionBasedBushingForce`.
    FunctionBasedBushing {
        /// First frame.
        frame1: FrameIndex,
        /// Second frame.
        frame2: FrameIndex,
        /// m_x(θx), m_y(θy), m_z(θz), f_x(δx), f_y(δy), f_z(δz).
        functions: Box<[FunctionSpec; 6]>,
        /// Rotational damping.
        rotational_damping: Vector3<f64>,
        /// Translational damping.
        translational_damping: Vector3<f64>,
    },
    /// `Ligament`.
    Ligament {
        /// Its path.
        path: PathSpec,
        /// Resting length [m].
        resting_length: f64,
        /// Force scale [N].
        pcsa_force: f64,
        /// Force (per `pcsa_force`) as a function of normalized length.
        force_length_curve: FunctionSpec,
    },
    /// `PathSpring`.
    PathSpring {
        /// Its path.
        path: PathSpec,
        /// Resting length [m].
        resting_length: f64,
        /// Stiffness [N/m].
        stiffness: f64,
        /// Dissipation [s/m].
        dissipation: f64,
    },
    /// `BushingForce`: linear springs and dampers between two frames.
    Bushing {
        /// First frame.
        frame1: FrameIndex,
        /// Second frame.
        frame2: FrameIndex,
        /// Rotational stiffness [N·m/rad].
        rotational_stiffness: Vector3<f64>,
        /// Translational stiffness [N/m].
        translational_stiffness: Vector3<f64>,
        /// Rotational damping [N·m·s/rad].
        rotational_damping: Vector3<f64>,
        /// Translational damping [N·s/m].
        translational_damping: Vector3<f64>,
    },
    /// `ExpressionBasedBushingForce`: formulas in `theta_x` to `delta_z`.
    ExpressionBasedBushing {
        /// First frame.
        frame1: FrameIndex,
        /// Second frame.
        frame2: FrameIndex,
        /// Formulas of Mx, My, Mz, Fx, Fy, Fz as written.
        expressions: Box<[String; 6]>,
        /// Rotational damping.
        rotational_damping: Vector3<f64>,
        /// Translational damping.
        translational_damping: Vector3<f64>,
    },
    /// `PointToPointSpring`: a spring between two points.
    ///
    /// OpenSim takes the points in the bodies (or ground) that the frames are fixed to, even where a socket names an
    /// offset frame.
    PointToPointSpring {
        /// Frame whose body has the first point.
        body1: FrameIndex,
        /// Frame whose body has the second point.
        body2: FrameIndex,
        /// First point [m].
        point1: Vector3<f64>,
        /// Second point [m].
        point2: Vector3<f64>,
        /// Stiffness [N/m].
        stiffness: f64,
        /// Length without force [m].
        rest_length: f64,
    },
    /// `Blankevoort1991Ligament`.
    Blankevoort1991Ligament {
        /// Its path.
        path: PathSpec,
        /// Force per strain beyond the transition [N].
        linear_stiffness: f64,
        /// Strain where the toe ends.
        transition_strain: f64,
        /// Force per rate of strain [N·s].
        damping_coefficient: f64,
        /// Slack length [m].
        slack_length: f64,
    },
    /// `PrescribedForce`: a force, its point and a torque as functions of time.
    Prescribed(Box<PrescribedForceSpec>),
    /// An actuator that follows a control; without one it does nothing.
    Actuator(ActuatorSpec),
    /// Not computed by this program (class name).
    Unsupported {
        /// OpenSim class name.
        class: String,
    },
}

impl ForceKind {
    /// The path along which the force acts, if it does so.
    pub fn path(&self) -> Option<&PathSpec> {
        match self {
            ForceKind::Ligament { path, .. }
            | ForceKind::PathSpring { path, .. }
            | ForceKind::Blankevoort1991Ligament { path, .. }
            | ForceKind::Actuator(ActuatorSpec { kind: ActuatorKind::Path { path }, .. }) => Some(path),
            _ => None,
        }
    }
}

/// Properties of a `PrescribedForce`; functions that the file does not give are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct PrescribedForceSpec {
    /// Frame that the force acts on.
    pub frame: FrameIndex,
    /// Whether the point is given in ground.
    pub point_is_global: bool,
    /// Whether force and torque are given in ground.
    pub force_is_global: bool,
    /// Force over time [N].
    pub force: Option<[FunctionSpec; 3]>,
    /// Point over time [m].
    pub point: Option<[FunctionSpec; 3]>,
    /// Torque over time [N·m].
    pub torque: Option<[FunctionSpec; 3]>,
}

/// An actuator: its force is the control times `optimal_force`.
#[derive(Clone, Debug)]
pub struct ActuatorSpec {
    /// Force or torque for a control of 1 [N or N·m].
    pub optimal_force: f64,
    /// Lowest control.
    pub min_control: f64,
    /// Highest control.
    pub max_control: f64,
    /// What it acts on.
    pub kind: ActuatorKind,
}

/// Activation of an `ActivationCoordinateActuator`, which follows the control: ȧ = (control − a) / time constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorActivation {
    /// Time constant [s].
    pub time_constant: f64,
    /// Activation before a simulation.
    pub default_activation: f64,
}

/// Actuator classes.
#[derive(Clone, Debug)]
pub enum ActuatorKind {
    /// `CoordinateActuator`, `ActivationCoordinateActuator`: along a coordinate.
    Coordinate {
        /// The coordinate.
        coordinate: CoordinateIndex,
        /// What takes the control's place; `None`: the control acts at once.
        activation: Option<ActuatorActivation>,
    },
    /// `TorqueActuator`: a torque on one body and the opposite on another.
    Torque {
        /// The body that the torque turns.
        body_a: FrameIndex,
        /// The body that the opposite torque turns.
        body_b: FrameIndex,
        /// Axis, not normalized.
        axis: Vector3<f64>,
        /// Whether the axis is given in ground, not in the first body.
        torque_is_global: bool,
    },
    /// `PointToPointActuator`: pushes two points apart.
    PointToPoint {
        /// Body of the first point.
        body_a: FrameIndex,
        /// Body of the second point.
        body_b: FrameIndex,
        /// First point [m].
        point_a: Vector3<f64>,
        /// Second point [m].
        point_b: Vector3<f64>,
        /// Whether the points are given in ground.
        points_are_global: bool,
    },
    /// `PointActuator`: a force at a point of a body.
    Point {
        /// The body.
        body: FrameIndex,
        /// The point [m].
        point: Vector3<f64>,
        /// Whether the point is given in ground.
        point_is_global: bool,
        /// Direction, not normalized.
        direction: Vector3<f64>,
        /// Whether the direction is given in ground.
        force_is_global: bool,
    },
    /// `PathActuator`: a tension along a path.
    Path {
        /// The path.
        path: PathSpec,
    },
}

impl ActuatorKind {
    /// OpenSim's name of the class.
    pub fn class(&self) -> &'static str {
        match self {
            ActuatorKind::Coordinate { activation: None, .. } => "CoordinateActuator",
            ActuatorKind::Coordinate { .. } => "ActivationCoordinateActuator",
            ActuatorKind::Torque { .. } => "TorqueActuator",
            ActuatorKind::PointToPoint { .. } => "PointToPointActuator",
            ActuatorKind::Point { .. } => "PointActuator",
            ActuatorKind::Path { .. } => "PathActuator",
        }
    }
}
