//! A model in the current format, written from its specification: `carpus upgrade`.
//!
//! Files from format 40000 on keep their text: only what OpenSim 4.6 itself changes on loading is changed. Older ones
//! are written anew; what the specification does not hold is listed.

mod bodies;
mod forces;
mod format;
mod functions;
mod joints;
mod muscles;
mod recent;
mod xml;

use super::diagnostics::{Diagnostics, Severity};
use super::document::Document;
use super::error::OsimError;
use super::file::OsimFile;
use super::spec::{FrameIndex, FrameKind, ModelSpec};
pub use format::CURRENT_FORMAT;
use format::own;
use xml::Xml;

/// Formats from here on keep their text.
const RECENT: u32 = 40000;

/// A file in the current format.
#[derive(Clone, Debug)]
pub struct Upgraded {
    /// The file.
    pub file: OsimFile,
    /// Line and description of what of the old file is not in it.
    pub left_out: Vec<(usize, String)>,
}

impl OsimFile {
    /// The same model in the format of OpenSim 4.6.
    ///
    /// # Errors
    /// The new text cannot be read again: a defect of this program.
    pub fn upgraded(&self) -> Result<Upgraded, OsimError> {
        if self.spec.document_version >= RECENT {
            return Ok(Upgraded { file: recent::upgraded(self)?, left_out: Vec::new() });
        }
        let mut writer = Writer { file: self, spec: &self.spec, xml: Xml::default(), left_out: Vec::new() };
        writer.model();
        let Writer { xml, mut left_out, .. } = writer;
        left_out.extend(self.unwritten());
        left_out.sort();
        let name = self.document.file().to_owned();
        Ok(Upgraded { file: OsimFile::parse(xml.finish().into_bytes(), &name)?, left_out })
    }

    /// The file of a model that was made as a specification, in the format of OpenSim 4.6; what of it no file can hold
    /// comes with it.
    ///
    /// - `name`: stands for the file in messages
    ///
    /// # Errors
    /// The specification is no model that a file can state: names twice, references that lead nowhere.
    pub fn of_spec(spec: &ModelSpec, name: &str) -> Result<Upgraded, OsimError> {
        let document = Document::parse(b"<OpenSimDocument><Model/></OpenSimDocument>".to_vec(), name).map_err(own)?;
        let mut spec = spec.clone();
        // Elements are of the document that the specification was read from, if it was.
        spec.frames.iter_mut().for_each(|frame| frame.at.element = None);
        spec.bodies.iter_mut().for_each(|body| body.at.element = None);
        let file = OsimFile { document, spec, diagnostics: Diagnostics::default() };
        let mut writer = Writer { file: &file, spec: &file.spec, xml: Xml::default(), left_out: Vec::new() };
        writer.model();
        let Writer { xml, left_out, .. } = writer;
        Ok(Upgraded { file: OsimFile::parse(xml.finish().into_bytes(), name)?, left_out })
    }

    /// What reading found and writing does not know of.
    fn unwritten(&self) -> Vec<(usize, String)> {
        const KNOWN: [&str; 4] = ["VisibleObject", "credits", "publications", "fixed"];
        let found = self.diagnostics.items.iter().filter(|item| {
            // OpenSim does not use such a property either.
            if item.message.contains("is not a property that is used in") {
                return false;
            }
            let unread = item.severity == Severity::Unsupported && item.message.ends_with("is not supported");
            let controller = item.message.contains("excitations come from the study");
            let ignored = item.severity == Severity::Ignored
                && item.message.starts_with('<')
                && !KNOWN.iter().any(|tag| item.message.starts_with(&format!("<{tag}>")));
            unread || controller || ignored || item.message.ends_with("only reports")
        });
        let text = |message: &str| match message.strip_prefix('<').and_then(|rest| rest.split_once('>')) {
            Some((tag, _)) => format!("<{tag}>"),
            None => message.split([' ', ':']).next().unwrap_or_default().to_owned(),
        };
        found.map(|item| (item.line, format!("{}: {}", item.path, text(&item.message)))).collect()
    }
}

/// State of one writing.
struct Writer<'a> {
    file: &'a OsimFile,
    spec: &'a ModelSpec,
    xml: Xml,
    left_out: Vec<(usize, String)>,
}

impl Writer<'_> {
    fn model(&mut self) {
        let spec = self.spec;
        let version = CURRENT_FORMAT.to_string();
        self.xml.open("OpenSimDocument", &[("Version", &version)]);
        // OpenSim takes white space from the names of such files.
        let name: String = spec.name.split_whitespace().collect();
        self.xml.open("Model", &[("name", &name)]);
        self.texts(&["credits", "publications", "length_units", "force_units"]);
        self.xml.vector("gravity", &spec.gravity);
        self.bodies();
        self.joints();
        self.constraints();
        self.forces();
        self.markers();
        self.xml.close();
        self.xml.close();
    }

    /// Properties of the model that are text.
    fn texts(&mut self, tags: &[&str]) {
        let document = &self.file.document;
        let Some(model) = document.children(document.root()).first() else { return };
        for tag in tags {
            if let Some(element) = document.child(*model, tag) {
                self.xml.text(tag, &document.text(element));
            }
        }
    }

    /// Path of a frame.
    fn frame(&self, frame: FrameIndex) -> String {
        self.spec.frames[frame.0].at.path.clone()
    }

    /// Path of a coordinate.
    fn coordinate(&self, coordinate: super::spec::CoordinateIndex) -> String {
        self.spec.coordinates[coordinate.0].at.path.clone()
    }

    /// Offset frames that a component owns, in a list of the given name.
    fn owned_frames(&mut self, owner: &str, list: &str) {
        let prefix = if owner == "/" { "/".to_owned() } else { format!("{owner}/") };
        let owned: Vec<usize> = (0..self.spec.frames.len())
            .filter(|i| {
                let frame = &self.spec.frames[*i];
                let rest = frame.at.path.strip_prefix(&prefix);
                matches!(frame.kind, FrameKind::Offset { .. }) && rest.is_some_and(|rest| !rest.contains('/'))
            })
            .collect();
        if owned.is_empty() {
            return;
        }
        self.xml.open(list, &[]);
        for i in owned {
            let frame = &self.spec.frames[i];
            let FrameKind::Offset { parent, translation, orientation } = frame.kind else { continue };
            self.xml.open("PhysicalOffsetFrame", &[("name", &frame.name)]);
            self.owned_frames(&frame.at.path.clone(), "components");
            self.wrap_objects(FrameIndex(i));
            let parent = self.frame(parent);
            self.xml.text("socket_parent", &parent);
            self.xml.vector("translation", &translation);
            self.xml.vector("orientation", &orientation);
            self.xml.close();
        }
        self.xml.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_specification_becomes_a_file_that_says_the_same() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/wrist.osim");
        let read = OsimFile::read(path).unwrap();
        let made = OsimFile::of_spec(&read.spec, "made.osim").unwrap();
        assert!(made.left_out.is_empty(), "{:?}", made.left_out);
        let (a, b) = (&read.spec, &made.file.spec);
        assert_eq!(a.coordinates.len(), b.coordinates.len());
        assert!(!a.muscles.is_empty());
        for (a, b) in a.muscles.iter().zip(&b.muscles) {
            assert_eq!(
                (&a.name, a.tendon_slack_length, a.path.points.len()),
                (&b.name, b.tendon_slack_length, b.path.points.len())
            );
        }
        for (a, b) in a.bodies.iter().zip(&b.bodies) {
            assert_eq!((&a.name, a.mass, a.mass_center, a.inertia), (&b.name, b.mass, b.mass_center, b.inertia));
        }
    }
}
