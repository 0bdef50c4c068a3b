//! What a tool writes.

use std::path::{Path, PathBuf};

use carpus_numerics::printable::is_deceptive;
use carpus_osim::osim::{Diagnostics, Severity};
use carpus_osim::storage::Storage;

/// A file that a tool writes.
#[derive(Clone, Debug)]
pub struct ResultFile {
    /// Where.
    pub path: PathBuf,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Whether the setup gives the file by its own name, not only the folder of results.
    pub is_named: bool,
}

/// What a tool did.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Files to be written.
    pub files: Vec<ResultFile>,
    /// Files that were read, or that those name.
    pub inputs: Vec<PathBuf>,
    /// What the user should know: file, line (0: none), text. What stands in the model and in files of forces comes
    /// first.
    pub warnings: Vec<(PathBuf, usize, String)>,
    /// How many of the warnings are about what stands in the model and in files of forces.
    pub warnings_of_files: usize,
    /// What was done, in lines for the terminal.
    pub summary: Vec<String>,
}

impl Outcome {
    /// Adds a storage as OpenSim's `Storage::printResult` names it: in `folder`, `.sto` unless the name has an
    /// extension.
    pub fn add_storage(&mut self, folder: &Path, name: &str, storage: &Storage, precision: usize) {
        // Only the name counts, folders in it are dropped.
        let name = name.rsplit(['/', '\\']).next().unwrap_or(name).replace(is_deceptive, "_");
        let has_extension = name.rsplit_once('.').is_some_and(|(stem, end)| !stem.is_empty() && !end.is_empty());
        let name = if has_extension { name } else { format!("{name}.sto") };
        self.files.push(ResultFile {
            path: folder.join(name),
            bytes: storage.text(precision).into_bytes(),
            is_named: false,
        });
    }

    /// Adds the warnings among what was found in a file.
    pub fn warn_of_diagnostics(&mut self, file: &Path, diagnostics: &Diagnostics) {
        for found in diagnostics.of(Severity::Warning) {
            let warning = (file.to_owned(), found.line, format!("{}: {}", found.path, found.message));
            self.warnings.insert(self.warnings_of_files, warning);
            self.warnings_of_files += 1;
        }
    }

    /// Adds a warning about a file.
    pub fn warn(&mut self, file: &Path, line: usize, text: impl Into<String>) {
        self.warnings.push((file.to_owned(), line, text.into()));
    }
}
