//! The end of a run: what earlier runs left goes, and the folder says who made what.

use std::collections::BTreeMap;
use std::path::{Component, Path};
use std::sync::atomic::Ordering;

use super::folder::{OutputFolder, lock, reason};
use super::manifest::{MANIFEST, Made, Manifest, UNFINISHED, listed, name_of};
use crate::diagnostic::{Diagnostic, Failure};
use crate::provenance::hash_of;

/// What becomes of files of an earlier run that are not of this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftovers {
    /// They are removed.
    Remove,
    /// They stay, as OpenSim's tools leave them, and are named.
    Name,
}

impl OutputFolder {
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
