//! Files are written completely or not at all, by way of a temporary file that takes the place of the old one: results
//! by one function (`OutputFolder::put_with`), and a model by itself by another (`OsimFile::write`).

use std::path::{Path, PathBuf};

/// The only files that write.
const WRITERS: [&str; 2] = ["crates/carpus-groundwork/src/output/folder.rs", "crates/carpus-osim/src/osim/document.rs"];

/// What writes, or changes what is written, beside the writers.
const WRITING: [&str; 7] =
    ["fs::write", "File::create", "File::options", "OpenOptions", "fs::rename", "fs::copy", ".persist("];

pub(super) fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The program's part of a file: tests write as they like.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]").next().unwrap_or(text)
}

fn writes(text: &str) -> Vec<&'static str> {
    WRITING.into_iter().filter(|word| without_tests(text).contains(word)).collect()
}

#[test]
fn verif_nothing_else_writes_files() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in std::fs::read_dir(root.join("crates")).unwrap() {
        sources(&folder.unwrap().path().join("src"), &mut files);
    }
    sources(&root.join("src"), &mut files);
    sources(&root.join("python/src"), &mut files);
    // A folder's own file of tests, which its `mod.rs` has as such.
    files.retain(|file| file.file_name().is_none_or(|name| name != "tests.rs"));
    assert!(files.len() > 300, "{}", files.len());
    let mut writers = Vec::new();
    for file in &files {
        let text = std::fs::read_to_string(file).unwrap();
        let place = file.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
        for word in writes(&text) {
            writers.push(format!("{place}: {word}"));
        }
    }
    writers.sort();
    assert_eq!(writers, WRITERS.map(|writer| format!("{writer}: .persist(")));
}

#[test]
fn verif_what_writes_is_recognized() {
    assert_eq!(writes("std::fs::write(path, text)?;"), ["fs::write"]);
    assert!(writes("let x = 1;\n#[cfg(test)]\nmod tests { fn f() { std::fs::write(a, b); } }").is_empty());
}
