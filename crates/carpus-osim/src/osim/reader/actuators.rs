//! Actuators and forces given over time.

use nalgebra::Vector3;

use super::functions::is_function;
use super::object::{Names, Object};
use super::properties::Bound;
use super::state::Reader;
use crate::osim::error::ProblemKind;
use crate::osim::spec::{
    ActuatorActivation, ActuatorKind, ActuatorSpec, ForceKind, FrameIndex, FunctionSpec, PrescribedForceSpec,
};

impl Reader<'_> {
    /// An actuator; `None` if its class is not read, or something is missing (reported).
    pub(super) fn actuator(&mut self, object: &Object, class: &str) -> Option<ForceKind> {
        let kind = match class {
            "CoordinateActuator" => {
                ActuatorKind::Coordinate { coordinate: self.force_coordinate(object)?, activation: None }
            }
            "ActivationCoordinateActuator" => {
                let positive = Bound::Positive("a time above 0");
                let activation = ActuatorActivation {
                    time_constant: self.number(object, &["activation_time_constant"], 0.01, positive),
                    default_activation: self.number(object, &["default_activation"], 0.5, Bound::Finite),
                };
                ActuatorKind::Coordinate { coordinate: self.force_coordinate(object)?, activation: Some(activation) }
            }
            "TorqueActuator" => self.torque_actuator(object)?,
            "PointToPointActuator" => self.point_to_point_actuator(object)?,
            "PointActuator" => self.point_actuator(object)?,
            "PathActuator" => ActuatorKind::Path { path: self.read_path(object).ok()? },
            _ => return None,
        };
        Some(ForceKind::Actuator(ActuatorSpec {
            optimal_force: self.number(object, &["optimal_force"], 1.0, Bound::Finite),
            min_control: self.number(object, &["min_control"], f64::NEG_INFINITY, Bound::Any),
            max_control: self.number(object, &["max_control"], f64::INFINITY, Bound::Any),
            kind,
        }))
    }

    /// Before 10905 the torque acts on the other body, and about the opposite axis, also where today's names stand
    /// (`TorqueActuator::updateFromXMLNode`).
    fn torque_actuator(&mut self, object: &Object) -> Option<ActuatorKind> {
        let swapped = self.version.has_forces_on_body_b();
        let names: [&[&'static str]; 3] = if swapped {
            [&["body_B", "bodyA"], &["body_A", "bodyB"], &["direction_A", "axis"]]
        } else {
            [&["bodyA"], &["bodyB"], &["axis"]]
        };
        let sign = if swapped { -1.0 } else { 1.0 };
        let (body_a, body_b) = (self.named_body(object, names[0]), self.named_body(object, names[1]));
        Some(ActuatorKind::Torque {
            body_a: body_a?,
            body_b: body_b?,
            axis: sign * self.direction(object, names[2], Vector3::z()),
            torque_is_global: self.boolean(object, &["torque_is_global"], true),
        })
    }

    fn point_to_point_actuator(&mut self, object: &Object) -> Option<ActuatorKind> {
        let (body_a, body_b) = (self.named_body(object, &["bodyA"]), self.named_body(object, &["bodyB"]));
        Some(ActuatorKind::PointToPoint {
            body_a: body_a?,
            body_b: body_b?,
            point_a: self.vector3(object, &["pointA"], Vector3::zeros()),
            point_b: self.vector3(object, &["pointB"], Vector3::zeros()),
            points_are_global: self.boolean(object, &["points_are_global"], false),
        })
    }

    /// Before 10905 the direction is that of the force on the other body, also where today's names stand
    /// (`PointActuator::updateFromXMLNode`).
    fn point_actuator(&mut self, object: &Object) -> Option<ActuatorKind> {
        let old = self.version.has_forces_on_body_b();
        let names: [&[&'static str]; 3] = if old {
            [&["body_B", "body"], &["point_B", "point"], &["direction_A", "direction"]]
        } else {
            [&["body"], &["point"], &["direction"]]
        };
        let sign = if old { -1.0 } else { 1.0 };
        Some(ActuatorKind::Point {
            body: self.named_body(object, names[0])?,
            point: self.vector3(object, names[1], Vector3::zeros()),
            point_is_global: self.boolean(object, &["point_is_global"], false),
            direction: sign * self.direction(object, names[2], Vector3::x()),
            force_is_global: self.boolean(object, &["force_is_global"], old),
        })
    }

    fn direction(&mut self, object: &Object, names: &[&'static str], default: Vector3<f64>) -> Vector3<f64> {
        let found = self.vector3(object, names, default);
        if found.norm() == 0.0 {
            let kind = ProblemKind::OutOfRange { property: names[0].to_owned(), expected: "a direction", found: 0.0 };
            self.problem(object.line, &object.path, kind);
        }
        found
    }

    /// A body by its name, or any frame by its path.
    fn named_body(&mut self, object: &Object, names: &[&'static str]) -> Option<FrameIndex> {
        let Some((element, name)) = self.string(object, names) else {
            let kind = ProblemKind::Missing { property: names[0].to_owned(), expected: "a body's name" };
            self.problem(object.line, &object.path, kind);
            return None;
        };
        if name.contains('/') {
            return self.frame_at(&Object { path: "/".to_owned(), ..object.clone() }, Some(element), names[0], &name);
        }
        self.body_at(object, element, names[0], &name)
    }

    pub(super) fn point_to_point_spring(&mut self, object: &Object) -> Option<ForceKind> {
        let body1 = self.constrained_body(object, "body1");
        let body2 = self.constrained_body(object, "body2");
        let (body1, body2) = (body1?, body2?);
        if self.base_frame(body1) == self.base_frame(body2) {
            let kind = ProblemKind::NotReadable {
                property: "socket_body2".to_owned(),
                expected: "another body than that of body1",
                found: "the same".to_owned(),
            };
            self.problem(object.line, &object.path, kind);
            return None;
        }
        Some(ForceKind::PointToPointSpring {
            body1,
            body2,
            point1: self.vector3(object, &["point1"], Vector3::zeros()),
            point2: self.vector3(object, &["point2"], Vector3::zeros()),
            stiffness: self.number(object, &["stiffness"], 1.0, Bound::NotNegative("a stiffness of 0 N/m or more")),
            rest_length: self.number(object, &["rest_length"], 0.0, Bound::NotNegative("a length of 0 m or more")),
        })
    }

    pub(super) fn prescribed_force(&mut self, object: &Object) -> Option<ForceKind> {
        let frame = match self.string(object, &["body"]) {
            Some((element, name)) if self.version.has_bare_names() => self.body_at(object, element, "body", &name),
            _ => self.frame_socket(object, "frame"),
        };
        let force = self.components_over_time(object, "forceFunctions");
        let point = self.components_over_time(object, "pointFunctions");
        let torque = self.components_over_time(object, "torqueFunctions");
        Some(ForceKind::Prescribed(Box::new(PrescribedForceSpec {
            frame: frame?,
            point_is_global: self.boolean(object, &["pointIsGlobal"], false),
            force_is_global: self.boolean(object, &["forceIsGlobal"], true),
            force: force?,
            point: point?,
            torque: torque?,
        })))
    }

    /// A set of three functions, or of none; `None` if it cannot be used (reported).
    fn components_over_time(&mut self, object: &Object, set: &'static str) -> Option<Option<[FunctionSpec; 3]>> {
        let Some(Some(element)) = self.one_object(object, set, |tag| tag == "FunctionSet") else { return Some(None) };
        self.mark(element);
        let Some(holder) = self.document.child(element, "objects") else { return Some(None) };
        self.mark(holder);
        let children = self.document.children(holder).iter().copied();
        let elements: Vec<_> = children.filter(|child| is_function(self.document.tag(*child))).collect();
        if !matches!(elements.len(), 0 | 3) {
            let found = format!("{} functions", elements.len());
            let kind =
                ProblemKind::NotReadable { property: set.to_owned(), expected: "three functions or none", found };
            self.problem(self.document.line(element), &object.path, kind);
            return None;
        }
        let mut functions = Vec::with_capacity(3);
        for element in elements {
            match self.function(element, object) {
                Some(function) => functions.push(function),
                None => {
                    let class = self.document.tag(element).to_owned();
                    self.problem(self.document.line(element), &object.path, ProblemKind::UnsupportedClass { class });
                    return None;
                }
            }
        }
        Some(functions.try_into().ok())
    }

    /// Offset frames among the components that a force owns.
    pub(super) fn read_owned_frames(&mut self, object: &Object) {
        for list in ["components", "frames"] {
            if let Some(list) = self.own_property(object, &[list]) {
                let children = self.document.children(list).to_vec();
                self.read_offset_frames(&children, &object.path, &mut Names::default());
            }
        }
    }
}
