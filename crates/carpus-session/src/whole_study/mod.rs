//! Chapters 2 to 4 of the dissertation from one study folder, resumable.
//!
//! A study is a list of steps. A step divides a participant's work into [units](crate::units) and, when all
//! participants are done, makes a section of the report from the units' results. A step is one file and one line of the
//! list.

mod conclusions;
mod dynamometer;
mod emg;
mod evaluate;
mod identify;
mod personalize;
mod power;
mod request;
mod scale;
mod sensitivity;
mod step;
mod ultrasound;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::diagnostic::{Diagnostic, Failure, Severity};
use crate::identify::{Identify, Priors};
use crate::loading::Purpose;
use crate::output::OutputFolder;
use crate::progress::{Progress, go_on};
use crate::report_parts::ReportParts;
use crate::study::Study;
use crate::task::{Recorder, Task, TaskDone};
use crate::units::UnitStore;
use carpus_report::article::{Article, Block, Section};
use carpus_report::render_article;
use carpus_report::results::InputFile;

pub use request::{DEFAULT_BAYESIAN_EVALUATIONS, DEFAULT_SOBOL, DEFAULT_SQP_ITERATIONS, WholeStudy};
pub use step::Told;
use step::{Context, Step};

/// The steps, in the order in which they are done.
const STEPS: [&dyn Step; 10] = [
    &dynamometer::Dynamometer,
    &emg::Emg,
    &scale::Scale,
    &sensitivity::Sensitivity,
    &personalize::Personalize,
    &evaluate::Evaluate,
    &identify::Identify,
    &ultrasound::Ultrasound,
    &power::Power,
    &conclusions::Conclusions,
];

/// What came of a study.
#[derive(Clone, Debug)]
pub struct StudyReport {
    /// The page.
    pub report: PathBuf,
    /// The steps, in the order in which they are done.
    pub steps: Vec<StepResult>,
    /// Units that an earlier run had finished.
    pub units_found_finished: usize,
    /// Units that were computed.
    pub units_computed: usize,
    /// What could not be done.
    pub failed: Vec<Diagnostic>,
}

/// What came of a step.
#[derive(Clone, Debug)]
pub struct StepResult {
    /// Its name.
    pub id: &'static str,
    /// Heading of its section.
    pub title: &'static str,
    /// Its section, or why there is none.
    pub told: Told,
}

impl WholeStudy {
    /// Fails if there is no step of a name that was asked for.
    ///
    /// # Errors
    /// There is none.
    pub fn check(&self) -> Result<(), Failure> {
        chosen(&self.steps).map(|_| ())
    }

    /// What is asked about the parameters' intervals, with the priors.
    fn identification(&self) -> Result<Identify, Failure> {
        let priors = self.priors.as_deref().map(Priors::read).transpose()?;
        Ok(Identify { priors: priors.or(self.identify.priors.clone()), seed: self.seed, ..self.identify.clone() })
    }
}

impl Study {
    /// Does all steps of the study for every participant and writes one report; what a run that was stopped had
    /// finished is found again.
    ///
    /// - `path`: the folder of the results
    ///
    /// # Errors
    /// The study, an unknown step, the folder; a request to stop.
    pub fn whole_study(
        self,
        request: &WholeStudy,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<StudyReport, Failure> {
        let steps = chosen(&request.steps)?;
        let (study, out, processing) = dynamometer::prepare(self, request, path, progress)?;
        let store = UnitStore::new(&out)?;
        let context = Context { study: &study, out: &out, request, store: &store, processing };
        let Work { inputs, warnings, failures } = context.work(&steps, None, progress)?;
        let told = steps.iter().map(|s| Ok((*s, s.section(&context)?))).collect::<Result<Vec<_>, Failure>>()?;
        let article = article(&context, &told, &warnings, &failures, inputs);
        let result = |(step, told): (&dyn Step, Told)| StepResult { id: step.id(), title: step.title(), told };
        let steps: Vec<StepResult> = told.into_iter().map(result).collect();
        write(&out, &article, &steps)?;
        write_timings(&store, &out)?;
        // Of a run of some steps the others' results stay.
        let command = if request.steps.is_empty() { "study" } else { "study --steps" };
        progress.warnings(&out.close(command, &study.others())?);
        let [units_found_finished, units_computed] = store.counts();
        let report = out.path().join("report.html");
        Ok(StudyReport { report, steps, units_found_finished, units_computed, failed: failures })
    }
}

impl Study {
    /// Does the units of a task: those of some participants. There is no report; [`Study::whole_study`] with the same
    /// request and folder finds them finished.
    ///
    /// - `arguments`: what is asked, without the task, as the command has it
    ///
    /// # Errors
    /// As there.
    pub fn study_task(
        self,
        request: &WholeStudy,
        task: Task,
        arguments: &[String],
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<TaskDone, Failure> {
        let steps = chosen(&request.steps)?;
        let (study, out, processing) = dynamometer::prepare(self, request, path, progress)?;
        let store = UnitStore::new(&out)?;
        let context = Context { study: &study, out: &out, request, store: &store, processing };
        let mut recorder = Recorder::begin(&out, task, arguments)?;
        match context.work(&steps, Some((task, &mut recorder)), progress) {
            Ok(work) => recorder.end(work.failures, store.counts()),
            Err(reason) => Err(recorder.fail(reason)),
        }
    }
}

/// What came of the participants' units.
#[derive(Default)]
struct Work {
    inputs: Vec<InputFile>,
    warnings: Vec<Diagnostic>,
    failures: Vec<Diagnostic>,
}

impl Context<'_> {
    /// Does the units of all participants, or of those of a task, and writes what is not part of the report.
    fn work(
        &self,
        steps: &[&dyn Step],
        mut task: Option<(Task, &mut Recorder)>,
        progress: &dyn Progress,
    ) -> Result<Work, Failure> {
        let Context { study, store, .. } = self;
        let failures = self.processing.as_ref().map(|p| p.failures.clone()).unwrap_or_default();
        let mut work = Work { failures, ..Work::default() };
        let mut printed: Vec<(&str, Vec<Diagnostic>)> = Vec::new();
        let all = study.chosen().len() * steps.len();
        for (i, participant) in study.chosen().iter().enumerate() {
            if task.as_ref().is_some_and(|(task, _)| !task.has(i)) {
                continue;
            }
            go_on(progress)?;
            progress.at(&format!("{}: reading", participant.name), i * steps.len(), all);
            let run = match study.load(participant, Purpose::Simulation) {
                Ok(run) => run,
                Err(Failure::Input(messages)) => {
                    work.failures.extend(messages);
                    continue;
                }
                Err(other) => return Err(other),
            };
            add_new(&mut work.warnings, &run.warnings);
            printed.push((participant.name.as_str(), run.warnings.clone()));
            add_new(&mut work.inputs, &run.inputs);
            let hashes: Vec<&str> = run.inputs.iter().map(|i| i.sha256.as_str()).collect();
            for (k, step) in steps.iter().enumerate() {
                let units = match step.units(self, &run) {
                    Ok(units) => units,
                    Err(Failure::Input(messages)) => {
                        work.failures.extend(messages);
                        continue;
                    }
                    Err(other) => return Err(other),
                };
                if let Some((_, recorder)) = &mut task {
                    recorder.plan(units.iter().map(|u| u.place.as_str()))?;
                }
                let said = store.run(&units, &hashes.join(" "), progress, [i * steps.len() + k, all])?;
                let (damaged, not_done): (Vec<_>, Vec<_>) =
                    said.into_iter().partition(|message| message.severity == Severity::Warning);
                // Said now, and not in the report, which does not depend on what lay in the folder.
                progress.warnings(&damaged);
                work.failures.extend(not_done);
                // Results are written where the report is: by one run.
                if task.is_none() {
                    step.write(self, &run)?;
                }
            }
        }
        progress.finished();
        for (participant, own) in &printed {
            progress.about(Some(participant));
            progress.warnings(own);
        }
        progress.about(None);
        Ok(work)
    }
}

impl StudyReport {
    /// For programs.
    pub fn value(&self) -> Value {
        json!({
            "schema": "carpus.study/1",
            "report": self.report,
            "steps": self.steps.iter().filter_map(|step| Some((step, step.parts()?))).map(|(step, part)| json!({
                "step": step.id,
                "summary": part.lead,
                "tables": part.tables.iter().map(|(name, _)| name).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "not_run": self.steps.iter().filter_map(|step| match &step.told {
                Told::NotRun(why) => Some(json!({ "step": step.id, "why": why })),
                Told::Parts(_) => None,
            }).collect::<Vec<_>>(),
            "units_found_finished": self.units_found_finished,
            "units_computed": self.units_computed,
        })
    }
}

impl StepResult {
    /// Its section, if it has one.
    pub fn parts(&self) -> Option<&ReportParts> {
        match &self.told {
            Told::Parts(parts) => Some(parts),
            Told::NotRun(_) => None,
        }
    }
}

/// The steps of these names, or all.
fn chosen(names: &[String]) -> Result<Vec<&'static dyn Step>, Failure> {
    if names.is_empty() {
        return Ok(STEPS.to_vec());
    }
    for name in names {
        if !STEPS.iter().any(|s| s.id() == name) {
            let known: Vec<&str> = STEPS.iter().map(|s| s.id()).collect();
            let hint = match carpus_study::study::nearest(name, known.iter().copied()) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are: {}", known.join(", ")),
            };
            return Err(Diagnostic::error(format!("there is no step `{name}`")).hint(hint).into());
        }
    }
    Ok(STEPS.iter().copied().filter(|s| names.iter().any(|n| n == s.id())).collect())
}

fn add_new<T: Clone + PartialEq>(all: &mut Vec<T>, more: &[T]) {
    for item in more {
        if !all.contains(item) {
            all.push(item.clone());
        }
    }
}

fn article(
    context: &Context,
    told: &[(&dyn Step, Told)],
    warnings: &[Diagnostic],
    failures: &[Diagnostic],
    inputs: Vec<InputFile>,
) -> Article {
    let text = |m: &Diagnostic| match m.place() {
        Some(place) => format!("{place}: {}", m.text),
        None => m.text.clone(),
    };
    let parts = || {
        told.iter().filter_map(|(_, told)| match told {
            Told::Parts(part) => Some(part),
            Told::NotRun(_) => None,
        })
    };
    let mut read_first: Vec<String> = failures.iter().map(|m| format!("Not done: {}", text(m))).collect();
    read_first.extend(parts().flat_map(|part| part.warnings.iter().cloned()));
    read_first.extend(warnings.iter().map(text));
    let settings = &context.study.tables.settings;
    Article {
        title: settings.name.clone(),
        kicker: "Study".to_string(),
        lead: parts().map(|p| p.lead.as_str()).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" "),
        facts: vec![
            ("participants".to_string(), context.study.chosen().len().to_string()),
            ("muscles".to_string(), settings.active_muscles.join(", ")),
            ("coordinate".to_string(), settings.dynamometer.coordinate.clone()),
        ],
        warnings: read_first,
        sections: told
            .iter()
            .map(|(step, told)| Section {
                id: step.id().to_string(),
                title: step.title().to_string(),
                blocks: match told {
                    Told::Parts(part) => [part.blocks.clone(), files(part)].concat(),
                    Told::NotRun(why) => vec![Block::Text(format!("Not run: {why}."))],
                },
            })
            .collect(),
        provenance: context.study.provenance(context.request, context.request.seed, inputs),
    }
}

fn files(part: &ReportParts) -> Vec<Block> {
    let names: Vec<&str> = part.tables.iter().map(|(name, _)| name.as_str()).collect();
    if names.is_empty() { Vec::new() } else { vec![Block::Text(format!("As tables: {}.", names.join(", ")))] }
}

fn write(out: &OutputFolder, article: &Article, steps: &[StepResult]) -> Result<(), Failure> {
    for (name, text) in steps.iter().filter_map(StepResult::parts).flat_map(|part| &part.tables) {
        out.write(name, text.as_bytes())?;
    }
    out.write("report.html", render_article(article).as_bytes())?;
    Ok(())
}

/// Processor seconds of every unit: the one table that depends on the machine.
fn write_timings(store: &UnitStore, out: &OutputFolder) -> Result<(), Failure> {
    let rows = store.seconds().into_iter().map(|(place, seconds)| vec![place, format!("{seconds:.3}")]);
    let text = crate::account::csv_text(["unit", "processor_seconds"].iter(), rows)?;
    out.put("timings.csv".as_ref(), text.as_bytes())?;
    Ok(())
}
