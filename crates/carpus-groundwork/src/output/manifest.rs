//! The file that says who made the others.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

const SCHEMA: &str = "carpus.output/1";
/// The file that says who made the others.
pub(super) const MANIFEST: &str = "carpus-output.json";
/// Stands for the command in the manifest where a run ended early: the next run of any command removes what it does not
/// write.
pub(super) const UNFINISHED: &str = "unfinished run";
/// Files that a message names before it counts the rest.
const NAMED: usize = 5;

/// Who made the files of a folder.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub(super) schema: String,
    /// The study whose results are here, if any: its name, and its study.toml.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) study: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) study_file: Option<PathBuf>,
    /// The command that began to write here and did not end: what it wrote is not in the list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) begun: Option<String>,
    pub(super) files: BTreeMap<String, Made>,
}

/// One file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Made {
    pub(super) command: String,
    /// What it is made from: a model, a setup, a recording; nothing for a result of the study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) source: Option<PathBuf>,
    pub(super) sha256: String,
}

impl Manifest {
    /// The manifest of a folder; `None` if there is none that can be read.
    pub(super) fn read(file: &Path) -> Option<Manifest> {
        let manifest: Manifest = serde_json::from_slice(&carpus_numerics::regular_file::read(file).ok()?).ok()?;
        (manifest.schema == SCHEMA).then_some(manifest)
    }

    /// One of a folder of which nothing is known.
    pub(super) fn new() -> Manifest {
        Manifest { schema: SCHEMA.to_owned(), study: None, study_file: None, begun: None, files: BTreeMap::new() }
    }

    /// Whether results of `other` are of this study: the same study.toml, the same study that was moved, or one that
    /// was made here.
    pub(super) fn is_of(&self, other: &str, other_file: &Path, name: &str, study_file: &Path, folder: &Path) -> bool {
        let moved = other == name && !other_file.exists();
        let made_here =
            || self.files.keys().any(|file| folder.join(file).canonicalize().is_ok_and(|f| f == study_file));
        other_file == study_file || moved || made_here()
    }
}

/// Whether results of two commands belong into one folder: those of one command (`study` and `study --steps`), and
/// those of commands that go on with a diagnosis where it lies.
pub(super) fn is_same_command(a: &str, b: &str) -> bool {
    const OF_A_DIAGNOSIS: [&str; 3] = ["diagnose", "effect", "plan"];
    let [a, b] = [a, b].map(|command| command.split(' ').next().unwrap_or(command));
    a == b || [a, b].iter().all(|command| OF_A_DIAGNOSIS.contains(command))
}

/// A path in the folder as the manifest writes it.
pub(super) fn name_of(relative: &Path) -> String {
    let parts = relative.components().filter(|part| *part != Component::CurDir);
    parts.map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Files in a message.
pub(super) fn listed(files: &[String]) -> String {
    let named = files.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    match files.len().saturating_sub(NAMED) {
        0 => named,
        rest => format!("{named} and {rest} more"),
    }
}
