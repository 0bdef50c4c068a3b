//! The folder that a command writes into, and what says who made the files in it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};

use super::failure::{Failure, Message};
use super::provenance::hash_of;
use crate::printable::{deceptive_in, number_of};

/// The file that says who made the others.
const MANIFEST: &str = "carpus-output.json";
const SCHEMA: &str = "carpus.output/1";
/// Stands for the command in the manifest where a run ended early: the next run of any command removes what it does not write.
const UNFINISHED: &str = "unfinished run";
/// Files that a message names before it counts the rest.
const NAMED: usize = 5;

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
}

/// Who made the files of a folder.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Manifest {
    schema: String,
    /// The study whose results are here, if any: its name, and its study.toml.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    study: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    study_file: Option<PathBuf>,
    files: BTreeMap<String, Made>,
}

/// One file.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Made {
    command: String,
    /// What it is made from: a model, a setup, a recording; nothing for a result of the study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    source: Option<PathBuf>,
    sha256: String,
}

/// What becomes of files of an earlier run that are not of this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftovers {
    /// They are removed.
    Remove,
    /// They stay, as OpenSim's tools leave them, and are named.
    Name,
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
            Message::error(format!("cannot write results here: {}", reason(&error)))
                .in_file(path)
                .hint("choose another folder with --out, or change its permissions")
        };
        std::fs::create_dir_all(path).map_err(unwritable)?;
        tempfile::Builder::new().prefix(".carpus-").tempfile_in(path).map_err(unwritable)?;
        let inputs = inputs.iter().filter_map(|file| file.canonicalize().ok()).collect();
        let (written, kept, closed) = Default::default();
        Ok(OutputFolder { path: path.to_owned(), inputs, claim: None, source: None, written, kept, closed })
    }

    /// Takes the folder for the results of a study.
    ///
    /// # Errors
    /// It holds those of another study.
    pub fn claimed_for(mut self, name: &str, study_file: &Path) -> Result<OutputFolder, Failure> {
        let study_file = study_file.canonicalize().unwrap_or_else(|_| study_file.to_owned());
        let mut known = Manifest::read(&self.path.join(MANIFEST)).unwrap_or_else(Manifest::new);
        let is_there = |(file, made): (&String, &Made)| made.source.is_none() && self.path.join(file).exists();
        let is_held = known.files.iter().any(is_there);
        if let (Some(other), Some(other_file), true) = (&known.study, &known.study_file, is_held) {
            if !known.is_of(other, other_file, name, &study_file, &self.path) {
                let text = format!("holds results of another study, `{other}` ({})", other_file.display());
                let hint =
                    "choose another folder with --out, or delete this one; beside each other they would be mixed up";
                return Err(Message::error(text).in_file(&self.path).hint(hint).into());
            }
        } else {
            known.files.retain(|_, made| made.source.is_some());
            (known.study, known.study_file) = (Some(name.to_owned()), Some(study_file));
        }
        self.claim = Some(known);
        Ok(self)
    }

    /// Takes the folder for results that are of no study. What else is in it stays.
    ///
    /// - `source`: the file that the results are made from
    pub fn with_results_of(mut self, source: &Path) -> OutputFolder {
        self.claim = Some(Manifest::read(&self.path.join(MANIFEST)).unwrap_or_else(Manifest::new));
        self.source = Some(source.canonicalize().unwrap_or_else(|_| source.to_owned()));
        self
    }

    /// The folder of an earlier run in which `folder` lies, and the way from there to `folder`: the nearest whose manifest has a
    /// file of this name in `folder`. Without one, `folder` itself.
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
            None => (OutputFolder::create(folder, &[])?.with_results_of(&whole.join(name)), PathBuf::new()),
        })
    }

    /// Ends a run that changed files of an earlier one: the manifest has them as they are now, each under the command that made
    /// it first. What is no longer there is not in it either.
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

    /// Ends a run: removes what earlier runs of the command left that is not of this one, and says in the folder who made what.
    /// What was changed by hand is never removed. Returns what a person should know.
    ///
    /// - `command`: the command's name
    /// - `others`: participants of the study that the run was not about; what is theirs stays
    ///
    /// # Errors
    /// The disk.
    pub fn close(&self, command: &str, others: &[&str]) -> Result<Vec<Message>, Failure> {
        self.close_with(command, others, Leftovers::Remove)
    }

    /// As [`OutputFolder::close`], with a choice of what becomes of files of earlier runs from the same source.
    ///
    /// # Errors
    /// As there.
    pub fn close_with(&self, command: &str, others: &[&str], leftovers: Leftovers) -> Result<Vec<Message>, Failure> {
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
            messages.push(Message::warning(text).in_file(&self.path));
        }
        if !changed.is_empty() {
            let text =
                format!("of an earlier run of {command}, changed since then and left here: {}", listed(&changed));
            messages.push(Message::warning(text).in_file(&self.path).hint("these files are not of this run"));
        }
        if !named.is_empty() {
            let text = format!("of an earlier run of {command} with this file, left here: {}", listed(&named));
            messages.push(Message::warning(text).in_file(&self.path).hint("these files are not of this run"));
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

    fn put_manifest(&self, manifest: &Manifest) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(manifest).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        self.put(MANIFEST.as_ref(), text.as_bytes()).map(|_| ())
    }

    /// Removes a file of an earlier run with the folders that it leaves empty. Whether it was; `None` if it is not there.
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
            |error: std::io::Error| Message::error(format!("cannot be removed: {}", reason(&error))).in_file(&path);
        if hash_of(&std::fs::read(&path).map_err(unreadable)?) != sha256 || self.refuse_input(&path).is_err() {
            return Ok(Some(false));
        }
        std::fs::remove_file(&path).map_err(unreadable)?;
        let mut folder = path.parent();
        while let Some(empty) = folder.filter(|folder| *folder != self.path && std::fs::remove_dir(folder).is_ok()) {
            folder = empty.parent();
        }
        Ok(Some(true))
    }

    /// Says that files of an earlier run are of this one, too: a file, or all below a folder of which nothing was written.
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
        self.refuse_result_of_study(relative.as_ref())?;
        let target = self.put(relative.as_ref(), bytes)?;
        if self.claim.is_some() {
            lock(&self.written).insert(name_of(relative.as_ref()), hash_of(bytes));
        }
        Ok(target)
    }

    /// As [`OutputFolder::write`], of a file that is no result and stays when another run does not write it.
    ///
    /// # Errors
    /// As there.
    pub fn put(&self, relative: &Path, bytes: &[u8]) -> Result<PathBuf, Failure> {
        let target = self.path.join(relative);
        if let Some(found) = deceptive_in(&relative.to_string_lossy()) {
            let text =
                format!("the name of this file has the character {}, which does not show as it is", number_of(found));
            return Err(Message::error(text)
                .in_file(&target)
                .hint("change the name that the file is made from")
                .into());
        }
        self.refuse_input(&target)?;
        let unwritable =
            |error: std::io::Error| Message::error(format!("cannot be written: {}", reason(&error))).in_file(&target);
        let folder = target.parent().unwrap_or(&self.path);
        std::fs::create_dir_all(folder).map_err(unwritable)?;
        let mut file = tempfile::Builder::new().prefix(".carpus-").tempfile_in(folder).map_err(unwritable)?;
        file.write_all(bytes).map_err(unwritable)?;
        allow_reading(file.as_file()).map_err(unwritable)?;
        file.persist(&target).map_err(|e| unwritable(e.error))?;
        Ok(target)
    }

    /// Fails if results that are of no study would take the place of one of a study.
    fn refuse_result_of_study(&self, relative: &Path) -> Result<(), Failure> {
        let (Some(_), Some(manifest)) = (&self.source, &self.claim) else { return Ok(()) };
        let (Some(study), target) = (&manifest.study, self.path.join(relative)) else { return Ok(()) };
        match manifest.files.get(&name_of(relative)).filter(|made| made.source.is_none() && target.exists()) {
            Some(made) => {
                let text = format!("this is a result of {} of study `{study}`; it is not overwritten", made.command);
                Err(Message::error(text).in_file(&target).hint("choose another folder").into())
            }
            None => Ok(()),
        }
    }

    /// Fails if `target` is one of the files that were read.
    pub fn refuse_input(&self, target: &Path) -> Result<(), Failure> {
        match target.canonicalize() {
            Ok(found) if self.inputs.contains(&found) => {
                Err(Message::error("this is one of the files that are read; it is not overwritten")
                    .in_file(target)
                    .hint("choose another folder with --out")
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

impl Manifest {
    /// The manifest of a folder; `None` if there is none that can be read.
    fn read(file: &Path) -> Option<Manifest> {
        let manifest: Manifest = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
        (manifest.schema == SCHEMA).then_some(manifest)
    }

    /// One of a folder of which nothing is known.
    fn new() -> Manifest {
        Manifest { schema: SCHEMA.to_owned(), study: None, study_file: None, files: BTreeMap::new() }
    }

    /// Whether results of `other` are of this study: the same study.toml, the same study that was moved, or one that was made
    /// here.
    fn is_of(&self, other: &str, other_file: &Path, name: &str, study_file: &Path, folder: &Path) -> bool {
        let moved = other == name && !other_file.exists();
        let made_here =
            || self.files.keys().any(|file| folder.join(file).canonicalize().is_ok_and(|f| f == study_file));
        other_file == study_file || moved || made_here()
    }
}

/// A path in the folder as the manifest writes it.
fn name_of(relative: &Path) -> String {
    let parts = relative.components().filter(|part| *part != Component::CurDir);
    parts.map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
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
        out.write("a/b/other.txt", b"text").unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("a/b/other.txt")).unwrap(), "text");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "no temporary file stays behind");
    }

    /// A run of a command that writes these files.
    fn run(folder: &Path, study: &Path, command: &str, others: &[&str], files: &[&str]) -> Vec<Message> {
        let out = OutputFolder::create(folder, &[]).unwrap().claimed_for("s", study).unwrap();
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
        assert!(
            run(&folder, &study, "compare", &[], &["P01/errors.csv"]).is_empty(),
            "another command removes nothing"
        );
        std::fs::write(folder.join("P01/mine.osim"), "changed by hand").unwrap();
        std::fs::write(folder.join("P01/notes.txt"), "not of this program").unwrap();
        let said = run(&folder, &study, "simulate", &["P02"], &["P01/series/a.csv"]);
        assert_eq!(said.len(), 2);
        assert!(said[0].text.contains("P01/series/b/c.csv") && said[0].text.contains("all.csv"), "{}", said[0].text);
        assert!(said[1].text.contains("P01/mine.osim"), "{}", said[1].text);
        assert!(!there("P01/series/b") && !there("all.csv"), "folders left empty go, too");
        for kept in ["P01/series/a.csv", "P01/mine.osim", "P01/notes.txt", "P02/series/a.csv", "P01/errors.csv"] {
            assert!(there(kept), "{kept}");
        }
        assert!(run(&folder, &study, "simulate", &[], &["P01/series/a.csv"])[0].text.contains("P02/series/a.csv"));
    }

    #[test]
    fn verif_what_a_run_that_failed_left_goes_with_the_next() {
        let place = tempfile::tempdir().unwrap();
        let (folder, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let out = OutputFolder::create(&folder, &[]).unwrap().claimed_for("s", &study).unwrap();
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
        let claim = |name: &str, study: &Path| OutputFolder::create(&folder, &[]).unwrap().claimed_for(name, study);
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
    fn run_from(folder: &Path, source: &Path, command: &str, files: &[&str], leftovers: Leftovers) -> Vec<Message> {
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
        // A study takes the folder, and what is of none stays; its own results are not overwritten by such.
        run(&folder, &study, "simulate", &[], &["all.csv"]);
        assert!(there("a.trc") && Manifest::read(&folder.join(MANIFEST)).unwrap().files.len() == 5);
        let out = OutputFolder::create(&folder, &[]).unwrap().with_results_of(&a);
        assert!(matches!(out.write("all.csv", b""), Err(Failure::Input(m)) if m[0].text.contains("of study `s`")));
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
