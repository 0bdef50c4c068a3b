//! A setup file of an OpenSim tool.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use super::diagnostic::{Diagnostic, Failure};
use super::model;
use super::output::{Leftovers, OutputFolder, shown};
use super::progress::{Progress, go_on};
use carpus_tools::{Outcome, ToolError, ToolProblem, run_tool};
use serde::Serialize;
use serde_json::{Value, json};

/// A run of a setup file; paths in it are relative to its folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunTool {
    /// The setup file.
    pub setup: PathBuf,
    /// A model in place of the one that the setup names.
    pub model: Option<PathBuf>,
    /// Whether work goes on without forces that are not computed.
    pub allow_unsupported: bool,
}

/// What a tool did.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ToolRun {
    /// The files that it wrote.
    pub files: Vec<PathBuf>,
    /// What it did, in lines.
    pub summary: Vec<String>,
}

impl ToolRun {
    /// For programs.
    pub fn value(&self) -> Value {
        json!({ "files": shown(&self.files), "summary": self.summary })
    }
}

impl RunTool {
    /// A setup as it is.
    pub fn new(setup: impl Into<PathBuf>) -> RunTool {
        RunTool { setup: setup.into(), model: None, allow_unsupported: false }
    }

    /// Runs the tool and writes its results where the setup says.
    ///
    /// # Errors
    /// The setup, the files that it names, the disk; a request to stop.
    pub fn run(&self, progress: &dyn Progress) -> Result<ToolRun, Failure> {
        go_on(progress)?;
        let outcome = run_tool(&self.setup, self.model.as_deref(), self.allow_unsupported).map_err(tool_failure)?;
        let warnings: Vec<Diagnostic> = outcome
            .warnings
            .iter()
            .map(|(file, line, text)| Diagnostic::warning(text.clone()).in_file(file).at_line(*line))
            .collect();
        // Many remarks about the model do not hide what is said about the results.
        let (of_files, of_results) = warnings.split_at(outcome.warnings_of_files.min(warnings.len()));
        progress.warnings(of_files);
        progress.warnings(of_results);
        let files = write(&self.setup, &outcome, progress)?;
        Ok(ToolRun { files, summary: outcome.summary })
    }
}

/// Writes the results. A folder of results says what made them; beside a file that the setup gives by its own name
/// nothing else appears.
fn write(setup: &Path, outcome: &Outcome, progress: &dyn Progress) -> Result<Vec<PathBuf>, Failure> {
    let mut folders: BTreeMap<PathBuf, OutputFolder> = BTreeMap::new();
    let mut written = Vec::new();
    for file in &outcome.files {
        let folder = file.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = file.path.file_name().unwrap_or_default();
        if file.is_named {
            written.push(OutputFolder::create(folder, &outcome.inputs)?.write(name, &file.bytes)?);
            continue;
        }
        let out = match folders.entry(folder.to_owned()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                new.insert(OutputFolder::create(folder, &outcome.inputs)?.overwriting_with_results_of(setup))
            }
        };
        written.push(out.write(name, &file.bytes)?);
    }
    for out in folders.values() {
        progress.warnings(&out.close_with("run-tool", &[], Leftovers::Name)?);
    }
    Ok(written)
}

/// The message for an error of a tool.
fn tool_failure(error: ToolError) -> Failure {
    if let ToolProblem::Osim(osim) = &*error.problem {
        return model::osim_failure(&error.file, osim);
    }
    let text = match &*error.problem {
        ToolProblem::Storage(storage) => storage.problem.to_string(),
        ToolProblem::Document(document) => document.kind.to_string(),
        other => other.to_string(),
    };
    let message = Diagnostic::error(text).in_file(&error.file).at_line(error.line);
    Diagnostic { hint: error.hint(), ..message }.into()
}
