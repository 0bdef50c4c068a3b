//! The folder that a command writes into, and what says who made the files in it.

mod manifest;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::diagnostic::{Diagnostic, Failure};
use super::provenance::{Hashed, hash_of};
use carpus_numerics::printable::{deceptive_in, number_of, visible_json};
use manifest::{Made, Manifest, is_same_command, name_of};

/// The file that says who made the others.
const MANIFEST: &str = "carpus-output.json";
/// Stands for the command in the manifest where a run ended early: the next run of any command removes what it does not
/// write.
const UNFINISHED: &str = "unfinished run";
/// Files that a message names before it counts the rest.
const NAMED: usize = 5;
/// Foreign files that are looked for: more are not counted.
const MOST_FOREIGN: usize = 1000;
/// Files that file managers put into folders, besides those whose names begin with a dot.
const OF_THE_SYSTEM: [&str; 2] = ["Thumbs.db", "desktop.ini"];

/// A folder that was found to be writable before anything was computed. Files appear in it whole or not at all.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Files that must not be overwritten, as canonical paths.
    inputs: Vec<PathBuf>,
    /// Whose results these are, and what lay here before; `None` for a file that is asked for by its own name.
    claim: Option<Manifest>,
    /// What the results are made from, where that is no study.
    source: Option<PathBuf>,
    /// Hash of every file that was written, by its path in the folder.
    written: Mutex<BTreeMap<String, String>>,
    /// Files of earlier runs that are of this one, too, by their paths.
    kept: Mutex<BTreeSet<String>>,
    /// Whether the manifest is written.
    closed: AtomicBool,
    /// Whether the folder says that a run has begun to write into it.
    begun: AtomicBool,
    /// Whether results of no study take the place of files that are not of this program.
    overwrites: bool,
}

/// What becomes of files of an earlier run that are not of this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftovers {
    /// They are removed.
    Remove,
    /// They stay, as OpenSim's tools leave them, and are named.
    Name,
}

/// Paths as they are shown.
pub fn shown(files: &[PathBuf]) -> Vec<String> {
    files.iter().map(|file| file.display().to_string()).collect()
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

    /// Fails if the folder holds what is not of this command, of which a person could not tell the results apart:
    /// results of another command; or, where no manifest says who made what, any files. An empty folder, one with
    /// nothing but inputs, and one with earlier results of the command are fine.
    ///
    /// - `command`: its name
    ///
    /// # Errors
    /// It does.
    pub fn only_of(self, command: &str) -> Result<OutputFolder, Failure> {
        let refused = |text: String| {
            let hint = "choose another folder with --out, or empty this one; beside each other they would be mixed up";
            Failure::from(Diagnostic::error(text).in_file(&self.path).hint(hint))
        };
        let Some(known) = Manifest::read(&self.path.join(MANIFEST)) else {
            let foreign = self.foreign_files();
            let [_, ..] = foreign.as_slice() else { return Ok(self) };
            let text = format!("holds files that are not of {command}: {}", listed(&foreign));
            return Err(refused(text));
        };
        if let Some(other) = known.begun.as_deref().filter(|other| !is_same_command(other, command)) {
            return Err(refused(format!("holds what a run of {other} left that did not end; this is {command}")));
        }
        let is_other = |(file, made): &(&String, &Made)| {
            made.command != UNFINISHED && !is_same_command(&made.command, command) && self.path.join(file).exists()
        };
        let others: Vec<(&String, &Made)> = known.files.iter().filter(is_other).collect();
        let Some((_, first)) = others.first() else { return Ok(self) };
        let of_first: Vec<String> =
            others.iter().filter(|(_, made)| made.command == first.command).map(|(file, _)| (*file).clone()).collect();
        Err(refused(format!("holds results of {}, not of {command}: {}", first.command, listed(&of_first))))
    }

    /// Files in the folder, by their paths in it, that are neither inputs nor what the system puts there; those of a
    /// folder that has a manifest of its own are known.
    fn foreign_files(&self) -> Vec<String> {
        let (mut found, mut folders) = (Vec::new(), vec![self.path.clone()]);
        while let Some(folder) = folders.pop().filter(|_| found.len() <= MOST_FOREIGN) {
            for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
                let (path, name) = (entry.path(), entry.file_name());
                let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
                let is_hidden = name.to_string_lossy().starts_with('.') || OF_THE_SYSTEM.iter().any(|n| *n == name);
                if is_folder && !path.join(MANIFEST).exists() && !is_hidden {
                    folders.push(path);
                } else if !is_folder && !is_hidden && self.refuse_input(&path).is_ok() {
                    found.push(name_of(path.strip_prefix(&self.path).unwrap_or(&path)));
                }
            }
        }
        found.sort();
        found
    }

    /// Takes the folder for the results of a study.
    ///
    /// - `command`: the command that makes them
    ///
    /// # Errors
    /// It holds those of another study, or what is not of this command ([`OutputFolder::only_of`]).
    pub fn claimed_for(self, name: &str, study_file: &Path, command: &str) -> Result<OutputFolder, Failure> {
        let study_file = study_file.canonicalize().unwrap_or_else(|_| study_file.to_owned());
        let mut known = Manifest::read(&self.path.join(MANIFEST)).unwrap_or_else(Manifest::new);
        let is_there = |(file, made): (&String, &Made)| made.source.is_none() && self.path.join(file).exists();
        let is_held = known.files.iter().any(is_there);
        if let (Some(other), Some(other_file), true) = (&known.study, &known.study_file, is_held) {
            if !known.is_of(other, other_file, name, &study_file, &self.path) {
                let text = format!("holds results of another study, `{other}` ({})", other_file.display());
                let hint =
                    "choose another folder with --out, or delete this one; beside each other they would be mixed up";
                return Err(Diagnostic::error(text).in_file(&self.path).hint(hint).into());
            }
        } else {
            known.files.retain(|_, made| made.source.is_some());
            (known.study, known.study_file) = (Some(name.to_owned()), Some(study_file));
        }
        let mut own = self.only_of(command)?;
        known.begun = Some(command.to_owned());
        own.claim = Some(known);
        Ok(own)
    }

    /// Takes the folder for results that are of no study. What else is in it stays, and is not overwritten if it is not
    /// of this program.
    ///
    /// - `source`: the file that the results are made from
    pub fn with_results_of(mut self, source: &Path) -> OutputFolder {
        self.claim = Some(Manifest::read(&self.path.join(MANIFEST)).unwrap_or_else(Manifest::new));
        self.source = Some(source.canonicalize().unwrap_or_else(|_| source.to_owned()));
        self
    }

    /// As [`OutputFolder::with_results_of`]; files of the same names are overwritten whoever made them: as OpenSim's
    /// tools do, or because the folder is given to be changed.
    pub fn overwriting_with_results_of(self, source: &Path) -> OutputFolder {
        let mut out = self.with_results_of(source);
        out.overwrites = true;
        out
    }

    /// The folder of an earlier run in which `folder` lies, and the way from there to `folder`: the nearest whose
    /// manifest has a file of this name in `folder`. Without one, `folder` itself.
    ///
    /// # Errors
    /// As [`OutputFolder::create`].
    pub fn of_earlier_run(folder: &Path, name: &str) -> Result<(OutputFolder, PathBuf), Failure> {
        let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let held = whole.ancestors().find_map(|root| {
            let inside = whole.strip_prefix(root).ok()?;
            let manifest = Manifest::read(&root.join(MANIFEST))?;
            manifest.files.contains_key(&name_of(&inside.join(name))).then(|| (root, inside.to_owned(), manifest))
        });
        Ok(match held {
            Some((root, inside, manifest)) => {
                // As the user wrote it, if that leads there.
                let shown = folder.ancestors().nth(inside.components().count());
                let shown = shown.filter(|shown| shown.canonicalize().is_ok_and(|path| path == root)).unwrap_or(root);
                let mut out = OutputFolder::create(shown, &[])?;
                out.claim = Some(manifest);
                (out, inside)
            }
            // The folder is given to be changed.
            None => {
                let out = OutputFolder::create(folder, &[])?.overwriting_with_results_of(&whole.join(name));
                (out, PathBuf::new())
            }
        })
    }

    /// Ends a run that changed files of an earlier one: the manifest has them as they are now, each under the command
    /// that made it first. What is no longer there is not in it either.
    ///
    /// # Errors
    /// The disk.
    pub fn close_changed(&self, command: &str) -> Result<(), Failure> {
        let Some(mut manifest) = self.claim.clone() else { return Ok(()) };
        manifest.files.retain(|file, _| self.path.join(file).exists());
        for (file, sha256) in lock(&self.written).iter() {
            let made = self.made(command, sha256);
            manifest.files.entry(file.clone()).or_insert(made).sha256.clone_from(sha256);
        }
        self.put_manifest(&manifest)?;
        self.closed.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// Ends a run: removes what earlier runs of the command left that is not of this one, and says in the folder who
    /// made what. What was changed by hand is never removed. Returns what a person should know.
    ///
    /// - `command`: the command's name
    /// - `others`: participants of the study that the run was not about; what is theirs stays
    ///
    /// # Errors
    /// The disk.
    pub fn close(&self, command: &str, others: &[&str]) -> Result<Vec<Diagnostic>, Failure> {
        self.close_with(command, others, Leftovers::Remove)
    }

    /// As [`OutputFolder::close`], with a choice of what becomes of files of earlier runs from the same source.
    ///
    /// # Errors
    /// As there.
    pub fn close_with(&self, command: &str, others: &[&str], leftovers: Leftovers) -> Result<Vec<Diagnostic>, Failure> {
        let Some(mut manifest) = self.claim.clone() else { return Ok(Vec::new()) };
        if self.source.is_some() {
            // Runs from other sources may have ended meanwhile.
            manifest = Manifest::read(&self.path.join(MANIFEST)).unwrap_or(manifest);
        }
        let written = lock(&self.written);
        let kept = lock(&self.kept);
        let of_others = |file: &str| {
            let mut parts = file.split('/').map(|part| part.strip_suffix(".html").unwrap_or(part));
            parts.any(|part| others.contains(&part))
        };
        let is_left = |file: &String, made: &Made| {
            [command, UNFINISHED].contains(&made.command.as_str())
                && made.source == self.source
                && !written.contains_key(file)
                && !kept.contains(file)
                && !of_others(file)
        };
        let left: Vec<(String, Made)> = manifest
            .files
            .iter()
            .filter(|(file, made)| is_left(file, made))
            .map(|(f, m)| (f.clone(), m.clone()))
            .collect();
        let (mut removed, mut changed, mut named) = (Vec::new(), Vec::new(), Vec::new());
        for (file, made) in left {
            if leftovers == Leftovers::Name && self.path.join(&file).exists() {
                named.push(file);
                continue;
            }
            manifest.files.remove(&file);
            match self.removes(&file, &made.sha256)? {
                Some(true) => removed.push(file),
                Some(false) => changed.push(file),
                None => {}
            }
        }
        self.write_manifest(manifest, command, &written)?;
        self.closed.store(true, Ordering::Relaxed);
        let mut messages = Vec::new();
        if !removed.is_empty() {
            let text = format!("removed what an earlier run of {command} had left here: {}", listed(&removed));
            messages.push(Diagnostic::warning(text).in_file(&self.path));
        }
        if !changed.is_empty() {
            let text =
                format!("of an earlier run of {command}, changed since then and left here: {}", listed(&changed));
            messages.push(Diagnostic::warning(text).in_file(&self.path).hint("these files are not of this run"));
        }
        if !named.is_empty() {
            let text = format!("of an earlier run of {command} with this file, left here: {}", listed(&named));
            messages.push(Diagnostic::warning(text).in_file(&self.path).hint("these files are not of this run"));
        }
        Ok(messages)
    }

    /// Says in the folder who made what.
    fn write_manifest(
        &self,
        mut manifest: Manifest,
        command: &str,
        written: &BTreeMap<String, String>,
    ) -> Result<(), Failure> {
        for (file, sha256) in written {
            manifest.files.insert(file.clone(), self.made(command, sha256));
        }
        self.put_manifest(&manifest)
    }

    fn made(&self, command: &str, sha256: &str) -> Made {
        Made { command: command.to_owned(), source: self.source.clone(), sha256: sha256.to_owned() }
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

    fn put_manifest(&self, manifest: &Manifest) -> Result<(), Failure> {
        self.put_manifest_as(&Manifest { begun: None, ..manifest.clone() })
    }

    fn put_manifest_as(&self, manifest: &Manifest) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(manifest).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        self.put(MANIFEST.as_ref(), text.as_bytes()).map(|_| ())
    }

    /// Removes a file of an earlier run with the folders that it leaves empty. Whether it was; `None` if it is not
    /// there.
    fn removes(&self, file: &str, sha256: &str) -> Result<Option<bool>, Failure> {
        let path = self.path.join(file);
        // A manifest may be anybody's: nothing but plain files below this folder is touched.
        let is_below = Path::new(file).components().all(|part| matches!(part, Component::Normal(_)));
        let root = self.path.canonicalize().ok();
        let parent = path.parent().and_then(|folder| folder.canonicalize().ok());
        let is_here = root.zip(parent).is_some_and(|(root, parent)| parent.starts_with(root));
        let is_file = path.symlink_metadata().is_ok_and(|data| data.is_file());
        if !(is_below && is_here && is_file) {
            return Ok(None);
        }
        let unreadable =
            |error: std::io::Error| Diagnostic::error(format!("cannot be removed: {}", reason(&error))).in_file(&path);
        if hash_of(&carpus_numerics::regular_file::read(&path).map_err(unreadable)?) != sha256
            || self.refuse_input(&path).is_err()
        {
            return Ok(Some(false));
        }
        std::fs::remove_file(&path).map_err(unreadable)?;
        let mut folder = path.parent();
        while let Some(empty) = folder.filter(|folder| *folder != self.path && std::fs::remove_dir(folder).is_ok()) {
            folder = empty.parent();
        }
        Ok(Some(true))
    }

    /// Says that files of an earlier run are of this one, too: a file, or all below a folder of which nothing was
    /// written.
    pub fn keep(&self, relative: impl AsRef<Path>) {
        let relative = name_of(relative.as_ref());
        let below = |file: &str| file == relative || file.strip_prefix(&relative).is_some_and(|r| r.starts_with('/'));
        if lock(&self.written).keys().any(|file| below(file)) {
            return;
        }
        let files = self.claim.iter().flat_map(|manifest| manifest.files.keys());
        lock(&self.kept).extend(files.filter(|file| below(file)).cloned());
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

impl Drop for OutputFolder {
    /// A run that ends early says, too, what it wrote.
    fn drop(&mut self) {
        let written = std::mem::take(&mut *lock(&self.written));
        if let Some(manifest) =
            self.claim.take().filter(|_| !written.is_empty() && !self.closed.load(Ordering::Relaxed))
        {
            // The run has failed already, and its own reason is what a person needs to know.
            let _ = self.write_manifest(manifest, UNFINISHED, &written);
        }
    }
}

fn listed(files: &[String]) -> String {
    let named = files.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    match files.len().saturating_sub(NAMED) {
        0 => named,
        rest => format!("{named} and {rest} more"),
    }
}

/// A lock whose holder panicked holds whole values all the same.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
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
fn reason(error: &std::io::Error) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_inputs_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.osim");
        std::fs::write(&model, "mine").unwrap();
        let out = OutputFolder::create(folder.path(), std::slice::from_ref(&model)).unwrap();
        assert!(matches!(out.write("model.osim", b"theirs"), Err(Failure::Input(_))));
        assert_eq!(std::fs::read_to_string(&model).unwrap(), "mine");
        out.write("results.json", "{\"model\": \"a\u{202e}b\"}".as_bytes()).unwrap();
        let json = std::fs::read_to_string(folder.path().join("results.json")).unwrap();
        assert_eq!(json, "{\"model\": \"a\\u202eb\"}", "what is not shown is written out");
        std::fs::remove_file(folder.path().join("results.json")).unwrap();
        out.write("a/b/other.txt", b"text").unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("a/b/other.txt")).unwrap(), "text");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "no temporary file stays behind");
    }

    /// A run of a command that writes these files.
    fn run(folder: &Path, study: &Path, command: &str, others: &[&str], files: &[&str]) -> Vec<Diagnostic> {
        let out = OutputFolder::create(folder, &[]).unwrap().claimed_for("s", study, command).unwrap();
        files.iter().for_each(|file| drop(out.write(file, file.as_bytes()).unwrap()));
        out.close(command, others).unwrap()
    }

    #[test]
    fn verif_a_run_leaves_nothing_of_the_run_before_that_is_not_its_own() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let there = |file: &str| folder.join(file).exists();
        let first = ["P01/series/a.csv", "P01/series/b/c.csv", "P01/mine.osim", "P02/series/a.csv", "all.csv"];
        assert!(run(&folder, &study, "simulate", &[], &first).is_empty());
        std::fs::write(folder.join("P01/mine.osim"), "changed by hand").unwrap();
        std::fs::write(folder.join("P01/notes.txt"), "not of this program").unwrap();
        let said = run(&folder, &study, "simulate", &["P02"], &["P01/series/a.csv"]);
        assert_eq!(said.len(), 2);
        assert!(said[0].text.contains("P01/series/b/c.csv") && said[0].text.contains("all.csv"), "{}", said[0].text);
        assert!(said[1].text.contains("P01/mine.osim"), "{}", said[1].text);
        assert!(!there("P01/series/b") && !there("all.csv"), "folders left empty go, too");
        for kept in ["P01/series/a.csv", "P01/mine.osim", "P01/notes.txt", "P02/series/a.csv"] {
            assert!(there(kept), "{kept}");
        }
        assert!(run(&folder, &study, "simulate", &[], &["P01/series/a.csv"])[0].text.contains("P02/series/a.csv"));
    }

    #[test]
    fn verif_what_a_run_that_failed_left_goes_with_the_next() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let out = OutputFolder::create(&folder, &[]).unwrap().claimed_for("s", &study, "simulate").unwrap();
        out.write("P01/a.csv", b"a").unwrap();
        drop(out);
        assert_eq!(run(&folder, &study, "simulate", &[], &["P01/b.csv"]).len(), 1);
        assert!(!folder.join("P01/a.csv").exists() && folder.join("P01/b.csv").exists());
    }

    #[test]
    fn verif_a_folder_with_results_of_another_study_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let [one, other] = ["one.toml", "other.toml"].map(|name| place.path().join(name));
        std::fs::write(&one, "").unwrap();
        std::fs::write(&other, "").unwrap();
        run(&folder, &one, "simulate", &[], &["a.csv", "study.toml"]);
        let claim =
            |name: &str, study: &Path| OutputFolder::create(&folder, &[]).unwrap().claimed_for(name, study, "simulate");
        assert!(matches!(claim("s", &other), Err(Failure::Input(m)) if m[0].text.contains("another study")));
        assert!(claim("s", &folder.join("study.toml")).is_ok(), "a study that was made here");
        std::fs::remove_file(&one).unwrap();
        assert!(claim("s", &other).is_ok(), "the study was moved");
        assert!(claim("t", &other).is_err());
        std::fs::remove_file(folder.join("a.csv")).unwrap();
        std::fs::remove_file(folder.join("study.toml")).unwrap();
        assert!(claim("t", &other).is_ok(), "nothing is left of it");
    }

    /// A run of a command that makes these files from a source.
    fn run_from(folder: &Path, source: &Path, command: &str, files: &[&str], leftovers: Leftovers) -> Vec<Diagnostic> {
        let out = OutputFolder::create(folder, &[]).unwrap().with_results_of(source);
        files.iter().for_each(|file| drop(out.write(file, file.as_bytes()).unwrap()));
        out.close_with(command, &[], leftovers).unwrap()
    }

    #[test]
    fn verif_results_of_no_study_say_what_they_are_made_from() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        let [a, b] = ["a.c3d", "b.c3d"].map(|name| place.path().join(name));
        [&study, &a, &b].into_iter().for_each(|file| std::fs::write(file, "").unwrap());
        let there = |file: &str| folder.join(file).exists();
        run_from(&folder, &a, "c3d", &["a.trc", "a.csv"], Leftovers::Remove);
        run_from(&folder, &b, "c3d", &["b.trc"], Leftovers::Remove);
        assert!(there("a.trc") && there("a.csv"), "what is made from another file stays");
        let said = run_from(&folder, &a, "c3d", &["a.trc"], Leftovers::Remove);
        assert!(said.len() == 1 && said[0].text.contains("a.csv") && !there("a.csv"), "{said:?}");
        let manifest = Manifest::read(&folder.join(MANIFEST)).unwrap();
        assert_eq!(manifest.files.keys().collect::<Vec<_>>(), ["a.trc", "b.trc"]);
        assert_eq!(manifest.files["b.trc"].source.as_deref(), b.canonicalize().ok().as_deref());
        // OpenSim's tools leave what is there; it is said.
        run_from(&folder, &a, "run-tool", &["x.sto", "y.sto"], Leftovers::Name);
        let said = run_from(&folder, &a, "run-tool", &["x.sto"], Leftovers::Name);
        assert!(said.len() == 1 && said[0].text.contains("left here: y.sto") && there("y.sto"), "{said:?}");
        // What is there and is not of this program stays, unless the tool is one of OpenSim's.
        std::fs::write(folder.join("b.csv"), "mine").unwrap();
        let out = OutputFolder::create(&folder, &[]).unwrap().with_results_of(&b);
        assert!(matches!(out.write("b.csv", b""), Err(Failure::Input(m)) if m[0].text.contains("did not make")));
        assert_eq!(std::fs::read_to_string(folder.join("b.csv")).unwrap(), "mine");
        OutputFolder::create(&folder, &[]).unwrap().overwriting_with_results_of(&b).write("b.csv", b"").unwrap();
        // A study does not take the folder, and its own results are not overwritten by such.
        let taken = OutputFolder::create(&folder, &[]).unwrap().claimed_for("s", &study, "simulate");
        assert!(matches!(taken, Err(Failure::Input(m)) if m[0].text.contains("holds results of c3d")));
        let folder = place.path().join("of_study");
        run(&folder, &study, "simulate", &[], &["all.csv"]);
        let out = OutputFolder::create(&folder, &[]).unwrap().with_results_of(&a);
        assert!(matches!(out.write("all.csv", b""), Err(Failure::Input(m)) if m[0].text.contains("of study `s`")));
    }

    #[test]
    fn verif_a_folder_with_what_is_not_of_the_command_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let claim = |folder: &Path, command: &str| {
            let inputs = [folder.join("study.toml")];
            OutputFolder::create(folder, &inputs).unwrap().claimed_for("s", &study, command).map_err(|e| match e {
                Failure::Input(messages) => messages[0].text.clone(),
                other => format!("{other:?}"),
            })
        };
        run(&folder, &study, "study --steps", &[], &["P01/models/a.osim", "all.csv"]);
        let said = claim(&folder, "compare").unwrap_err();
        assert_eq!(said, "holds results of study --steps, not of compare: P01/models/a.osim, all.csv");
        assert!(claim(&folder, "study").is_ok(), "the same command with other words");
        let diagnosed = place.path().join("diagnosed");
        run(&diagnosed, &study, "diagnose", &[], &["P01/diagnosis.json"]);
        assert!(claim(&diagnosed, "effect").is_ok() && claim(&diagnosed, "plan --effect").is_ok());
        assert!(claim(&diagnosed, "personalize").is_err());
        // Files of another hand; but not what is read, what the system puts there, or a folder that says itself what it
        // holds.
        let foreign = place.path().join("foreign");
        std::fs::create_dir_all(foreign.join("deep/processed")).unwrap();
        run(&foreign.join("deep/processed"), &study, "dynamometer", &[], &["study.toml"]);
        for file in ["study.toml", ".DS_Store", "desktop.ini"] {
            std::fs::write(foreign.join(file), "").unwrap();
        }
        assert!(claim(&foreign, "compare").is_ok());
        std::fs::write(foreign.join("deep/old.csv"), "").unwrap();
        assert_eq!(claim(&foreign, "compare").unwrap_err(), "holds files that are not of compare: deep/old.csv");
        // A run that was killed could not say what it wrote, but did say who it was.
        let killed = place.path().join("killed");
        let out = claim(&killed, "personalize").unwrap();
        out.write("P01/model.osim", b"half").unwrap();
        std::mem::forget(out);
        assert!(claim(&killed, "personalize").is_ok());
        assert!(claim(&killed, "compare").unwrap_err().contains("a run of personalize left that did not end"));
        run(&killed, &study, "personalize", &[], &["P01/model.osim"]);
        assert!(Manifest::read(&killed.join(MANIFEST)).unwrap().begun.is_none());
    }

    #[test]
    fn verif_a_manifest_knows_what_a_later_command_changed() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        run(&folder, &study, "effect", &[], &["P01/results.json", "P01/model.osim", "P01/effects.toml"]);
        let (out, inside) = OutputFolder::of_earlier_run(&folder.join("P01"), "results.json").unwrap();
        assert_eq!((out.path(), inside.as_path()), (folder.as_path(), Path::new("P01")));
        out.write(inside.join("model.osim"), b"another").unwrap();
        std::fs::remove_file(folder.join("P01/effects.toml")).unwrap();
        out.close_changed("effect remove").unwrap();
        drop(out);
        let manifest = Manifest::read(&folder.join(MANIFEST)).unwrap();
        assert_eq!(manifest.files.keys().collect::<Vec<_>>(), ["P01/model.osim", "P01/results.json"]);
        assert_eq!(manifest.files["P01/model.osim"].sha256, hash_of(b"another"));
        // So that the next run knows it as this program's.
        let said = run(&folder, &study, "effect", &[], &["P01/results.json"]);
        assert!(said.len() == 1 && said[0].text.contains("removed"), "{said:?}");
        assert!(!folder.join("P01/model.osim").exists());
    }

    #[test]
    fn verif_a_manifest_cannot_name_files_elsewhere() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "mine").unwrap();
        run(&folder, &study, "simulate", &[], &["a.csv"]);
        let file = folder.join(MANIFEST);
        let manifest = std::fs::read_to_string(&file).unwrap();
        let hostile =
            manifest.replace("\"a.csv\": {", "\"../study.toml\": {").replace(&hash_of(b"a.csv"), &hash_of(b"mine"));
        assert_ne!(manifest, hostile);
        std::fs::write(&file, hostile).unwrap();
        assert!(run(&folder, &study, "simulate", &[], &["b.csv"]).is_empty());
        assert_eq!(std::fs::read_to_string(&study).unwrap(), "mine");
    }

    #[test]
    fn verif_a_file_in_place_of_the_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("results");
        std::fs::write(&file, "").unwrap();
        assert!(matches!(OutputFolder::create(&file, &[]), Err(Failure::Input(_))));
        assert!(matches!(OutputFolder::create(&file.join("below"), &[]), Err(Failure::Input(_))));
    }
}
