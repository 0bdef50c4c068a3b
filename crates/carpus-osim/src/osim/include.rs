//! Files that objects name by the attribute `file`, in their place.

use super::document::{Document, ElementId};
use super::error::OsimError;
use std::path::{Path, PathBuf};

/// Files that a document includes, at most: more include one another.
const MOST_INCLUDES: usize = 50;

/// Why a file cannot stand in the place of the object that names it.
#[derive(Debug)]
pub struct IncludeError {
    /// Line of the object.
    pub line: usize,
    /// Its tag.
    pub tag: String,
    /// The file as the object names it.
    pub file: String,
    /// Where that is.
    pub path: PathBuf,
    /// What is wrong with it; `None` if its format version is another one than that of the document.
    pub source: Option<OsimError>,
}

/// A document with the files that its objects name in their place, on the same line, so that lines stay what they are;
/// with the first of them that cannot be, which is left as it is, as are those after it.
///
/// Relative files are sought beside the document, as OpenSim does (`Object::readObjectFromXMLNodeOrFile`).
///
/// - `path`: of the document
/// - `any_version`: whether files of other format versions are taken
pub fn include_files(mut document: Document, path: &Path, any_version: bool) -> (Document, Option<IncludeError>) {
    for _ in 0..MOST_INCLUDES {
        let named = |e: &ElementId| {
            let file = document.attribute(*e, "file")?;
            let is_file = !file.trim().is_empty() && file != "Unassigned" && document.children(*e).is_empty();
            is_file.then_some((*e, file))
        };
        let Some((element, file)) = document.elements().find_map(|e| named(&e)) else { return (document, None) };
        let other = path.parent().unwrap_or(Path::new("")).join(file.replace('\\', "/"));
        let failure = |source: Option<OsimError>| IncludeError {
            line: document.line(element),
            tag: document.tag(element).to_owned(),
            file: file.clone(),
            path: other.clone(),
            source,
        };
        // What is no file, such as a device, may have no end.
        let read = match std::fs::metadata(&other) {
            Ok(metadata) if !metadata.is_file() => Err(std::io::ErrorKind::InvalidInput.into()),
            Ok(_) => Ok(()),
            Err(source) => Err(source),
        };
        let read = read.map_err(|source| OsimError::Read { file: other.display().to_string(), source });
        let found = match read.and_then(|()| Document::read(&other)) {
            Ok(found) => found,
            Err(error) => {
                let failure = failure(Some(error));
                return (document, Some(failure));
            }
        };
        let (object, version) = (found.object(), document.attribute(document.root(), "Version"));
        if !any_version && object != found.root() && version != found.attribute(found.root(), "Version") {
            let failure = failure(None);
            return (document, Some(failure));
        }
        let text = String::from_utf8_lossy(&found.bytes()[found.range(object)]).replace(['\r', '\n'], " ");
        match document.spliced(vec![(document.range(element), text)]) {
            Ok(longer) => document = longer,
            Err(error) => {
                let failure = failure(Some(OsimError::Document(error)));
                return (document, Some(failure));
            }
        }
    }
    (document, None)
}
