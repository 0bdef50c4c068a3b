//! Effects that the catalogue lacks: a formula that a laboratory writes down, and an effect made of it that behaves as
//! one of the catalogue.
//!
//! What is defined stays for as long as the program runs ([`register`]): there are a few per run at most.

mod definition;
mod unit;
mod variable;

use std::sync::{PoisonError, RwLock};

use thiserror::Error;

use super::effect::{
    Behaviour, Description, Effect, JointState, MomentUse, MuscleState, NativeForm, OsimForm, Parameter, Role, Stage,
    TrialContext, amplitude, shape,
};
use super::effects::CATALOGUE;
use carpus_numerics::numerics::{Dual, Scalar};
use carpus_simulation::simulation::MuscleKinematics;
pub use definition::{DefinedParameter, Definition};
pub use variable::{OfMuscle, Place, Plain, Variable};

/// Values of a wave's shape that fits start from, at most.
const MOST_STARTS: usize = 16;
/// Two of these starts are not further apart than this phase at the ends of what a variable reaches [rad].
const PHASE_BETWEEN_STARTS: f64 = 2.0;

/// An effect made of a formula.
pub struct OwnEffect {
    definition: Definition,
    description: &'static Description,
    starts: &'static [&'static [f64]],
}

/// Why an effect cannot be used beside the catalogue.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TakenId {
    /// The catalogue has it.
    #[error("`id`: expected an identifier of its own, found `{id}`, which is an effect of the catalogue")]
    Catalogue {
        /// The identifier.
        id: String,
    },
    /// Another file has it.
    #[error("`id`: expected one definition of `{id}`, found another one in {other}")]
    Defined {
        /// The identifier.
        id: String,
        /// The other file.
        other: String,
    },
}

static REGISTERED: RwLock<Vec<&'static OwnEffect>> = RwLock::new(Vec::new());

/// The effects defined so far, in the order of their definition.
pub fn registered() -> Vec<&'static OwnEffect> {
    REGISTERED.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// What defines an effect; `None` if it is one of the catalogue.
pub fn definition(effect: &dyn Effect) -> Option<&'static Definition> {
    registered().into_iter().find(|own| own.description.id == effect.description().id).map(OwnEffect::defined)
}

/// Puts an effect beside the catalogue; one of the same text is there once.
///
/// # Errors
/// Another effect has its identifier.
pub fn register(definition: Definition) -> Result<&'static OwnEffect, TakenId> {
    let id = definition.id.clone();
    if CATALOGUE.iter().any(|e| e.description().id == id) {
        return Err(TakenId::Catalogue { id });
    }
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = registered.iter().find(|e| e.definition.id == id) {
        return match known.definition == definition {
            true => Ok(known),
            false => Err(TakenId::Defined { id, other: known.definition.file.display().to_string() }),
        };
    }
    let effect: &'static OwnEffect = Box::leak(Box::new(OwnEffect::new(definition)));
    registered.push(effect);
    Ok(effect)
}

impl OwnEffect {
    /// The effect that a definition describes. Its texts stay for as long as the program runs.
    fn new(definition: Definition) -> OwnEffect {
        let kept = |text: &str| -> &'static str { Box::leak(text.to_owned().into_boxed_str()) };
        // Its sizes are the laboratory's, at the joint that it records: they follow neither strength nor neutral angle.
        let parameter = |p: &DefinedParameter| -> Parameter {
            let (name, unit, source) = (kept(&p.name), kept(&p.unit), kept(&p.source));
            match p.role {
                Role::Amplitude => {
                    Parameter { start: p.start, ..amplitude(name, unit, p.typical, p.plausible, source) }
                }
                Role::Shape => shape(name, unit, p.start, p.typical, p.plausible, source),
            }
        };
        let parameters: Vec<Parameter> = definition.parameters.iter().map(parameter).collect();
        let rivals: Vec<&'static str> = definition.rivals.iter().map(|r| kept(r)).collect();
        let starts: Vec<&'static [f64]> =
            starts(&definition).into_iter().map(|values| -> &'static [f64] { values.leak() }).collect();
        let is_native = definition.place == Place::Joint && definition.variables.iter().all(is_of_opensim);
        let (stage, equation, osim_form) = match definition.place {
            Place::Joint if is_native => {
                (Stage::Joint, definition.formula.clone(), OsimForm::Native("ExpressionBasedCoordinateForce"))
            }
            Place::Joint => {
                let reason = "OpenSim's formulas know the coordinate and its speed alone";
                (Stage::Joint, definition.formula.clone(), OsimForm::SideCar(reason))
            }
            Place::Muscles => {
                let of = definition.muscles.as_ref().map_or(String::new(), |m| format!(" of {}", m.join(", ")));
                let equation = format!("moment{of} (1 + {})", definition.formula);
                (Stage::Geometry, equation, OsimForm::SideCar("no stock muscle has it"))
            }
        };
        let muscle_moment = match definition.variables.contains(&Variable::Plain(Plain::Moment)) {
            true => MomentUse::Reads,
            false => MomentUse::None,
        };
        let description = Description {
            id: kept(&definition.id),
            name: kept(&definition.name),
            stage,
            order: u8::MAX,
            behaviour: Behaviour { muscle_moment, ..Behaviour::PLAIN },
            equation: kept(&equation),
            parameters: parameters.leak(),
            signature: kept(&definition.signature),
            experiment: kept(&definition.experiment),
            rivals: rivals.leak(),
            osim_form,
            unidentifiable: None,
        };
        OwnEffect { definition, description: Box::leak(Box::new(description)), starts: starts.leak() }
    }

    /// What defines it.
    pub fn defined(&self) -> &Definition {
        &self.definition
    }

    /// Whether value or slope of the formula jump somewhere.
    pub fn has_kinks(&self) -> bool {
        self.definition.expression.has_kinks()
    }

    /// What the formula is at values of its variables and parameters.
    pub fn value_at(&self, values: &[f64]) -> f64 {
        self.definition.expression.value_at(values)
    }

    /// What the formula's variables are over a trial, in their order.
    fn series_at_joint<'a>(&self, joint: &JointState<'a>) -> Vec<Series<'a>> {
        let series = |variable: &Variable| match variable {
            Variable::Plain(plain) => match plain {
                Plain::Angle => Series::Samples(joint.angle),
                Plain::Speed => Series::Samples(joint.speed),
                Plain::Acceleration => Series::Samples(joint.acceleration),
                Plain::Time => Series::Samples(joint.trial.time),
                Plain::Session => Series::Constant(joint.trial.session),
                Plain::Moment => Series::Samples(joint.trial.muscle_moment),
                Plain::Activation | Plain::Arm => Series::Constant(f64::NAN),
            },
            Variable::OfMuscle(quantity, name) => of_muscle(*quantity, name, joint),
        };
        self.definition.variables.iter().map(series).collect()
    }

    /// The formula at every sample.
    fn each<S: Scalar>(&self, series: &[Series], parameters: &[S], mut see: impl FnMut(usize, S), samples: usize) {
        let count = series.len();
        let mut values = vec![S::constant(0.0); count + parameters.len()];
        values[count..].copy_from_slice(parameters);
        for k in 0..samples {
            for (value, series) in values.iter_mut().zip(series) {
                *value = S::constant(series.at(k));
            }
            see(k, self.definition.expression.value_at(&values));
        }
    }
}

/// Whether OpenSim's formulas on a coordinate know a variable.
fn is_of_opensim(variable: &Variable) -> bool {
    matches!(variable, Variable::Plain(Plain::Angle | Plain::Speed))
}

/// A variable over a trial.
enum Series<'a> {
    Samples(&'a [f64]),
    Constant(f64),
}

impl Series<'_> {
    fn at(&self, sample: usize) -> f64 {
        match self {
            Series::Samples(samples) => samples.get(sample).copied().unwrap_or(f64::NAN),
            Series::Constant(value) => *value,
        }
    }
}

/// A variable of a muscle by its name; no number where there is no such muscle ([`Definition::unknown_muscles`] says so
/// before).
fn of_muscle<'a>(quantity: OfMuscle, name: &str, joint: &JointState<'a>) -> Series<'a> {
    let Some(at) = joint.trial.muscles.iter().position(|m| m.name == name) else { return Series::Constant(f64::NAN) };
    let path = |of: fn(&MuscleKinematics) -> &[f64]| match joint.muscles.get(at) {
        Some(muscle) => Series::Samples(of(muscle)),
        None => Series::Constant(f64::NAN),
    };
    match quantity {
        OfMuscle::Activation => path(|m| &m.activation),
        OfMuscle::Length => path(|m| &m.length),
        OfMuscle::Speed => path(|m| &m.lengthening_speed),
        OfMuscle::Arm => path(|m| &m.moment_arm),
        OfMuscle::Excitation => match joint.trial.excitation.get(at) {
            Some(excitation) => Series::Samples(excitation),
            None => Series::Constant(f64::NAN),
        },
    }
}

/// Values that fits start from beside the usual shape: those of the file, and for the wave number of a sine as many
/// over the plausible range as its local minima call for.
fn starts(definition: &Definition) -> Vec<Vec<f64>> {
    let usual: Vec<f64> = definition.parameters.iter().map(|p| p.start).collect();
    let mut all = Vec::new();
    for (i, p) in definition.parameters.iter().enumerate().filter(|(_, p)| p.role == Role::Shape) {
        let own = definition.variables.len() + i;
        let waves = |(at, v): (usize, &Variable)| definition.expression.waves_in(own, at).then(|| v.reach());
        let reach = definition.variables.iter().enumerate().filter_map(waves).fold(0.0, f64::max);
        let [low, high] = p.plausible;
        let values = p.starts.clone().unwrap_or_else(|| {
            let count = ((high - low) * reach / PHASE_BETWEEN_STARTS).ceil() as usize;
            let count = count.min(MOST_STARTS);
            (0..count).map(|k| low + (high - low) * (k as f64 + 0.5) / count as f64).collect()
        });
        for value in values {
            let mut start = usual.clone();
            start[i] = value;
            all.push(start);
        }
    }
    all
}

impl Effect for OwnEffect {
    fn description(&self) -> &'static Description {
        self.description
    }

    fn further_starts(&self) -> &'static [&'static [f64]] {
        self.starts
    }

    fn scale_muscle(&self, values: &[f64], muscle: &MuscleState, factor: &mut [f64]) {
        if self.definition.place != Place::Muscles || self.description.is_absent(values) {
            return;
        }
        if let Some(only) = &self.definition.muscles {
            let name = muscle.trial.muscles.get(muscle.muscle).map(|m| &m.name);
            if !name.is_some_and(|name| only.contains(name)) {
                return;
            }
        }
        let trial: &TrialContext = muscle.trial;
        let series = |variable: &Variable| match variable {
            Variable::Plain(Plain::Angle) => Series::Samples(muscle.angle),
            Variable::Plain(Plain::Time) => Series::Samples(trial.time),
            Variable::Plain(Plain::Session) => Series::Constant(trial.session),
            Variable::Plain(Plain::Activation) => Series::Samples(muscle.activation),
            Variable::Plain(Plain::Arm) => Series::Samples(muscle.moment_arm),
            _ => Series::Constant(f64::NAN),
        };
        let series: Vec<Series> = self.definition.variables.iter().map(series).collect();
        let samples = factor.len();
        self.each(&series, values, |k, value: f64| factor[k] *= 1.0 + value, samples);
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        if self.definition.place != Place::Joint || self.description.is_absent(values) {
            return;
        }
        let samples = moment.len();
        self.each(&self.series_at_joint(joint), values, |k, value: f64| moment[k] += value, samples);
    }

    fn reads_muscles(&self) -> bool {
        true
    }

    fn moment_derivative(&self, values: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        if self.definition.place != Place::Joint {
            return None;
        }
        let dual = |(i, v): (usize, &f64)| if i == parameter { Dual::variable(*v, 0) } else { Dual::from(*v) };
        let parameters: Vec<Dual<1>> = values.iter().enumerate().map(dual).collect();
        let mut by = vec![0.0; joint.angle.len()];
        let samples = by.len();
        self.each(&self.series_at_joint(joint), &parameters, |k, value: Dual<1>| by[k] = value.gradient[0], samples);
        Some(by)
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        if !matches!(self.description.osim_form, OsimForm::Native(_)) {
            return None;
        }
        let numbers = values.iter().map(|v| format!("({v:?})"));
        let names: Vec<String> = self.definition.variables.iter().map(Variable::word).chain(numbers).collect();
        Some(NativeForm::Formula(self.definition.expression.opensim_text(&names)))
    }
}
