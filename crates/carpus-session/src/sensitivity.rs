//! Which muscle parameters the trials of each condition respond to, over participants.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::diagnostic::{Diagnostic, Failure};
use super::json::{pretty, value};
use super::output::OutputFolder;
use super::progress::{Progress, go_on};
use super::report_parts::ReportParts;
use super::screening::{ConditionSensitivity, ScreeningOptions, conditions, refused, screened};
use super::sensitivity_report;
use super::study::Study;
use carpus_personalization::sensitivity::MuscleScreening;
use carpus_report::article::{Article, Section};
use carpus_report::render_article;
use carpus_report::results::InputFile;

/// What every participant's trials respond to.
#[derive(Debug)]
pub struct Sensitivity<'s> {
    study: &'s Study,
    /// The screening of every condition of every participant.
    pub conditions: Vec<ConditionSensitivity>,
    /// What is written as `sensitivity.json`.
    pub value: Value,
    /// Tables, figures and tests.
    pub report: ReportParts,
    /// The page.
    pub article: Article,
    /// Why participants could not be screened.
    pub failed: Vec<Diagnostic>,
}

impl Study {
    /// Screens the training trials of every participant, condition by condition.
    ///
    /// # Errors
    /// No participant that could be screened: the model, the trials, a screening of which every run fails; a request to
    /// stop.
    pub fn sensitivity(&self, request: &ScreeningOptions, progress: &dyn Progress) -> Result<Sensitivity<'_>, Failure> {
        let mut inputs: Vec<InputFile> = Vec::new();
        let outcomes = self.each("screening", progress, |participant| {
            let run = participant.load()?.data;
            progress.warnings(&run.warnings);
            let of = |condition| {
                go_on(progress)?;
                screened(&run, condition, request, progress)
            };
            let found: Result<Vec<_>, Failure> = conditions(&run)?.into_iter().map(of).collect();
            inputs.extend(run.inputs.iter().filter(|file| !inputs.contains(file)).cloned().collect::<Vec<_>>());
            found
        })?;
        let participants = outcomes.done.len();
        let conditions: Vec<ConditionSensitivity> = outcomes.done.into_iter().flatten().collect();
        let report = sensitivity_report::report(&conditions)?;
        let provenance = self.provenance(request, request.seed, inputs);
        let value = value(&json!({
            "schema": "carpus.sensitivity/1",
            "provenance": provenance,
            "starts": request.starts,
            "bounds_fraction_of_model": MuscleScreening::parameters(&["MUSCLE"]).map_err(refused)?,
            "conditions": conditions,
            "anova": report.anova,
        }))?;
        let article = Article {
            title: "What the trials respond to".to_string(),
            kicker: format!("Sensitivity · {}", self.tables.settings.name),
            lead: report.lead.clone(),
            facts: vec![("participants".to_string(), participants.to_string())],
            warnings: report.warnings.clone(),
            sections: vec![Section {
                id: "sensitivity".to_string(),
                title: "Sensitivity".to_string(),
                blocks: report.blocks.clone(),
            }],
            provenance,
        };
        Ok(Sensitivity { study: self, conditions, value, report, article, failed: outcomes.failed })
    }
}

impl Sensitivity<'_> {
    /// Writes `sensitivity.json`, the tables and `report.html`, whose path comes back.
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder) -> Result<PathBuf, Failure> {
        out.write("sensitivity.json", pretty(&self.value)?.as_bytes())?;
        for (name, text) in &self.report.tables {
            out.write(name, text.as_bytes())?;
        }
        out.write("report.html", render_article(&self.article).as_bytes())
    }

    /// Writes the files of `carpus sensitivity` into a folder of results. Returns what a person should know about files
    /// of earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.study.write_results(path.as_ref(), "sensitivity", |out| self.write_to(out).map(|_| ()))
    }
}
