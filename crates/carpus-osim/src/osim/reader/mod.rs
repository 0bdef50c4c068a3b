//! From a [`Document`] to a [`ModelSpec`]: OpenSim's property lookup, defaults, names, sockets and version upgrades.
//!
//! Every element that is read is marked; what remains unmarked is reported by [`leftovers`], so that nothing is
//! dropped silently.

mod actuators;
mod bodies;
mod constraints;
mod defaults;
mod force_sets;
mod forces;
mod format;
mod functions;
mod joints;
mod leftovers;
mod muscles;
mod object;
mod other_muscles;
mod other_paths;
mod paths;
mod pending;
mod plausibility;
mod properties;
mod sets;
mod sockets;
mod state;
mod station_frames;
mod upgrade;

use super::diagnostics::Diagnostics;
use super::document::{Document, ElementId};
use super::error::OsimError;
use super::spec::ModelSpec;
pub(super) use defaults::{with_defaults_of, with_earlier_defaults};
use format::model_element;
use object::{Names, Object};
use state::Reader;

/// Reads the model of a document.
pub(super) fn read_model(document: &Document) -> Result<(ModelSpec, Diagnostics), OsimError> {
    let (spec, diagnostics, _) = read_model_and_forces(document, &[], false)?;
    Ok((spec, diagnostics))
}

/// Reads the model of a document and adds the forces of others: with what was found in the model, and in each of those.
///
/// - `force_sets`: with the defaults of files before them ([`with_earlier_defaults`])
/// - `replace`: whether the forces of the model's own force set are left out
pub(super) fn read_model_and_forces(
    document: &Document,
    force_sets: &[Document],
    replace: bool,
) -> Result<(ModelSpec, Diagnostics, Vec<Diagnostics>), OsimError> {
    let (model, version) = model_element(document)?;
    let mut reader = Reader::new(document, version);
    reader.read(model);
    let diagnostics = reader.take_diagnostics();
    if replace {
        reader.remove_force_set();
    }
    let of_force_sets = reader.add_force_sets(force_sets)?;
    let Reader { problems, spec, .. } = reader;
    if !problems.is_empty() {
        return Err(OsimError::Invalid { problems });
    }
    Ok((spec, diagnostics, of_force_sets))
}

impl Reader<'_> {
    fn read(&mut self, model: ElementId) {
        self.mark(self.document.root());
        self.mark(model);
        self.read_defaults(model);
        let line = self.document.line(model);
        let object = Object { element: Some(model), default: None, path: "/".to_owned(), line };
        self.spec.document_version = self.version.0;
        self.spec.name = self.component_name(model, &mut Names::default(), "/");
        self.spec.gravity = self.vector3(&object, &["gravity"], nalgebra::Vector3::new(0.0, -9.80665, 0.0));
        self.check_units(&object);
        let components = self.model_components(&object);
        self.read_ground_and_bodies(&object, &components);
        self.read_joints(&object, &components);
        self.register_markers(&object);
        self.resolve_offsets();
        self.resolve_station_frames();
        self.read_joint_connections();
        self.read_constraints(&object, &components);
        self.read_forces(&object, &components);
        self.read_markers(&object);
        self.report_implausible();
        self.report_leftovers(model, "");
    }
}
