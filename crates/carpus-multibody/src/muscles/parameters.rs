//! What a Millard 2012 muscle is made of.

use super::activation::FirstOrderActivation;
use super::curves::MillardCurves;
use super::error::MuscleError;
use super::law::{
    Balance, Contraction, MuscleLaw, RigidTendonRule, ValueAndSlope, balance_of_forces, balance_of_velocities,
    force_of_fiber,
};
use super::pennation::{FixedWidthPennation, significant_real};
use carpus_numerics::numerics::{Scalar, SmoothSegmentedFunction};
use carpus_osim::osim::spec::{Millard2012Spec, MuscleKind, MuscleSpec};
use std::sync::Arc;

/// Damping below this is none (OpenSim's `MIN_NONZERO_DAMPING_COEFFICIENT`).
pub const MIN_NONZERO_DAMPING_COEFFICIENT: f64 = 0.001;

/// The properties that a muscle's forces depend on, under OpenSim's names; all may carry derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Millard2012Parameters<S = f64> {
    /// Force of the fibres at optimal length, full activation and zero velocity [N].
    pub max_isometric_force: S,
    /// Fibre length of greatest active force [m].
    pub optimal_fiber_length: S,
    /// Tendon length above which the tendon pulls [m].
    pub tendon_slack_length: S,
    /// Angle between fibre and tendon at optimal fibre length [rad].
    pub pennation_angle_at_optimal: S,
    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub max_contraction_velocity: S,
    /// Damping coefficient β [-]; below [`MIN_NONZERO_DAMPING_COEFFICIENT`] the fibre is not damped.
    pub fiber_damping: S,
    /// Time constant of activation [s].
    pub activation_time_constant: S,
    /// Time constant of deactivation [s].
    pub deactivation_time_constant: S,
}

impl Millard2012Parameters<f64> {
    /// The same values as another scalar type, without derivatives.
    pub fn lift<S: Scalar>(&self) -> Millard2012Parameters<S> {
        Millard2012Parameters {
            max_isometric_force: S::constant(self.max_isometric_force),
            optimal_fiber_length: S::constant(self.optimal_fiber_length),
            tendon_slack_length: S::constant(self.tendon_slack_length),
            pennation_angle_at_optimal: S::constant(self.pennation_angle_at_optimal),
            max_contraction_velocity: S::constant(self.max_contraction_velocity),
            fiber_damping: S::constant(self.fiber_damping),
            activation_time_constant: S::constant(self.activation_time_constant),
            deactivation_time_constant: S::constant(self.deactivation_time_constant),
        }
    }
}

/// What a muscle is made of apart from its numbers; fixed while parameters are fitted.
#[derive(Clone, Debug)]
pub(super) struct Structure {
    pub name: String,
    pub curves: MillardCurves,
    pub damped: bool,
    pub ignore_tendon_compliance: bool,
    pub ignore_activation_dynamics: bool,
    pub minimum_activation: f64,
    pub maximum_pennation_angle: f64,
    pub default_activation: f64,
    pub default_fiber_length: f64,
}

/// A Millard 2012 equilibrium muscle: a fibre, pennate at fixed width, in series with a tendon.
///
/// ```text
/// F_max [a f_L(l̃) f_V(ṽ) + f_PE(l̃) + β ṽ] cos φ = F_max f_T(l̃_T)        l̃ = l/l_opt, ṽ = v/(v_max l_opt)
/// ```
/// States are the activation a and (unless the tendon is rigid) the fibre length l; the muscle's path enters as length
/// and lengthening speed. Lengths [m], velocities [m/s] positive when lengthening, forces [N] positive in tension.
///
/// # References
/// Millard et al. (2013), doi:10.1115/1.4023390; OpenSim `Millard2012EquilibriumMuscle`.
#[derive(Clone, Debug)]
pub struct Millard2012<S = f64> {
    pub(super) parameters: Millard2012Parameters<S>,
    pub(super) structure: Arc<Structure>,
    pub(super) pennation: FixedWidthPennation<S>,
    pub(super) minimum_fiber_length: S,
    /// 1 / (v_max l_opt).
    pub(super) inverse_max_velocity: S,
}

impl Millard2012<f64> {
    /// The muscle that a model file specifies, adapted as OpenSim adapts it (see [`MillardCurves::new`]).
    ///
    /// # Errors
    /// [`MuscleError::NotComputed`]; otherwise [`MuscleError::InMuscle`] around what OpenSim too would refuse.
    pub fn from_spec(spec: &MuscleSpec) -> Result<Millard2012, MuscleError> {
        match &spec.kind {
            MuscleKind::Millard2012Equilibrium(millard) => Self::build(spec, millard)
                .map_err(|source| MuscleError::InMuscle { muscle: spec.name.clone(), source: Box::new(source) }),
            MuscleKind::OtherClass { class, .. } => {
                Err(MuscleError::NotComputed { muscle: spec.name.clone(), class: class.clone() })
            }
        }
    }

    fn build(spec: &MuscleSpec, millard: &Millard2012Spec) -> Result<Millard2012, MuscleError> {
        let damped = millard.fiber_damping >= MIN_NONZERO_DAMPING_COEFFICIENT;
        // Without damping the fibre velocity is singular at zero activation, unless the tendon is rigid.
        let singular = !damped && !spec.ignore_tendon_compliance;
        let lowest = if singular { 0.01 } else { 0.0 };
        let minimum_activation =
            if singular { millard.minimum_activation } else { millard.minimum_activation.min(1.0) };
        let ok = minimum_activation >= lowest && minimum_activation <= 1.0 - significant_real();
        let expected = format!("at least {lowest} and below 1");
        MuscleError::require(ok, "minimum_activation", &expected, millard.minimum_activation)?;
        let expected = format!("at least minimum_activation ({minimum_activation})");
        MuscleError::require(spec.min_control >= minimum_activation, "min_control", &expected, spec.min_control)?;
        let structure = Structure {
            name: spec.name.clone(),
            curves: MillardCurves::new(millard, singular)?,
            damped,
            ignore_tendon_compliance: spec.ignore_tendon_compliance,
            ignore_activation_dynamics: spec.ignore_activation_dynamics,
            minimum_activation,
            maximum_pennation_angle: millard.maximum_pennation_angle,
            default_activation: millard.default_activation,
            default_fiber_length: millard.default_fiber_length,
        };
        let parameters = Millard2012Parameters {
            max_isometric_force: spec.max_isometric_force,
            optimal_fiber_length: spec.optimal_fiber_length,
            tendon_slack_length: spec.tendon_slack_length,
            pennation_angle_at_optimal: spec.pennation_angle_at_optimal,
            max_contraction_velocity: spec.max_contraction_velocity,
            fiber_damping: if damped { millard.fiber_damping } else { 0.0 },
            activation_time_constant: millard.activation_time_constant,
            deactivation_time_constant: millard.deactivation_time_constant,
        };
        Self::assemble(parameters, Arc::new(structure))
    }
}

impl<S: Scalar> Millard2012<S> {
    fn assemble(
        parameters: Millard2012Parameters<S>,
        structure: Arc<Structure>,
    ) -> Result<Millard2012<S>, MuscleError> {
        check(&parameters, &structure)?;
        let length = parameters.optimal_fiber_length;
        let pennation =
            FixedWidthPennation::new(length, parameters.pennation_angle_at_optimal, structure.maximum_pennation_angle)?;
        let minimum_fiber_length = (length * structure.curves.min_norm_active_fiber_length)
            .max(pennation.minimum_fiber_length)
            .max(S::constant(significant_real()));
        let inverse_max_velocity = (parameters.max_contraction_velocity * length).recip();
        Ok(Millard2012 { parameters, structure, pennation, minimum_fiber_length, inverse_max_velocity })
    }

    /// The same muscle with other parameters, which may carry derivatives. Cheap: the curves are shared.
    ///
    /// Whether the fibre is damped stays as in the file.
    ///
    /// # Errors
    /// [`MuscleError::InvalidProperty`].
    pub fn with_parameters<T: Scalar>(
        &self,
        parameters: Millard2012Parameters<T>,
    ) -> Result<Millard2012<T>, MuscleError> {
        Millard2012::assemble(parameters, Arc::clone(&self.structure))
    }

    /// Muscle name.
    pub fn name(&self) -> &str {
        &self.structure.name
    }
    /// The parameters in use.
    pub fn parameters(&self) -> &Millard2012Parameters<S> {
        &self.parameters
    }
    /// The curves in use.
    pub fn curves(&self) -> &MillardCurves {
        &self.structure.curves
    }
    /// The pennation model.
    pub fn pennation(&self) -> &FixedWidthPennation<S> {
        &self.pennation
    }
    /// Activation dynamics.
    pub fn activation_dynamics(&self) -> FirstOrderActivation<S> {
        FirstOrderActivation {
            activation_time_constant: self.parameters.activation_time_constant,
            deactivation_time_constant: self.parameters.deactivation_time_constant,
            minimum_activation: self.structure.minimum_activation,
        }
    }
    /// Activation within `minimum_activation` and 1, as every force calculation uses it.
    #[inline]
    pub fn clamp_activation(&self, activation: S) -> S {
        if activation.value() < self.structure.minimum_activation {
            S::constant(self.structure.minimum_activation)
        } else if activation.value() > 1.0 {
            S::constant(1.0)
        } else {
            activation
        }
    }
    /// Shortest fibre that the pennation model and the active force–length curve allow [m].
    pub fn minimum_fiber_length(&self) -> S {
        self.minimum_fiber_length
    }
    /// Fibre length no shorter than [`minimum_fiber_length`](Self::minimum_fiber_length).
    #[inline]
    pub fn clamp_fiber_length(&self, fiber_length: S) -> S {
        fiber_length.max(self.minimum_fiber_length)
    }
    /// Whether the fibre is damped.
    pub fn is_damped(&self) -> bool {
        self.structure.damped
    }
    /// Whether the tendon is rigid, so that the fibre length is no state.
    pub fn ignore_tendon_compliance(&self) -> bool {
        self.structure.ignore_tendon_compliance
    }
    /// Whether the activation equals the excitation, so that the activation is no state.
    pub fn ignore_activation_dynamics(&self) -> bool {
        self.structure.ignore_activation_dynamics
    }
    /// Lowest activation.
    pub fn minimum_activation(&self) -> f64 {
        self.structure.minimum_activation
    }
    /// Activation before initialization, `default_activation`.
    pub fn default_activation(&self) -> f64 {
        self.structure.default_activation
    }
    /// Fibre length before initialization, `default_fiber_length` [m].
    pub fn default_fiber_length(&self) -> f64 {
        self.structure.default_fiber_length
    }
}

fn check<S: Scalar>(parameters: &Millard2012Parameters<S>, structure: &Structure) -> Result<(), MuscleError> {
    let damped = structure.damped;
    let slack = parameters.tendon_slack_length.value();
    let (ok, expected) = match structure.ignore_tendon_compliance {
        true => (slack >= 0.0, "a number of 0 or more"),
        false => (slack > 0.0, "a number above 0"),
    };
    MuscleError::require(ok && slack.is_finite(), "tendon_slack_length", expected, slack)?;
    let force = parameters.max_isometric_force.value();
    MuscleError::require(force >= 0.0 && force.is_finite(), "max_isometric_force", "at least 0 N", force)?;
    let positive = [
        ("max_contraction_velocity", parameters.max_contraction_velocity),
        ("activation_time_constant", parameters.activation_time_constant),
        ("deactivation_time_constant", parameters.deactivation_time_constant),
    ];
    for (property, value) in positive {
        let value = value.value();
        MuscleError::require(value > 0.0 && value.is_finite(), property, "a number above 0", value)?;
    }
    let damping = parameters.fiber_damping.value();
    let lowest = if damped { MIN_NONZERO_DAMPING_COEFFICIENT } else { 0.0 };
    let expected = if damped { "at least 0.001 (the muscle is damped)" } else { "0 (the muscle is not damped)" };
    let ok = damping >= lowest && damping.is_finite() && (damped || damping == 0.0);
    MuscleError::require(ok, "fiber_damping", expected, damping)
}

fn read(curve: &SmoothSegmentedFunction, at: f64) -> ValueAndSlope {
    let found = curve.value_and_derivative(at);
    (found.value, found.derivative)
}

/// With the curves themselves.
impl MuscleLaw for Millard2012 {
    fn tendon(&self, norm_length: f64) -> ValueAndSlope {
        read(&self.curves().tendon_force_length, norm_length)
    }

    fn active(&self, norm_length: f64) -> ValueAndSlope {
        read(&self.curves().active_force_length, norm_length)
    }

    fn passive(&self, norm_length: f64) -> ValueAndSlope {
        read(&self.curves().fiber_force_length, norm_length)
    }

    fn balance(&self, at: &Contraction) -> Balance {
        if self.states_velocity() {
            return balance_of_velocities(at, |multiplier| read(&self.curves().force_velocity_inverse, multiplier));
        }
        balance_of_forces(at, read(&self.curves().force_velocity, at.u), self.parameters.fiber_damping)
    }

    fn states_velocity(&self) -> bool {
        !self.is_damped() && !self.ignore_tendon_compliance()
    }

    fn max_velocity(&self) -> f64 {
        self.parameters.max_contraction_velocity
    }

    fn fiber_force(&self, at: &Contraction) -> [f64; 3] {
        force_of_fiber(at, read(&self.curves().force_velocity, at.u), self.parameters.fiber_damping)
    }

    fn shortest(&self) -> f64 {
        self.curves().min_norm_active_fiber_length
    }

    fn sine_of_greatest_pennation(&self) -> f64 {
        self.structure.maximum_pennation_angle.sin()
    }

    fn rigid_tendon_rule(&self) -> RigidTendonRule {
        RigidTendonRule::Unilateral
    }
}
