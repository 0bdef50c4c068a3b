//! Files that a setup names to be read: no result is written over one of them.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::error::{ToolError, ToolProblem};
use super::result::Outcome;
use carpus_osim::osim::Document;

/// Names of files whose text may name further files: setups, models, external loads, controls, sets of forces and
/// markers.
const NAMING: [&str; 2] = ["xml", "osim"];

/// Fails if a result would take the place of a file that the setup names, or one that such a file names, whatever calls
/// it so: only the properties whose names begin with `output_` name results. Links are followed.
///
/// Of two results of the same path the later stays, as in OpenSim, with a warning.
///
/// # Errors
/// [`ToolProblem::Overwrites`] with the result's path.
pub fn refuse_to_overwrite(setup: &Path, model: Option<&Path>, outcome: &mut Outcome) -> Result<(), ToolError> {
    let inputs = named_files(std::iter::once(setup).chain(model));
    for file in &outcome.files {
        if file.path.canonicalize().is_ok_and(|found| inputs.contains(&found)) {
            return Err(ToolError::new(&file.path, ToolProblem::Overwrites));
        }
    }
    let mut seen = HashSet::new();
    let is_last: Vec<bool> = outcome.files.iter().rev().map(|file| seen.insert(file.path.clone())).collect();
    let mut is_last = is_last.into_iter().rev();
    let (kept, replaced): (Vec<_>, Vec<_>) =
        std::mem::take(&mut outcome.files).into_iter().partition(|_| is_last.next() == Some(true));
    outcome.files = kept;
    outcome.inputs.extend(inputs);
    for file in replaced {
        outcome.warn(&file.path, 0, "two results have this name: the later one is written");
    }
    Ok(())
}

/// Canonical paths of files, and of all that they name.
fn named_files<'a>(first: impl Iterator<Item = &'a Path>) -> HashSet<PathBuf> {
    let mut found = HashSet::new();
    let mut waiting: Vec<PathBuf> = Vec::new();
    for path in first {
        found.extend(path.canonicalize());
        // What is read as a setup or a model is one, whatever its name.
        waiting.extend(names_in(path));
    }
    while let Some(path) = waiting.pop() {
        let Ok(canonical) = path.canonicalize() else { continue };
        let names = path.extension().is_some_and(|e| NAMING.iter().any(|known| e.eq_ignore_ascii_case(known)));
        if found.insert(canonical) && names {
            waiting.extend(names_in(&path));
        }
    }
    found
}

/// Files that exist and that the text of a document names, relative to its folder.
fn names_in(path: &Path) -> Vec<PathBuf> {
    let Ok(document) = Document::read(path) else { return Vec::new() };
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut words: HashSet<String> = HashSet::new();
    for element in document.elements() {
        words.extend(document.attribute(element, "file"));
        if document.children(element).is_empty() && !document.tag(element).starts_with("output_") {
            let text = document.text(element);
            words.extend(text.split_ascii_whitespace().map(str::to_owned));
            words.insert(text);
        }
    }
    let is_name = |word: &String| !word.is_empty() && word.parse::<f64>().is_err();
    let files = words.into_iter().filter(is_name).map(|word| folder.join(word.replace('\\', "/")));
    files.filter(|file| file.is_file()).collect()
}
