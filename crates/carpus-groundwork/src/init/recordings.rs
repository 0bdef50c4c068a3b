//! Recordings of the dynamometer: whose they are, what their names say, and which file has their EMG.

use std::path::{Path, PathBuf};

use super::columns::Role;
use super::conditions::{self, Named, RECORDERS};
use super::folder::{count, some, within};
use super::proposal::Note;
use super::read_file::Read;
use super::whose::Whose;
use carpus_study::study::nearest;

/// A file of the dynamometer.
#[derive(Clone, Debug)]
pub struct Recording {
    /// The file.
    pub path: PathBuf,
    /// The table of it, where it has several.
    pub table: Option<String>,
    /// Whose it is.
    pub participant: String,
    /// What its name says.
    pub named: Named,
    /// The file of its EMG and the table of that, where they are others.
    pub emg: Option<(PathBuf, Option<String>)>,
    /// Angle as recorded.
    pub angle: Vec<f64>,
    /// Moment as recorded.
    pub moment: Vec<f64>,
}

/// What a file of the dynamometer is.
pub fn recording(folder: &Path, read: &Read, whose: &Whose<'_>) -> Recording {
    let path = within(folder, &read.path);
    let stem = read.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let participant = whose.of(&read.path);
    // A sheet or a struct of one trial says what its file's name leaves out.
    let mut named = read.table().map(conditions::of_name).unwrap_or_default();
    named.add(conditions::of_name(&stem));
    // Folders say what names leave out, the nearest first.
    let parents: Vec<&str> = path.split('/').rev().skip(1).collect();
    for parent in parents {
        let of_folder = conditions::of_name(parent);
        named.contraction = named.contraction.or(of_folder.contraction);
        named.direction = named.direction.or(of_folder.direction);
        named.effort_percent = named.effort_percent.or(of_folder.effort_percent);
    }
    Recording {
        participant,
        named,
        emg: None,
        table: read.table().map(str::to_owned),
        angle: read.samples(&Role::Angle),
        moment: read.samples(&Role::Moment),
        path: read.path.clone(),
    }
}

/// A table of EMG, whose it is, and its name without words for recorders.
struct Candidate<'r> {
    who: String,
    name: String,
    read: &'r Read,
}

/// Finds the file of the EMG of every recording.
pub fn pair(folder: &Path, recordings: &mut Vec<Recording>, emg: &[Read], whose: &Whose<'_>, unknown: &mut Vec<Note>) {
    let key = |path: &Path, table: Option<&str>| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let start = conditions::participant(&stem).map_or(0, |p| p.len());
        let text = format!("{} {}", &stem[start..], table.unwrap_or_default().to_lowercase());
        let words = text.split(|c: char| !(c.is_alphanumeric() || matches!(c, '+' | '-' | '%' | '.')));
        words
            .filter(|word| !word.is_empty() && !RECORDERS.contains(word))
            .map(str::to_owned)
            .collect::<Vec<_>>()
            .join(" ")
    };
    let of = |path: &Path| whose.of(path);
    let candidates: Vec<Candidate<'_>> =
        emg.iter().map(|read| Candidate { who: of(&read.path), name: key(&read.path, read.table()), read }).collect();
    for recording in recordings.iter_mut() {
        let (who, name) = (of(&recording.path), key(&recording.path, recording.table.as_deref()));
        // Tables of one file belong together before all others.
        let beside: Vec<&Candidate<'_>> = candidates.iter().filter(|c| c.read.path == recording.path).collect();
        let own: Vec<&Candidate<'_>> = match beside[..] {
            [] => candidates.iter().filter(|c| c.who == who).collect(),
            _ => beside,
        };
        let alone = (own.len() == 1 && own[0].read.path == recording.path).then(|| own[0]);
        let exact = || own.iter().find(|c| c.name == name).copied();
        let near = || {
            let found = nearest(&name, own.iter().map(|c| c.name.as_str()))?;
            own.iter().find(|c| c.name == found && same_numbers(&c.name, &name)).copied()
        };
        let found = alone.or_else(exact).or_else(near);
        recording.emg = found.map(|c| (c.read.path.clone(), c.read.table().map(str::to_owned)));
    }
    let without: Vec<&PathBuf> = recordings.iter().filter(|r| r.emg.is_none()).map(|r| &r.path).collect();
    if !without.is_empty() {
        unknown.push(Note {
            what: format!(
                "{} without a file of EMG are left out: {}",
                count(without.len(), "recording"),
                some(folder, without.into_iter())
            ),
            remedy: "files belong together whose names agree but for the recorder (emg, delsys, biodex, …)".to_owned(),
        });
        recordings.retain(|r| r.emg.is_some());
    }
    let is_used = |read: &&Read| {
        let own = (read.path.clone(), read.table().map(str::to_owned));
        recordings.iter().any(|recording| recording.emg.as_ref() == Some(&own))
    };
    let alone: Vec<&PathBuf> = emg.iter().filter(|read| !is_used(read)).map(|read| &read.path).collect();
    if !alone.is_empty() {
        unknown.push(Note {
            what: format!(
                "{} of EMG without a recording of the torque: {}",
                count(alone.len(), "file"),
                some(folder, alone.into_iter())
            ),
            remedy: "they are not used".to_owned(),
        });
    }
}

/// Whether two names have the same numbers.
fn same_numbers(a: &str, b: &str) -> bool {
    let numbers = |text: &str| {
        let parts = text.split(|c: char| !c.is_ascii_digit()).filter(|p| !p.is_empty());
        parts.map(str::to_owned).collect::<Vec<_>>()
    };
    numbers(a) == numbers(b)
}
