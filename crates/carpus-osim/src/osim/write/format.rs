//! The format that is written.

use crate::osim::document::Document;
use crate::osim::error::{DocumentError, OsimError};
use crate::osim::file::OsimFile;

/// The format that is written, that of OpenSim 4.6.
pub const CURRENT_FORMAT: u32 = 40600;

/// The error of a text made here.
pub(super) fn own(error: DocumentError) -> OsimError {
    OsimError::from(error)
}

/// The document after splices.
pub(super) fn spliced(
    document: &Document,
    edits: Vec<(std::ops::Range<usize>, String)>,
) -> Result<OsimFile, OsimError> {
    OsimFile::from_document(document.spliced(edits).map_err(own)?)
}
