//! `carpus run-tool`: a setup file of an OpenSim tool.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use serde_json::json;

use crate::args::{Global, RunToolArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use carpus_session::model;
use carpus_session::output::{Leftovers, OutputFolder};
use carpus_tools::{Outcome, ToolError, ToolProblem, run_tool};

/// Runs the command.
///
/// # Errors
/// The setup, the files that it names, or the disk.
pub fn run(args: &RunToolArgs, global: &Global) -> Result<(), Failure> {
    let outcome = run_tool(&args.setup, args.model.as_deref(), args.allow_unsupported).map_err(tool_failure)?;
    let warnings: Vec<Diagnostic> = outcome
        .warnings
        .iter()
        .map(|(file, line, text)| Diagnostic::warning(text.clone()).in_file(file).at_line(*line))
        .collect();
    failure::print(&warnings);
    let written = write(&args.setup, &outcome)?;
    if global.json {
        let files: Vec<String> = written.iter().map(|f| f.display().to_string()).collect();
        return print_result(&json!({ "files": files, "summary": outcome.summary }).to_string());
    }
    let mut text = outcome.summary.join("\n");
    for file in &written {
        text.push_str(&format!("\n{}", file.display()));
    }
    print_result(text.trim_start())
}

/// Writes the results. A folder of results says what made them; beside a file that the setup gives by its own name nothing
/// else appears.
fn write(setup: &Path, outcome: &Outcome) -> Result<Vec<PathBuf>, Failure> {
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
        failure::print(&out.close_with("run-tool", &[], Leftovers::Name)?);
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
