//! `carpus demo`.
use crate::cli::args::{DemoArgs, Global};
use crate::cli::failure::Failure;

/// Runs the command.
///
/// # Errors
/// See the library.
pub fn run(_args: &DemoArgs, _global: &Global) -> Result<(), Failure> {
    Err(Failure::Internal("not wired".into()))
}
