//! Typed view of an `.osim` model, faithful to the file: OpenSim's property names and OpenSim's units.
//!
//! References between components (sockets) are already resolved to indices; defaults that OpenSim assumes for absent
//! properties are already filled in. Nothing here computes: see [`crate::multibody::Model`] for the compiled model.

use nalgebra::{Matrix3, Vector3};

/// Declares an index type into one of the vectors of [`ModelSpec`].
macro_rules! index_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub usize);
    };
}
index_type!(
    /// Index into [`ModelSpec::bodies`].
    BodyIndex
);
index_type!(
    /// Index into [`ModelSpec::frames`]; frame 0 is ground.
    FrameIndex
);
index_type!(
    /// Index into [`ModelSpec::joints`].
    JointIndex
);
index_type!(
    /// Index into [`ModelSpec::coordinates`].
    CoordinateIndex
);
index_type!(
    /// Index into [`ModelSpec::wrap_objects`].
    WrapObjectIndex
);
index_type!(
    /// Index into [`ModelSpec::muscles`].
    MuscleIndex
);

/// Where in the source file something stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// Line of the element's start tag, counted from 1; 0 if the component was not read from a file.
    pub line: usize,
    /// Absolute component path, e.g. `/forceset/ECRL`.
    pub path: String,
    /// The document element (handle used for edits); `None` if the component was not read from a file.
    pub element: Option<usize>,
}

/// A model as its file states it.
#[derive(Clone, Debug, Default)]
pub struct ModelSpec {
    /// Model name.
    pub name: String,
    /// `OpenSimDocument` version, e.g. 40000.
    pub document_version: u32,
    /// Acceleration due to gravity, expressed in ground [m/s²].
    pub gravity: Vector3<f64>,
    /// Rigid bodies in the order of the file (ground is not among them).
    pub bodies: Vec<BodySpec>,
    /// All frames: ground (index 0), one per body, then offset frames.
    pub frames: Vec<FrameSpec>,
    /// Joints in the order of the file.
    pub joints: Vec<JointSpec>,
    /// Coordinates, in the order of joints and, within a joint, in OpenSim's order (SpatialTransform order for a
    /// CustomJoint).
    pub coordinates: Vec<CoordinateSpec>,
    /// Constraints.
    pub constraints: Vec<ConstraintSpec>,
    /// Wrap objects of all frames.
    pub wrap_objects: Vec<WrapObjectSpec>,
    /// Muscles, in the order of the force set.
    pub muscles: Vec<MuscleSpec>,
    /// Forces other than muscles, in the order of the force set.
    pub forces: Vec<ForceSpec>,
    /// Markers.
    pub markers: Vec<MarkerSpec>,
}

/// A rigid body.
#[derive(Clone, Debug)]
pub struct BodySpec {
    /// Body name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass in the body frame [m].
    pub mass_center: Vector3<f64>,
    /// Inertia about the mass centre, in body axes [kg·m²].
    pub inertia: Matrix3<f64>,
    /// The body's frame.
    pub frame: FrameIndex,
}

/// A frame that something can be fixed to.
#[derive(Clone, Debug)]
pub struct FrameSpec {
    /// Frame name (not unique).
    pub name: String,
    /// Where it stands; `at.path` is unique.
    pub at: Location,
    /// What kind of frame.
    pub kind: FrameKind,
}

/// What a frame is fixed to.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameKind {
    /// The inertial frame.
    Ground,
    /// A body's own frame.
    Body(BodyIndex),
    /// `PhysicalOffsetFrame`: fixed in a parent frame.
    Offset {
        /// Parent frame.
        parent: FrameIndex,
        /// Origin in the parent frame [m].
        translation: Vector3<f64>,
        /// Body-fixed x-y-z rotation sequence from the parent frame [rad].
        orientation: Vector3<f64>,
    },
}

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
    /// OpenSim's motion type, as OpenSim itself would determine it.
    pub motion_type: MotionType,
}

/// A function of one argument (or of several, for polynomials OpenSim may nest).
#[derive(Clone, Debug, PartialEq)]
pub enum FunctionSpec {
    /// `Constant`.
    Constant {
        /// The value.
        value: f64,
    },
    /// `LinearFunction`: slope·x + intercept.
    Linear {
        /// Slope.
        slope: f64,
        /// Intercept.
        intercept: f64,
    },
    /// `SimmSpline` (also `natCubicSpline`, `NaturalCubicSpline` of old files).
    SimmSpline {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `PiecewiseLinearFunction`.
    PiecewiseLinear {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `PiecewiseConstantFunction` and `StepFunction` of old files.
    PiecewiseConstant {
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
    },
    /// `StepFunction`: smooth step between two values.
    Step {
        /// Start of the transition.
        start_time: f64,
        /// End of the transition.
        end_time: f64,
        /// Value before.
        start_value: f64,
        /// Value after.
        end_value: f64,
    },
    /// `GCVSpline` of degree 1, 3, 5 or 7.
    GcvSpline {
        /// (degree + 1) / 2.
        half_order: usize,
        /// Error variance; negative: estimated.
        error_variance: f64,
        /// Abscissae.
        x: Vec<f64>,
        /// Ordinates.
        y: Vec<f64>,
        /// Weights.
        weights: Vec<f64>,
    },
    /// `PolynomialFunction`, highest power first.
    Polynomial {
        /// Coefficients, highest power first.
        coefficients: Vec<f64>,
    },
    /// `MultiplierFunction`.
    Multiplier {
        /// Factor.
        scale: f64,
        /// The function that is scaled.
        function: Box<FunctionSpec>,
    },
    /// `Sine`: amplitude·sin(omega·x + phase) + offset.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// Angular frequency.
        omega: f64,
        /// Phase [rad].
        phase: f64,
        /// Offset.
        offset: f64,
    },
}

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

/// A surface that paths can wrap over.
#[derive(Clone, Debug)]
pub struct WrapObjectSpec {
    /// Name (not unique among frames).
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame that it is fixed to.
    pub frame: FrameIndex,
    /// Whether it is active.
    pub active: bool,
    /// Origin in the frame [m].
    pub translation: Vector3<f64>,
    /// Body-fixed x-y-z rotation [rad].
    pub xyz_body_rotation: Vector3<f64>,
    /// Constrained half of the surface.
    pub quadrant: Quadrant,
    /// Which surface.
    pub shape: WrapShape,
}

/// Which half of a wrap surface a path may use (`quadrant`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quadrant {
    /// Unconstrained (`all`).
    All,
    /// One half: axis 0, 1, 2 for x, y, z and its sign (+1 or −1).
    Half {
        /// 0, 1 or 2.
        axis: usize,
        /// +1 or −1.
        sign: i8,
    },
}

/// Wrap surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WrapShape {
    /// `WrapSphere`.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// `WrapCylinder`, axis along z.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Length [m].
        length: f64,
    },
    /// `WrapEllipsoid`.
    Ellipsoid {
        /// Semi-axes [m].
        dimensions: [f64; 3],
    },
    /// `WrapTorus`, axis along z.
    Torus {
        /// Radius of the hole [m], as OpenSim defines it.
        inner_radius: f64,
        /// Outer radius [m], as OpenSim defines it.
        outer_radius: f64,
    },
}

/// A `GeometryPath`.
#[derive(Clone, Debug, Default)]
pub struct PathSpec {
    /// Where it stands.
    pub at: Location,
    /// Points from origin to insertion.
    pub points: Vec<PathPointSpec>,
    /// Wrap instances in the order of the file.
    pub wraps: Vec<PathWrapSpec>,
}

/// A point of a path.
#[derive(Clone, Debug)]
pub struct PathPointSpec {
    /// Point name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame that the point is given in.
    pub frame: FrameIndex,
    /// Which kind of point.
    pub kind: PathPointKind,
}

/// Path point classes.
#[derive(Clone, Debug)]
pub enum PathPointKind {
    /// `PathPoint`.
    Fixed {
        /// Location in the frame [m].
        location: Vector3<f64>,
    },
    /// `ConditionalPathPoint`: active while the coordinate is within the range.
    Conditional {
        /// Location in the frame [m].
        location: Vector3<f64>,
        /// The coordinate that decides.
        coordinate: CoordinateIndex,
        /// Range [rad or m].
        range: [f64; 2],
    },
    /// `MovingPathPoint`: each component a function [m] of a coordinate (`None`: constant in OpenSim, function of 0).
    Moving {
        /// x, y, z: function and its argument.
        location: Box<[(FunctionSpec, Option<CoordinateIndex>); 3]>,
    },
}

/// A `PathWrap`: one path over one wrap object.
#[derive(Clone, Debug)]
pub struct PathWrapSpec {
    /// Name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// The wrap object.
    pub wrap_object: WrapObjectIndex,
    /// How an ellipsoid is wrapped.
    pub method: WrapMethod,
    /// First and last path point between which the path may wrap, counted from 1; −1: no limit.
    pub range: [i32; 2],
}

/// `PathWrap::method`, used for ellipsoids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum WrapMethod {
    /// `hybrid` (the default).
    #[default]
    Hybrid,
    /// `midpoint`.
    Midpoint,
    /// `axial`.
    Axial,
}

/// A muscle.
#[derive(Clone, Debug)]
pub struct MuscleSpec {
    /// Muscle name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// `appliesForce` (not `isDisabled` in old files).
    pub applies_force: bool,
    /// Its path.
    pub path: PathSpec,
    /// Maximum isometric force of the fibres [N].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fiber_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Pennation angle at optimal fibre length [rad].
    pub pennation_angle_at_optimal: f64,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub max_contraction_velocity: f64,
    /// Rigid tendon.
    pub ignore_tendon_compliance: bool,
    /// Activation equals excitation.
    pub ignore_activation_dynamics: bool,
    /// Lowest control (excitation) value.
    pub min_control: f64,
    /// Highest control (excitation) value.
    pub max_control: f64,
    /// The class and its own properties.
    pub kind: MuscleKind,
}

/// Muscle classes.
#[derive(Clone, Debug)]
pub enum MuscleKind {
    /// `Millard2012EquilibriumMuscle`.
    Millard2012Equilibrium(Box<Millard2012Spec>),
    /// A class whose path is understood but whose force is not computed (class name).
    PathOnly {
        /// OpenSim class name.
        class: String,
        /// Own properties of a `Thelen2003Muscle`, which [`crate::dynamics`] simulates.
        thelen2003: Option<Box<Thelen2003Spec>>,
    },
}

/// Properties of `Thelen2003Muscle` beyond those of every muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thelen2003Spec {
    /// `FmaxTendonStrain`: tendon strain at maximum isometric force.
    pub fmax_tendon_strain: f64,
    /// `FmaxMuscleStrain`: passive fibre strain at maximum isometric force.
    pub fmax_muscle_strain: f64,
    /// `KshapeActive`: width of the active force–length curve.
    pub kshape_active: f64,
    /// `KshapePassive`: shape of the passive force–length curve.
    pub kshape_passive: f64,
    /// `Af`: shape of the force–velocity curve.
    pub af: f64,
    /// `Flen`: greatest normalized force of a lengthening fibre.
    pub flen: f64,
    /// `fv_linear_extrap_threshold`: share of `Flen` from which on the force–velocity curve is a line.
    pub fv_linear_extrap_threshold: f64,
    /// Highest pennation angle [rad].
    pub maximum_pennation_angle: f64,
    /// Activation time constant [s].
    pub activation_time_constant: f64,
    /// Deactivation time constant [s].
    pub deactivation_time_constant: f64,
    /// Lower bound of activation.
    pub minimum_activation: f64,
    /// Activation before initialization.
    pub default_activation: f64,
    /// Fibre length assumed before initialization [m].
    pub default_fiber_length: f64,
}

/// Properties of `Millard2012EquilibriumMuscle` beyond those of every muscle. Absent or empty properties carry the
/// value that OpenSim uses in their place.
#[derive(Clone, Debug, PartialEq)]
pub struct Millard2012Spec {
    /// Linear damping of the fibre (dimensionless β).
    pub fiber_damping: f64,
    /// Fibre length assumed before initialization [m].
    pub default_fiber_length: f64,
    /// Activation before initialization.
    pub default_activation: f64,
    /// Lower bound of activation.
    pub minimum_activation: f64,
    /// Activation time constant [s].
    pub activation_time_constant: f64,
    /// Deactivation time constant [s].
    pub deactivation_time_constant: f64,
    /// Highest pennation angle [rad].
    pub maximum_pennation_angle: f64,
    /// Active force–length curve.
    pub active_force_length: ActiveForceLengthSpec,
    /// Force–velocity curve.
    pub force_velocity: ForceVelocitySpec,
    /// Passive fibre force–length curve.
    pub fiber_force_length: FiberForceLengthSpec,
    /// Tendon force–length curve.
    pub tendon_force_length: TendonForceLengthSpec,
}

/// `ActiveForceLengthCurve`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveForceLengthSpec {
    /// Normalized fibre length where the steep ascending limb starts.
    pub min_norm_active_fiber_length: f64,
    /// Normalized fibre length where steep and shallow ascending limbs meet.
    pub transition_norm_fiber_length: f64,
    /// Normalized fibre length where the descending limb ends.
    pub max_norm_active_fiber_length: f64,
    /// Slope of the shallow ascending limb.
    pub shallow_ascending_slope: f64,
    /// Lowest value of the curve.
    pub minimum_value: f64,
}

/// `ForceVelocityCurve`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceVelocitySpec {
    /// Slope at normalized velocity −1.
    pub concentric_slope_at_vmax: f64,
    /// Slope just before reaching it.
    pub concentric_slope_near_vmax: f64,
    /// Slope at velocity 0.
    pub isometric_slope: f64,
    /// Slope at normalized velocity +1.
    pub eccentric_slope_at_vmax: f64,
    /// Slope just before reaching it.
    pub eccentric_slope_near_vmax: f64,
    /// Force multiplier at normalized velocity +1.
    pub max_eccentric_velocity_force_multiplier: f64,
    /// Curviness of the concentric limb, 0 to 1.
    pub concentric_curviness: f64,
    /// Curviness of the eccentric limb, 0 to 1.
    pub eccentric_curviness: f64,
}

/// `FiberForceLengthCurve`; `None`: OpenSim computes the value from the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberForceLengthSpec {
    /// Strain at zero force.
    pub strain_at_zero_force: f64,
    /// Strain at normalized force 1.
    pub strain_at_one_norm_force: f64,
    /// Stiffness at the end of the low-force region.
    pub stiffness_at_low_force: Option<f64>,
    /// Stiffness at normalized force 1.
    pub stiffness_at_one_norm_force: Option<f64>,
    /// Curviness, 0 to 1.
    pub curviness: Option<f64>,
}

/// `TendonForceLengthCurve`; `None`: OpenSim computes the value from the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TendonForceLengthSpec {
    /// Strain at normalized force 1.
    pub strain_at_one_norm_force: f64,
    /// Stiffness at normalized force 1.
    pub stiffness_at_one_norm_force: Option<f64>,
    /// Normalized force at the end of the toe region.
    pub norm_force_at_toe_end: Option<f64>,
    /// Curviness, 0 to 1.
    pub curviness: Option<f64>,
}

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
    /// Not computed by this program (class name).
    Unsupported {
        /// OpenSim class name.
        class: String,
    },
}

/// A marker.
#[derive(Clone, Debug)]
pub struct MarkerSpec {
    /// Name.
    pub name: String,
    /// Where it stands.
    pub at: Location,
    /// Frame.
    pub frame: FrameIndex,
    /// Location in the frame [m].
    pub location: Vector3<f64>,
    /// Whether placing markers leaves it where it is.
    pub fixed: bool,
}
