//! `carpus run-tool`: a setup file of an OpenSim tool.

use serde_json::json;

use crate::args::{Global, RunToolArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::print_result;
use carpus_session::run_tool::RunTool;

/// Runs the command.
///
/// # Errors
/// The setup, the files that it names, or the disk.
pub fn run(args: &RunToolArgs, global: &Global) -> Result<(), Failure> {
    let (setup, model) = (args.setup.clone(), args.model.clone());
    let done = RunTool { setup, model, allow_unsupported: args.allow_unsupported }.run(&Bars::new(global))?;
    let files: Vec<String> = done.files.iter().map(|f| f.display().to_string()).collect();
    if global.json {
        return print_result(&json!({ "files": files, "summary": done.summary }).to_string());
    }
    let mut text = done.summary.join("\n");
    for file in &files {
        text.push_str(&format!("\n{file}"));
    }
    print_result(text.trim_start())
}
