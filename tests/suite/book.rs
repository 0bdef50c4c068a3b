//! The README and the book: pages from the program are up to date, links lead somewhere, words are about what is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All files below a folder with this extension, sorted.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == extension) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn book() -> PathBuf {
    root().join("docs/src")
}

/// The README, what lies beside it, and all pages of the book.
fn documents() -> Vec<PathBuf> {
    let mut all = vec![root().join("README.md"), root().join("ARCHITECTURE.md")];
    all.extend(files(&book(), "md"));
    assert!(all.len() > 60, "{} documents", all.len());
    all
}

fn carpus(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_carpus")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn verif_pages_from_the_program_are_up_to_date() {
    let folder = std::env::temp_dir().join(format!("carpus-book-{}", std::process::id()));
    carpus(&["book", "--out", folder.to_str().unwrap()]);
    let made = files(&folder, "md");
    assert!(made.len() > 30, "{} pages", made.len());
    for page in &made {
        let relative = page.strip_prefix(&folder).unwrap();
        let committed = read(&book().join(relative));
        let advice = "renew it with: cargo run -- book --out docs/src";
        assert!(committed == read(page), "docs/src/{} differs from the program's; {advice}", relative.display());
    }
    let of_effects = |folder: &Path| -> BTreeSet<String> {
        files(&folder.join("catalogue"), "md")
            .iter()
            .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
            .collect()
    };
    assert_eq!(of_effects(&book()), of_effects(&folder), "pages of effects that there are");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Targets of Markdown links and images outside of code, with the line they are on.
fn links(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (number, line) in prose_lines(text) {
        let mut rest = line.as_str();
        while let Some(at) = rest.find("](") {
            rest = &rest[at + 2..];
            let Some(end) = rest.find(')') else { break };
            found.push((number, rest[..end].to_string()));
            rest = &rest[end..];
        }
    }
    found
}

/// Lines outside of fenced code, with code in back quotes taken out.
fn prose_lines(text: &str) -> Vec<(usize, String)> {
    let mut in_code = false;
    let mut lines = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        } else if !in_code {
            let outside = line.split('`').step_by(2).collect::<Vec<_>>().join(" ");
            lines.push((i + 1, outside));
        }
    }
    lines
}

/// Anchors of the headings of a page, as mdBook and forges name them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut in_code = false;
    let mut found = BTreeSet::new();
    for line in text.lines() {
        in_code ^= line.trim_start().starts_with("```");
        if let Some(title) = line.strip_prefix('#').filter(|_| !in_code) {
            let kept = title.trim_start_matches('#').trim().chars().filter_map(|c| match c {
                ' ' => Some('-'),
                c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
                _ => None,
            });
            found.insert(kept.collect::<String>().to_lowercase());
        }
    }
    found
}

#[test]
fn verif_every_link_of_readme_and_book_leads_somewhere() {
    let mut broken = Vec::new();
    let mut checked = 0;
    for page in documents() {
        for (line, target) in links(&read(&page)) {
            if target.starts_with("http://") || target.starts_with("https://") {
                continue;
            }
            checked += 1;
            let (file, anchor) = target.split_once('#').unwrap_or((&target, ""));
            let to = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let leaves_the_book = page.starts_with(book()) && !resolved(&to).starts_with(book());
            let lacks_anchor = || !anchor.is_empty() && !anchors(&read(&to)).contains(anchor);
            if !to.exists() || leaves_the_book || lacks_anchor() {
                broken.push(format!("{}:{line}: {target}", page.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(checked > 100, "{checked} links");
    assert!(broken.is_empty(), "links that lead nowhere:\n{}", broken.join("\n"));
}

/// A path without `..`.
fn resolved(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                out.pop();
            }
            part => out.push(part),
        }
    }
    out
}

#[test]
fn verif_every_page_is_in_the_summary() {
    let summary = book().join("SUMMARY.md");
    let mut listed: Vec<PathBuf> = links(&read(&summary)).into_iter().map(|(_, target)| book().join(target)).collect();
    listed.push(summary);
    listed.sort();
    assert_eq!(listed, files(&book(), "md"));
}

#[test]
fn verif_the_readme_is_short_and_holds_its_two_commands() {
    let readme = read(&root().join("README.md"));
    assert!(readme.lines().count() <= 150, "{} lines", readme.lines().count());
    assert!(readme.len() <= 9000, "{} bytes", readme.len());
    for command in ["cargo test", "cargo run --release -- demo"] {
        assert!(readme.lines().any(|l| l.starts_with(&format!("$ {command}"))), "{command}");
    }
}

/// Phrases that tell how something came about: builds, tables and trials of earlier days. Words of a phrase stand next
/// to each other; `*` is any word, `#` a number.
const DIARY: [&str; 29] = [
    "commit",
    "commits",
    "committed",
    "seed #",
    "seeds #",
    "noise seeds",
    "tuning",
    "tuned",
    "formerly",
    "previously",
    "earlier build",
    "earlier builds",
    "earlier table",
    "earlier tables",
    "previous build",
    "previous builds",
    "previous table",
    "former build",
    "older build",
    "build before",
    "builds before",
    "table before",
    "tables before",
    "chosen on",
    "chosen after",
    "began with",
    "made anew since",
    "clean studies",
    "of today",
];

/// The phrase of [`DIARY`] or the commit that a text has.
fn diary_of(text: &str) -> Option<String> {
    // Options and their values are no words.
    let words: Vec<String> = text
        .split_whitespace()
        .scan(false, |is_value, word| {
            let skip = word.starts_with("--") || std::mem::take(is_value);
            *is_value = word.starts_with("--");
            Some(if skip { String::new() } else { word.to_lowercase() })
        })
        .map(|w| w.trim_matches(|c: char| !c.is_alphanumeric()).to_string())
        .collect();
    let matches = |word: &str, wanted: &str| match wanted {
        "#" => !word.is_empty() && word.chars().all(|c| c.is_ascii_digit()),
        wanted => word == wanted,
    };
    let phrase = DIARY.iter().find(|phrase| {
        let wanted: Vec<&str> = phrase.split(' ').collect();
        words.windows(wanted.len()).any(|window| window.iter().zip(&wanted).all(|(word, want)| matches(word, want)))
    });
    let is_hash = |word: &&String| {
        (7..=40).contains(&word.len())
            && word.chars().all(|c| c.is_ascii_digit() || ('a'..='f').contains(&c))
            && word.chars().any(|c| c.is_ascii_digit())
            && word.chars().any(char::is_alphabetic)
            && !word.chars().next().is_some_and(|c| c.is_ascii_digit() && word.contains('e'))
    };
    phrase.map(|p| (*p).to_string()).or_else(|| words.iter().find(is_hash).cloned())
}

#[test]
fn verif_a_diary_is_recognized() {
    for text in ["found by commit c22d4f9", "with seed 21", "chosen on a table", "by the build before", "in 0d3a41b,"] {
        assert!(diary_of(text).is_some(), "{text}");
    }
    for text in ["carpus personalize study --seed 1", "the seed of the draws", "1 - 1e-9 of 1000000", "a decade"] {
        assert_eq!(diary_of(text), None, "{text}");
    }
}

#[test]
fn verif_only_evidence_pages_speak_of_builds_seeds_and_tuning() {
    let mut found = Vec::new();
    let mut look = |path: &Path, line: usize, text: &str| {
        if let Some(phrase) = diary_of(text) {
            found.push(format!("{}:{line}: {phrase}", path.strip_prefix(root()).unwrap().display()));
        }
    };
    for page in documents().iter().filter(|p| !p.starts_with(book().join("evidence"))) {
        let text = read(page);
        paragraphs(&text, |l| Some(l.trim())).iter().for_each(|(line, text)| look(page, *line, text));
    }
    let sources = ["src", "crates"].map(|folder| files(&root().join(folder), "rs")).concat();
    assert!(sources.len() > 200, "{} sources", sources.len());
    for source in &sources {
        let text = read(source);
        let comment = |line| {
            let line = str::trim_start(line);
            let marks = ["//!", "///", "//"];
            marks.iter().find_map(|mark| line.strip_prefix(mark)).map(str::trim)
        };
        paragraphs(&text, comment).iter().for_each(|(line, text)| look(source, *line, text));
    }
    assert!(found.is_empty(), "these say how something came about, not what is:\n{}", found.join("\n"));
}

/// Runs of lines of which `part` takes something, joined, with the first line's number.
fn paragraphs<'a>(text: &'a str, part: impl Fn(&'a str) -> Option<&'a str>) -> Vec<(usize, String)> {
    let mut all: BTreeMap<usize, String> = BTreeMap::new();
    let mut start = None;
    for (i, line) in text.lines().enumerate() {
        match part(line).filter(|l| !l.is_empty()) {
            Some(words) => {
                let paragraph = all.entry(*start.get_or_insert(i + 1)).or_default();
                paragraph.push_str(words);
                paragraph.push(' ');
            }
            None => start = None,
        }
    }
    all.into_iter().collect()
}

#[test]
fn verif_shells_and_man_get_every_command() {
    let help = carpus(&["--help"]);
    let listed: Vec<&str> = help
        .lines()
        .filter(|l| l.starts_with("  ") && l.as_bytes().get(2).is_some_and(u8::is_ascii_lowercase))
        .filter_map(|l| l.split_whitespace().next())
        .filter(|name| !["carpus", "help"].contains(name))
        .collect();
    assert!(listed.len() > 25 && listed.contains(&"personalize"), "{listed:?}");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = carpus(&["completions", shell]);
        listed.iter().for_each(|name| assert!(script.contains(name), "{shell}: {name}"));
    }
    let folder = std::env::temp_dir().join(format!("carpus-man-{}", std::process::id()));
    carpus(&["man", "--out", folder.to_str().unwrap()]);
    for name in &listed {
        let page = read(&folder.join(format!("carpus-{name}.1")));
        assert!(page.contains(".SH SYNOPSIS") && page.contains("Example"), "{name}");
    }
    assert!(folder.join("carpus.1").exists() && folder.join("carpus-effect-add.1").exists());
    std::fs::remove_dir_all(&folder).unwrap();
}
