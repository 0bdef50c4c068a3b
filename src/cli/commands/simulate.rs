//! `carpus simulate`.
use crate::cli::args::{Global, SimulateArgs};
use crate::cli::failure::Failure;

/// Runs the command.
///
/// # Errors
/// See the library.
pub fn run(_args: &SimulateArgs, _global: &Global) -> Result<(), Failure> {
    Err(Failure::Internal("not wired".into()))
}
