//! Whose a file is: by the table of persons, by the names of folders and files, by the folders themselves.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::conditions::{self, Named, RECORDERS};
use super::folder::within;
use super::proposal::Note;
use carpus_study::study::Participant;

/// The one participant of files that say nothing of persons.
const ONLY: &str = "P01";

/// Tells whose a file is.
#[derive(Clone, Debug)]
pub struct Whose<'p> {
    folder: &'p Path,
    people: &'p [Participant],
    /// Whether each folder below is a person.
    by_folder: bool,
}

impl<'p> Whose<'p> {
    /// - `paths`: of all recordings that are used
    /// - `people`: a table of persons
    pub fn new<'r>(
        folder: &'p Path,
        people: &'p [Participant],
        paths: impl Iterator<Item = &'r Path>,
        [assumed, unknown]: [&mut Vec<Note>; 2],
    ) -> Whose<'p> {
        let mut whose = Whose { folder, people, by_folder: false };
        let paths: BTreeSet<String> = paths.map(|path| within(folder, path)).collect();
        if !paths.iter().any(|path| whose.named(path).is_some()) && whose.of_root().is_none() {
            whose.by_folder(&paths, assumed);
        }
        whose.note_visits(&paths, unknown);
        whose
    }

    /// The participant of a file.
    pub fn of(&self, path: &Path) -> String {
        let path = within(self.folder, path);
        let of_folder = || self.by_folder.then(|| top(&path)).flatten().map(str::to_owned);
        self.named(&path).or_else(|| self.of_root()).or_else(of_folder).unwrap_or_else(|| ONLY.to_owned())
    }

    /// Whom the path names: a person of the table, or the first folder or else the file with such a name.
    fn named(&self, path: &str) -> Option<String> {
        self.naming(path).map(|(_, name)| name)
    }

    /// The place in the path of the part that names a participant, and the name.
    fn naming(&self, path: &str) -> Option<(usize, String)> {
        let parts: Vec<&str> = path.split('/').collect();
        let of_table = |(i, part): (usize, &&str)| {
            let is = |p: &&Participant| part.to_lowercase().starts_with(&p.name.to_lowercase());
            Some((i, self.people.iter().find(is)?.name.clone()))
        };
        let of_name = |(i, part): (usize, &&str)| Some((i, conditions::participant(part)?));
        parts.iter().enumerate().find_map(of_table).or_else(|| parts.iter().enumerate().find_map(of_name))
    }

    fn of_root(&self) -> Option<String> {
        conditions::participant(&self.folder.file_name().unwrap_or_default().to_string_lossy())
    }

    /// Without names of participants: folders of which none is about trials or recorders are persons.
    fn by_folder(&mut self, paths: &BTreeSet<String>, assumed: &mut Vec<Note>) {
        let tops: BTreeSet<Option<&str>> = paths.iter().map(|path| top(path)).collect();
        let names: Vec<&str> = tops.iter().copied().flatten().collect();
        let are_persons = names.len() > 1 && names.len() == tops.len() && names.iter().all(|name| is_of_no_trial(name));
        self.by_folder = are_persons;
        let remedy = "see the column participant of participants.csv and trials.csv; folders or files whose names \
                      begin as S01, P2 or Proband 3 say it";
        let what = if are_persons {
            format!("each folder is one participant: {}", names.join(", "))
        } else {
            format!("all recordings are of one participant, {ONLY}: no name of a folder or file says whose they are")
        };
        assumed.push(Note { what, remedy: remedy.to_owned() });
    }

    /// A participant below several folders that are not about trials or recorders may have come several times.
    fn note_visits(&self, paths: &BTreeSet<String>, unknown: &mut Vec<Note>) {
        let mut places: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for path in paths {
            if let Some((place, name)) = self.naming(path) {
                let above: Vec<&str> = path.split('/').take(place).filter(|part| is_of_no_trial(part)).collect();
                places.entry(name).or_default().insert(above.join("/"));
            }
        }
        for (name, folders) in places.into_iter().filter(|(_, folders)| folders.len() > 1) {
            let folders: Vec<&str> = folders.iter().map(|f| if f.is_empty() { "." } else { f.as_str() }).collect();
            unknown.push(Note {
                what: format!("whether {name} in the folders {} came several times: taken as once", folders.join(", ")),
                remedy: "visits are participants of their own: give them names such as P01a and P01b, and the columns \
                         person and visit in participants.csv"
                    .to_owned(),
            });
        }
    }
}

/// The first folder of a path.
fn top(path: &str) -> Option<&str> {
    path.split_once('/').map(|(first, _)| first)
}

/// Whether a name is about neither a trial nor a recorder.
fn is_of_no_trial(name: &str) -> bool {
    let lower = name.to_lowercase();
    let mut words = lower.split(|c: char| !c.is_alphanumeric());
    conditions::of_name(name) == Named::default() && !words.any(|word| RECORDERS.contains(&word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(paths: &[&str]) -> (Vec<String>, Vec<String>) {
        let folder = Path::new("/lab/exports");
        let files: Vec<_> = paths.iter().map(|path| folder.join(path)).collect();
        let (mut assumed, mut unknown) = (Vec::new(), Vec::new());
        let whose = Whose::new(folder, &[], files.iter().map(AsRef::as_ref), [&mut assumed, &mut unknown]);
        let notes = assumed.into_iter().chain(unknown).map(|note| note.what).collect();
        (files.iter().map(|file| whose.of(file)).collect(), notes)
    }

    #[test]
    fn verif_persons_are_never_merged_in_silence() {
        let (whose, notes) = told(&["Anna/mvc.csv", "Anna/emg/mvc.csv", "Ben/mvc.csv"]);
        assert_eq!(whose, ["Anna", "Anna", "Ben"]);
        assert_eq!(notes, ["each folder is one participant: Anna, Ben"]);
        let (whose, notes) = told(&["P03a/mvc.csv", "P03b_mvc.csv", "emg/P03a/mvc.csv"]);
        assert_eq!((whose, notes.len()), (vec!["P03a".to_owned(), "P03b".to_owned(), "P03a".to_owned()], 0));
        for paths in [["isometric/1.csv", "MVC/1.csv"], ["emg/1.csv", "biodex/1.csv"], ["1.csv", "Anna/2.csv"]] {
            let (whose, notes) = told(&paths);
            assert_eq!(whose, ["P01", "P01"], "{paths:?}");
            assert!(notes.len() == 1 && notes[0].starts_with("all recordings are of one participant"), "{notes:?}");
        }
        let (whose, notes) = told(&["before/P03/mvc.csv", "after/P03/mvc.csv", "before/P04/mvc.csv"]);
        assert_eq!(whose, ["P03", "P03", "P04"]);
        assert_eq!(notes, ["whether P03 in the folders after, before came several times: taken as once"]);
    }
}
