//! What a physical effect is: a description for people, and how it acts on a simulated trial.

use super::own_effect::Definition;
use super::silent_muscles::SilentMuscles;
use carpus_osim::osim::spec::{Millard2012Spec, MuscleKind, MuscleSpec};
use carpus_simulation::simulation::MuscleKinematics;

/// Where an effect acts; trials are simulated in this order, whatever the order effects are listed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Recorded EMG to excitation.
    Excitation,
    /// Excitation to activation.
    Activation,
    /// Properties of the muscle.
    Muscle,
    /// Angle and moment arms.
    Geometry,
    /// Moments of the joint itself.
    Joint,
    /// Weight and inertia of the segment.
    Inertia,
    /// From the joint's moment to the recorded one.
    Sensor,
}

/// How an effect is written into a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OsimForm {
    /// A component or property of stock OpenSim 4.6.
    Native(&'static str),
    /// No component exists: it changes the controls (excitations).
    Controls(&'static str),
    /// Neither: kept beside the model.
    SideCar(&'static str),
}

/// What a parameter does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// At 0 the effect is absent.
    Amplitude,
    /// Says how the effect looks when it is there.
    Shape,
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Parameter {
    /// Name.
    pub name: &'static str,
    /// Unit as reported.
    pub unit: &'static str,
    /// What it does.
    pub role: Role,
    /// Value without the effect (amplitudes: 0), or the usual shape.
    pub start: f64,
    /// A typical size at a wrist: the scale of the amplitude, the standard deviation that a shape is expected to have.
    pub scale: f64,
    /// Plausible range at a wrist, as reported.
    pub plausible: [f64; 2],
    /// How `start` and `plausible` move with the joint's neutral angle: 1 with it (an angle), -1 against it (an angle whose positive
    /// direction is the other), 0 not at all.
    pub moves_with_neutral: f64,
    /// Whether size and range are those of a wrist, so that at a stronger joint they are larger in proportion.
    pub of_a_wrist: bool,
    /// Where the range comes from.
    pub source: &'static str,
}

/// What people should know of an effect.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Description {
    /// Identifier.
    pub id: &'static str,
    /// How people call it.
    pub name: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// What it adds or changes.
    pub equation: &'static str,
    /// Its parameters, in the order of every `values` slice.
    pub parameters: &'static [Parameter],
    /// How it shows in the residual.
    pub signature: &'static str,
    /// The experiment that exposes it.
    pub experiment: &'static str,
    /// Effects that look alike.
    pub rivals: &'static [&'static str],
    /// Its form in an `.osim` file.
    pub osim_form: OsimForm,
    /// Cannot be told from a muscle parameter by any moment, and why; `None` if it can.
    pub unidentifiable: Option<&'static str>,
}

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
    /// Simulated moment of the muscles [N·m] without the effects that ask for it ([`Effect::needs_moment`]), but with those that
    /// act back on it ([`Effect::feeds_back`]); empty if none asks.
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
    /// Paths and activations of the active muscles; empty where an effect that follows excitations is shown a change of these.
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
    /// What people should know of it.
    fn description(&self) -> &'static Description;

    /// Whether it is no larger than what every recording's noise has of it in any case, so that it explains nothing.
    ///
    /// - `values`: its parameters, as for [`Effect::excite`]
    fn is_within_noise(&self, _values: &[f64]) -> bool {
        false
    }

    /// Whether what [`Effect::excite`] makes of a sample depends on that sample alone, so that a few of them may be given.
    fn is_instantaneous(&self) -> bool {
        false
    }

    /// Whether what [`Effect::excite`] makes of a muscle's excitation depends on other muscles'; otherwise these may be left empty.
    fn mixes_muscles(&self) -> bool {
        false
    }

    /// Whether [`Effect::change_angle`] or [`Effect::add_moment`] read the muscles' moment.
    ///
    /// The recorded moment must not be used in its place: its noise would look like an effect.
    fn needs_moment(&self) -> bool {
        false
    }

    /// Whether the moment that it reads is the one that there is with the effect, and not without it.
    fn feeds_back(&self) -> bool {
        false
    }

    /// Values, amplitudes 0, that fits also start from: shapes so far from the usual one that a fit from there may not arrive. As at a
    /// joint whose neutral angle is 0.
    fn further_starts(&self) -> &'static [&'static [f64]] {
        &[]
    }

    /// Recorded EMG to excitation, per muscle and sample.
    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let _ = (values, trial, excitation);
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

    /// Force that a muscle pulls with beside its fibres', as a share of its maximum isometric force, at every sample: added to
    /// `force`. [`Effect::scale_muscle`] of all effects scales the moment of both.
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

    /// Derivative of what [`Effect::add_moment`] adds by a parameter, per sample [N·m per unit of the parameter]; `None`: it is taken
    /// from differences.
    fn moment_derivative(&self, values: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        let _ = (values, parameter, joint);
        None
    }

    /// How long after a change of the excitation [`Effect::add_moment`] still shows it [s], where it is linear in the excitation: what
    /// it makes of the change alone is then the moment's. `None`: it reads no excitation.
    fn excitation_memory(&self, silent_muscles: &SilentMuscles) -> Option<f64> {
        let _ = silent_muscles;
        None
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

    /// What defines it, if it is not of the catalogue.
    fn definition(&self) -> Option<&Definition> {
        None
    }

    /// Whether its values are natural logarithms of the ratios by which properties of the muscles change, so that what they are
    /// reported as depends on the muscles.
    fn has_log_ratios(&self) -> bool {
        false
    }

    /// The parameters as people read them, given the model's muscles: for those that are changes of a muscle's property.
    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let _ = muscles;
        values.to_vec()
    }
}

impl Description {
    /// Values at which the effect is absent.
    pub fn absent(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.start).collect()
    }

    /// Whether all amplitudes are 0.
    pub fn is_absent(&self, values: &[f64]) -> bool {
        self.amplitudes().all(|i| values[i] == 0.0)
    }

    /// Positions of the amplitudes among the parameters.
    pub fn amplitudes(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.parameters.len()).filter(|i| self.parameters[*i].role == Role::Amplitude)
    }
}

/// An amplitude: absent at 0.
pub(crate) const fn amplitude(
    name: &'static str,
    unit: &'static str,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter {
        name,
        unit,
        role: Role::Amplitude,
        start: 0.0,
        scale,
        plausible,
        moves_with_neutral: 0.0,
        of_a_wrist: true,
        source,
    }
}

/// A shape: `start` with standard deviation `scale`.
pub(crate) const fn shape(
    name: &'static str,
    unit: &'static str,
    start: f64,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter {
        name,
        unit,
        role: Role::Shape,
        start,
        scale,
        plausible,
        moves_with_neutral: 0.0,
        of_a_wrist: true,
        source,
    }
}

/// A shape that is an angle of the coordinate, as at a joint whose neutral angle is 0.
///
/// - `direction`: 1, or -1 if it is positive where the coordinate decreases
pub(crate) const fn angle(
    name: &'static str,
    direction: f64,
    start: f64,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter { moves_with_neutral: direction, ..shape(name, "rad", start, scale, plausible, source) }
}

/// Multiplies a property of all muscles by eʳ, as `change` does it with the factor. Returns whether r is not 0.
pub(crate) fn scale_property(muscles: &mut [MuscleSpec], r: f64, change: impl Fn(&mut Millard2012Spec, f64)) -> bool {
    for muscle in muscles.iter_mut().filter(|_| r != 0.0) {
        if let MuscleKind::Millard2012Equilibrium(properties) = &mut muscle.kind {
            change(properties, r.exp());
        }
    }
    r != 0.0
}

/// Mean of a property over the muscles, multiplied by eʳ.
pub(crate) fn scaled_mean(muscles: &[MuscleSpec], r: f64, property: impl Fn(&Millard2012Spec) -> f64) -> f64 {
    let known: Vec<f64> = muscles
        .iter()
        .filter_map(|m| match &m.kind {
            MuscleKind::Millard2012Equilibrium(properties) => Some(property(properties)),
            MuscleKind::PathOnly { .. } => None,
        })
        .collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64 * r.exp()
}

/// A series as it was so much earlier, at the same times; linear between samples and constant outside. An empty one stays empty.
pub(crate) fn delayed(time: &[f64], series: &[f64], delay: f64) -> Vec<f64> {
    if series.is_empty() {
        return Vec::new();
    }
    let mut after = 0;
    let at = |t: &f64| {
        let at = t - delay;
        while after < time.len() && time[after] <= at {
            after += 1;
        }
        between(time, series, after, at)
    };
    time.iter().map(at).collect()
}

/// Value of a series at a time, linear between samples and constant outside.
pub(crate) fn interpolate(time: &[f64], series: &[f64], at: f64) -> f64 {
    between(time, series, time.partition_point(|t| *t <= at), at)
}

/// - `after`: the first sample after `at`
fn between(time: &[f64], series: &[f64], after: usize, at: f64) -> f64 {
    let last = time.len() - 1;
    if at <= time[0] {
        return series[0];
    }
    if at >= time[last] {
        return series[last];
    }
    let i = after.clamp(1, last) - 1;
    let part = (at - time[i]) / (time[i + 1] - time[i]);
    series[i] + part * (series[i + 1] - series[i])
}
