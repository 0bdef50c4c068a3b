//! The program `carpus`, for the console script of the package.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs a command of the program and returns its exit code.
///
/// - `words`: `carpus`, then its arguments
#[pyfunction]
pub fn program(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| carpus::cli::run_words(words))
}
