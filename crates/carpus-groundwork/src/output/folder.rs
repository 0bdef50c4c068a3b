//! A folder of results, and how files come into it.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::manifest::{MANIFEST, Manifest, name_of};
use crate::diagnostic::{Diagnostic, Failure};
use crate::provenance::Hashed;
use carpus_numerics::printable::{deceptive_in, number_of, visible_json};

/// A folder that was found to be writable before anything was computed. Files appear in it whole or not at all.
#[derive(Debug)]
pub struct OutputFolder {
    pub(super) path: PathBuf,
    /// Files that must not be overwritten, as canonical paths.
    pub(super) inputs: Vec<PathBuf>,
    /// Whose results these are, and what lay here before; `None` for a file that is asked for by its own name.
    pub(super) claim: Option<Manifest>,
    /// What the results are made from, where that is no study.
    pub(super) source: Option<PathBuf>,
    /// Hash of every file that was written, by its path in the folder.
    pub(super) written: Mutex<BTreeMap<String, String>>,
    /// Files of earlier runs that are of this one, too, by their paths.
    pub(super) kept: Mutex<BTreeSet<String>>,
    /// Whether the manifest is written.
    pub(super) closed: AtomicBool,
    /// Whether the folder says that a run has begun to write into it.
    pub(super) begun: AtomicBool,
    /// Whether results of no study take the place of files that are not of this program.
    pub(super) overwrites: bool,
}

impl OutputFolder {
    /// Makes the folder if it is missing and tries to write into it.
    ///
    /// - `inputs`: files that were or will be read; writing over one of them is refused
    ///
    /// # Errors
    /// The folder cannot be made or written to.
    pub fn create(path: &Path, inputs: &[PathBuf]) -> Result<OutputFolder, Failure> {
        let unwritable = |error: std::io::Error| {
            Diagnostic::error(format!("cannot write results here: {}", reason(&error)))
                .in_file(path)
                .hint("choose another folder with --out, or change its permissions")
        };
        std::fs::create_dir_all(path).map_err(unwritable)?;
        tempfile::Builder::new().prefix(".carpus-").tempfile_in(path).map_err(unwritable)?;
        let inputs = inputs.iter().filter_map(|file| file.canonicalize().ok()).collect();
        let (written, kept, closed, begun) = Default::default();
        let (path, claim, source, overwrites) = (path.to_owned(), None, None, false);
        Ok(OutputFolder { path, inputs, claim, source, written, kept, closed, begun, overwrites })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file, by way of a temporary one, making the folders above it.
    ///
    /// # Errors
    /// The disk; or the file is one of the inputs.
    pub fn write(&self, relative: impl AsRef<Path>, bytes: &[u8]) -> Result<PathBuf, Failure> {
        let bytes = as_shown(relative.as_ref(), bytes);
        self.write_with(relative, |file| file.write_all(&bytes))
    }

    /// As [`OutputFolder::write`], of a file that is too long to be held in memory.
    ///
    /// - `content`: writes it
    ///
    /// # Errors
    /// As there.
    pub fn write_with(
        &self,
        relative: impl AsRef<Path>,
        content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<PathBuf, Failure> {
        self.refuse_result_of_study(relative.as_ref())?;
        self.refuse_foreign(relative.as_ref())?;
        let (target, sha256) = self.put_with(relative.as_ref(), content)?;
        if self.claim.is_some() {
            lock(&self.written).insert(name_of(relative.as_ref()), sha256);
        }
        Ok(target)
    }

    /// As [`OutputFolder::write`], of a file that is no result and stays when another run does not write it.
    ///
    /// # Errors
    /// As there.
    pub fn put(&self, relative: &Path, bytes: &[u8]) -> Result<PathBuf, Failure> {
        let bytes = as_shown(relative, bytes);
        self.put_with(relative, |file| file.write_all(&bytes)).map(|(target, _)| target)
    }

    /// Writes a file; its path and hash.
    fn put_with(
        &self,
        relative: &Path,
        content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(PathBuf, String), Failure> {
        if relative != Path::new(MANIFEST) {
            self.begin()?;
        }
        let target = self.path.join(relative);
        if let Some(found) = deceptive_in(&relative.to_string_lossy()) {
            let text =
                format!("the name of this file has the character {}, which does not show as it is", number_of(found));
            return Err(Diagnostic::error(text)
                .in_file(&target)
                .hint("change the name that the file is made from")
                .into());
        }
        self.refuse_input(&target)?;
        let unwritable = |error: std::io::Error| {
            Diagnostic::error(format!("cannot be written: {}", reason(&error))).in_file(&target)
        };
        let folder = target.parent().unwrap_or(&self.path);
        std::fs::create_dir_all(folder).map_err(unwritable)?;
        let mut file = tempfile::Builder::new().prefix(".carpus-").tempfile_in(folder).map_err(unwritable)?;
        let mut hashed = Hashed::new(std::io::BufWriter::new(file.as_file_mut()));
        content(&mut hashed).and_then(|()| hashed.flush()).map_err(unwritable)?;
        let sha256 = hashed.hash();
        allow_reading(file.as_file()).map_err(unwritable)?;
        file.persist(&target).map_err(|e| unwritable(e.error))?;
        Ok((target, sha256))
    }

    /// Says in the folder of a study's results, before the first of them, which command began: a run that is killed
    /// cannot say it any more.
    fn begin(&self) -> Result<(), Failure> {
        match &self.claim {
            Some(manifest) if manifest.begun.is_some() && !self.begun.swap(true, Ordering::Relaxed) => {
                self.put_manifest_as(manifest)
            }
            _ => Ok(()),
        }
    }

    pub(super) fn put_manifest(&self, manifest: &Manifest) -> Result<(), Failure> {
        self.put_manifest_as(&Manifest { begun: None, ..manifest.clone() })
    }

    fn put_manifest_as(&self, manifest: &Manifest) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(manifest).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        self.put(MANIFEST.as_ref(), text.as_bytes()).map(|_| ())
    }

    /// Fails if results that are of no study would take the place of one of a study.
    fn refuse_result_of_study(&self, relative: &Path) -> Result<(), Failure> {
        let (Some(_), Some(manifest)) = (&self.source, &self.claim) else { return Ok(()) };
        let (Some(study), target) = (&manifest.study, self.path.join(relative)) else { return Ok(()) };
        match manifest.files.get(&name_of(relative)).filter(|made| made.source.is_none() && target.exists()) {
            Some(made) => {
                let text = format!("this is a result of {} of study `{study}`; it is not overwritten", made.command);
                Err(Diagnostic::error(text).in_file(&target).hint("choose another folder").into())
            }
            None => Ok(()),
        }
    }

    /// Fails if results that are of no study would take the place of a file that is not of this program.
    fn refuse_foreign(&self, relative: &Path) -> Result<(), Failure> {
        let (Some(_), Some(manifest), false) = (&self.source, &self.claim, self.overwrites) else { return Ok(()) };
        let (name, target) = (name_of(relative), self.path.join(relative));
        let is_known = manifest.files.contains_key(&name) || lock(&self.written).contains_key(&name);
        if is_known || !target.exists() || self.refuse_input(&target).is_err() {
            return Ok(());
        }
        let text = "there is a file of this name that carpus did not make here; it is not overwritten";
        Err(Diagnostic::error(text).in_file(&target).hint("choose another folder with --out, or move the file").into())
    }

    /// Fails if `target` is one of the files that were read.
    pub fn refuse_input(&self, target: &Path) -> Result<(), Failure> {
        match target.canonicalize() {
            Ok(found) if self.inputs.contains(&found) => {
                Err(Diagnostic::error("this is one of the files that are read; it is not overwritten")
                    .in_file(target)
                    .hint("choose another folder (--out) or another name for the result")
                    .into())
            }
            _ => Ok(()),
        }
    }
}

/// A lock whose holder panicked holds whole values all the same.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Temporary files are private to the user; results are not.
#[cfg(unix)]
fn allow_reading(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn allow_reading(_: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

/// The operating system's words without its error number.
pub(super) fn reason(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_lowercase()
}

/// The content of a file; JSON with characters that are not shown as they are written as escapes, which leaves its
/// values.
fn as_shown<'a>(name: &Path, bytes: &'a [u8]) -> Cow<'a, [u8]> {
    let json = name.extension().filter(|e| *e == "json").and_then(|_| std::str::from_utf8(bytes).ok());
    match json.map(visible_json) {
        Some(Cow::Owned(text)) => Cow::Owned(text.into_bytes()),
        _ => Cow::Borrowed(bytes),
    }
}
