//! OpenSim's tools by their setup files; the catalogue of effects.

use std::path::PathBuf;
use std::sync::Arc;

use carpus::effects::catalogue::with_own;
use carpus::session::diagnostic::Failure;
use carpus::session::run_tool::RunTool;
use pyo3::prelude::*;

use crate::failure::OrRaise;
use crate::job::{Relay, long};

/// Runs one of OpenSim's tools. Returns the files that it wrote, and what it did in lines.
#[pyfunction]
#[pyo3(signature = (setup, model, allow_unsupported))]
pub fn run_tool(
    py: Python<'_>,
    setup: PathBuf,
    model: Option<PathBuf>,
    allow_unsupported: bool,
) -> PyResult<(Vec<PathBuf>, Vec<String>)> {
    let relay = Arc::<Relay>::default();
    let asked = RunTool { setup, model, allow_unsupported };
    let told = Arc::clone(&relay);
    let done = long(py, &relay, move || asked.run(&*told))?;
    Ok((done.files, done.summary))
}

/// The catalogue of effects, and those defined beside it, as JSON.
#[pyfunction]
pub fn catalogue(py: Python<'_>) -> PyResult<String> {
    let all: Vec<_> = with_own().into_iter().map(|e| *e.description()).collect();
    serde_json::to_string(&all).map_err(|e| Failure::Internal(e.to_string())).or_raise(py)
}
