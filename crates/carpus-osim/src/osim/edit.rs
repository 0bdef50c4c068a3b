//! Edits: splices into the text, after which specification and text agree again.
//!
//! An edit changes the bytes of one value or inserts one property or component with the file's own indentation and
//! line ends; everything else stays. Each edit is checked by reading the new text: one that would make the model
//! invalid is refused and leaves the file as it was.

mod error;
pub(super) mod splice;

use super::document::{Document, ElementId, escape};
use super::error::nearest;
use super::file::OsimFile;
use super::reader;
use super::spec::{Location, MuscleKind, MuscleSpec, OtherMuscleSpec, PathSpec};
pub use error::EditError;
pub use splice::format_number;
use splice::{Splice, insertion, lines, value_edit};

/// Properties of every muscle that [`OsimFile::set_muscle_property`] can set.
const MUSCLE_PROPERTIES: [&str; 7] = [
    "max_isometric_force",
    "optimal_fiber_length",
    "tendon_slack_length",
    "pennation_angle_at_optimal",
    "max_contraction_velocity",
    "min_control",
    "max_control",
];

/// Further properties of `Thelen2003Muscle`.
const THELEN_PROPERTIES: [&str; 13] = [
    "FmaxTendonStrain",
    "FmaxMuscleStrain",
    "KshapeActive",
    "KshapePassive",
    "Af",
    "Flen",
    "fv_linear_extrap_threshold",
    "maximum_pennation_angle",
    "activation_time_constant",
    "deactivation_time_constant",
    "minimum_activation",
    "default_activation",
    "default_fiber_length",
];

/// Further properties of `DeGrooteFregly2016Muscle`.
const DEGROOTE_PROPERTIES: [&str; 9] = [
    "activation_time_constant",
    "deactivation_time_constant",
    "default_activation",
    "default_normalized_tendon_force",
    "active_force_width_scale",
    "fiber_damping",
    "passive_fiber_strain_at_one_norm_force",
    "tendon_strain_at_one_norm_force",
    "activation_dynamics_smoothing",
];

/// Further properties of `Schutte1993Muscle_Deprecated` and `Delp1990Muscle_Deprecated`.
const DEPRECATED_PROPERTIES: [&str; 3] = ["time_scale", "activation1", "activation2"];

/// Further properties of `Millard2012EquilibriumMuscle`; those of a curve are written `Curve/property`.
const MILLARD_PROPERTIES: [&str; 29] = [
    "fiber_damping",
    "default_fiber_length",
    "default_activation",
    "minimum_activation",
    "activation_time_constant",
    "deactivation_time_constant",
    "maximum_pennation_angle",
    "ActiveForceLengthCurve/min_norm_active_fiber_length",
    "ActiveForceLengthCurve/transition_norm_fiber_length",
    "ActiveForceLengthCurve/max_norm_active_fiber_length",
    "ActiveForceLengthCurve/shallow_ascending_slope",
    "ActiveForceLengthCurve/minimum_value",
    "ForceVelocityCurve/concentric_slope_at_vmax",
    "ForceVelocityCurve/concentric_slope_near_vmax",
    "ForceVelocityCurve/isometric_slope",
    "ForceVelocityCurve/eccentric_slope_at_vmax",
    "ForceVelocityCurve/eccentric_slope_near_vmax",
    "ForceVelocityCurve/max_eccentric_velocity_force_multiplier",
    "ForceVelocityCurve/concentric_curviness",
    "ForceVelocityCurve/eccentric_curviness",
    "FiberForceLengthCurve/strain_at_zero_force",
    "FiberForceLengthCurve/strain_at_one_norm_force",
    "FiberForceLengthCurve/stiffness_at_low_force",
    "FiberForceLengthCurve/stiffness_at_one_norm_force",
    "FiberForceLengthCurve/curviness",
    "TendonForceLengthCurve/strain_at_one_norm_force",
    "TendonForceLengthCurve/stiffness_at_one_norm_force",
    "TendonForceLengthCurve/norm_force_at_toe_end",
    "TendonForceLengthCurve/curviness",
];

/// Sets of a model that components can be added to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComponentSet {
    /// `BodySet`.
    Bodies,
    /// `JointSet` (formats from 30501; before, joints stand in bodies).
    Joints,
    /// `ConstraintSet`.
    Constraints,
    /// `ForceSet`.
    Forces,
    /// `MarkerSet`.
    Markers,
}

impl ComponentSet {
    fn tag(self) -> &'static str {
        match self {
            ComponentSet::Bodies => "BodySet",
            ComponentSet::Joints => "JointSet",
            ComponentSet::Constraints => "ConstraintSet",
            ComponentSet::Forces => "ForceSet",
            ComponentSet::Markers => "MarkerSet",
        }
    }
}

/// New values of muscle properties: muscle, property, value in the file's unit.
pub type MusclePropertyChange<'a> = (&'a str, &'a str, f64);

impl OsimFile {
    /// Sets a property of a muscle, in OpenSim's unit (m, N, rad); exactly the line of that property changes. A
    /// property that the file does not give is added to the muscle. A curve's property is written `Curve/property`,
    /// e.g. `FiberForceLengthCurve/strain_at_one_norm_force`.
    ///
    /// # Errors
    /// [`EditError`]: unknown or ambiguous muscle, unknown property, a value that is not a number or that makes the
    /// model invalid. The file is then unchanged.
    pub fn set_muscle_property(&mut self, muscle: &str, property: &str, value: f64) -> Result<(), EditError> {
        self.set_muscle_properties(&[(muscle, property, value)])
    }

    /// Sets several properties of muscles; all or none.
    ///
    /// # Errors
    /// As [`OsimFile::set_muscle_property`].
    pub fn set_muscle_properties(&mut self, changes: &[MusclePropertyChange<'_>]) -> Result<(), EditError> {
        let before = self.clone();
        let result = self.change_muscles(changes);
        if result.is_err() {
            *self = before;
        }
        result
    }

    fn change_muscles(&mut self, changes: &[MusclePropertyChange<'_>]) -> Result<(), EditError> {
        // Values that the file gives are replaced first, all at once: that keeps element handles valid.
        let mut edits: Vec<Splice> = Vec::new();
        let mut absent = Vec::new();
        for &(name, property, value) in changes {
            if value.is_nan() {
                let (muscle, property) = (name.to_owned(), property.to_owned());
                return Err(EditError::NotANumber { muscle, property, value });
            }
            let muscle = self.muscle_element(name, property)?;
            match self.existing(muscle, property) {
                Some(element) => {
                    let edit = value_edit(&self.document, element, property, &format_number(value))?;
                    edits.retain(|(range, _)| *range != edit.0);
                    edits.push(edit);
                }
                None => absent.push((name, property, value)),
            }
        }
        self.apply(edits)?;
        for (name, property, value) in absent {
            let muscle = self.muscle_element(name, property)?;
            self.set_in(muscle, property, &format_number(value))?;
        }
        Ok(())
    }

    /// Sets the text of a property of the component at an absolute path (`/bodyset/hand`,
    /// `/forceset/ECRL/path/ECRL-P1`); adds the property if the file does not give it. A nested object's property is
    /// written `Class/property`.
    ///
    /// # Errors
    /// [`EditError`]: unknown component, a property that holds components, text that makes the model invalid. The file
    /// is then unchanged.
    pub fn set_property(&mut self, path: &str, property: &str, text: &str) -> Result<(), EditError> {
        let element = self.component(path)?;
        let before = self.clone();
        let result = self.set_in(element, property, text);
        if result.is_err() {
            *self = before;
        }
        result
    }

    /// Sets several properties of components, given by path, property and text; all or none.
    ///
    /// # Errors
    /// As [`OsimFile::set_property`].
    pub fn set_properties(&mut self, changes: &[(&str, &str, String)]) -> Result<(), EditError> {
        let before = self.clone();
        let result = self.change_properties(changes);
        if result.is_err() {
            *self = before;
        }
        result
    }

    fn change_properties(&mut self, changes: &[(&str, &str, String)]) -> Result<(), EditError> {
        // Values that the file gives are replaced first, all at once: that keeps element handles valid.
        let (mut edits, mut absent) = (Vec::new(), Vec::new());
        for (path, property, text) in changes {
            match self.existing(self.component(path)?, property) {
                Some(element) => {
                    let edit = value_edit(&self.document, element, property, text)?;
                    edits.retain(|(range, _): &Splice| *range != edit.0);
                    edits.push(edit);
                }
                None => absent.push((path, property, text)),
            }
        }
        self.apply(edits)?;
        for (path, property, text) in absent {
            self.set_in(self.component(path)?, property, text)?;
        }
        Ok(())
    }

    /// Removes the components at absolute paths, each with the line on which it begins.
    ///
    /// # Errors
    /// [`EditError`]: unknown component, or something that the model cannot be without. The file is then unchanged.
    pub fn remove_components(&mut self, paths: &[&str]) -> Result<(), EditError> {
        let mut edits: Vec<Splice> = Vec::new();
        for path in paths {
            let range = self.document.range(self.component(path)?);
            let before = &self.document.bytes()[..range.start];
            edits.push((before.trim_ascii_end().len()..range.end, String::new()));
        }
        edits.sort_by_key(|(range, _)| range.start);
        edits.dedup();
        self.apply(edits)
    }

    /// Adds a force, given as one element (`<CoordinateLimitForce name="…">…`), at the end of the force set.
    ///
    /// # Errors
    /// As [`OsimFile::add_component`].
    pub fn add_force(&mut self, fragment: &str) -> Result<(), EditError> {
        self.add_component(ComponentSet::Forces, fragment)
    }

    /// Adds a force of a class whose properties are plain values, at the end of the force set.
    ///
    /// - `properties`: names and texts, in the order in which they are written
    ///
    /// # Errors
    /// As [`OsimFile::add_component`].
    pub fn add_force_of(&mut self, class: &str, name: &str, properties: &[(&str, String)]) -> Result<(), EditError> {
        let mut fragment = format!("<{class} name=\"{}\">\n", escape(name));
        for (property, text) in properties {
            fragment.push_str(&format!("\t<{property}>{}</{property}>\n", escape(text)));
        }
        fragment.push_str(&format!("</{class}>"));
        self.add_force(&fragment)
    }

    /// Adds a component, given as one element, at the end of a set; the set is created if the model has none. The
    /// fragment's own indentation is replaced by that of the file.
    ///
    /// # Errors
    /// [`EditError`]: the fragment is not one element, or the model would become invalid. The file is then unchanged.
    pub fn add_component(&mut self, set: ComponentSet, fragment: &str) -> Result<(), EditError> {
        self.add_components(set, &[fragment.to_owned()])
    }

    /// Adds components at the end of a set; all or none.
    ///
    /// # Errors
    /// As [`OsimFile::add_component`].
    pub fn add_components(&mut self, set: ComponentSet, fragments: &[String]) -> Result<(), EditError> {
        if fragments.is_empty() {
            return Ok(());
        }
        for fragment in fragments {
            Document::parse(fragment.trim().as_bytes().to_vec(), "fragment").map_err(EditError::Fragment)?;
        }
        let fragment = &fragments.iter().map(|f| f.trim()).collect::<Vec<_>>().join("\n");
        let tag = set.tag();
        let Some(&model) = self.document.children(self.document.root()).first() else {
            return Err(EditError::UnknownComponent {
                file: self.document.file().to_owned(),
                path: "/".to_owned(),
                nearest: None,
            });
        };
        let edits = match self.document.child(model, tag) {
            Some(set) => match self.document.child(set, "objects") {
                Some(objects) => insertion(&self.document, objects, fragment),
                None => insertion(&self.document, set, &lines(&["<objects>", fragment, "</objects>"])),
            },
            None => {
                let open = format!("<{tag} name=\"{}\">", tag.to_lowercase());
                let close = format!("</{tag}>");
                let inner = lines(&["<objects>", fragment, "</objects>"]);
                insertion(&self.document, model, &lines(&[&open, &inner, &close]))
            }
        };
        self.apply(edits)
    }

    /// The element of the muscle with this name, which has to be the only one and to have the property.
    fn muscle_element(&self, name: &str, property: &str) -> Result<ElementId, EditError> {
        let file = || self.document.file().to_owned();
        let written = |muscle: &&MuscleSpec| {
            let element = muscle.at.element.map(ElementId);
            element.and_then(|element| self.document.attribute(element, "name")).as_deref() == Some(name)
        };
        let mut found: Vec<&MuscleSpec> = self.spec.muscles.iter().filter(written).collect();
        if found.is_empty() {
            found = self.spec.muscles.iter().filter(|muscle| muscle.name == name).collect();
        }
        let muscle = match found[..] {
            [muscle] => muscle,
            [] => {
                let names = self.spec.muscles.iter().map(|muscle| muscle.name.as_str());
                return Err(EditError::UnknownMuscle {
                    file: file(),
                    name: name.to_owned(),
                    nearest: nearest(name, names),
                });
            }
            _ => {
                let lines = found.iter().map(|muscle| muscle.at.line).collect();
                return Err(EditError::AmbiguousMuscle { file: file(), name: name.to_owned(), lines });
            }
        };
        let of_class: &[&str] = match &muscle.kind {
            MuscleKind::Millard2012Equilibrium(_) => &MILLARD_PROPERTIES,
            MuscleKind::OtherClass { law, .. } => match law.as_deref() {
                Some(OtherMuscleSpec::Thelen2003(_)) => &THELEN_PROPERTIES,
                Some(OtherMuscleSpec::DeGrooteFregly2016(_)) => &DEGROOTE_PROPERTIES,
                Some(OtherMuscleSpec::Deprecated(_)) => &DEPRECATED_PROPERTIES,
                Some(OtherMuscleSpec::RigidTendon(_)) | None => &[],
            },
        };
        let mut known = MUSCLE_PROPERTIES.iter().chain(of_class);
        match muscle.at.element {
            Some(element) if known.any(|&known| known == property) => Ok(ElementId(element)),
            _ => Err(EditError::UnknownProperty {
                file: file(),
                line: muscle.at.line,
                path: muscle.at.path.clone(),
                property: property.to_owned(),
                nearest: nearest(property, MUSCLE_PROPERTIES.iter().chain(of_class).copied()),
            }),
        }
    }

    /// The element of a property (`Curve/property` for nested ones), if the file gives it.
    fn existing(&self, owner: ElementId, property: &str) -> Option<ElementId> {
        let found = property.split('/').try_fold(owner, |at, tag| self.document.child(at, tag));
        let old_name = (property == "pennation_angle_at_optimal").then_some("pennation_angle");
        found.or_else(|| self.document.child(owner, old_name?))
    }

    fn set_in(&mut self, owner: ElementId, property: &str, text: &str) -> Result<(), EditError> {
        if let Some(element) = self.existing(owner, property) {
            let edit = value_edit(&self.document, element, property, text)?;
            return self.apply(vec![edit]);
        }
        let value = escape(text);
        match property.split_once('/') {
            None => self.apply(insertion(&self.document, owner, &format!("<{property}>{value}</{property}>"))),
            Some((object, inner)) => match self.document.child(owner, object) {
                Some(element) => self.set_in(element, inner, text),
                None => {
                    let fragment = self.new_nested_object(owner, object);
                    self.apply(insertion(&self.document, owner, &fragment))?;
                    // Insertion at the end of `owner` leaves its own handle valid: its start tag comes first.
                    self.set_in(owner, property, text)
                }
            },
        }
    }

    /// A nested object that the file does not give: a copy of the one in `<defaults>`, whose values hold until now.
    fn new_nested_object(&self, owner: ElementId, object: &str) -> String {
        let model = self.document.children(self.document.root()).first();
        let defaults = model.and_then(|&model| self.document.child(model, "defaults"));
        let class = defaults.and_then(|defaults| self.document.child(defaults, self.document.tag(owner)));
        match class.and_then(|class| self.document.child(class, object)) {
            Some(element) => String::from_utf8_lossy(&self.document.bytes()[self.document.range(element)]).into_owned(),
            None => format!("<{object} />"),
        }
    }

    /// Element of the component at a path.
    fn component(&self, path: &str) -> Result<ElementId, EditError> {
        let locations = locations(self);
        let found = locations.iter().find(|location| location.path == path).and_then(|location| location.element);
        found.map(ElementId).ok_or_else(|| EditError::UnknownComponent {
            file: self.document.file().to_owned(),
            path: path.to_owned(),
            nearest: nearest(path, locations.iter().map(|location| location.path.as_str())),
        })
    }

    /// Splices, then reads the new text.
    pub(super) fn apply(&mut self, edits: Vec<Splice>) -> Result<(), EditError> {
        if edits.is_empty() {
            return Ok(());
        }
        let document = self.document.spliced(edits).map_err(|error| EditError::Invalid(error.into()))?;
        let (spec, diagnostics) = reader::read_model(&document).map_err(EditError::Invalid)?;
        *self = OsimFile { document, spec, diagnostics };
        Ok(())
    }
}

/// Where every component of a file stands.
fn locations(file: &OsimFile) -> Vec<&Location> {
    fn path_locations(path: &PathSpec) -> impl Iterator<Item = &Location> {
        let points = path.points.iter().map(|point| &point.at);
        std::iter::once(&path.at).chain(points).chain(path.wraps.iter().map(|wrap| &wrap.at))
    }
    let spec = &file.spec;
    let mut all: Vec<&Location> = Vec::new();
    all.extend(spec.frames.iter().map(|frame| &frame.at));
    all.extend(spec.joints.iter().map(|joint| &joint.at));
    all.extend(spec.coordinates.iter().map(|coordinate| &coordinate.at));
    all.extend(spec.constraints.iter().map(|constraint| &constraint.at));
    all.extend(spec.wrap_objects.iter().map(|wrap| &wrap.at));
    for muscle in &spec.muscles {
        all.push(&muscle.at);
        all.extend(path_locations(&muscle.path));
    }
    for force in &spec.forces {
        all.push(&force.at);
        if let Some(path) = force.kind.path() {
            all.extend(path_locations(path));
        }
    }
    all.extend(spec.markers.iter().map(|marker| &marker.at));
    all
}
