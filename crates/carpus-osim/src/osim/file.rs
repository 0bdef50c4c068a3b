//! A model file: its text, what it says, and what of it was not understood.

use std::path::Path;

use super::diagnostics::Diagnostics;
use super::document::{Document, ElementId};
use super::error::{OsimError, WriteError};
use super::include::include_files;
use super::reader;
use super::spec::ModelSpec;

/// An `.osim` file: its text, what it says, and what of it was not understood.
#[derive(Clone, Debug)]
pub struct OsimFile {
    /// The text. Change it through the methods of this type, which keep `spec` in agreement.
    pub document: Document,
    /// What the text says.
    pub spec: ModelSpec,
    /// What was not understood, ignored or changed on reading.
    pub diagnostics: Diagnostics,
}

impl OsimFile {
    /// Reads a model file, with the files of the same format version that its objects name by the attribute `file` in
    /// their place: the model that is written is one file.
    ///
    /// # Errors
    /// [`OsimError`]: the file cannot be read, is not well-formed, is no OpenSim model, has a format version outside
    /// 10901 to 40600, or contains values or references that cannot be used (all of them are listed).
    pub fn read(path: impl AsRef<Path>) -> Result<OsimFile, OsimError> {
        let path = path.as_ref();
        OsimFile::from_document(include_files(Document::read(path)?, path, false).0)
    }

    /// Reads a model from bytes; `file` is the name used in messages.
    ///
    /// # Errors
    /// As [`OsimFile::read`].
    pub fn parse(bytes: impl Into<Vec<u8>>, file: &str) -> Result<OsimFile, OsimError> {
        OsimFile::from_document(Document::parse(bytes.into(), file)?)
    }

    pub(super) fn from_document(document: Document) -> Result<OsimFile, OsimError> {
        let (spec, diagnostics) = reader::read_model(&document)?;
        Ok(OsimFile { document, spec, diagnostics })
    }

    /// The model as OpenSim builds it once another file was read: `<defaults>` of that one hold for it too, where it
    /// does not state its own (`Object::updateDefaultObjectsFromXMLNode`).
    ///
    /// - `earlier`: such as a tool's setup
    /// - `owner`: what has the `<defaults>` there
    ///
    /// # Errors
    /// As [`OsimFile::read`].
    pub fn with_defaults_of(&self, earlier: &Document, owner: ElementId) -> Result<OsimFile, OsimError> {
        OsimFile::from_document(reader::with_defaults_of(earlier, owner, &self.document)?)
    }

    /// What the model is with the forces of files added at the end of its force set, as OpenSim's tools do it
    /// (`AbstractTool::updateModelForces`), and what of each of the files was not understood.
    ///
    /// Every file has its own format version. `<defaults>` of the model and of each file hold for the files behind it
    /// too, property by property, as OpenSim keeps them from file to file. A force whose name the set has already is
    /// left out, with a warning. The file itself stays as it is: elements of [`Location::source`](super::spec::Location::source) 1 and above are not
    /// in its document.
    ///
    /// - `force_sets`: documents with a `<ForceSet>` (before 2.0 `<ActuatorSet>`)
    /// - `replace`: leave out the forces of the model's own set; those among its `<components>` stay
    ///
    /// # Errors
    /// [`OsimError`], with the file of forces that it is about: no force set, a format version that is not read, values
    /// or references that cannot be used.
    pub fn with_force_sets(
        &self,
        force_sets: &[Document],
        replace: bool,
    ) -> Result<(ModelSpec, Vec<Diagnostics>), OsimError> {
        let force_sets = reader::with_earlier_defaults(&self.document, force_sets)?;
        let (spec, _, diagnostics) = reader::read_model_and_forces(&self.document, &force_sets, replace)?;
        Ok((spec, diagnostics))
    }

    /// Writes the file; bytes that were not edited are those that were read.
    ///
    /// # Errors
    /// [`WriteError`]; what was at `path` before is then untouched.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), WriteError> {
        self.document.write(path)
    }
}
