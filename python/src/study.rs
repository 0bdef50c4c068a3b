//! Studies: of a folder, of the bundled one, of arrays in memory.

use std::path::PathBuf;
use std::sync::Arc;

use carpus::session::bundled;
use carpus::session::diagnose::Diagnose;
use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::evaluate::Evaluate;
use carpus::session::groups::CompareGroups;
use carpus::session::loading::Purpose;
use carpus::session::output::OutputFolder;
use carpus::session::own_effects::register_all;
use carpus::session::screening::ScreeningOptions;
use carpus::session::study::{Opening, Study as OpenStudy};
use carpus::session::task::{Task, asked_by_program};
use carpus::session::whole_study::{Told, WholeStudy};
use carpus::study::{
    Contraction, Direction, MomentPart, Participant, PostureCoordinate, RelativeBounds, Settings, Study as Tables,
    Trial, TrialInfo, TrialUse,
};
use pyo3::prelude::*;
use serde::de::DeserializeOwned;
use serde_json::json;
use tempfile::TempDir;

use crate::answer::Answer;
use crate::answers::{CohortAnswer, GroupsAnswer};
use crate::cells::{EvaluationCell, SensitivityCell};
use crate::failure::{OrRaise, diagnostics, refused};
use crate::job::{long, warn};
use crate::loaded::Opened;
use crate::model::Model;
use crate::session::Session;

/// An open study.
#[pyclass(module = "carpus._carpus", frozen)]
pub struct Study {
    opened: Arc<Opened>,
}

/// A participant as Python gives it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct GivenParticipant {
    name: String,
    mass: Option<f64>,
    height: Option<f64>,
    mvc_flexion: Option<f64>,
    mvc_extension: Option<f64>,
    person: Option<String>,
    group: Option<String>,
    visit: Option<String>,
}

/// A trial as Python gives it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct GivenTrial {
    participant: String,
    name: String,
    contraction: String,
    direction: String,
    usage: String,
    effort_percent: Option<f64>,
    posture: Option<f64>,
    held: Vec<(String, f64)>,
    repetition: Option<u32>,
    start_time: Option<f64>,
    arm_flipped: bool,
    time: Vec<f64>,
    angle: Vec<f64>,
    moment: Vec<f64>,
    excitation: Vec<Vec<f64>>,
}

/// What a study of arrays measures.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct GivenSettings {
    name: String,
    coordinate: String,
    muscles: Vec<String>,
    posture: Vec<(String, f64)>,
    include: Option<Vec<String>>,
    damping: f64,
    /// Least and greatest value of a property, as shares of the model's.
    bounds: Vec<(String, [f64; 2])>,
}

/// The value that a word stands for.
fn of_word<T: DeserializeOwned>(key: &str, word: &str, expected: &str) -> Result<T, Failure> {
    serde_json::from_value(json!(word)).map_err(|_| refused(format!("{key}: expected {expected}, found `{word}`")))
}

/// A coordinate held at a value [degrees, or metres].
fn held((coordinate, value): (String, f64)) -> PostureCoordinate {
    PostureCoordinate { coordinate, line: 0, value_deg_or_m: value }
}

impl GivenTrial {
    fn trial(self) -> Result<Trial, Failure> {
        let contraction: Contraction =
            of_word("contraction", &self.contraction, "isometric, isotonic, passive, mvc or freehand")?;
        let direction: Direction = of_word("direction", &self.direction, "flexion, extension or none")?;
        let usage: TrialUse = of_word("use", &self.usage, "train, test, mvc or ignore")?;
        let info = TrialInfo {
            effort_percent: self.effort_percent,
            posture: self.posture,
            held: self.held.into_iter().map(held).collect(),
            repetition: self.repetition,
            start_time: self.start_time,
            arm_flipped: self.arm_flipped,
            ..TrialInfo::new(&self.participant, &self.name, contraction, direction, usage)
        };
        Ok(Trial::from_samples(info, self.time, self.angle, self.moment, self.excitation))
    }
}

fn in_memory(
    given: GivenSettings,
    participants: Vec<GivenParticipant>,
    trials: Vec<GivenTrial>,
) -> Result<Tables, Failure> {
    let muscles: Vec<&str> = given.muscles.iter().map(String::as_str).collect();
    let mut settings = Settings::with_defaults(&given.name, &given.coordinate, &muscles)?;
    settings.dynamometer.damping = given.damping;
    settings.posture = given.posture.into_iter().map(held).collect();
    if let Some(include) = given.include {
        let part = |word: &String| of_word::<MomentPart>("include", word, "muscles, passive, gravity or inertia");
        settings.dynamometer.include = include.iter().map(part).collect::<Result<_, _>>()?;
    }
    for (property, [lower, upper]) in given.bounds {
        let bounds = &mut settings.bounds;
        let of = match property.as_str() {
            "optimal_fiber_length" => &mut bounds.optimal_fiber_length,
            "tendon_slack_length" => &mut bounds.tendon_slack_length,
            "max_isometric_force" => &mut bounds.max_isometric_force,
            other => {
                let expected = "optimal_fiber_length, tendon_slack_length or max_isometric_force";
                return Err(refused(format!("bounds: expected {expected}, found `{other}`")));
            }
        };
        if !(0.0 < lower && lower <= 1.0 && 1.0 <= upper && upper.is_finite()) {
            let text =
                format!("bounds of {property}: expected a share up to 1 and one from 1 on, found {lower} and {upper}");
            return Err(refused(text));
        }
        *of = RelativeBounds { lower, upper };
    }
    let participant = |p: GivenParticipant| Participant {
        mass: p.mass,
        height: p.height,
        mvc_flexion: p.mvc_flexion,
        mvc_extension: p.mvc_extension,
        person: p.person,
        group: p.group,
        visit: p.visit,
        ..Participant::named(&p.name)
    };
    let participants = participants.into_iter().map(participant).collect();
    let trials = trials.into_iter().map(GivenTrial::trial).collect::<Result<_, _>>()?;
    Ok(Tables::of_trials(settings, participants, trials)?)
}

fn opened(study: OpenStudy, again: Option<(PathBuf, Opening)>, folder: Option<TempDir>) -> Study {
    Study { opened: Arc::new(Opened { study, relay: Arc::default(), again, _folder: folder }) }
}

fn open(path: PathBuf, opening: Opening, own_effects: &[PathBuf], folder: Option<TempDir>) -> Result<Study, Failure> {
    register_all(own_effects, Some(&path))?;
    let study = OpenStudy::open_with(&path, opening.clone())?;
    Ok(opened(study, Some((path, opening)), folder))
}

#[pymethods]
impl Study {
    /// Opens a study of a folder.
    #[staticmethod]
    #[pyo3(signature = (path, participants, model, effects, own_effects, allow_unsupported, scale_models, command))]
    fn open(
        py: Python<'_>,
        path: PathBuf,
        participants: Vec<String>,
        model: Option<PathBuf>,
        effects: Option<PathBuf>,
        own_effects: Vec<PathBuf>,
        allow_unsupported: bool,
        scale_models: bool,
        command: Option<String>,
    ) -> PyResult<Study> {
        let scales_models = scale_models;
        let opening = Opening { participants, model, effects, allow_unsupported, scales_models, command };
        py.detach(|| open(path, opening, &own_effects, None)).or_raise(py)
    }

    /// The bundled study, in a folder that goes with it.
    #[staticmethod]
    fn bundled(py: Python<'_>) -> PyResult<Study> {
        let made = py.detach(|| {
            let folder = TempDir::new().map_err(|e| refused(format!("no temporary folder can be made: {e}")))?;
            bundled::write_study(&OutputFolder::create(folder.path(), &[])?)?;
            open(folder.path().join("study"), Opening::default(), &[], Some(folder))
        });
        made.or_raise(py)
    }

    /// A study of arrays.
    #[staticmethod]
    fn from_memory(
        py: Python<'_>,
        settings: GivenSettings,
        participants: Vec<GivenParticipant>,
        trials: Vec<GivenTrial>,
        model: PyRef<'_, Model>,
    ) -> PyResult<Study> {
        let tables = in_memory(settings, participants, trials).or_raise(py)?;
        Ok(opened(OpenStudy::from_memory(tables, model.file.clone()), None, None))
    }

    /// Name of the study.
    #[getter]
    fn name(&self) -> &str {
        &self.opened.study.tables.settings.name
    }

    /// The folder of the study; of one in memory `<memory>`.
    #[getter]
    fn folder(&self) -> PathBuf {
        self.opened.study.tables.folder.clone()
    }

    /// Names of the participants.
    fn participants(&self) -> Vec<String> {
        self.opened.study.chosen().iter().map(|p| p.name.clone()).collect()
    }

    /// What a person should look at, of the tables.
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        let warnings: Vec<Diagnostic> = self.opened.study.tables.warnings.iter().map(Diagnostic::from).collect();
        diagnostics(py, &warnings)
    }

    /// Reads a participant's model and trials.
    fn load(&self, py: Python<'_>, participant: String) -> PyResult<Session> {
        let opened = Arc::clone(&self.opened);
        let session = long(py, &self.opened.relay, move || opened.load(&participant, Purpose::Simulation))?;
        Ok(Session { cell: session })
    }

    /// What diagnoses of several participants say together; `None` of fewer than two.
    ///
    /// - `diagnoses`: in the study's order; `candidates`, `baselines`, `seed`: as they were asked for
    fn cohort(
        &self,
        py: Python<'_>,
        diagnoses: Vec<PyRef<'_, Answer>>,
        candidates: Vec<String>,
        baselines: bool,
        seed: u64,
    ) -> PyResult<Option<Answer>> {
        let diagnoses = diagnoses.iter().map(|answer| Arc::clone(&answer.inner)).collect();
        let (opened, request) = (Arc::clone(&self.opened), Diagnose { seed, candidates, baselines });
        long(py, &self.opened.relay, move || Ok(CohortAnswer::of(opened, diagnoses, &request).map(Answer::of)))
    }

    /// Models on held-out trials.
    fn evaluate(&self, py: Python<'_>, models: Vec<PathBuf>, seed: u64) -> PyResult<Answer> {
        let opened = Arc::clone(&self.opened);
        let request = Evaluate { models, seed };
        long(py, &self.opened.relay, move || {
            let evaluated = EvaluationCell::try_new(opened, |o| o.study.evaluate(&request, &*o.relay))?;
            Ok(Answer::of(evaluated))
        })
    }

    /// What differs between groups of participants, or before and after.
    fn groups(&self, py: Python<'_>, results: Vec<PathBuf>, tables: Vec<PathBuf>) -> PyResult<Answer> {
        let study = Arc::clone(&self.opened);
        let request = CompareGroups { tables, ..CompareGroups::new(results) };
        long(py, &self.opened.relay, move || {
            let found = study.study.compare_groups(&request)?;
            Ok(Answer::of(GroupsAnswer { study, found }))
        })
    }

    /// Which parameters the trials respond to.
    #[pyo3(signature = (starts, sobol, resamples, seed))]
    fn sensitivity(
        &self,
        py: Python<'_>,
        starts: usize,
        sobol: Option<usize>,
        resamples: usize,
        seed: u64,
    ) -> PyResult<Answer> {
        let opened = Arc::clone(&self.opened);
        let request = ScreeningOptions { starts, sobol, resamples, seed };
        long(py, &self.opened.relay, move || {
            let screened = SensitivityCell::try_new(opened, |o| o.study.sensitivity(&request, &*o.relay))?;
            Ok(Answer::of(screened))
        })
    }

    /// All steps of a study and one report, as JSON: the page, the steps, what could not be done.
    #[pyo3(signature = (out, steps, starts, sobol, bayesian_evaluations, sqp_iterations, priors, seed, task))]
    fn whole_study(
        &self,
        py: Python<'_>,
        out: PathBuf,
        steps: Vec<String>,
        starts: Option<usize>,
        sobol: Option<usize>,
        bayesian_evaluations: Option<usize>,
        sqp_iterations: Option<u64>,
        priors: Option<PathBuf>,
        seed: u64,
        task: Option<&str>,
    ) -> PyResult<String> {
        let known = WholeStudy::default();
        let request = WholeStudy {
            steps,
            starts: starts.unwrap_or(known.starts),
            sobol: sobol.unwrap_or(known.sobol),
            bayesian_evaluations: bayesian_evaluations.unwrap_or(known.bayesian_evaluations),
            sqp_iterations: sqp_iterations.unwrap_or(known.sqp_iterations),
            priors,
            seed,
            ..known
        };
        let Some((path, opening)) = self.opened.again.clone() else {
            return Err(refused("a whole study is of a folder: this one is in memory")).or_raise(py);
        };
        let wrong = |why: String| refused(format!("task: {why}"));
        let task = task.map(|text| text.parse::<Task>().map_err(wrong)).transpose().or_raise(py)?;
        let relay = Arc::clone(&self.opened.relay);
        let (report, failed) = long(py, &self.opened.relay, move || {
            // The steps may process recordings to a study of their own: they take theirs.
            let study = OpenStudy::open_with(&path, opening)?.scaling_models();
            if let Some(task) = task {
                let done = study.study_task(&request, task, &asked_by_program(&request), &out, &*relay)?;
                let [found, computed] = [done.units_found_finished, done.units_computed];
                let said = json!({ "report": "", "units_found_finished": found, "units_computed": computed });
                return if done.failed.is_empty() {
                    Ok((said.to_string(), done.failed))
                } else {
                    Err(done.failed.into())
                };
            }
            let report = study.whole_study(&request, &out, &*relay)?;
            let step = |s: &carpus::session::whole_study::StepResult| {
                let not_run = match &s.told {
                    Told::Parts(_) => None,
                    Told::NotRun(why) => Some(why.clone()),
                };
                json!({ "id": s.id, "title": s.title, "not_run": not_run })
            };
            let said = json!({
                "report": report.report,
                "steps": report.steps.iter().map(step).collect::<Vec<_>>(),
                "units_found_finished": report.units_found_finished,
                "units_computed": report.units_computed,
            });
            Ok((said.to_string(), report.failed))
        })?;
        warn(py, &failed)?;
        Ok(report)
    }
}
