//! Whose results a folder takes: what it holds already must be of the same study and command.

use std::path::{Path, PathBuf};

use super::folder::OutputFolder;
use super::manifest::{MANIFEST, Made, Manifest, UNFINISHED, is_same_command, listed, name_of};
use crate::diagnostic::{Diagnostic, Failure};

/// Foreign files that are looked for: more are not counted.
const MOST_FOREIGN: usize = 1000;
/// Files that file managers put into folders, besides those whose names begin with a dot.
const OF_THE_SYSTEM: [&str; 2] = ["Thumbs.db", "desktop.ini"];

impl OutputFolder {
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
}
