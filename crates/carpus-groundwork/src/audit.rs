//! Audit of a model alone: what no body has, over the ranges of its coordinates.
//!
//! In: a model. Out: findings, each with the object's path, its line, how much, and a remedy. The model is posed at its
//! default posture, and each coordinate with a range is moved through it while the others are held. One file per
//! subject. Not here: what a model has and what is not supported ([`super::info`]); studies.

mod architecture;
mod finding;
mod inertia;
mod moment_arms;
mod operating_range;
mod paths;
mod poses;
mod ranges;
mod reading;
mod wraps;

use std::path::PathBuf;

use serde::Serialize;

use super::diagnostic::{Diagnostic, Failure};
use super::model::{self, LoadedModel, Needs};
use super::progress::{Progress, go_on};
use super::provenance::{DEFAULT_SEED, input_file, made_by};
use super::quantity::Assignment;
use carpus_report::next_steps::{NextStep, command, quoted};
use carpus_report::results::Provenance;
pub use finding::{Check, Finding, Level};
use poses::Poses;

/// An audit of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct AuditModel {
    /// The model.
    pub model: PathBuf,
    /// Coordinates that are moved through their ranges; none: all that have one.
    pub coordinates: Vec<String>,
    /// Coordinates that are held elsewhere than at their defaults.
    pub set: Vec<Assignment>,
    /// Words that results give as what made them; without them the request itself.
    pub command: Option<String>,
}

/// What an audit found.
#[derive(Clone, Debug, Serialize)]
pub struct Audit {
    /// Name and version of the form.
    pub schema: &'static str,
    /// The file.
    pub file: String,
    /// Name of the model.
    pub model: String,
    /// Coordinates that were moved.
    pub coordinates: Vec<String>,
    /// How many muscles were looked at.
    pub muscles: usize,
    /// Errors first, then warnings, then notes; each in the order of the file.
    pub findings: Vec<Finding>,
    /// What made it.
    pub provenance: Provenance,
}

impl AuditModel {
    /// All coordinates, all others at their defaults.
    pub fn new(model: impl Into<PathBuf>) -> AuditModel {
        AuditModel { model: model.into(), coordinates: Vec::new(), set: Vec::new(), command: None }
    }

    /// Looks at the model.
    ///
    /// # Errors
    /// The file is no model that can be computed with; an unknown coordinate; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<(Audit, Vec<Diagnostic>), Failure> {
        go_on(progress)?;
        let mut messages = Vec::new();
        // What is not supported is told by `info`; the rest of the model is looked at all the same.
        let loaded = model::load(&self.model, Needs::Motion, true, &mut messages)?;
        messages.clear();
        let open: Vec<&str> = loaded.model.unsupported_constraints.iter().map(|(name, _)| name.as_str()).collect();
        if !open.is_empty() {
            let text = format!("constraints do not hold here, coordinates are taken as given: {}", open.join(", "));
            let hint = "what is found of coordinates in their loops holds for poses that the model may not reach";
            messages.push(Diagnostic::warning(text).in_file(&self.model).hint(hint));
        }
        let posture = loaded.posture(&self.set, &mut messages)?;
        let poses = Poses::of(&loaded, &self.coordinates, posture)?;
        let mut findings = reading::findings(&loaded);
        findings.extend(inertia::findings(&loaded));
        findings.extend(ranges::findings(&loaded));
        findings.extend(architecture::findings(&loaded));
        let swept = poses.sweep(&loaded, progress, &mut findings)?;
        findings.extend(wraps::findings(&loaded, &poses));
        findings.extend(paths::findings(&loaded, &poses, &swept)?);
        findings.extend(operating_range::findings(&loaded, &poses, &swept));
        findings.extend(moment_arms::findings(&loaded, &poses, &swept));
        findings.sort_by_key(|finding| (finding.level, finding.line));
        let audit = Audit {
            schema: "carpus.audit/1",
            file: self.model.display().to_string(),
            model: loaded.model.name.clone(),
            coordinates: poses.moved.iter().map(|c| loaded.model.coordinates[c.0].name.clone()).collect(),
            muscles: loaded.file.spec.muscles.len(),
            findings,
            provenance: self.provenance(&loaded)?,
        };
        Ok((audit, messages))
    }

    fn provenance(&self, loaded: &LoadedModel) -> Result<Provenance, Failure> {
        let file = input_file(&loaded.path, &loaded.path.display().to_string(), "model")?;
        Ok(made_by(self.command.as_deref(), self, DEFAULT_SEED, vec![file]))
    }
}

impl Audit {
    /// Findings of one level.
    pub fn of(&self, level: Level) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(move |finding| finding.level == level)
    }

    /// What to do next.
    pub fn next_steps(&self) -> Vec<NextStep> {
        let file = quoted(&self.file);
        let look = |finding: &Finding, kind: &str| {
            let what = format!("See the first {kind} in three dimensions ({}).", finding.path);
            command(what, format!("carpus view {file} --open"))
        };
        let error = self.of(Level::Error).next().map(|finding| look(finding, "error"));
        let warning = self.of(Level::Warning).next().map(|finding| look(finding, "warning"));
        let begin = command("Make a study of your recordings.", format!("carpus init FOLDER --model {file}"));
        match (error, warning) {
            (Some(error), _) => {
                let what = "Mend the errors in the model, and look again.";
                vec![error, command(what, format!("carpus audit {file}"))]
            }
            (None, warning) => warning.into_iter().chain([begin]).collect(),
        }
    }
}
