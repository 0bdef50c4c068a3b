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
mod functions;
mod joints;
mod leftovers;
mod muscles;
mod other_muscles;
mod paths;
mod plausibility;
mod properties;
mod sockets;
mod station_frames;
mod upgrade;

use std::collections::{BTreeSet, HashMap, HashSet};

use super::diagnostics::{Diagnostic, Diagnostics, Severity};
use super::document::{Document, ElementId};
use super::error::{OsimError, Problem, ProblemKind};
use super::spec::{CoordinateIndex, FrameIndex, Location, ModelSpec};
pub(super) use defaults::{with_defaults_of, with_earlier_defaults};
use upgrade::Version;

/// Oldest format that is read, as in OpenSim 4.6.
const OLDEST_VERSION: u32 = 10901;
/// Oldest format of files of forces, that of a file that states none (`XMLDocument::updateDocumentVersion`).
const OLDEST_FORCE_SET: u32 = 10500;
/// Newest format that is read, that of OpenSim 4.6.
const NEWEST_VERSION: u32 = 40600;

/// An OpenSim object in the file, with the place where its class' default values stand.
#[derive(Clone, Debug)]
struct Object {
    /// Its element; `None` if the object is only implied.
    element: Option<ElementId>,
    /// The element of the same class in the model's `<defaults>`.
    default: Option<ElementId>,
    /// Absolute component path.
    path: String,
    /// Line for messages.
    line: usize,
}

/// Path of the model's `<ComponentSet>`.
const COMPONENT_SET: &str = "/componentset";

/// Components of the model that stand in none of its sets of bodies, joints, forces and so on; they act like those.
struct FreeComponents {
    /// In its `<components>`.
    own: Vec<ElementId>,
    /// In its `<ComponentSet>`.
    of_set: Vec<ElementId>,
}

/// State of one reading.
struct Reader<'a> {
    document: &'a Document,
    /// What [`Location::source`] is for components of the document.
    source: usize,
    version: Version,
    /// `<defaults>` by class, under its present name.
    defaults: HashMap<String, ElementId>,
    /// Elements that have been read.
    used: Vec<bool>,
    /// Properties asked for, by tag of the object: the known properties when something unknown is found.
    known: HashMap<String, BTreeSet<&'static str>>,
    problems: Vec<Problem>,
    diagnostics: Diagnostics,
    spec: ModelSpec,
    frames_by_path: HashMap<String, FrameIndex>,
    coordinates_by_path: HashMap<String, CoordinateIndex>,
    /// Frames in the order in which OpenSim visits them when it looks for a wrap object.
    search_order: Vec<FrameIndex>,
    /// Offset frames whose parent is not resolved yet.
    unresolved: Vec<sockets::UnresolvedOffset>,
    /// Stations and markers by path.
    stations: HashMap<String, ElementId>,
    /// Frames given by stations that are not resolved yet.
    pending_station_frames: Vec<station_frames::PendingStationFrame>,
    /// Joints, in the order of the model, whose frames are not resolved yet.
    pending_joints: Vec<joints::PendingJoint>,
}

/// Characters that begin a line or a column of a table; OpenSim 4.6 refuses them in names.
const LINES_AND_COLUMNS: [char; 2] = ['\n', '\t'];

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
    let mut reader = Reader {
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
    };
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

/// The `<Model>` element and the format version.
fn model_element(document: &Document) -> Result<(ElementId, Version), OsimError> {
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
fn format_version(document: &Document, oldest: u32) -> Result<Version, OsimError> {
    let root = document.root();
    let found = document.attribute(root, "Version").unwrap_or_default();
    let version: u32 = found.trim().parse().unwrap_or(0);
    if (oldest..=NEWEST_VERSION).contains(&version) {
        return Ok(Version(version));
    }
    let (file, line) = (document.file().to_owned(), document.line(root));
    Err(OsimError::UnsupportedVersion { file, line, found, oldest, newest: NEWEST_VERSION })
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

    /// What was found so far, in the order of the file.
    fn take_diagnostics(&mut self) -> Diagnostics {
        let mut diagnostics = std::mem::take(&mut self.diagnostics);
        diagnostics.sort();
        diagnostics
    }

    fn read_defaults(&mut self, owner: ElementId) {
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

    fn check_units(&mut self, model: &Object) {
        for (property, expected) in [("length_units", "meters"), ("force_units", "N")] {
            let Some(element) = self.property(model, &[property]) else { continue };
            let found = self.document.text(element);
            let same = found.eq_ignore_ascii_case(expected)
                || (property == "length_units" && ["m", "meter", "metres"].contains(&found.to_lowercase().as_str()))
                || (property == "force_units" && found.eq_ignore_ascii_case("newtons"))
                || found.is_empty();
            if !same {
                let message = format!("{property} is \"{found}\"; numbers are taken as {expected}, as in OpenSim");
                self.diagnose(Severity::Warning, element, "/", message, None);
            }
        }
    }

    /// Elements of the model's own `<components>` list and of its `<ComponentSet>`.
    fn model_components(&mut self, model: &Object) -> FreeComponents {
        let own = model.element.and_then(|element| self.document.child(element, "components"));
        if let Some(list) = own {
            self.mark(list);
        }
        let own = own.map_or_else(Vec::new, |list| self.document.children(list).to_vec());
        FreeComponents { own, of_set: self.set_objects(model, &["ComponentSet"]) }
    }

    /// Elements of a set (`<BodySet><objects>…`) that is a child of the model.
    fn set_objects(&mut self, model: &Object, tags: &[&'static str]) -> Vec<ElementId> {
        let Some(set) = self.property(model, tags) else { return Vec::new() };
        self.mark(set);
        let Some(objects) = self.document.child(set, "objects") else { return Vec::new() };
        self.mark(objects);
        self.document.children(objects).to_vec()
    }

    /// Objects of a set, those of the model's `<components>` with one of the classes before and those of its
    /// `<ComponentSet>` behind, each with the path of its owner.
    fn set_and_components(
        &mut self,
        model: &Object,
        tags: &[&'static str],
        owner: &'static str,
        components: &FreeComponents,
        belongs: fn(&str) -> bool,
    ) -> Vec<(ElementId, &'static str)> {
        let objects = self.set_objects(model, tags);
        let belongs = |element: &&ElementId| belongs(self.document.tag(**element));
        let before = components.own.iter().filter(belongs).map(|&element| (element, ""));
        let behind = components.of_set.iter().filter(belongs).map(|&element| (element, COMPONENT_SET));
        before.chain(objects.into_iter().map(|element| (element, owner))).chain(behind).collect()
    }

    fn mark(&mut self, element: ElementId) {
        self.used[element.0] = true;
    }

    /// The object at an element: marks it as read and finds its class' defaults.
    fn object(&mut self, element: ElementId, owner: &str, name: &str) -> Object {
        self.mark(element);
        let default = self.defaults.get(upgrade::present_class(self.document.tag(element))).copied();
        let path = if owner == "/" { format!("/{name}") } else { format!("{owner}/{name}") };
        Object { element: Some(element), default, path, line: self.document.line(element) }
    }

    fn location(&self, object: &Object) -> Location {
        let element = object.element.map(|element| element.0);
        Location { source: self.source, line: object.line, path: object.path.clone(), element }
    }

    /// Name of a component as OpenSim 4.6 gives it: without white space in old files, the class in lower case if
    /// there is none, made unique among `names` (those of the same owner).
    fn component_name(&mut self, element: ElementId, names: &mut Names, owner: &str) -> String {
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

    fn diagnose(&mut self, severity: Severity, element: ElementId, path: &str, message: String, hint: Option<String>) {
        let line = self.document.line(element);
        let path = if path.is_empty() { "/" } else { path }.to_owned();
        self.diagnostics.items.push(Diagnostic { severity, line, path, message, hint, also_at: Vec::new() });
    }

    fn problem(&mut self, line: usize, path: &str, kind: ProblemKind) {
        let path = if path.is_empty() { "/" } else { path }.to_owned();
        self.problems.push(Problem { file: self.document.file().to_owned(), line, path, kind });
    }
}

/// Names given so far to the components of one owner.
#[derive(Default)]
struct Names(HashSet<String>);

impl Names {
    /// `name`, or `name_0`, `name_1`, … whichever is free, as in `Component::finalizeFromProperties`.
    fn unique(&mut self, name: &str) -> String {
        let mut unique = name.to_owned();
        let mut count = 0;
        while !self.0.insert(unique.clone()) {
            unique = format!("{name}_{count}");
            count += 1;
        }
        unique
    }
}
