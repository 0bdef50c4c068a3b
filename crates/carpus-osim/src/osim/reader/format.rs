//! Which formats are read.

use super::upgrade::Version;
use crate::osim::document::{Document, ElementId};
use crate::osim::error::OsimError;

/// Oldest format that is read, as in OpenSim 4.6.
pub(super) const OLDEST_VERSION: u32 = 10901;

/// Oldest format of files of forces, that of a file that states none (`XMLDocument::updateDocumentVersion`).
pub(super) const OLDEST_FORCE_SET: u32 = 10500;

/// Newest format that is read, that of OpenSim 4.6.
pub(super) const NEWEST_VERSION: u32 = 40600;

/// The `<Model>` element and the format version.
pub(super) fn model_element(document: &Document) -> Result<(ElementId, Version), OsimError> {
    let root = document.root();
    let not_a_model = |element, found: String| OsimError::NotAModel {
        file: document.file().to_owned(),
        line: document.line(element),
        found,
    };
    if document.tag(root) != "OpenSimDocument" {
        return Err(not_a_model(root, format!("<{}>", document.tag(root))));
    }
    let version = format_version(document, OLDEST_VERSION)?;
    match document.children(root).first() {
        Some(&model) if document.tag(model) == "Model" => Ok((model, version)),
        Some(&other) => Err(not_a_model(other, format!("<{}>", document.tag(other)))),
        None => Err(not_a_model(root, "an empty <OpenSimDocument>".to_owned())),
    }
}

/// The format version that a root element gives, of those from `oldest` on.
pub(super) fn format_version(document: &Document, oldest: u32) -> Result<Version, OsimError> {
    let root = document.root();
    let found = document.attribute(root, "Version").unwrap_or_default();
    let version: u32 = found.trim().parse().unwrap_or(0);
    if (oldest..=NEWEST_VERSION).contains(&version) {
        return Ok(Version(version));
    }
    let (file, line) = (document.file().to_owned(), document.line(root));
    Err(OsimError::UnsupportedVersion { file, line, found, oldest, newest: NEWEST_VERSION })
}
