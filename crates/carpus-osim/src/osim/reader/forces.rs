//! Forces other than muscles, and markers.

use nalgebra::Vector3;

use super::functions::is_function;
use super::muscles::is_muscle;
use super::object::{FreeComponents, Names, Object};
use super::pending::UnresolvedOffset;
use super::properties::Bound;
use super::state::Reader;
use super::upgrade::present_class;
use crate::osim::diagnostics::Severity;
use crate::osim::document::ElementId;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{
    CoordinateIndex, ForceKind, ForceSpec, FrameIndex, FrameKind, FunctionSpec, Location, MarkerSpec,
};

/// Abscissae and ordinates of the curve that `Ligament`'s constructor makes.
const LIGAMENT_CURVE: [[f64; 13]; 2] = [
    [-5.0, 0.998, 0.999, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5.0],
    [0.0, 0.0, 0.0, 0.0, 0.035, 0.12, 0.26, 0.55, 1.17, 2.0, 2.0, 2.0, 2.0],
];

/// Functions of a `FunctionBasedBushingForce`.
const BUSHING_FUNCTIONS: [&str; 6] = [
    "m_x_theta_x_function",
    "m_y_theta_y_function",
    "m_z_theta_z_function",
    "f_x_delta_x_function",
    "f_y_delta_y_function",
    "f_z_delta_z_function",
];

/// Forces between the model's contact geometries.
const CONTACT_FORCES: [&str; 5] = [
    "HuntCrossleyForce",
    "ElasticFoundationForce",
    "SmoothSphereHalfSpaceForce",
    "Smith2018ArticularContactForce",
    "MeyerFregly2016Force",
];

fn is_force(tag: &str) -> bool {
    is_muscle(tag) || ["Force", "Actuator", "Ligament", "Spring"].iter().any(|end| tag.ends_with(end))
}

impl Reader<'_> {
    pub(super) fn read_forces(&mut self, model: &Object, components: &FreeComponents) {
        let elements = self.set_and_components(model, &["ForceSet", "ActuatorSet"], "/forceset", components, is_force);
        let mut names = Names::default();
        for (element, owner) in elements {
            self.read_force(element, owner, &mut names);
        }
    }

    /// A muscle or another force.
    ///
    /// - `names`: those of the forces that were read before
    pub(super) fn read_force(&mut self, element: ElementId, owner: &str, names: &mut Names) {
        let name = self.component_name(element, names, owner);
        let object = self.object(element, owner, &name);
        if is_muscle(self.document.tag(element)) {
            self.read_muscle(element, &object, name);
        } else {
            self.read_other_force(element, &object, name);
        }
    }

    fn read_other_force(&mut self, element: ElementId, object: &Object, name: String) {
        let class = self.document.tag(element).to_owned();
        let applies_force = self.enabled(object, "appliesForce");
        let at = self.location(object);
        let problems = self.problems.len();
        let kind = match class.as_str() {
            "CoordinateLimitForce" => self.coordinate_limit(object),
            "SpringGeneralizedForce" => self.spring_generalized(object),
            "ExpressionBasedCoordinateForce" => self.expression_based(object),
            "FunctionBasedBushingForce" => self.bushing(object),
            "BushingForce" => self.linear_bushing(object),
            "ExpressionBasedBushingForce" => self.expression_bushing(object),
            "PointToPointSpring" => self.point_to_point_spring(object),
            "PrescribedForce" => self.prescribed_force(object),
            "Blankevoort1991Ligament" => self.blankevoort_ligament(object),
            "Ligament" => self.ligament(object),
            "PathSpring" => self.path_spring(object),
            class => self.actuator(object, present_class(class)),
        };
        let kind = kind.unwrap_or_else(|| {
            if self.problems.len() == problems {
                self.unsupported_force(element, object, &class, applies_force);
            }
            ForceKind::Unsupported { class: class.clone() }
        });
        if !matches!(kind, ForceKind::Unsupported { .. }) {
            self.diagnostics.understood(present_class(&class));
        }
        if matches!(kind, ForceKind::Actuator(_)) && applies_force {
            let message = format!("{class} follows a control in run-tool; elsewhere it is taken as passive");
            self.diagnose(Severity::Ignored, element, &object.path, message, None);
        }
        self.spec.forces.push(ForceSpec { name, at, applies_force, kind });
    }

    fn unsupported_force(&mut self, element: ElementId, object: &Object, class: &str, applies_force: bool) {
        if !applies_force {
            let message = format!("{class} is not computed; the model has it switched off");
            self.diagnose(Severity::Ignored, element, &object.path, message, None);
        } else if class.ends_with("Actuator") {
            let message = format!("{class} is not computed: taken as passive, without control signal");
            self.diagnose(Severity::Unsupported, element, &object.path, message, None);
        } else if CONTACT_FORCES.contains(&class) {
            let message = format!("{class}: contact is not simulated; bodies pass through each other");
            self.diagnose(Severity::Unsupported, element, &object.path, message, None);
        } else {
            self.diagnose(Severity::Unsupported, element, &object.path, format!("{class} is not computed"), None);
        }
    }

    pub(super) fn force_coordinate(&mut self, object: &Object) -> Option<CoordinateIndex> {
        let Some((element, name)) = self.string(object, &["coordinate"]) else {
            let kind = ProblemKind::Missing { property: "coordinate".to_owned(), expected: "a coordinate's name" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        self.coordinate_named(object, Some(element), "coordinate", &name)
    }

    fn coordinate_limit(&mut self, object: &Object) -> Option<ForceKind> {
        let coordinate = self.force_coordinate(object)?;
        let computes_dissipation = self.boolean(object, &["compute_dissipation_energy"], false);
        let mut value = |name, default| self.number(object, &[name], default, Bound::Finite);
        Some(ForceKind::CoordinateLimit {
            coordinate,
            upper_stiffness: value("upper_stiffness", 1.0),
            upper_limit: value("upper_limit", 0.0),
            lower_stiffness: value("lower_stiffness", 1.0),
            lower_limit: value("lower_limit", 0.0),
            damping: value("damping", 0.001),
            transition: value("transition", 0.1),
            computes_dissipation,
        })
    }

    fn spring_generalized(&mut self, object: &Object) -> Option<ForceKind> {
        let coordinate = self.force_coordinate(object)?;
        let mut value = |name| self.number(object, &[name], 0.0, Bound::Finite);
        Some(ForceKind::SpringGeneralized {
            coordinate,
            stiffness: value("stiffness"),
            rest_length: value("rest_length"),
            viscosity: value("viscosity"),
        })
    }

    fn expression_based(&mut self, object: &Object) -> Option<ForceKind> {
        let coordinate = self.force_coordinate(object)?;
        let expression = self.string(object, &["expression"]).map_or_else(|| "0.0".to_owned(), |(_, text)| text);
        Some(ForceKind::ExpressionBasedCoordinate { coordinate, expression })
    }

    fn bushing(&mut self, object: &Object) -> Option<ForceKind> {
        let (frame1, frame2) = self.linked_frames(object)?;
        let mut functions = Vec::with_capacity(6);
        for name in BUSHING_FUNCTIONS {
            functions.push(self.bushing_function(object, name)?);
        }
        let functions: [FunctionSpec; 6] = functions.try_into().ok()?;
        Some(ForceKind::FunctionBasedBushing {
            frame1,
            frame2,
            functions: Box::new(functions),
            rotational_damping: self.vector3(object, &["rotational_damping"], Vector3::zeros()),
            translational_damping: self.vector3(object, &["translational_damping"], Vector3::zeros()),
        })
    }

    fn linear_bushing(&mut self, object: &Object) -> Option<ForceKind> {
        let (frame1, frame2) = self.linked_frames(object)?;
        let mut vector = |name: &'static str| {
            let found = self.vector3(object, &[name], Vector3::zeros());
            if let Some(found) = found.iter().copied().find(|x| *x < 0.0) {
                let kind =
                    ProblemKind::OutOfRange { property: name.to_owned(), expected: "numbers of 0 or more", found };
                self.problem(object.line, &object.path, kind);
            }
            found
        };
        Some(ForceKind::Bushing {
            frame1,
            frame2,
            rotational_stiffness: vector("rotational_stiffness"),
            translational_stiffness: vector("translational_stiffness"),
            rotational_damping: vector("rotational_damping"),
            translational_damping: vector("translational_damping"),
        })
    }

    fn expression_bushing(&mut self, object: &Object) -> Option<ForceKind> {
        const EXPRESSIONS: [&str; 6] =
            ["Mx_expression", "My_expression", "Mz_expression", "Fx_expression", "Fy_expression", "Fz_expression"];
        let (frame1, frame2) = self.linked_frames(object)?;
        let expressions =
            EXPRESSIONS.map(|name| self.string(object, &[name]).map_or_else(|| "0.0".to_owned(), |(_, text)| text));
        Some(ForceKind::ExpressionBasedBushing {
            frame1,
            frame2,
            expressions: Box::new(expressions),
            rotational_damping: self.vector3(object, &["rotational_damping"], Vector3::zeros()),
            translational_damping: self.vector3(object, &["translational_damping"], Vector3::zeros()),
        })
    }

    fn blankevoort_ligament(&mut self, object: &Object) -> Option<ForceKind> {
        let path = self.read_path(object).ok()?;
        let mut value = |name: &'static str, default| {
            self.number(object, &[name], default, Bound::NotNegative("a number of 0 or more"))
        };
        let (linear_stiffness, transition_strain) = (value("linear_stiffness", 1.0), value("transition_strain", 0.06));
        let damping_coefficient = value("damping_coefficient", 0.003);
        let slack_length = self.number(object, &["slack_length"], 0.0, Bound::Positive("a length greater than 0 m"));
        Some(ForceKind::Blankevoort1991Ligament {
            path,
            linear_stiffness,
            transition_strain,
            damping_coefficient,
            slack_length,
        })
    }

    fn bushing_function(&mut self, object: &Object, name: &'static str) -> Option<FunctionSpec> {
        let Some(property) = self.property(object, &[name]) else { return Some(FunctionSpec::Constant { value: 0.0 }) };
        let children = self.document.children(property);
        match children.iter().copied().find(|&child| is_function(self.document.tag(child))) {
            Some(element) => self.function(element, object),
            None => {
                let kind = ProblemKind::Missing { property: name.to_owned(), expected: "a function" };
                self.problem(self.document.line(property), &object.path, kind);
                None
            }
        }
    }

    /// The two frames of a bushing or weld, with the offset frames that it owns (`TwoFrameLinker`).
    pub(super) fn linked_frames(&mut self, object: &Object) -> Option<(FrameIndex, FrameIndex)> {
        self.read_owned_frames(object);
        if !self.version.has_locations_in_bodies() {
            self.resolve_offsets();
            let frame1 = self.frame_socket(object, "frame1");
            let frame2 = self.frame_socket(object, "frame2");
            return Some((frame1?, frame2?));
        }
        let frame1 = self.linked_body(object, "body_1", "location_body_1", "orientation_body_1");
        let frame2 = self.linked_body(object, "body_2", "location_body_2", "orientation_body_2");
        self.resolve_offsets();
        Some((frame1?, frame2?))
    }

    fn linked_body(
        &mut self,
        object: &Object,
        body: &'static str,
        location: &'static str,
        orientation: &'static str,
    ) -> Option<FrameIndex> {
        let round = super::upgrade::six_significant_digits;
        let translation = self.vector3(object, &[location], Vector3::zeros()).map(round);
        let orientation = self.vector3(object, &[orientation], Vector3::zeros()).map(round);
        let Some((element, name)) = self.string(object, &[body]) else {
            let kind = ProblemKind::Missing { property: body.to_owned(), expected: "a body's name" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        let base = self.body_at(object, element, body, &name)?;
        if translation == Vector3::zeros() && orientation == Vector3::zeros() {
            return Some(base);
        }
        let name = format!("{}_offset", self.reference(&name));
        let path = format!("{}/{name}", object.path);
        let at = Location { path, ..self.location(object) };
        let frame = self.add_frame(&name, at, FrameKind::Offset { parent: base, translation, orientation });
        let parent = Some((None, self.spec.frames[base.0].at.path.clone()));
        self.unresolved.push(UnresolvedOffset { frame, object: object.clone(), parent });
        Some(frame)
    }

    fn ligament(&mut self, object: &Object) -> Option<ForceKind> {
        let path = self.read_path(object).ok()?;
        let resting_length =
            self.number(object, &["resting_length"], 0.0, Bound::Positive("a length greater than 0 m"));
        let pcsa_force = self.number(object, &["pcsa_force"], 0.0, Bound::Finite);
        let force_length_curve = match self.one_object(object, "force_length_curve", is_function) {
            Some(Some(element)) => self.function(element, object)?,
            _ => FunctionSpec::SimmSpline { x: LIGAMENT_CURVE[0].to_vec(), y: LIGAMENT_CURVE[1].to_vec() },
        };
        Some(ForceKind::Ligament { path, resting_length, pcsa_force, force_length_curve })
    }

    fn path_spring(&mut self, object: &Object) -> Option<ForceKind> {
        let path = self.read_path(object).ok()?;
        let mut value = |name: &'static str, bound| match self.optional_number(object, &[name], bound) {
            Some(value) => value,
            None => {
                let kind = ProblemKind::Missing { property: name.to_owned(), expected: "a number" };
                self.problem(object.line, &object.path, kind);
                0.0
            }
        };
        Some(ForceKind::PathSpring {
            path,
            resting_length: value("resting_length", Bound::NotNegative("a length of 0 m or more")),
            stiffness: value("stiffness", Bound::NotNegative("a stiffness of 0 N/m or more")),
            dissipation: value("dissipation", Bound::NotNegative("a dissipation of 0 s/m or more")),
        })
    }

    /// Markers are stations.
    pub(super) fn register_markers(&mut self, model: &Object) {
        let mut names = Names::default();
        for element in self.set_objects(model, &["MarkerSet"]) {
            if self.document.tag(element) == "Marker" {
                let name = self.document.attribute(element, "name").unwrap_or_default();
                let path = format!("/markerset/{}", names.unique(&name));
                self.stations.entry(path).or_insert(element);
            }
        }
    }

    pub(super) fn read_markers(&mut self, model: &Object) {
        let mut names = Names::default();
        for element in self.set_objects(model, &["MarkerSet"]) {
            if self.document.tag(element) != "Marker" {
                continue; // reported with the leftovers
            }
            let name = self.component_name(element, &mut names, "/markerset");
            let object = self.object(element, "/markerset", &name);
            let location = self.vector3(&object, &["location"], Vector3::zeros());
            let fixed = self.boolean(&object, &["fixed"], false);
            let Some(frame) = self.point_frame(&object) else { continue };
            self.diagnostics.understood("Marker");
            let at = self.location(&object);
            self.spec.markers.push(MarkerSpec { name, at, frame, location, fixed });
        }
    }
}
