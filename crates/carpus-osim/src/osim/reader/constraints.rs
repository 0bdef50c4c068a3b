//! Constraints.

use super::functions::is_function;
use super::object::{FreeComponents, Names, Object};
use super::properties::Bound;
use super::state::Reader;
use crate::osim::diagnostics::Severity;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{ConstraintKind, ConstraintSpec, CoordinateIndex, FrameIndex};
use nalgebra::Vector3;

impl Reader<'_> {
    pub(super) fn read_constraints(&mut self, model: &Object, components: &FreeComponents) {
        let is_constraint = |tag: &str| tag.ends_with("Constraint");
        let elements = self.set_and_components(model, &["ConstraintSet"], "/constraintset", components, is_constraint);
        let mut names = Names::default();
        for (element, owner) in elements {
            let name = self.component_name(element, &mut names, owner);
            let object = self.object(element, owner, &name);
            let class = self.document.tag(element).to_owned();
            let is_enforced = self.enabled(&object, "isEnforced");
            let kind = match class.as_str() {
                "CoordinateCouplerConstraint" => match self.coupler(&object) {
                    Some(kind) => kind,
                    None => ConstraintKind::Unsupported { class: self.class_of_coupler(class, &object) },
                },
                _ => {
                    let severity = if is_enforced { Severity::Unsupported } else { Severity::Ignored };
                    let kind = self.joining_constraint(&class, &object);
                    let message = match kind {
                        Some(_) => format!(
                            "{class} holds in the trials and images of studies and in run-tool; other commands take \
                             all coordinates as given"
                        ),
                        None => format!("{class} is not enforced"),
                    };
                    self.diagnose(severity, element, &object.path, message, None);
                    kind.unwrap_or(ConstraintKind::Unsupported { class })
                }
            };
            let at = self.location(&object);
            self.spec.constraints.push(ConstraintSpec { name, at, is_enforced, kind });
        }
    }

    /// `None` if something is missing or not supported (reported).
    fn coupler(&mut self, object: &Object) -> Option<ConstraintKind> {
        self.diagnostics.understood("CoordinateCouplerConstraint");
        let independent = self.words(object, &["independent_coordinate_names"]);
        let Some((dependent_element, dependent)) = self.string(object, &["dependent_coordinate_name"]) else {
            let property = "dependent_coordinate_name".to_owned();
            let kind = ProblemKind::Missing { property, expected: "a coordinate's name" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        let element = self.property(object, &["independent_coordinate_names"]);
        let property = "independent_coordinate_names";
        if independent.is_empty() {
            let kind = ProblemKind::Missing { property: property.to_owned(), expected: "a coordinate's name" };
            self.problem(object.line, &object.path, kind);
        }
        let independent_coordinates: Option<Vec<CoordinateIndex>> =
            independent.iter().map(|name| self.coordinate_named(object, element, property, name)).collect();
        let dependent_coordinate =
            self.coordinate_named(object, Some(dependent_element), "dependent_coordinate_name", &dependent)?;
        let scale_factor = self.number(object, &["scale_factor"], 1.0, Bound::Finite);
        let holder = self.property(object, &["coupled_coordinates_function"]);
        let function = holder.and_then(|holder| {
            let children = self.document.children(holder);
            children.iter().copied().find(|&child| is_function(self.document.tag(child)))
        });
        let Some(element) = function else {
            let property = "coupled_coordinates_function".to_owned();
            self.problem(object.line, &object.path, ProblemKind::Missing { property, expected: "a function" });
            return None;
        };
        let Some(function) = self.function(element, object) else {
            let message = format!("coupler not enforced: function {} is not supported", self.document.tag(element));
            self.diagnose(Severity::Unsupported, element, &object.path, message, None);
            return None;
        };
        Some(ConstraintKind::CoordinateCoupler {
            independent_coordinates: independent_coordinates?,
            dependent_coordinate,
            function,
            scale_factor,
        })
    }

    /// What of a coupler is not supported: its function, if there is one.
    fn class_of_coupler(&mut self, class: String, object: &Object) -> String {
        let holder = self.property(object, &["coupled_coordinates_function"]);
        let function = holder.and_then(|holder| self.document.children(holder).first().copied());
        match function {
            Some(function) => format!("{class} by a {}", self.document.tag(function)),
            None => class,
        }
    }

    /// Constraints between two bodies; `None` for other classes, or if something is missing (reported).
    fn joining_constraint(&mut self, class: &str, object: &Object) -> Option<ConstraintKind> {
        let zero = Vector3::zeros();
        Some(match class {
            "WeldConstraint" => {
                let (frame1, frame2) = self.linked_frames(object)?;
                ConstraintKind::Weld { frame1, frame2 }
            }
            "PointConstraint" => ConstraintKind::Point {
                body_1: self.constrained_body(object, "body_1")?,
                body_2: self.constrained_body(object, "body_2")?,
                location_body_1: self.vector3(object, &["location_body_1"], zero),
                location_body_2: self.vector3(object, &["location_body_2"], zero),
            },
            "ConstantDistanceConstraint" => ConstraintKind::ConstantDistance {
                body_1: self.constrained_body(object, "body_1")?,
                body_2: self.constrained_body(object, "body_2")?,
                location_body_1: self.vector3(object, &["location_body_1"], zero),
                location_body_2: self.vector3(object, &["location_body_2"], zero),
                constant_distance: self.number(
                    object,
                    &["constant_distance"],
                    f64::EPSILON,
                    Bound::Positive("a distance greater than 0 m"),
                ),
            },
            "PointOnLineConstraint" => ConstraintKind::PointOnLine {
                line_body: self.constrained_body(object, "line_body")?,
                follower_body: self.constrained_body(object, "follower_body")?,
                line_direction_vec: self.vector3(object, &["line_direction_vec"], zero),
                point_on_line: self.vector3(object, &["point_on_line"], zero),
                point_on_follower: self.vector3(object, &["point_on_follower"], zero),
            },
            _ => return None,
        })
    }

    /// A body by socket, or by name in old formats.
    pub(super) fn constrained_body(&mut self, object: &Object, socket: &'static str) -> Option<FrameIndex> {
        match self.string(object, &[socket]) {
            Some((element, name)) => self.body_at(object, element, socket, &name),
            None => self.frame_socket(object, socket),
        }
    }
}
