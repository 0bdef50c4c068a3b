//! The state of one reading, and what every part of it does.

use std::collections::{BTreeSet, HashMap};

use super::object::{Names, Object};
use super::pending::{PendingJoint, PendingStationFrame, UnresolvedOffset};
use super::upgrade::{self, Version};
use crate::osim::diagnostics::{Diagnostic, Diagnostics, Severity};
use crate::osim::document::{Document, ElementId};
use crate::osim::error::{Problem, ProblemKind};
use crate::osim::spec::{CoordinateIndex, FrameIndex, Location, ModelSpec};

/// State of one reading.
pub(super) struct Reader<'a> {
    pub(super) document: &'a Document,
    /// What [`Location::source`] is for components of the document.
    pub(super) source: usize,
    pub(super) version: Version,
    /// `<defaults>` by class, under its present name.
    pub(super) defaults: HashMap<String, ElementId>,
    /// Elements that have been read.
    pub(super) used: Vec<bool>,
    /// Properties asked for, by tag of the object: the known properties when something unknown is found.
    pub(super) known: HashMap<String, BTreeSet<&'static str>>,
    pub(super) problems: Vec<Problem>,
    pub(super) diagnostics: Diagnostics,
    pub(super) spec: ModelSpec,
    pub(super) frames_by_path: HashMap<String, FrameIndex>,
    pub(super) coordinates_by_path: HashMap<String, CoordinateIndex>,
    /// Frames in the order in which OpenSim visits them when it looks for a wrap object.
    pub(super) search_order: Vec<FrameIndex>,
    /// Offset frames whose parent is not resolved yet.
    pub(super) unresolved: Vec<UnresolvedOffset>,
    /// Stations and markers by path.
    pub(super) stations: HashMap<String, ElementId>,
    /// Frames given by stations that are not resolved yet.
    pub(super) pending_station_frames: Vec<PendingStationFrame>,
    /// Joints, in the order of the model, whose frames are not resolved yet.
    pub(super) pending_joints: Vec<PendingJoint>,
}

/// Characters that begin a line or a column of a table; OpenSim 4.6 refuses them in names.
const LINES_AND_COLUMNS: [char; 2] = ['\n', '\t'];

impl Reader<'_> {
    /// Nothing was read yet.
    pub(super) fn new(document: &Document, version: Version) -> Reader<'_> {
        Reader {
            document,
            source: 0,
            version,
            defaults: HashMap::new(),
            used: vec![false; document.n_elements()],
            known: HashMap::new(),
            problems: Vec::new(),
            diagnostics: Diagnostics::default(),
            spec: ModelSpec::default(),
            frames_by_path: HashMap::new(),
            coordinates_by_path: HashMap::new(),
            search_order: Vec::new(),
            unresolved: Vec::new(),
            stations: HashMap::new(),
            pending_station_frames: Vec::new(),
            pending_joints: Vec::new(),
        }
    }

    /// What was found so far, in the order of the file.
    pub(super) fn take_diagnostics(&mut self) -> Diagnostics {
        let mut diagnostics = std::mem::take(&mut self.diagnostics);
        diagnostics.sort();
        diagnostics
    }

    pub(super) fn read_defaults(&mut self, owner: ElementId) {
        let Some(defaults) = self.document.child(owner, "defaults") else { return };
        self.mark(defaults);
        for &child in self.document.children(defaults) {
            // OpenSim looks for present names only, and applies them to objects of old names too.
            let class = self.document.tag(child);
            if upgrade::present_class(class) == class {
                self.defaults.entry(class.to_owned()).or_insert(child);
            }
        }
    }

    pub(super) fn mark(&mut self, element: ElementId) {
        self.used[element.0] = true;
    }

    /// The object at an element: marks it as read and finds its class' defaults.
    pub(super) fn object(&mut self, element: ElementId, owner: &str, name: &str) -> Object {
        self.mark(element);
        let default = self.defaults.get(upgrade::present_class(self.document.tag(element))).copied();
        let path = if owner == "/" { format!("/{name}") } else { format!("{owner}/{name}") };
        Object { element: Some(element), default, path, line: self.document.line(element) }
    }

    pub(super) fn location(&self, object: &Object) -> Location {
        let element = object.element.map(|element| element.0);
        Location { source: self.source, line: object.line, path: object.path.clone(), element }
    }

    /// Name of a component as OpenSim 4.6 gives it: without white space in old files, the class in lower case if
    /// there is none, made unique among `names` (those of the same owner).
    pub(super) fn component_name(&mut self, element: ElementId, names: &mut Names, owner: &str) -> String {
        let written = self.document.attribute(element, "name").unwrap_or_default();
        let mut name = written.clone();
        if self.version.strips_white_space_from_names() {
            name.retain(|c| !c.is_whitespace());
        }
        if let Some(found) = name.chars().find(|c| LINES_AND_COLUMNS.contains(c)) {
            let line = self.document.line(element);
            self.problem(line, owner, ProblemKind::NameOfLines { name: name.clone(), found });
            name = name.replace(LINES_AND_COLUMNS, " ");
        }
        if name.is_empty() {
            name = upgrade::present_class(self.document.tag(element)).to_lowercase();
        }
        let unique = names.unique(&name);
        if unique != name && !written.is_empty() {
            let message = format!("name \"{name}\" is used twice; this one is called \"{unique}\", as in OpenSim");
            self.diagnose(Severity::Warning, element, owner, message, None);
        }
        unique
    }

    pub(super) fn diagnose(
        &mut self,
        severity: Severity,
        element: ElementId,
        path: &str,
        message: String,
        hint: Option<String>,
    ) {
        let line = self.document.line(element);
        let path = if path.is_empty() { "/" } else { path }.to_owned();
        self.diagnostics.items.push(Diagnostic { severity, line, path, message, hint, also_at: Vec::new() });
    }

    pub(super) fn problem(&mut self, line: usize, path: &str, kind: ProblemKind) {
        let path = if path.is_empty() { "/" } else { path }.to_owned();
        self.problems.push(Problem { file: self.document.file().to_owned(), line, path, kind });
    }
}
