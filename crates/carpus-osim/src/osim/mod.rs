//! OpenSim `.osim` files: lossless document, typed specification, edits and diagnostics.
//!
//! In: the bytes of an `.osim` file. Out: a [`spec::ModelSpec`] (typed, faithful, OpenSim's property names) and a
//! list of diagnostics saying what was understood, approximated, ignored or unsupported, with file and line.
//! Writing goes the other way: an edit of the specification is a splice into the original bytes, so bytes that were
//! not edited stay as they were. This is the only module that knows XML.

pub mod diagnostics;
pub mod document;
pub mod edit;
pub mod error;
mod file;
mod include;
mod meshes;
mod reader;
pub mod scale;
pub mod spec;
mod write;

pub use diagnostics::{Diagnostic, Diagnostics, Severity};
pub use document::{Document, ElementId};
pub use edit::{ComponentSet, EditError};
pub use error::{DocumentError, DocumentErrorKind, OsimError, Problem, ProblemKind, WriteError};
pub use file::OsimFile;
pub use include::{IncludeError, include_files};
pub use meshes::MeshSpec;
pub use scale::{BodyFactors, ScaleError, ScaledBodies};
pub use write::{CURRENT_FORMAT, Upgraded};
