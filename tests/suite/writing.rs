//! Files are written completely or not at all: one function writes them (`OutputFolder::put_with`), by way of a
//! temporary file that takes the place of the old one.

use std::path::{Path, PathBuf};

/// The only file that writes.
const WRITER: &str = "crates/carpus-session/src/output.rs";

/// What writes, or changes what is written, beside the writer.
const WRITING: [&str; 7] =
    ["fs::write", "File::create", "File::options", "OpenOptions", "fs::rename", "fs::copy", ".persist("];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
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
fn verif_one_function_writes_files() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in std::fs::read_dir(root.join("crates")).unwrap() {
        sources(&folder.unwrap().path().join("src"), &mut files);
    }
    sources(&root.join("src"), &mut files);
    sources(&root.join("python/src"), &mut files);
    assert!(files.len() > 300, "{}", files.len());
    let mut writers = Vec::new();
    for file in &files {
        let text = std::fs::read_to_string(file).unwrap();
        let place = file.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
        for word in writes(&text) {
            writers.push(format!("{place}: {word}"));
        }
    }
    assert_eq!(writers, [format!("{WRITER}: .persist(")]);
}

#[test]
fn verif_what_writes_is_recognized() {
    assert_eq!(writes("std::fs::write(path, text)?;"), ["fs::write"]);
    assert!(writes("let x = 1;\n#[cfg(test)]\nmod tests { fn f() { std::fs::write(a, b); } }").is_empty());
}
