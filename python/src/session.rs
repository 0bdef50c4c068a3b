//! A participant's model and trials in memory, and every use case on them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carpus::identifiability::MuscleProperty;
use carpus::session::compare::Compare;
use carpus::session::diagnose::{Diagnose, forward_model};
use carpus::session::diagnostic::{Failure, Severity};
use carpus::session::effect_choice::{chosen, decide, objections};
use carpus::session::effect_steps::AddEffects;
use carpus::session::identify::{Identify, Priors, TiedMuscles};
use carpus::session::loading::Purpose;
use carpus::session::participant::Session as LibrarySession;
use carpus::session::personalize::Personalize;
use carpus::session::plan::Plan;
use carpus::session::progress::Progress;
use carpus::session::simulate::Simulate;
use carpus::study::{PriorKnowledge, PriorUnit};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, json};

use crate::answer::Answer;
use crate::answers::{EffectsAnswer, PlanAnswer};
use crate::cells::{ComparisonCell, DiagnosisCell, IdentificationCell, PersonalizationCell, SimulationCell};
use crate::failure::{OrRaise, diagnostics, refused};
use crate::job::long;
use crate::loaded::LoadedSession;
use crate::model::Model;

/// A participant's model and trials.
#[pyclass(module = "carpus._carpus", frozen)]
pub struct Session {
    /// The session.
    pub cell: Arc<LoadedSession>,
}

impl Session {
    /// The session.
    pub fn library(&self) -> &LibrarySession<'_> {
        self.cell.borrow_dependent()
    }

    fn work(
        &self,
        py: Python<'_>,
        work: impl FnOnce(Arc<LoadedSession>) -> Result<Answer, Failure> + Send + 'static,
    ) -> PyResult<Answer> {
        let cell = Arc::clone(&self.cell);
        long(py, &self.cell.borrow_owner().relay, move || work(cell))
    }
}

/// What is known of a parameter, as Python gives it: muscle, property, mean, standard deviation, and whether both are
/// multiples of the model's value.
type GivenPrior = (String, String, f64, f64, bool);

/// Prior knowledge as Python gives it: a table's file, or its rows.
#[derive(FromPyObject)]
enum GivenPriors {
    Rows(Vec<GivenPrior>),
    File(PathBuf),
}

#[pymethods]
impl Session {
    /// Name of the participant.
    #[getter]
    fn participant(&self) -> &str {
        &self.library().data.participant.name
    }

    /// Names of the active muscles.
    fn muscles(&self) -> Vec<String> {
        self.library().data.model.muscle_names().map(String::from).collect()
    }

    /// What a person should know before trusting results.
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        diagnostics(py, &self.library().data.warnings)
    }

    /// The participant's model.
    fn model(&self) -> Model {
        let loaded = &self.library().data.loaded;
        Model::of(loaded.file.clone(), &loaded.path)
    }

    /// What `trials.csv` says of every trial, as JSON.
    fn trials(&self) -> String {
        let one = |t: &carpus::study::Trial| {
            let i = &t.info;
            json!({
                "name": i.name, "contraction": i.contraction, "direction": i.direction, "use": i.usage,
                "effort_percent": i.effort_percent, "posture_deg": i.posture.map(f64::to_degrees),
                "held": i.held.iter().map(|h| (h.coordinate.clone(), json!(h.value_deg_or_m))).collect::<Map<_, _>>(),
                "repetition": i.repetition, "start_time_s": i.start_time, "samples": t.len(),
                "duration_s": t.duration(),
            })
        };
        serde_json::Value::Array(self.library().data.trials.iter().map(one).collect()).to_string()
    }

    /// Recorded and prepared series of a trial: `time`, `angle`, `moment` (n), `excitation`, `activation`,
    /// `path_length`, `moment_arm` (muscles, n).
    fn recorded<'py>(&self, py: Python<'py>, place: usize) -> PyResult<Option<Bound<'py, PyDict>>> {
        let data = &self.library().data;
        let Some((trial, prepared)) = data.trials.get(place).zip(data.prepared.get(place)) else { return Ok(None) };
        let result = PyDict::new(py);
        result.set_item("time", PyArray1::from_slice(py, &trial.time))?;
        result.set_item("angle", PyArray1::from_slice(py, &trial.angle))?;
        result.set_item("moment", PyArray1::from_slice(py, &trial.moment))?;
        result.set_item("excitation", PyArray2::from_vec2(py, &trial.excitation)?)?;
        type OfMuscle = fn(&carpus::simulation::MuscleKinematics) -> &Vec<f64>;
        let series: [(&str, OfMuscle); 3] =
            [("activation", |m| &m.activation), ("path_length", |m| &m.length), ("moment_arm", |m| &m.moment_arm)];
        for (name, of) in series {
            let muscles = &prepared.kinematics().muscles;
            let all: Vec<f64> = muscles.iter().flat_map(|m| of(m).iter().copied()).collect();
            result.set_item(name, all.into_pyarray(py).reshape([muscles.len(), trial.len()])?)?;
        }
        Ok(Some(result))
    }

    /// Simulates every trial with the model as it is.
    fn simulate(&self, py: Python<'_>, seed: u64) -> PyResult<Answer> {
        self.work(py, move |cell| {
            Ok(Answer::of(SimulationCell::try_new(cell, |c| c.borrow_dependent().simulate(&Simulate { seed }))?))
        })
    }

    /// Errors of the model as it is.
    fn compare(&self, py: Python<'_>, seed: u64) -> PyResult<Answer> {
        self.work(py, move |cell| {
            Ok(Answer::of(ComparisonCell::try_new(cell, |c| c.borrow_dependent().compare(&Compare { seed }))?))
        })
    }

    /// Fits the active muscles' parameters.
    fn personalize(&self, py: Python<'_>, seed: u64, intervals: bool) -> PyResult<Answer> {
        let asked = Personalize { seed, intervals };
        self.work(py, move |cell| {
            Ok(Answer::of(PersonalizationCell::try_new(cell, |c| c.borrow_dependent().personalize(&asked))?))
        })
    }

    /// Intervals and posterior of muscle parameters.
    #[pyo3(signature = (properties, tie, priors, level, draws, seed))]
    fn identify(
        &self,
        py: Python<'_>,
        properties: Option<Vec<String>>,
        tie: Vec<(String, Vec<String>)>,
        priors: Option<GivenPriors>,
        level: f64,
        draws: usize,
        seed: u64,
    ) -> PyResult<Answer> {
        let asked = identification(properties, tie, priors, level, draws, seed).or_raise(py)?;
        self.work(py, move |cell| {
            Ok(Answer::of(IdentificationCell::try_new(cell, |c| c.borrow_dependent().identify(&asked))?))
        })
    }

    /// Which physical effects are missing.
    fn diagnose(&self, py: Python<'_>, candidates: Vec<String>, baselines: bool, seed: u64) -> PyResult<Answer> {
        let asked = Diagnose { seed, candidates, baselines };
        self.work(py, move |cell| {
            Ok(Answer::of(DiagnosisCell::try_new(cell, |c| c.borrow_dependent().diagnose(&asked))?))
        })
    }

    /// The model with effects: those that are named, or those that a diagnosis names.
    ///
    /// - `diagnosis`: of this session; without one it is made
    #[pyo3(signature = (effects, diagnosis, i_choose, seed))]
    fn add_effects(
        &self,
        py: Python<'_>,
        effects: Option<Vec<String>>,
        diagnosis: Option<PyRef<'_, Answer>>,
        i_choose: bool,
        seed: u64,
    ) -> PyResult<Answer> {
        let known = diagnosis.and_then(|answer| answer.inner.diagnosis());
        self.work(py, move |cell| {
            let opened = cell.borrow_owner();
            let name = cell.borrow_dependent().data.participant.name.clone();
            let for_diagnosis = opened.load(&name, Purpose::Diagnosis)?;
            let session = for_diagnosis.borrow_dependent();
            let forward = forward_model(&session.data)?;
            let named = effects.as_deref().map(chosen).transpose()?;
            let diagnosis = match known {
                Some(known) => known,
                None => session.diagnosed(&forward, &Diagnose { seed, ..Diagnose::default() })?.known,
            };
            let (effects, said) = match (named, &effects) {
                (Some(named), Some(ids)) => (named, objections(&name, &diagnosis, ids, i_choose)),
                _ => {
                    let (effects, why) = decide(&diagnosis.result)?;
                    let said = why.map(|why| {
                        carpus::session::diagnostic::Diagnostic::warning(format!("participant {name}: {why}"))
                    });
                    (effects, said.into_iter().collect())
                }
            };
            if said.iter().any(|m| m.severity == Severity::Error) {
                return Err(said.into());
            }
            opened.relay.warnings(&said);
            let asked = AddEffects { seed, i_choose };
            let added = session.add_effects(Path::new(""), &forward, &effects, &diagnosis, &asked)?;
            Ok(Answer::of(EffectsAnswer { session: Arc::clone(&for_diagnosis), diagnosis, added }))
        })
    }

    /// Which further trials would tell explanations apart.
    #[pyo3(signature = (rivals, diagnosis, seed))]
    fn plan(
        &self,
        py: Python<'_>,
        rivals: Vec<String>,
        diagnosis: Option<PyRef<'_, Answer>>,
        seed: u64,
    ) -> PyResult<Answer> {
        let known = diagnosis.and_then(|answer| answer.inner.diagnosis());
        self.work(py, move |cell| {
            let name = cell.borrow_dependent().data.participant.name.clone();
            let for_diagnosis = cell.borrow_owner().load(&name, Purpose::Diagnosis)?;
            let session = for_diagnosis.borrow_dependent();
            let forward = forward_model(&session.data)?;
            let asked = Plan { seed, rivals };
            asked.named()?;
            let diagnosis = match known {
                Some(known) => known,
                None => session.diagnosed(&forward, &Diagnose { seed, ..Diagnose::default() })?.known,
            };
            let planned = session.plan(&forward, diagnosis, &asked)?;
            Ok(Answer::of(PlanAnswer { session: Arc::clone(&for_diagnosis), planned }))
        })
    }
}

fn identification(
    properties: Option<Vec<String>>,
    tie: Vec<(String, Vec<String>)>,
    priors: Option<GivenPriors>,
    level: f64,
    draws: usize,
    seed: u64,
) -> Result<Identify, Failure> {
    if !(level > 0.0 && level < 1.0) {
        return Err(refused(format!("level: expected a number between 0 and 1, found {level}")));
    }
    let property = |name: &String| {
        let known = MuscleProperty::ALL.into_iter().find(|p| p.name() == *name);
        known.ok_or_else(|| {
            let names = MuscleProperty::ALL.map(|p| p.name()).join(", ");
            refused(format!("properties: expected some of {names}, found `{name}`"))
        })
    };
    let prior = |(muscle, property, mean, sd, of_model): GivenPrior| {
        if !(mean > 0.0 && mean.is_finite() && sd > 0.0 && sd.is_finite()) {
            let text = format!("priors: {muscle}.{property}: expected a mean and an sd above 0, found {mean} and {sd}");
            return Err(refused(text));
        }
        let unit = if of_model { PriorUnit::Model } else { PriorUnit::File };
        Ok(PriorKnowledge { muscle, property, mean, sd, unit, source: None, line: 0 })
    };
    let priors = priors.map(|given| match given {
        GivenPriors::File(file) => Priors::read(&file),
        GivenPriors::Rows(rows) => {
            Ok(Priors { file: None, values: rows.into_iter().map(prior).collect::<Result<_, _>>()? })
        }
    });
    let known = Identify::default();
    Ok(Identify {
        seed,
        properties: match properties {
            Some(names) => names.iter().map(property).collect::<Result<_, _>>()?,
            None => known.properties,
        },
        tie: tie.into_iter().map(|(name, muscles)| TiedMuscles { name, muscles }).collect(),
        priors: priors.transpose()?,
        level,
        draws,
    })
}
