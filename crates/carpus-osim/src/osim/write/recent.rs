//! Files of format 40000 and later: the changes that OpenSim 4.6 makes on loading them.

use std::ops::Range;

use super::format::{CURRENT_FORMAT, spliced};
use crate::osim::document::{ElementId, escape};
use crate::osim::error::OsimError;
use crate::osim::file::OsimFile;

/// Paths of forces became a named property.
const NAMED_PATHS: u32 = 40500;

/// The same text with the changes.
pub(super) fn upgraded(file: &OsimFile) -> Result<OsimFile, OsimError> {
    let document = &file.document;
    let version = file.spec.document_version;
    if version >= CURRENT_FORMAT {
        return Ok(file.clone());
    }
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let root = document.root();
    edits.extend(set_attribute(file, root, "Version", &CURRENT_FORMAT.to_string()));
    for element in document.elements() {
        match document.tag(element) {
            "GeometryPath"
                if version < NAMED_PATHS && document.attribute(element, "name").as_deref() != Some("path") =>
            {
                edits.extend(set_attribute(file, element, "name", "path"));
            }
            "actuator_list" => {
                let range = document.range(element);
                let sockets = escape(&sockets(file, element));
                edits.push((range, format!("<socket_actuators>{sockets}</socket_actuators>")));
            }
            _ => {}
        }
    }
    spliced(document, edits)
}

/// Replaces or adds an attribute of a start tag.
fn set_attribute(file: &OsimFile, element: ElementId, name: &str, value: &str) -> Option<(Range<usize>, String)> {
    let range = file.document.start_tag(element);
    let text = String::from_utf8_lossy(&file.document.bytes()[range.clone()]).into_owned();
    let tag = file.document.tag(element);
    let find = |quote: char| {
        let start = text.find(&format!(" {name}={quote}"))? + name.len() + 3;
        Some((start, start + text[start..].find(quote)?))
    };
    match find('"').or_else(|| find('\'')) {
        Some((from, to)) => {
            let at = range.start + from..range.start + to;
            // A name with bytes that are no UTF-8 would shift positions: then nothing is changed.
            (text.len() == range.len()).then(|| (at, value.to_owned()))
        }
        None => {
            let after = range.start + 1 + tag.len();
            Some((after..after, format!(" {name}=\"{value}\"")))
        }
    }
}

/// Component paths of the actuators that a list names.
fn sockets(file: &OsimFile, list: ElementId) -> String {
    let spec = &file.spec;
    let muscles = spec.muscles.iter().map(|m| (&m.name, &m.at.path));
    let actuators = spec.forces.iter().filter(|f| {
        matches!(&f.kind, crate::osim::spec::ForceKind::Actuator(_))
            || matches!(&f.kind, crate::osim::spec::ForceKind::Unsupported { class } if class.ends_with("Actuator"))
    });
    let all: Vec<(&String, &String)> = muscles.chain(actuators.map(|f| (&f.name, &f.at.path))).collect();
    let text = file.document.text(list);
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    if words.first().is_some_and(|word| word.eq_ignore_ascii_case("ALL")) {
        return all.iter().map(|(_, path)| path.as_str()).collect::<Vec<_>>().join(" ");
    }
    let path = |word: &&str| {
        let name = word.rsplit('/').next().unwrap_or(word);
        all.iter()
            .find(|(known, _)| known.as_str() == name)
            .map_or_else(|| (*word).to_owned(), |(_, path)| (*path).clone())
    };
    words.iter().map(path).collect::<Vec<_>>().join(" ")
}
