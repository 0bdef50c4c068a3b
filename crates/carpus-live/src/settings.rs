//! What is asked for.

use std::path::{Path, PathBuf};

use carpus_session::diagnostic::{Diagnostic, Failure};

/// The program whose commands are the steps.
#[derive(Clone, Debug)]
pub struct Program {
    /// Its file.
    pub file: PathBuf,
    /// Threads of a command; `None`: one per core.
    pub threads: Option<usize>,
}

/// A study that is worked on in a browser.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The study.toml, or the folder it is in.
    pub study: PathBuf,
    /// The folder of the steps and the ledger.
    pub out: PathBuf,
    /// The port to listen on; 0: a free one.
    pub port: u16,
    /// Seed of everything random.
    pub seed: u64,
    /// Whether work goes on without components of a model that would change the result and are not supported.
    pub allow_unsupported: bool,
    /// The program.
    pub program: Program,
}

impl Settings {
    /// The study as commands name it.
    ///
    /// # Errors
    /// Its path is no text.
    pub(crate) fn study_word(&self) -> Result<String, Failure> {
        word(&self.study)
    }

    /// A file or folder among the steps as commands name it.
    ///
    /// - `inside`: its path in the folder of the steps, with slashes
    ///
    /// # Errors
    /// The folder's path is no text.
    pub(crate) fn out_word(&self, inside: &str) -> Result<String, Failure> {
        word(&inside.split('/').fold(self.out.clone(), |path, part| path.join(part)))
    }
}

/// A path as a word of a command. A path that begins with a dash would be taken for an option.
fn word(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().ok_or_else(|| Diagnostic::error("expected a path in UTF-8").in_file(path))?;
    Ok(if text.starts_with('-') { format!("./{text}") } else { text.to_owned() })
}
