//! A model of an old format in the current one.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};

use super::diagnostic::{Diagnostic, Failure};
use super::model;
use super::output::OutputFolder;
use super::progress::Progress;
use carpus_osim::osim::OsimFile;

/// An upgrade of a model's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Upgrade {
    /// The old model.
    pub old: PathBuf,
}

/// An upgraded model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Upgraded {
    /// The old format.
    pub from: u32,
    /// The current one.
    pub to: u32,
    /// The file.
    pub file: PathBuf,
    /// What was left out: line and component.
    pub left_out: Vec<(usize, String)>,
}

impl Upgraded {
    /// For programs.
    pub fn value(&self) -> Value {
        let left = self.left_out.iter().map(|(line, what)| json!({ "line": line, "what": what }));
        json!({
            "schema": "carpus.upgrade/1", "from": self.from, "to": self.to, "file": self.file.display().to_string(),
            "left_out": left.collect::<Vec<_>>(),
        })
    }
}

impl Upgrade {
    /// Writes the model in the current format.
    ///
    /// # Errors
    /// A model that cannot be read, or the disk.
    pub fn run(&self, new: &Path, progress: &dyn Progress) -> Result<Upgraded, Failure> {
        let fail = |error| model::osim_failure(&self.old, &error);
        let file = OsimFile::read(&self.old).map_err(fail)?;
        let upgraded = file.upgraded().map_err(fail)?;
        let warnings: Vec<Diagnostic> = upgraded
            .left_out
            .iter()
            .map(|(line, text)| Diagnostic::warning(format!("left out: {text}")).in_file(&self.old).at_line(*line))
            .collect();
        progress.warnings(&warnings);
        let folder = new.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let Some(name) = new.file_name() else {
            return Err(Diagnostic::error("expected a file to write").in_file(new).into());
        };
        let written = OutputFolder::create(folder, std::slice::from_ref(&self.old))?
            .write(name, upgraded.file.document.bytes())?;
        Ok(Upgraded {
            from: file.spec.document_version,
            to: upgraded.file.spec.document_version,
            file: written,
            left_out: upgraded.left_out,
        })
    }
}
