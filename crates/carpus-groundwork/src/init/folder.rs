//! Files below a folder, and how they are spoken of.

use std::path::{Path, PathBuf};

use super::proposal::Note;
use crate::diagnostic::{Diagnostic, Failure};
use carpus_study::study::Format;

/// Ends of names of files of text that may be tables of numbers.
const TEXT_FILES: [&str; 9] = ["csv", "txt", "tsv", "dat", "asc", "tab", "prn", "sto", "mot"];
/// Most files that are looked at.
const MOST_FILES: usize = 5000;

pub fn note_left(folder: &Path, left: &[PathBuf], unknown: &mut Vec<Note>) {
    if !left.is_empty() {
        unknown.push(Note {
            what: format!("what {} hold: {}", count(left.len(), "other file"), some(folder, left.iter())),
            remedy: "they are not used; recordings are tables with a time in text (.csv, .txt, .tsv), .xlsx, .mat, \
                     .edf, .bdf, .c3d, .sto and .mot"
                .to_owned(),
        });
    }
}

/// Whether a file may be a table of numbers by its name, and whether as text.
pub fn may_be_table(path: &Path) -> (bool, bool) {
    let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_text = TEXT_FILES.contains(&end.as_str());
    (is_text || Format::ENDS.contains(&end.as_str()), is_text)
}

/// Files below a folder that may be recordings, in the order of their names, and other files.
pub fn files(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Failure> {
    let (mut tables, mut others, mut folders) = (Vec::new(), Vec::new(), vec![folder.to_owned()]);
    while let Some(next) = folders.pop() {
        let unreadable =
            |e: std::io::Error| Failure::from(Diagnostic::error(format!("cannot be read: {e}")).in_file(&next));
        for entry in std::fs::read_dir(&next).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
            let is_own = matches!(name.as_str(), "study.toml" | "participants.csv" | "trials.csv");
            if name.starts_with('.') || path.is_symlink() || (is_own && next.join("study.toml").exists()) {
                continue;
            }
            match path.is_dir() {
                true => folders.push(path),
                false if may_be_table(&path).0 => tables.push(path),
                false => others.push(path),
            }
        }
        if tables.len() > MOST_FILES {
            let message = Diagnostic::error(format!("more than {MOST_FILES} files")).in_file(folder);
            return Err(message.hint("give the folder of one study").into());
        }
    }
    let natural = |path: &PathBuf| natural_order(&path.display().to_string());
    tables.sort_by_key(natural);
    others.sort();
    Ok((tables, others))
}

/// A name such that numbers in it are in their order.
fn natural_order(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let (mut letters, mut digits) = (String::new(), String::new());
    for c in name.chars() {
        if c.is_ascii_digit() && digits.len() < 18 {
            digits.push(c);
        } else {
            if !digits.is_empty() {
                parts.push((std::mem::take(&mut letters), digits.parse().unwrap_or(0)));
                digits.clear();
            }
            letters.push(c);
        }
    }
    parts.push((letters, digits.parse().unwrap_or(0)));
    parts
}

/// The path below a folder, with slashes.
pub fn within(folder: &Path, path: &Path) -> String {
    let parts = path.strip_prefix(folder).unwrap_or(path).components();
    parts.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("/")
}

pub fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

pub fn some<'p>(folder: &Path, paths: impl ExactSizeIterator<Item = &'p PathBuf>) -> String {
    let n = paths.len();
    let mut names: Vec<String> = paths.take(3).map(|path| within(folder, path)).collect();
    if n > names.len() {
        names.push(format!("… ({} more)", n - names.len()));
    }
    names.join(", ")
}
