//! Forces and actuators.

use super::Writer;
use crate::osim::spec::{
    ActuatorKind, ActuatorSpec, ForceKind, ForceSpec, FunctionSpec, PathSpec, PrescribedForceSpec,
};
use nalgebra::Vector3;

impl Writer<'_> {
    pub(super) fn forces(&mut self) {
        let spec = self.spec;
        // In the order of the file.
        let muscles = spec.muscles.iter().enumerate().map(|(i, m)| (m.at.order(), Ok(i)));
        let forces = spec.forces.iter().enumerate().map(|(i, f)| (f.at.order(), Err(i)));
        let mut all: Vec<_> = muscles.chain(forces).collect();
        all.sort_by_key(|(at, _)| *at);
        let at = |one: &Result<usize, usize>| match one {
            Ok(i) => &spec.muscles[*i].at,
            Err(i) => &spec.forces[*i].at,
        };
        let is_in = |one: &Result<usize, usize>, set: &str| at(one).path.starts_with(&format!("/{set}/"));
        let all: Vec<_> = all.into_iter().map(|(_, one)| one).collect();
        let (behind, own): (Vec<_>, Vec<_>) = all.into_iter().partition(|one| is_in(one, "componentset"));
        for (class, name, members) in [("ForceSet", "forceset", own), ("ComponentSet", "componentset", behind)] {
            if members.is_empty() {
                continue;
            }
            self.xml.open(class, &[("name", name)]);
            self.xml.open("objects", &[]);
            for one in members {
                match one {
                    Ok(i) => self.muscle(&spec.muscles[i]),
                    Err(i) => self.force(&spec.forces[i]),
                }
            }
            self.xml.close();
            self.xml.close();
        }
    }

    fn force(&mut self, force: &ForceSpec) {
        let class = match &force.kind {
            ForceKind::CoordinateLimit { .. } => "CoordinateLimitForce",
            ForceKind::SpringGeneralized { .. } => "SpringGeneralizedForce",
            ForceKind::ExpressionBasedCoordinate { .. } => "ExpressionBasedCoordinateForce",
            ForceKind::FunctionBasedBushing { .. } => "FunctionBasedBushingForce",
            ForceKind::Bushing { .. } => "BushingForce",
            ForceKind::ExpressionBasedBushing { .. } => "ExpressionBasedBushingForce",
            ForceKind::PointToPointSpring { .. } => "PointToPointSpring",
            ForceKind::Ligament { .. } => "Ligament",
            ForceKind::PathSpring { .. } => "PathSpring",
            ForceKind::Blankevoort1991Ligament { .. } => "Blankevoort1991Ligament",
            ForceKind::Prescribed(_) => "PrescribedForce",
            ForceKind::Actuator(actuator) => actuator.kind.class(),
            ForceKind::Unsupported { class } => {
                self.left_out.push((force.at.line, format!("{}: {class}", force.at.path)));
                return;
            }
        };
        self.xml.open(class, &[("name", &force.name)]);
        self.xml.boolean("appliesForce", force.applies_force);
        self.force_properties(force);
        self.xml.close();
    }

    fn force_properties(&mut self, force: &ForceSpec) {
        let name = |coordinate: &crate::osim::spec::CoordinateIndex| self.spec.coordinates[coordinate.0].name.clone();
        match &force.kind {
            ForceKind::CoordinateLimit {
                coordinate,
                upper_stiffness,
                upper_limit,
                lower_stiffness,
                lower_limit,
                damping,
                transition,
                computes_dissipation,
            } => {
                let name = name(coordinate);
                self.xml.text("coordinate", &name);
                self.xml.number("upper_stiffness", *upper_stiffness);
                self.xml.number("upper_limit", *upper_limit);
                self.xml.number("lower_stiffness", *lower_stiffness);
                self.xml.number("lower_limit", *lower_limit);
                self.xml.number("damping", *damping);
                self.xml.number("transition", *transition);
                if *computes_dissipation {
                    self.xml.boolean("compute_dissipation_energy", true);
                }
            }
            ForceKind::SpringGeneralized { coordinate, stiffness, rest_length, viscosity } => {
                let name = name(coordinate);
                self.xml.text("coordinate", &name);
                self.xml.number("stiffness", *stiffness);
                self.xml.number("rest_length", *rest_length);
                self.xml.number("viscosity", *viscosity);
            }
            ForceKind::ExpressionBasedCoordinate { coordinate, expression } => {
                let name = name(coordinate);
                self.xml.text("coordinate", &name);
                self.xml.text("expression", expression);
            }
            ForceKind::FunctionBasedBushing {
                frame1,
                frame2,
                functions,
                rotational_damping,
                translational_damping,
            } => {
                const PROPERTIES: [&str; 6] = [
                    "m_x_theta_x_function",
                    "m_y_theta_y_function",
                    "m_z_theta_z_function",
                    "f_x_delta_x_function",
                    "f_y_delta_y_function",
                    "f_z_delta_z_function",
                ];
                self.bushing_frames(force, [*frame1, *frame2]);
                PROPERTIES.iter().zip(functions.iter()).for_each(|(name, function)| self.xml.function(name, function));
                self.xml.vector("rotational_damping", rotational_damping);
                self.xml.vector("translational_damping", translational_damping);
            }
            ForceKind::Bushing {
                frame1,
                frame2,
                rotational_stiffness,
                translational_stiffness,
                rotational_damping,
                translational_damping,
            } => {
                self.bushing_frames(force, [*frame1, *frame2]);
                self.xml.vector("rotational_stiffness", rotational_stiffness);
                self.xml.vector("translational_stiffness", translational_stiffness);
                self.xml.vector("rotational_damping", rotational_damping);
                self.xml.vector("translational_damping", translational_damping);
            }
            ForceKind::ExpressionBasedBushing {
                frame1,
                frame2,
                expressions,
                rotational_damping,
                translational_damping,
            } => {
                self.bushing_frames(force, [*frame1, *frame2]);
                for (name, formula) in ["Mx", "My", "Mz", "Fx", "Fy", "Fz"].iter().zip(expressions.iter()) {
                    self.xml.text(&format!("{name}_expression"), formula);
                }
                self.xml.vector("rotational_damping", rotational_damping);
                self.xml.vector("translational_damping", translational_damping);
            }
            ForceKind::PointToPointSpring { body1, body2, point1, point2, stiffness, rest_length } => {
                self.sockets(&[("body1", *body1), ("body2", *body2)]);
                self.xml.vector("point1", point1);
                self.xml.vector("point2", point2);
                self.xml.number("stiffness", *stiffness);
                self.xml.number("rest_length", *rest_length);
            }
            ForceKind::Ligament { path, resting_length, pcsa_force, force_length_curve } => {
                self.path(path);
                self.xml.number("resting_length", *resting_length);
                self.xml.number("pcsa_force", *pcsa_force);
                self.xml.function("force_length_curve", force_length_curve);
            }
            ForceKind::PathSpring { path, resting_length, stiffness, dissipation } => {
                self.path(path);
                self.xml.number("resting_length", *resting_length);
                self.xml.number("stiffness", *stiffness);
                self.xml.number("dissipation", *dissipation);
            }
            ForceKind::Blankevoort1991Ligament {
                path,
                linear_stiffness,
                transition_strain,
                damping_coefficient,
                slack_length,
            } => {
                self.path(path);
                self.xml.number("linear_stiffness", *linear_stiffness);
                self.xml.number("transition_strain", *transition_strain);
                self.xml.number("damping_coefficient", *damping_coefficient);
                self.xml.number("slack_length", *slack_length);
            }
            ForceKind::Prescribed(own) => self.prescribed_force(own),
            ForceKind::Actuator(own) => self.actuator(own),
            ForceKind::Unsupported { .. } => {}
        }
    }

    fn bushing_frames(&mut self, force: &ForceSpec, [frame1, frame2]: [crate::osim::spec::FrameIndex; 2]) {
        self.sockets(&[("frame1", frame1), ("frame2", frame2)]);
        self.owned_frames(&force.at.path, "frames");
    }

    fn prescribed_force(&mut self, own: &PrescribedForceSpec) {
        self.sockets(&[("frame", own.frame)]);
        self.xml.boolean("pointIsGlobal", own.point_is_global);
        self.xml.boolean("forceIsGlobal", own.force_is_global);
        self.function_set("forceFunctions", &own.force);
        self.function_set("pointFunctions", &own.point);
        self.function_set("torqueFunctions", &own.torque);
    }

    fn function_set(&mut self, name: &str, functions: &Option<[FunctionSpec; 3]>) {
        let Some(functions) = functions else { return };
        self.xml.open("FunctionSet", &[("name", name)]);
        self.xml.open("objects", &[]);
        functions.iter().for_each(|function| self.xml.bare_function(function));
        self.xml.close();
        self.xml.close();
    }

    fn actuator(&mut self, own: &ActuatorSpec) {
        self.xml.number("min_control", own.min_control);
        self.xml.number("max_control", own.max_control);
        let body = |frame: &crate::osim::spec::FrameIndex| self.spec.frames[frame.0].name.clone();
        let vector = |xml: &mut super::xml::Xml, name: &str, value: &Vector3<f64>| xml.vector(name, value);
        match &own.kind {
            ActuatorKind::Coordinate { coordinate, activation } => {
                self.xml.text("coordinate", &self.spec.coordinates[coordinate.0].name);
                if let Some(activation) = activation {
                    self.xml.number("activation_time_constant", activation.time_constant);
                    self.xml.number("default_activation", activation.default_activation);
                }
            }
            ActuatorKind::Torque { body_a, body_b, axis, torque_is_global } => {
                let (a, b) = (body(body_a), body(body_b));
                self.xml.text("bodyA", &a);
                self.xml.text("bodyB", &b);
                self.xml.boolean("torque_is_global", *torque_is_global);
                vector(&mut self.xml, "axis", axis);
            }
            ActuatorKind::PointToPoint { body_a, body_b, point_a, point_b, points_are_global } => {
                let (a, b) = (body(body_a), body(body_b));
                self.xml.text("bodyA", &a);
                self.xml.text("bodyB", &b);
                self.xml.boolean("points_are_global", *points_are_global);
                vector(&mut self.xml, "pointA", point_a);
                vector(&mut self.xml, "pointB", point_b);
            }
            ActuatorKind::Point { body: on, point, point_is_global, direction, force_is_global } => {
                let on = body(on);
                self.xml.text("body", &on);
                vector(&mut self.xml, "point", point);
                self.xml.boolean("point_is_global", *point_is_global);
                vector(&mut self.xml, "direction", direction);
                self.xml.boolean("force_is_global", *force_is_global);
            }
            ActuatorKind::Path { path } => {
                let path: &PathSpec = path;
                self.path(path);
            }
        }
        self.xml.number("optimal_force", own.optimal_force);
    }
}
