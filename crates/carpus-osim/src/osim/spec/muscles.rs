//! Muscles and their curves.

use super::functions::FunctionSpec;
use super::location::Location;
use super::paths::PathSpec;

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
    /// Another class. Its path is understood; its force is computed if its law is known.
    OtherClass {
        /// OpenSim class name.
        class: String,
        /// Properties of the classes that `carpus::dynamics` simulates; `None`: the force is not computed.
        law: Option<Box<OtherMuscleSpec>>,
    },
}

/// Properties of muscle classes beyond those of every muscle, but for `Millard2012EquilibriumMuscle`.
#[derive(Clone, Debug)]
pub enum OtherMuscleSpec {
    /// `Thelen2003Muscle`.
    Thelen2003(Thelen2003Spec),
    /// `DeGrooteFregly2016Muscle`.
    DeGrooteFregly2016(DeGrooteFregly2016Spec),
    /// `RigidTendonMuscle`.
    RigidTendon(RigidTendonSpec),
    /// `Schutte1993Muscle_Deprecated`, `Delp1990Muscle_Deprecated`.
    Deprecated(DeprecatedMuscleSpec),
}

/// Properties of `DeGrooteFregly2016Muscle` beyond those of every muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeGrooteFregly2016Spec {
    /// Activation time constant [s].
    pub activation_time_constant: f64,
    /// Deactivation time constant [s].
    pub deactivation_time_constant: f64,
    /// Activation before initialization.
    pub default_activation: f64,
    /// Tendon force over maximum isometric force before initialization.
    pub default_normalized_tendon_force: f64,
    /// `tendon_compliance_dynamics_mode` is not `explicit`: a solver outside the muscle has to give the tendon force's
    /// rate.
    pub implicit_tendon_compliance: bool,
    /// Width of the active force–length curve, at least 1.
    pub active_force_width_scale: f64,
    /// Damping force over maximum isometric force per normalized fibre velocity.
    pub fiber_damping: f64,
    /// Fibre strain at a passive force of the maximum isometric force.
    pub passive_fiber_strain_at_one_norm_force: f64,
    /// Tendon strain at the maximum isometric force.
    pub tendon_strain_at_one_norm_force: f64,
    /// No passive force.
    pub ignore_passive_fiber_force: bool,
    /// Steepness of the change between activation and deactivation.
    pub activation_dynamics_smoothing: f64,
}

/// Curves of `RigidTendonMuscle`.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidTendonSpec {
    /// Active force by normalized fibre length.
    pub active_force_length_curve: FunctionSpec,
    /// Passive force by normalized fibre length.
    pub passive_force_length_curve: FunctionSpec,
    /// Factor of the active force by normalized fibre velocity.
    pub force_velocity_curve: FunctionSpec,
}

/// Properties of `Schutte1993Muscle_Deprecated` and `Delp1990Muscle_Deprecated` beyond those of every muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct DeprecatedMuscleSpec {
    /// Unit of time [s].
    pub time_scale: f64,
    /// Speed of activation per excitation.
    pub activation1: f64,
    /// Speed of activation and deactivation.
    pub activation2: f64,
    /// Tendon force by tendon strain.
    pub tendon_force_length_curve: FunctionSpec,
    /// Active force by normalized fibre length.
    pub active_force_length_curve: FunctionSpec,
    /// Passive force by normalized fibre length; `None`: the exponential that Schutte's muscle has without a curve.
    pub passive_force_length_curve: Option<FunctionSpec>,
    /// The class and what only it has.
    pub kind: DeprecatedMuscleKind,
}

/// What the two classes do not share.
#[derive(Clone, Debug, PartialEq)]
pub enum DeprecatedMuscleKind {
    /// `Schutte1993Muscle_Deprecated`.
    Schutte1993 {
        /// Damping of the fibre.
        damping: f64,
    },
    /// `Delp1990Muscle_Deprecated`.
    Delp1990 {
        /// Mass between fibre and tendon, normalized.
        mass: f64,
        /// Factor of the active force by normalized fibre velocity.
        force_velocity_curve: FunctionSpec,
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
