//! What is stated of an effect: what people should know of it, and how it behaves beside others.

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

/// What the value of a parameter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// What is reported, in its unit.
    Itself,
    /// The natural logarithm of the ratio by which a property of the muscles changes. Reported is the property, which
    /// depends on the muscles.
    LogRatio,
}

/// How size and plausible range of a parameter, which are those of a wrist, follow the strength of the joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StrengthScaling {
    /// They do not.
    None,
    /// In proportion: moments, stiffness, drag.
    Proportional,
    /// As the weight of what the joint moves: weight and inertia.
    Weight,
    /// Inversely: compliance.
    Inverse,
}

/// How start and plausible range of a parameter, which are those of a joint whose neutral angle is 0, follow the
/// neutral angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NeutralShift {
    /// They do not: it is no angle of the coordinate.
    None,
    /// An angle of the coordinate.
    Along,
    /// An angle that is positive where the coordinate decreases.
    Against,
}

impl NeutralShift {
    /// What is added per radian of neutral angle.
    pub fn sign(self) -> f64 {
        match self {
            NeutralShift::None => 0.0,
            NeutralShift::Along => 1.0,
            NeutralShift::Against => -1.0,
        }
    }
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
    /// What its value is.
    pub quantity: Quantity,
    /// Value without the effect (amplitudes: 0), or the usual shape.
    pub start: f64,
    /// A typical size at a wrist: the scale of the amplitude, the standard deviation that a shape is expected to have.
    pub scale: f64,
    /// Plausible range at a wrist, as reported.
    pub plausible: [f64; 2],
    /// How size and range follow the joint's strength.
    pub strength: StrengthScaling,
    /// How start and range follow the joint's neutral angle.
    pub neutral: NeutralShift,
    /// Step limit: fits try no value further from the start than so many scales; shapes up to the plausible range in
    /// any case.
    pub reach: f64,
    /// Where the range comes from.
    pub source: &'static str,
}

/// What [`super::Effect::excite`] of an effect reads, sample by sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExcitationScope {
    /// The muscle's own excitation over the whole trial; or the effect changes no excitation.
    WholeTrial,
    /// The muscle's own excitation at that sample, so that a few samples may be given.
    Sample,
    /// The excitation of all muscles at that sample.
    SampleOfAllMuscles,
}

/// How an effect uses the simulated moment of the muscles.
///
/// The recorded moment must not be used in its place: its noise would look like an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MomentUse {
    /// It does not read it.
    None,
    /// It reads the moment that there is without effects of this kind.
    Reads,
    /// It reads the moment that there is with it: it acts back on itself.
    FedBack,
}

/// What an effect does where the forearm is turned over, so that gravity acts the other way about the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FlippedArm {
    /// The same.
    Same,
    /// The moment that it adds changes its sign. A force in a model acts the same way in all trials and cannot stand
    /// for it.
    Reversed,
}

/// How an effect behaves beside others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Behaviour {
    /// What its action on excitations reads.
    pub excitation: ExcitationScope,
    /// How it uses the muscles' moment.
    pub muscle_moment: MomentUse,
    /// What it does where the forearm is turned over.
    pub flipped_arm: FlippedArm,
}

impl Behaviour {
    /// Of an effect that needs nothing else.
    pub const PLAIN: Behaviour = Behaviour {
        excitation: ExcitationScope::WholeTrial,
        muscle_moment: MomentUse::None,
        flipped_arm: FlippedArm::Same,
    };
}

/// What is stated of an effect.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Description {
    /// Identifier.
    pub id: &'static str,
    /// How people call it.
    pub name: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// Place within the stage: effects act by increasing order. Those of equal order each add or each multiply, so that
    /// their order does not matter.
    pub order: u8,
    /// How it behaves beside others.
    pub behaviour: Behaviour,
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

impl Stage {
    /// Whether effects of the stage add moments to that of the muscles, and change nothing else.
    pub fn adds_moment(self) -> bool {
        matches!(self, Stage::Joint | Stage::Inertia)
    }

    /// Step of differences, in units of a parameter's scale. Of closed formulas errors of rounding and of the step
    /// squared are both near 10⁻⁸. Curves of muscles are tables with an error of 10⁻⁸, and take a wider one.
    pub fn difference_step(self) -> f64 {
        match self {
            Stage::Muscle | Stage::Activation => 1e-2,
            _ => 1e-4,
        }
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

    /// Whether it reads the muscles' moment.
    pub fn needs_moment(&self) -> bool {
        self.behaviour.muscle_moment != MomentUse::None
    }

    /// Whether the moment that it reads is the one that there is with the effect.
    pub fn feeds_back(&self) -> bool {
        self.behaviour.muscle_moment == MomentUse::FedBack
    }
}

/// Reach of an amplitude, in scales: an effect that is much larger than usual is still found.
const REACH: f64 = 30.0;
/// Reach of an amplitude in a property of the muscles, in scales: beyond it curves lose their meaning.
pub(crate) const REACH_OF_PROPERTY: f64 = 5.0;
/// Reach of a shape, in its standard deviations.
const REACH_OF_SHAPE: f64 = 3.0;

/// An amplitude: absent at 0.
pub const fn amplitude(
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
        quantity: Quantity::Itself,
        start: 0.0,
        scale,
        plausible,
        strength: StrengthScaling::None,
        neutral: NeutralShift::None,
        reach: REACH,
        source,
    }
}

/// An amplitude whose value is the natural logarithm of the ratio by which a property of the muscles changes.
///
/// - `unit`, `plausible`: of the property
pub(crate) const fn log_ratio(
    name: &'static str,
    unit: &'static str,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter {
        quantity: Quantity::LogRatio,
        ..amplitude(name, unit, scale, plausible, source).reaching(REACH_OF_PROPERTY)
    }
}

/// A shape: `start` with standard deviation `scale`.
pub const fn shape(
    name: &'static str,
    unit: &'static str,
    start: f64,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter { role: Role::Shape, start, ..amplitude(name, unit, scale, plausible, source).reaching(REACH_OF_SHAPE) }
}

/// A shape that is an angle of the coordinate, as at a joint whose neutral angle is 0.
pub(crate) const fn angle(
    name: &'static str,
    neutral: NeutralShift,
    start: f64,
    scale: f64,
    plausible: [f64; 2],
    source: &'static str,
) -> Parameter {
    Parameter { neutral, ..shape(name, "rad", start, scale, plausible, source) }
}

impl Parameter {
    /// Larger in proportion at a stronger joint.
    pub(crate) const fn of_strength(self) -> Parameter {
        Parameter { strength: StrengthScaling::Proportional, ..self }
    }

    /// Larger in proportion at a stronger joint; where the model's bodies weigh less about the coordinate than the
    /// lightest hand about a wrist, 0.2 N·m (assumed, no published source), at most in proportion to their weight.
    pub(crate) const fn of_weight(self) -> Parameter {
        Parameter { strength: StrengthScaling::Weight, ..self }
    }

    /// Smaller in proportion at a stronger joint.
    pub(crate) const fn against_strength(self) -> Parameter {
        Parameter { strength: StrengthScaling::Inverse, ..self }
    }

    /// With another step limit.
    pub(crate) const fn reaching(self, reach: f64) -> Parameter {
        Parameter { reach, ..self }
    }
}
