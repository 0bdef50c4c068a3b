//! Every model on every held-out condition, over participants.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::diagnostic::{Diagnostic, Failure};
use super::evaluation_report::{self, ModelName, Representative, representatives};
use super::loading::LoadedParticipant;
use super::model::osim_failure;
use super::output::OutputFolder;
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file};
use super::report_parts::ReportParts;
use super::study::Study;
use carpus_osim::osim::OsimFile;
use carpus_osim::osim::spec::ModelSpec;
use carpus_report::article::{Article, Section};
use carpus_report::render_article;
use carpus_simulation::evaluation::{Cohort, ConditionError, ErrorTable, TrialErrors, condition_errors};
use carpus_study::study::{Contraction, Participant, TrialUse};

/// The participant's model as the study names it.
pub const LINEAR: &str = "linear";

/// An evaluation of models on the trials with use = test.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evaluate {
    /// Folders of models, with a folder for every participant: `DIR/P01/NAME.osim`. A file `model.osim`, as a
    /// personalization writes it, goes by the name of its folder `DIR`. Without any, the study's own model is evaluated
    /// alone.
    pub models: Vec<PathBuf>,
    /// Written into the results; nothing in an evaluation is random.
    pub seed: u64,
}

impl Default for Evaluate {
    fn default() -> Self {
        Evaluate { models: Vec::new(), seed: DEFAULT_SEED }
    }
}

/// Errors of every model in every held-out condition of every participant.
#[derive(Debug)]
pub struct Evaluation<'s> {
    study: &'s Study,
    /// The models; the control, [`LINEAR`], last.
    pub names: Vec<ModelName>,
    /// Errors over participants.
    pub cohort: Cohort,
    /// Tables, figures and tests.
    pub report: ReportParts,
    /// The page.
    pub article: Article,
    /// Why participants could not be evaluated.
    pub failed: Vec<Diagnostic>,
}

impl Study {
    /// Evaluates models on the held-out isometric and isotonic trials of every participant.
    ///
    /// # Errors
    /// No participant that could be evaluated: the model, the trials, the models in question; a request to stop.
    pub fn evaluate(&self, request: &Evaluate, progress: &dyn Progress) -> Result<Evaluation<'_>, Failure> {
        let mut names: Vec<ModelName> = vec![ModelName { id: LINEAR.to_string(), label: "linear".to_string() }];
        let mut inputs = Vec::new();
        let outcomes = self.each("evaluating", progress, |participant| {
            let run = participant.load()?.data;
            progress.warnings(&run.warnings);
            let mut models = vec![(LINEAR.to_string(), run.loaded.file.spec.clone())];
            for (name, path) in model_files(&request.models, participant.about())? {
                let file = OsimFile::read(&path).map_err(|e| osim_failure(&path, &e))?;
                inputs.push(input_file(&path, &path.display().to_string(), "evaluated model")?);
                // A linearly scaled model among them is the control.
                if name == LINEAR {
                    models[0].1 = file.spec;
                    continue;
                }
                if !names.iter().any(|known| known.id == name) {
                    names.push(ModelName { id: name.clone(), label: name.replace('_', " ") });
                }
                models.push((name, file.spec));
            }
            inputs.extend(run.inputs.clone());
            let shown: Vec<&str> = models.iter().rev().take(3).map(|(name, _)| name.as_str()).collect();
            self.errors_of(&run, &models, &shown)
        })?;
        // The control stands last, as in table 3.1.
        names.rotate_left(1);
        let (errors, curves): (Vec<_>, Vec<_>) = outcomes.done.into_iter().unzip();
        let cohort = Cohort::new(errors.concat(), names.iter().map(|n| n.id.clone()).collect());
        let report = evaluation_report::evaluation(&cohort, &names, &curves.concat())?;
        inputs.sort_by(|a, b| (&a.role, &a.path).cmp(&(&b.role, &b.path)));
        inputs.dedup();
        let article = Article {
            title: "Models on held-out trials".to_string(),
            kicker: format!("Evaluation · {}", self.tables.settings.name),
            lead: report.lead.clone(),
            facts: vec![
                ("participants".to_string(), cohort.participants().len().to_string()),
                ("models".to_string(), cohort.models().len().to_string()),
            ],
            warnings: report.warnings.clone(),
            sections: vec![Section {
                id: "evaluation".to_string(),
                title: "Evaluation".to_string(),
                blocks: report.blocks.clone(),
            }],
            provenance: self.provenance(request, request.seed, inputs),
        };
        Ok(Evaluation { study: self, names, cohort, report, article, failed: outcomes.failed })
    }

    /// Errors of models on a participant's held-out isometric and isotonic trials, and for the models `shown` the
    /// moments of the first held-out trial of every condition.
    ///
    /// # Errors
    /// A model that cannot be simulated; no held-out trial.
    pub(super) fn errors_of(
        &self,
        run: &LoadedParticipant,
        models: &[(String, ModelSpec)],
        shown: &[&str],
    ) -> Result<(Vec<ConditionError>, Vec<Representative>), Failure> {
        let held_out: Vec<usize> = (0..run.trials.len())
            .filter(|&i| {
                let info = &run.trials[i].info;
                info.usage == TrialUse::Test
                    && matches!(info.contraction, Contraction::Isometric | Contraction::Isotonic)
                    && info.effort_percent.is_some()
            })
            .collect();
        if held_out.is_empty() {
            let text = format!("participant {}: no held-out isometric or isotonic trial", run.participant.name);
            return Err(Diagnostic::error(text)
                .in_file(&self.tables.folder.join("trials.csv"))
                .hint("mark repetitions with use = test")
                .into());
        }
        let mut errors = Vec::new();
        let mut curves: Vec<Representative> = representatives(run, &held_out);
        for (name, spec) in models {
            let simulated = self.simulate_some(run, spec, &held_out)?;
            let trial_errors = held_out.iter().zip(&simulated).map(|(&i, simulation)| {
                TrialErrors::calc(&run.trials[i].info, &run.trials[i].moment, &simulation.moment)
                    .map_err(|e| Failure::Internal(format!("trial {}: {e}", run.trials[i].info.name)))
            });
            let table = ErrorTable::from_trials(trial_errors.collect::<Result<_, _>>()?);
            errors.extend(condition_errors(&run.participant.name, name, &table));
            if shown.contains(&name.as_str()) {
                for curve in &mut curves {
                    let at = held_out.iter().position(|&i| run.trials[i].info.name == curve.trial);
                    if let Some(at) = at {
                        curve.add(name, &simulated[at].moment);
                    }
                }
            }
        }
        Ok((errors, curves))
    }
}

impl Evaluation<'_> {
    /// The errors and their tests, for programs.
    ///
    /// - `report`: where the page is
    pub fn value(&self, report: &Path) -> Value {
        json!({
            "schema": "carpus.evaluation/1",
            "errors": self.cohort.errors(),
            "anova": self.report.anova,
            "report": report,
        })
    }

    /// Writes the tables and `report.html`, whose path comes back.
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder) -> Result<PathBuf, Failure> {
        for (name, text) in &self.report.tables {
            out.write(name, text.as_bytes())?;
        }
        out.write("report.html", render_article(&self.article).as_bytes())
    }

    /// Writes the files of `carpus evaluate` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.study.write_results(path.as_ref(), "evaluate", |out| self.write_to(out).map(|_| ()))
    }
}

/// The models of a participant in the folders given: `DIR/PARTICIPANT/*.osim`. A file `model.osim`, as `personalize`
/// writes it, goes by the name of its folder.
///
/// # Errors
/// A folder without a model of this participant; two models of one name.
fn model_files(folders: &[PathBuf], participant: &Participant) -> Result<Vec<(String, PathBuf)>, Failure> {
    let mut found: Vec<(String, PathBuf)> = Vec::new();
    for folder in folders {
        let of_participant = folder.join(&participant.name);
        let unreadable = |e: std::io::Error| {
            Diagnostic::error(format!("models of participant {}: {e}", participant.name))
                .in_file(&of_participant)
                .hint("--models takes folders with one folder a participant, e.g. DIR/P01/isotonic_25.osim")
        };
        let mut here = Vec::new();
        for entry in std::fs::read_dir(&of_participant).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("osim")) {
                here.push((model_name(&path, folder), path));
            }
        }
        if here.is_empty() {
            let message = Diagnostic::error("no .osim file in this folder").in_file(&of_participant);
            return Err(message.into());
        }
        here.sort();
        for (name, path) in here {
            if found.iter().any(|(known, _)| *known == name) {
                let text = format!("two models are called `{name}`");
                return Err(Diagnostic::error(text).in_file(&path).hint("rename the file").into());
            }
            found.push((name, path));
        }
    }
    Ok(found)
}

fn model_name(path: &Path, folder: &Path) -> String {
    let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let folder = folder.file_name().map(|s| s.to_string_lossy().into_owned());
    match folder {
        Some(folder) if stem == "model" => folder,
        _ => stem,
    }
}
