//! `carpus run-tool`: a setup file of an OpenSim tool.

use crate::args::{Global, RunToolArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::stdout::print_result;
use carpus_session::output::shown;
use carpus_session::run_tool::RunTool;

/// Runs the command.
///
/// # Errors
/// The setup, the files that it names, or the disk.
pub fn run(args: &RunToolArgs, global: &Global) -> Result<(), Failure> {
    let (setup, model) = (args.setup.clone(), args.model.clone());
    let done = RunTool { setup, model, allow_unsupported: args.allow_unsupported }.run(&Bars::new(global))?;
    if global.json {
        return print_result(&done.value().to_string());
    }
    let lines: Vec<String> = done.summary.iter().cloned().chain(shown(&done.files)).collect();
    print_result(lines.join("\n").trim_start())
}
