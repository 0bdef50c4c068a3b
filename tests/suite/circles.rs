//! No circle of files: what a file uses does not use it in turn, not by way of others either.
//!
//! A file's text is cut into paths (`crate::…`, `self::…`, `super::…`, or a child's name first); braces behind `::` are
//! written out, comments and what begins with `mod tests {` are left out. A path leads to the file of the longest part
//! of it that names one, so that what a parent hands on by `pub use` counts as the parent's.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::writing::sources;

type Module = Vec<String>;
type Uses = BTreeMap<Module, BTreeSet<Module>>;

/// The file's place among the modules of its crate.
fn module(file: &Path) -> Module {
    let mut parts: Module = file.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if matches!(parts.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        parts.pop();
    }
    parts
}

/// All paths of a text.
fn paths(text: &str) -> Vec<String> {
    let text = text.split("mod tests {").next().unwrap_or_default().replace("(in crate::", "(");
    let lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let code = lines.map(|line| line.split(" // ").next().unwrap_or_default()).collect::<Vec<_>>().join("\n");
    let (mut found, mut path, mut before) = (Vec::new(), String::new(), Vec::<String>::new());
    for c in code.chars() {
        if c.is_alphanumeric() || c == '_' || c == ':' {
            path.push(c);
            continue;
        }
        let whole = before.last().cloned().unwrap_or_default() + &path;
        match c {
            '{' if path.ends_with("::") => before.push(whole),
            _ if !path.is_empty() => found.push(whole),
            _ => {}
        }
        path.clear();
        if c == '}' {
            before.pop();
        }
    }
    found
}

/// The file that a path in a file leads to.
fn target(files: &BTreeMap<Module, String>, from: &Module, path: &str) -> Option<Module> {
    let (first, rest) = path.split_once("::")?;
    let mut at = match first {
        "crate" => Module::new(),
        "self" | "super" => from.clone(),
        child => [from.as_slice(), &[child.to_owned()]].concat(),
    };
    if first == "super" {
        at.pop();
    } else if !files.contains_key(&at) {
        return None;
    }
    for part in rest.split("::") {
        match part {
            "super" => drop(at.pop()),
            "self" | "" => {}
            part => at.push(part.to_owned()),
        }
    }
    (0..=at.len()).rev().map(|n| at[..n].to_vec()).find(|module| files.contains_key(module))
}

/// The files that each file uses.
fn uses(files: &BTreeMap<Module, String>) -> Uses {
    let of = |(from, text): (&Module, &String)| {
        let to = paths(text).into_iter().filter_map(|path| target(files, from, &path));
        (from.clone(), to.filter(|to| to != from).collect())
    };
    files.iter().map(of).collect()
}

/// The files from which uses lead back to themselves.
fn on_circles(uses: &Uses) -> Vec<String> {
    let returns = |start: &&Module| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![*start]);
        while let Some(at) = open.pop() {
            open.extend(uses[at].iter().filter(|to| seen.insert(*to)));
        }
        seen.contains(start)
    };
    uses.keys().filter(returns).map(|module| module.join("/")).collect()
}

#[test]
fn verif_no_circle_of_files() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = std::fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let (mut n_files, mut n_uses, mut circles) = (0, 0, Vec::new());
    for folder in crates.chain([root.to_owned(), root.join("python")]).map(|of| of.join("src")) {
        let mut found = Vec::new();
        sources(&folder, &mut found);
        let place = |file: &Path| module(file.strip_prefix(&folder).unwrap());
        let uses = uses(&found.iter().map(|file| (place(file), std::fs::read_to_string(file).unwrap())).collect());
        (n_files, n_uses) = (n_files + uses.len(), n_uses + uses.values().map(BTreeSet::len).sum::<usize>());
        circles.extend(on_circles(&uses).into_iter().map(|file| folder.join(file)));
    }
    assert!(n_files > 300 && n_uses > n_files, "{n_files} files, {n_uses} uses");
    assert!(circles.is_empty(), "circles of files: {circles:#?}");
}

#[test]
fn verif_a_circle_is_recognized() {
    let files = [("lib.rs", "mod a;\npub use a::X;"), ("a.rs", "use super::b::{c::Y, Z};"), ("b/mod.rs", "mod c;")];
    let with = |c: &str| -> BTreeMap<Module, String> {
        let all = files.into_iter().chain([("b/c.rs", c)]);
        all.map(|(file, text)| (module(Path::new(file)), text.to_owned())).collect()
    };
    assert!(on_circles(&uses(&with("// use crate::a::X;\nmod tests { use crate::a::X; }"))).is_empty());
    assert_eq!(on_circles(&uses(&with("use crate::a::X;"))), ["a", "b/c"]);
}
