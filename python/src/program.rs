//! The program `carpus`, for the console script of the package.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Says which file this module is: units of work depend on it.
#[pyfunction]
pub fn set_program(file: PathBuf) {
    carpus::session::units::set_program(file);
}

/// Runs a command of the program and returns its exit code.
///
/// - `words`: `carpus`, then its arguments
#[pyfunction]
pub fn program(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| carpus::cli::run_words(words))
}
