//! `carpus personalize`: fitted muscle parameters, the model that has them, errors before and after.

use std::path::Path;

use super::compare::error_table;
use super::simulate::summary;
use crate::cli::args::{Global, PersonalizeArgs};
use crate::cli::failure::Failure;
use crate::cli::study_run::StudyRun;
use crate::report::results::Results;
use crate::study::Participant;

/// Runs the command.
///
/// # Errors
/// See the library.
pub fn run(_args: &PersonalizeArgs, _global: &Global) -> Result<(), Failure> {
    Err(Failure::Internal("not wired".into()))
}

/// Fits.
///
/// # Errors
/// See.
pub fn personalize(_s: &StudyRun, _p: &Participant, _f: &Path, _g: &Global) -> Result<Results, Failure> {
    Err(Failure::Internal("not wired".into()))
}

/// What `--json` prints.
pub fn json(outcomes: &[Results]) -> String {
    serde_json::Value::Array(outcomes.iter().map(summary).collect()).to_string()
}

/// Errors before and after, for a terminal.
pub fn readable(outcomes: &[Results]) -> String {
    error_table(outcomes)
}
