//! Effects that Python defines: a function of series over a trial and of its parameters.
//!
//! What the function raises ends the work that called it, which raises it again ([`take_raised`]).

use std::any::Any;
use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};

use carpus::effects::catalogue;
use carpus::effects::effect::{
    Behaviour, Description, Effect, JointState, MomentUse, MuscleState, OsimForm, Parameter, Stage, amplitude, shape,
};
use carpus::session::diagnostic::Failure;
use numpy::{PyArray1, PyArray2, PyArrayLike1, PyArrayLike2, TypeMustMatch};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::{OrRaise, refused};

/// What is unwound where a function of Python raised.
struct Raised;

/// What it raised.
static RAISED: Mutex<Option<PyErr>> = Mutex::new(None);

/// What a function raised, if that is what was unwound.
pub fn take_raised(payload: &(dyn Any + Send)) -> Option<PyErr> {
    let raised = payload.is::<Raised>();
    raised.then(|| RAISED.lock().unwrap_or_else(PoisonError::into_inner).take()).flatten()
}

/// Ends the work.
fn raise(error: PyErr) -> ! {
    *RAISED.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
    resume_unwind(Box::new(Raised))
}

/// Series that a function can have, by the name of its argument.
const VARIABLES: [&str; 11] = [
    "angle",
    "speed",
    "acceleration",
    "time",
    "session",
    "moment",
    "activation",
    "length",
    "lengthening_speed",
    "moment_arm",
    "excitation",
];

/// Where an effect of Python acts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    /// A moment of the joint [N·m].
    Joint,
    /// The share by which every muscle's moment is larger.
    Muscles,
}

/// An effect that is a function of Python.
struct PythonEffect {
    description: &'static Description,
    place: Place,
    /// Names of the series that it has, of [`VARIABLES`].
    variables: Vec<&'static str>,
    /// Of a dictionary of the series and a list of the parameters' values: a series.
    function: Py<PyAny>,
    /// Of the same: an array of a series per parameter.
    derivatives: Option<Py<PyAny>>,
}

/// Series in a dictionary, as far as the function has them.
struct Series<'py> {
    py: Python<'py>,
    wanted: Vec<&'static str>,
    of: Bound<'py, PyDict>,
}

impl<'py> Series<'py> {
    fn new(py: Python<'py>, wanted: &[&'static str]) -> Series<'py> {
        Series { py, wanted: wanted.to_vec(), of: PyDict::new(py) }
    }

    fn one(&self, name: &str, samples: &[f64]) -> PyResult<()> {
        match self.wanted.contains(&name) {
            true => self.of.set_item(name, PyArray1::from_slice(self.py, samples)),
            false => Ok(()),
        }
    }

    fn number(&self, name: &str, value: f64) -> PyResult<()> {
        if self.wanted.contains(&name) { self.of.set_item(name, value) } else { Ok(()) }
    }

    /// A series per muscle.
    fn several(&self, name: &str, rows: &[Vec<f64>]) -> PyResult<()> {
        match self.wanted.contains(&name) {
            true => self.of.set_item(name, PyArray2::from_vec2(self.py, rows)?),
            false => Ok(()),
        }
    }
}

impl PythonEffect {
    fn series_at_joint<'py>(&self, py: Python<'py>, joint: &JointState) -> PyResult<Bound<'py, PyDict>> {
        let series = Series::new(py, &self.variables);
        series.one("angle", joint.angle)?;
        series.one("speed", joint.speed)?;
        series.one("acceleration", joint.acceleration)?;
        series.one("time", joint.trial.time)?;
        series.number("session", joint.trial.session)?;
        series.one("moment", joint.trial.muscle_moment)?;
        let each = |of: fn(&carpus::simulation::MuscleKinematics) -> &Vec<f64>| -> Vec<Vec<f64>> {
            joint.muscles.iter().map(|m| of(m).clone()).collect()
        };
        series.several("activation", &each(|m| &m.activation))?;
        series.several("length", &each(|m| &m.length))?;
        series.several("lengthening_speed", &each(|m| &m.lengthening_speed))?;
        series.several("moment_arm", &each(|m| &m.moment_arm))?;
        series.several("excitation", joint.trial.excitation)?;
        Ok(series.of)
    }

    fn series_at_muscle<'py>(&self, py: Python<'py>, muscle: &MuscleState) -> PyResult<Bound<'py, PyDict>> {
        let series = Series::new(py, &self.variables);
        series.one("angle", muscle.angle)?;
        series.one("time", muscle.trial.time)?;
        series.number("session", muscle.trial.session)?;
        series.one("activation", muscle.activation)?;
        series.one("moment_arm", muscle.moment_arm)?;
        if let Some(spec) = muscle.trial.muscles.get(muscle.muscle) {
            series.of.set_item("muscle", &spec.name)?;
        }
        Ok(series.of)
    }

    /// Calls the function and checks what it returns.
    fn value(&self, py: Python<'_>, series: Bound<'_, PyDict>, values: &[f64], samples: usize) -> PyResult<Vec<f64>> {
        let returned = self.function.bind(py).call1((series, values.to_vec()))?;
        let array: PyArrayLike1<'_, f64, TypeMustMatch> = returned.extract().map_err(|_| {
            let id = self.description.id;
            PyValueError::new_err(format!("effect `{id}`: expected a float64 array of {samples} samples"))
        })?;
        let value: Vec<f64> = array.as_array().iter().copied().collect();
        if value.len() != samples || !value.iter().all(|v| v.is_finite()) {
            let id = self.description.id;
            let found = match value.iter().position(|v| !v.is_finite()) {
                Some(k) => format!("{} at sample {k}", value[k]),
                None => format!("{} values", value.len()),
            };
            let text =
                format!("effect `{id}`: expected {samples} finite values, found {found} (parameters {values:?})");
            return Err(PyValueError::new_err(text));
        }
        Ok(value)
    }
}

impl Effect for PythonEffect {
    fn description(&self) -> &'static Description {
        self.description
    }

    fn scale_muscle(&self, values: &[f64], muscle: &MuscleState, factor: &mut [f64]) {
        if self.place != Place::Muscles || self.description.is_absent(values) {
            return;
        }
        let shares = Python::attach(|py| {
            let series = self.series_at_muscle(py, muscle)?;
            self.value(py, series, values, factor.len())
        });
        let shares = shares.unwrap_or_else(|error| raise(error));
        factor.iter_mut().zip(shares).for_each(|(factor, share)| *factor *= 1.0 + share);
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        if self.place != Place::Joint || self.description.is_absent(values) {
            return;
        }
        let added = Python::attach(|py| {
            let series = self.series_at_joint(py, joint)?;
            self.value(py, series, values, moment.len())
        });
        let added = added.unwrap_or_else(|error| raise(error));
        moment.iter_mut().zip(added).for_each(|(moment, added)| *moment += added);
    }

    fn reads_muscles(&self) -> bool {
        true
    }

    fn moment_derivative(&self, values: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        let derivatives = self.derivatives.as_ref().filter(|_| self.place == Place::Joint)?;
        let (count, samples) = (values.len(), joint.angle.len());
        let row = Python::attach(|py| -> PyResult<Vec<f64>> {
            let returned = derivatives.bind(py).call1((self.series_at_joint(py, joint)?, values.to_vec()))?;
            let expected = || {
                let id = self.description.id;
                PyValueError::new_err(format!(
                    "effect `{id}`: expected derivatives as a float64 array of shape ({count}, {samples})"
                ))
            };
            let array: PyArrayLike2<'_, f64, TypeMustMatch> = returned.extract().map_err(|_| expected())?;
            let array = array.as_array();
            if array.shape() != [count, samples] {
                return Err(expected());
            }
            Ok(array.row(parameter).to_vec())
        });
        Some(row.unwrap_or_else(|error| raise(error)))
    }
}

/// Takes an effect away that was defined by [`define_effect`]; returns whether it was there.
#[pyfunction]
pub fn forget_effect(id: &str) -> bool {
    catalogue::withdraw(id)
}

/// A parameter as Python gives it: name, unit, whether it is an amplitude, start, typical size, plausible range,
/// source.
type GivenParameter = (String, String, bool, f64, f64, [f64; 2], String);

/// A text that stays for as long as the program runs: there are a few effects per run at most.
fn kept(text: &str) -> &'static str {
    Box::leak(text.to_owned().into_boxed_str())
}

/// Puts an effect beside the catalogue.
///
/// - `place`: `joint` or `muscles`
/// - `texts`: identifier, name, equation, how it shows, the experiment that exposes it
#[pyfunction]
#[pyo3(signature = (place, texts, parameters, variables, rivals, function, derivatives))]
pub fn define_effect(
    py: Python<'_>,
    place: &str,
    texts: [String; 5],
    parameters: Vec<GivenParameter>,
    variables: Vec<String>,
    rivals: Vec<String>,
    function: Py<PyAny>,
    derivatives: Option<Py<PyAny>>,
) -> PyResult<()> {
    defined(place, texts, &parameters, &variables, &rivals, function, derivatives).or_raise(py)
}

fn defined(
    place: &str,
    texts: [String; 5],
    parameters: &[GivenParameter],
    variables: &[String],
    rivals: &[String],
    function: Py<PyAny>,
    derivatives: Option<Py<PyAny>>,
) -> Result<(), Failure> {
    let place = match place {
        "joint" => Place::Joint,
        "muscles" => Place::Muscles,
        other => return Err(refused(format!("place: expected joint or muscles, found {other}"))),
    };
    let known = |name: &String| {
        let found = VARIABLES.into_iter().find(|v| v == name);
        found.ok_or_else(|| refused(format!("`{name}` is neither a parameter nor one of {}", VARIABLES.join(", "))))
    };
    let variables: Vec<&'static str> = variables.iter().map(known).collect::<Result<_, _>>()?;
    if !parameters.iter().any(|p| p.2) {
        return Err(refused("expected a parameter with role amplitude: at 0 the effect is absent"));
    }
    let parameter = |(name, unit, is_amplitude, start, typical, range, source): &GivenParameter| {
        let (name, unit, source) = (kept(name), kept(unit), kept(source));
        match is_amplitude {
            true => Parameter { start: *start, ..amplitude(name, unit, *typical, *range, source) },
            false => shape(name, unit, *start, *typical, *range, source),
        }
    };
    let parameters: Vec<Parameter> = parameters.iter().map(parameter).collect();
    let rivals: Vec<&'static str> = rivals.iter().map(|r| kept(r)).collect();
    let [id, name, equation, signature, experiment] = texts.map(|t| kept(&t));
    let muscle_moment = if variables.contains(&"moment") { MomentUse::Reads } else { MomentUse::None };
    let description: &'static Description = Box::leak(Box::new(Description {
        id,
        name,
        stage: if place == Place::Joint { Stage::Joint } else { Stage::Geometry },
        order: u8::MAX,
        behaviour: Behaviour { muscle_moment, ..Behaviour::PLAIN },
        equation,
        parameters: parameters.leak(),
        signature,
        experiment,
        rivals: rivals.leak(),
        osim_form: OsimForm::SideCar("a function of a Python program"),
        unidentifiable: None,
    }));
    let effect: &'static PythonEffect =
        Box::leak(Box::new(PythonEffect { description, place, variables, function, derivatives }));
    catalogue::register(effect).map_err(|e| refused(e.to_string()))
}
