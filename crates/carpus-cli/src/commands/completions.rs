//! `carpus completions`: what a shell needs to complete commands and options.

use crate::args::CompletionsArgs;
use crate::failure::Failure;
use crate::help;
use crate::stdout::print_result;

/// Runs the command.
///
/// # Errors
/// Standard output cannot be written.
pub fn run(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut help::command(), "carpus", &mut script);
    let script = String::from_utf8(script).map_err(|e| Failure::Internal(e.to_string()))?;
    print_result(&script)
}
