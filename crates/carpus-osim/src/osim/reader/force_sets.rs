//! Files of forces that OpenSim's tools add to a model (`AbstractTool::updateModelForces`, `ForceSet::append`).

use std::collections::HashSet;

use super::format::{OLDEST_FORCE_SET, format_version};
use super::object::Names;
use super::state::Reader;
use super::upgrade::Version;
use crate::osim::diagnostics::{Diagnostics, Severity};
use crate::osim::document::{Document, ElementId};
use crate::osim::error::OsimError;
use crate::osim::spec::{Location, is_in_force_set};

/// Path of the force set.
const FORCE_SET: &str = "/forceset";

/// The `<ForceSet>` of a document, under its root or, in the oldest files, the root itself; and the format version.
pub(super) fn force_set_element(document: &Document) -> Result<(ElementId, Version), OsimError> {
    let set = document.object();
    let version = match set == document.root() {
        true => Version(OLDEST_FORCE_SET),
        false => format_version(document, OLDEST_FORCE_SET)?,
    };
    if ["ForceSet", "ActuatorSet"].contains(&document.tag(set)) {
        return Ok((set, version));
    }
    let (file, line, found) = (document.file().to_owned(), document.line(set), format!("<{}>", document.tag(set)));
    Err(OsimError::NotAForceSet { file, line, found })
}

impl<'a> Reader<'a> {
    /// Takes the forces of the force set away, after everything that belongs to them was read.
    pub(super) fn remove_force_set(&mut self) {
        let stays = |at: &Location| !at.is_in_force_set();
        self.spec.muscles.retain(|muscle| stays(&muscle.at));
        self.spec.forces.retain(|force| stays(&force.at));
        self.frames_by_path.retain(|path, _| !is_in_force_set(path));
    }

    /// Reads the forces of documents behind those that there are; what was found in each document.
    ///
    /// A force whose name another one of the set has already is left out, as in OpenSim: also one of the same file, and
    /// one without a name behind another without.
    ///
    /// # Errors
    /// A document that has no force set, or a format version that is not read.
    pub(super) fn add_force_sets(&mut self, documents: &'a [Document]) -> Result<Vec<Diagnostics>, OsimError> {
        let muscles = self.spec.muscles.iter().map(|muscle| (&muscle.at, &muscle.name));
        let all = muscles.chain(self.spec.forces.iter().map(|force| (&force.at, &force.name)));
        let written: HashSet<String> =
            all.filter(|(at, _)| at.is_in_force_set()).map(|(_, name)| name.clone()).collect();
        let mut names = (Names(written.clone()), written);
        let mut diagnostics = Vec::with_capacity(documents.len());
        for (i, document) in documents.iter().enumerate() {
            let (set, version) = force_set_element(document)?;
            (self.document, self.source, self.version) = (document, i + 1, version);
            self.used = vec![false; document.n_elements()];
            self.defaults.clear();
            self.add_force_set(set, &mut names);
            diagnostics.push(self.take_diagnostics());
        }
        Ok(diagnostics)
    }

    /// - `names`: unique ones of components, and those that the files give
    fn add_force_set(&mut self, set: ElementId, (names, written): &mut (Names, HashSet<String>)) {
        self.read_defaults(set);
        let objects = self.document.child(set, "objects");
        if let Some(objects) = objects {
            self.mark(objects);
        }
        for &element in objects.map_or(&[][..], |objects| self.document.children(objects)) {
            let name = self.reference(&self.document.attribute(element, "name").unwrap_or_default());
            if written.insert(name.clone()) {
                self.read_force(element, FORCE_SET, names);
                continue;
            }
            self.mark_all(element);
            let message = format!("force \"{name}\" is left out, as in OpenSim: the force set has one of this name");
            self.diagnose(Severity::Warning, element, FORCE_SET, message, Some("give it another name".to_owned()));
        }
        self.report_leftovers(set, FORCE_SET);
    }

    /// Takes an element and everything in it as read.
    pub(super) fn mark_all(&mut self, element: ElementId) {
        self.mark(element);
        for &child in self.document.children(element) {
            self.mark_all(child);
        }
    }
}
