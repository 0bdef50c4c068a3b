//! `carpus compare`.
use crate::cli::args::{CompareArgs, Global};
use crate::cli::failure::Failure;

/// Runs the command.
///
/// # Errors
/// See the library.
pub fn run(_args: &CompareArgs, _global: &Global) -> Result<(), Failure> {
    Err(Failure::Internal("not wired".into()))
}
