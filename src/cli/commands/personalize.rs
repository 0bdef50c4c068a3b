//! `carpus personalize`.
use crate::cli::args::{Global, PersonalizeArgs};
use crate::cli::failure::Failure;

/// Runs the command.
///
/// # Errors
/// See the library.
pub fn run(_args: &PersonalizeArgs, _global: &Global) -> Result<(), Failure> {
    Err(Failure::Internal("not wired".into()))
}
