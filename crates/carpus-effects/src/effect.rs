//! What a physical effect is: a description, and how it acts on a simulated trial.

mod description;

use super::silent_muscles::SilentMuscles;
use carpus_osim::osim::spec::{MuscleProperty, MuscleSpec};
use carpus_simulation::simulation::MuscleKinematics;
pub use description::{
    Behaviour, Description, ExcitationScope, FlippedArm, MomentUse, NeutralShift, OsimForm, Parameter, Quantity, Role,
    Stage, StrengthScaling, amplitude, shape,
};
pub(crate) use description::{REACH_OF_PROPERTY, angle, log_ratio};

/// What is known of a trial besides its samples.
#[derive(Clone, Copy, Debug)]
pub struct TrialContext<'a> {
    /// Time [s].
    pub time: &'a [f64],
    /// Place in the session, 0 at its start to 1 at its end.
    pub session: f64,
    /// Whether the forearm is turned over, so that gravity acts the other way about the axis.
    pub arm_flipped: bool,
    /// ∫ e dt of every muscle from the start of the session to that of the trial [s].
    pub exposure: &'a [f64],
    /// Recorded angle of the coordinate [rad].
    pub recorded_angle: &'a [f64],
    /// Angle about which the joint's passive properties lie [rad].
    pub neutral_angle: f64,
    /// Simulated moment of the muscles [N·m] without the effects that ask for it, but with those that act back on it
    /// ([`MomentUse`]); empty if none asks.
    pub muscle_moment: &'a [f64],
    /// Sign of each muscle's moment arm in the middle of the recorded angles.
    pub directions: &'a [f64],
    /// Excitation of each active muscle: before effects while these act on it, after them for joint and sensor.
    pub excitation: &'a [Vec<f64>],
    /// What the model's muscles that the study does not activate could do.
    pub silent_muscles: &'a SilentMuscles,
    /// The active muscles.
    pub muscles: &'a [MuscleSpec],
}

/// The joint over a trial.
#[derive(Clone, Copy, Debug)]
pub struct JointState<'a> {
    /// The trial.
    pub trial: &'a TrialContext<'a>,
    /// Angle [rad].
    pub angle: &'a [f64],
    /// Speed [rad/s].
    pub speed: &'a [f64],
    /// Acceleration [rad/s²].
    pub acceleration: &'a [f64],
    /// Paths and activations of the active muscles; empty where an effect that follows excitations is shown a change of
    /// these.
    pub muscles: &'a [MuscleKinematics],
}

/// A form of stock OpenSim 4.6 that gives the moment of an effect on the moving coordinate exactly; SI units.
#[derive(Clone, Debug, PartialEq)]
pub enum NativeForm {
    /// `SpringGeneralizedForce`: −stiffness (q − rest_angle) − viscosity q̇.
    Spring {
        /// Stiffness [N·m/rad].
        stiffness: f64,
        /// Angle without moment [rad].
        rest_angle: f64,
        /// Viscosity [N·m·s/rad].
        viscosity: f64,
    },
    /// `CoordinateLimitForce` without damping.
    Limit {
        /// Stiffness beyond the limits [N·m/rad].
        stiffness: f64,
        /// Lower and upper limit [rad].
        limit: [f64; 2],
        /// Angle over which the stiffness sets in [rad].
        transition: f64,
    },
    /// `ExpressionBasedCoordinateForce`: a formula in `q` and `qdot`.
    Formula(String),
    /// Moment of inertia [kg·m²] that the body moved by the coordinate has more.
    Inertia(f64),
}

/// A muscle over a trial.
#[derive(Clone, Copy, Debug)]
pub struct MuscleState<'a> {
    /// The trial.
    pub trial: &'a TrialContext<'a>,
    /// Which of the active muscles.
    pub muscle: usize,
    /// Angle of the joint [rad].
    pub angle: &'a [f64],
    /// Moment arm [m], positive when tension increases the coordinate.
    pub moment_arm: &'a [f64],
    /// Activation.
    pub activation: &'a [f64],
}

/// A physical effect that a model may lack. All stages do nothing unless an effect overrides them.
///
/// With all amplitudes 0 every stage leaves its argument as it is, to the last bit. `values` are in the order of
/// [`Description::parameters`], in SI units.
pub trait Effect: Sync {
    /// What is stated of it.
    fn description(&self) -> &'static Description;

    /// Whether it is no larger than what every recording's noise has of it in any case, so that it explains nothing.
    ///
    /// - `values`: its parameters, as for [`Effect::excite`]
    fn is_within_noise(&self, _values: &[f64]) -> bool {
        false
    }

    /// Values, amplitudes 0, that fits also start from: shapes so far from the usual one that a fit from there may not
    /// arrive. As at a joint whose neutral angle is 0.
    fn further_starts(&self) -> &'static [&'static [f64]] {
        &[]
    }

    /// Recorded EMG to excitation, per muscle and sample.
    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let _ = (values, trial, excitation);
    }

    /// Properties that [`Effect::change_muscles`] changes. A class of muscles that has none of them does not show the
    /// effect.
    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[]
    }

    /// Properties of the active muscles. Returns whether anything changed.
    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        let _ = (values, muscles);
        false
    }

    /// The recorded angle to the joint's.
    fn change_angle(&self, values: &[f64], trial: &TrialContext, angle: &mut [f64]) {
        let _ = (values, trial, angle);
    }

    /// Factor of a muscle's moment at an angle.
    fn moment_factor(&self, values: &[f64], trial: &TrialContext, muscle: usize, angle: f64) -> f64 {
        let _ = (values, trial, muscle, angle);
        1.0
    }

    /// Factors of a muscle's moment at every sample, multiplied into `factor`; by default
    /// [`Effect::moment_factor`] at the angles.
    fn scale_muscle(&self, values: &[f64], muscle: &MuscleState, factor: &mut [f64]) {
        for (factor, angle) in factor.iter_mut().zip(muscle.angle) {
            *factor *= self.moment_factor(values, muscle.trial, muscle.muscle, *angle);
        }
    }

    /// Force that a muscle pulls with beside its fibres', as a share of its maximum isometric force, at every sample:
    /// added to `force`. [`Effect::scale_muscle`] of all effects scales the moment of both.
    fn add_muscle_force(&self, values: &[f64], muscle: &MuscleState, force: &mut [f64]) {
        let _ = (values, muscle, force);
    }

    /// λ of an optimal fibre length lo (1 + λ (1 − a)) of all active muscles.
    fn length_by_activation(&self, values: &[f64]) -> f64 {
        let _ = values;
        0.0
    }

    /// Moments of the joint, weight and inertia: adds to the moment [N·m] at every sample.
    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let _ = (values, joint, moment);
    }

    /// Derivative of what [`Effect::add_moment`] adds by a parameter, per sample [N·m per unit of the parameter];
    /// `None`: it is taken from differences.
    fn moment_derivative(&self, values: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        let _ = (values, parameter, joint);
        None
    }

    /// How long after a change of the excitation [`Effect::add_moment`] still shows it [s], where it is linear in the
    /// excitation: what it makes of the change alone is then the moment's. `None`: it reads no excitation.
    fn excitation_memory(&self, silent_muscles: &SilentMuscles) -> Option<f64> {
        let _ = silent_muscles;
        None
    }

    /// Whether [`Effect::add_moment`] reads paths or activations of the muscles.
    fn reads_muscles(&self) -> bool {
        false
    }

    /// The joint's moment to the recorded one; affine in the moment.
    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let _ = (values, trial, moment);
    }

    /// What gives the moment of [`Effect::add_moment`] in stock OpenSim 4.6; `None` if nothing does.
    ///
    /// - `neutral_angle`: of the joint [rad]
    fn native_form(&self, values: &[f64], neutral_angle: f64) -> Option<NativeForm> {
        let _ = (values, neutral_angle);
        None
    }

    /// The parameters as people read them, given the model's muscles: for those that are changes of a muscle's
    /// property.
    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let _ = muscles;
        values.to_vec()
    }
}

impl dyn Effect {
    /// Whether what it adds to the joint's moment follows from the trial's motion, whatever the muscles do.
    pub fn follows_motion_alone(&self, silent_muscles: &SilentMuscles) -> bool {
        self.description().stage.adds_moment()
            && self.description().behaviour.muscle_moment == MomentUse::None
            && !self.reads_muscles()
            && self.excitation_memory(silent_muscles).is_none()
    }

    /// Whether its values are natural logarithms of the ratios by which properties of the muscles change.
    pub fn has_log_ratios(&self) -> bool {
        self.description().parameters.iter().any(|p| p.quantity == Quantity::LogRatio)
    }
}

/// Multiplies a property of all muscles that have it by eʳ. Returns whether anything changed.
pub(crate) fn scale_property(muscles: &mut [MuscleSpec], r: f64, property: MuscleProperty) -> bool {
    if r == 0.0 {
        return false;
    }
    let mut changed = false;
    for muscle in muscles.iter_mut().filter(|muscle| property.of(muscle).is_some()) {
        property.scale(muscle, r.exp());
        changed = true;
    }
    changed
}

/// Mean of a property over the muscles that have it, multiplied by eʳ; the factor alone where none has it, so that what
/// is plausible of the effect stays finite.
pub(crate) fn scaled_mean(muscles: &[MuscleSpec], r: f64, property: MuscleProperty) -> f64 {
    let known: Vec<f64> = muscles.iter().filter_map(|muscle| property.of(muscle)).collect();
    match known.len() {
        0 => r.exp(),
        n => known.iter().sum::<f64>() / n as f64 * r.exp(),
    }
}

/// Why an effect does nothing to any of the muscles: a property that it changes and none of them has.
pub fn lacks_property(effect: &dyn Effect, muscles: &[MuscleSpec]) -> Option<String> {
    let lacking = |property: &&MuscleProperty| muscles.iter().all(|muscle| property.of(muscle).is_none());
    let properties = effect.muscle_properties();
    if properties.is_empty() || !properties.iter().all(|property| lacking(&property)) {
        return None;
    }
    let mut classes: Vec<&str> = muscles.iter().map(MuscleSpec::class).collect();
    classes.sort_unstable();
    classes.dedup();
    let words: Vec<&str> = properties.iter().map(|property| property.words()).collect();
    Some(format!("the active muscles ({}) have no {}", classes.join(", "), words.join(" and no ")))
}
