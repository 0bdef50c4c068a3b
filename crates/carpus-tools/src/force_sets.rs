//! Forces that a setup adds to the model: `force_set_files` and `replace_force_set` of OpenSim's `AbstractTool`.

use std::path::{Path, PathBuf};

use super::error::ToolError;
use super::result::Outcome;
use super::setup::{Properties, Setup};
use super::system::System;
use carpus_osim::osim::OsimFile;

/// The model of a tool as a system, with the forces of the files that the setup names.
///
/// - `path`: of the model
///
/// # Errors
/// A file; something in it that cannot be used, or that refers to what the model does not have.
pub fn system_with(
    tool: &Properties,
    path: &Path,
    file: &OsimFile,
    outcome: &mut Outcome,
) -> Result<System, ToolError> {
    let replace = tool.boolean("replace_force_set", tool.boolean("replace_actuator_set", false)?)?;
    let paths = force_set_files(tool);
    if paths.is_empty() && !replace {
        return System::of_spec(path, file.spec.clone());
    }
    let read = |path: &PathBuf| Setup::read(path).map(Setup::into_document);
    let documents = paths.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let (spec, diagnostics) = file.with_force_sets(&documents, replace).map_err(|e| {
        let file = PathBuf::from(e.file());
        ToolError::new(&file, e)
    })?;
    for (path, diagnostics) in paths.iter().zip(&diagnostics) {
        outcome.warn_of_diagnostics(path, diagnostics);
    }
    System::of_files(path, &paths, spec)
}

/// The files, by their older name where the present one is empty.
fn force_set_files(tool: &Properties) -> Vec<PathBuf> {
    let words = |property: &str| tool.words(property).unwrap_or_default();
    let (present, old) = (words("force_set_files"), words("actuator_set_files"));
    let files = if present.is_empty() { old } else { present };
    files.iter().filter(|file| *file != "Unassigned").map(|file| tool.setup().resolve(file)).collect()
}
