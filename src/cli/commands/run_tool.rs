//! `carpus run-tool`: a setup file of an OpenSim tool.

use serde_json::json;

use crate::cli::args::{Global, RunToolArgs};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::output::OutputFolder;
use crate::cli::{model, print_result};
use crate::tools::{ToolError, ToolProblem, run_tool};

/// Runs the command.
///
/// # Errors
/// The setup, the files that it names, or the disk.
pub fn run(args: &RunToolArgs, global: &Global) -> Result<(), Failure> {
    let outcome = run_tool(&args.setup, args.model.as_deref(), args.allow_unsupported).map_err(tool_failure)?;
    let warnings: Vec<Message> = outcome
        .warnings
        .iter()
        .map(|(file, line, text)| Message::warning(text.clone()).in_file(file).at_line(*line))
        .collect();
    failure::print(&warnings);
    let inputs: Vec<_> = std::iter::once(args.setup.clone()).chain(args.model.clone()).collect();
    let mut written = Vec::new();
    for file in &outcome.files {
        let folder = file.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(std::path::Path::new("."));
        let name = file.path.file_name().unwrap_or_default();
        written.push(OutputFolder::create(folder, &inputs)?.write(name, &file.bytes)?);
    }
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
    let message = Message::error(text).in_file(&error.file).at_line(error.line);
    Message { hint: error.hint(), ..message }.into()
}
