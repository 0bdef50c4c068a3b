//! Actuators of setups: the `force_set_files` of OpenSim's tools.

use std::path::Path;

use super::error::{ToolError, ToolProblem};
use super::setup::{Properties, Setup};
use super::system::{Actor, System};
use crate::forces::Actuator;
use crate::osim::spec::{ActuatorKind, ActuatorSpec, FrameIndex, Location};
use nalgebra::Vector3;

fn read(force: &Properties, system: &System) -> Result<Option<Actuator>, ToolError> {
    let applies = force.boolean("appliesForce", true)? && !force.boolean("isDisabled", false)?;
    let vector = |property: &str, default: Vector3<f64>| match force.text(property) {
        Some(_) => force.vector(property),
        None => Ok(default),
    };
    let kind = match force.class() {
        "CoordinateActuator" | "GeneralizedForce" => {
            let name = force.string("coordinate");
            let Some(coordinate) = system.model.coordinate(&name) else {
                let names = system.model.coordinates.iter().map(|c| c.name.as_str());
                let nearest = crate::osim::error::nearest(&name, names);
                let problem = ToolProblem::Unknown { kind: "coordinate", name, nearest };
                return Err(force.error_at("coordinate", problem));
            };
            ActuatorKind::Coordinate { coordinate }
        }
        "TorqueActuator" => ActuatorKind::Torque {
            body_a: body(force, "bodyA", system)?,
            body_b: body(force, "bodyB", system)?,
            axis: vector("axis", Vector3::z())?,
            torque_is_global: force.boolean("torque_is_global", true)?,
        },
        "PointActuator" => ActuatorKind::Point {
            body: body(force, "body", system)?,
            point: vector("point", Vector3::zeros())?,
            point_is_global: force.boolean("point_is_global", false)?,
            direction: vector("direction", Vector3::x())?,
            force_is_global: force.boolean("force_is_global", false)?,
        },
        "PointToPointActuator" => ActuatorKind::PointToPoint {
            body_a: body(force, "bodyA", system)?,
            body_b: body(force, "bodyB", system)?,
            point_a: vector("pointA", Vector3::zeros())?,
            point_b: vector("pointB", Vector3::zeros())?,
            points_are_global: force.boolean("points_are_global", false)?,
        },
        _ => return Ok(None),
    };
    let spec = ActuatorSpec {
        optimal_force: force.number("optimal_force", 1.0)?,
        min_control: force.number("min_control", f64::NEG_INFINITY)?,
        max_control: force.number("max_control", f64::INFINITY)?,
        kind,
    };
    let compiled = Actuator::compile(&force.name(), &Location::default(), &spec, &system.model);
    Ok(compiled.map_err(|e| force.error_at("optimal_force", e))?.filter(|_| applies))
}

fn body(force: &Properties, property: &str, system: &System) -> Result<FrameIndex, ToolError> {
    let name = force.string(property);
    system.frame(&name).ok_or_else(|| {
        let names = system.spec.bodies.iter().map(|b| b.name.as_str());
        let nearest = crate::osim::error::nearest(&name, names);
        force.error_at(property, ToolProblem::Unknown { kind: "body", name, nearest })
    })
}

/// Adds the forces of a file (`force_set_files`).
///
/// # Errors
/// The file; a class that is not supported here; a coordinate or body that the model does not have.
pub fn add_force_set(path: &Path, system: &mut System) -> Result<Vec<(usize, String)>, ToolError> {
    let setup = Setup::read(path)?;
    let set = setup.object();
    if set.class() != "ForceSet" && set.class() != "ActuatorSet" {
        return Err(set.unsupported(set.class(), "expected a ForceSet"));
    }
    for force in set.objects("") {
        match force.class() {
            "CoordinateActuator" | "GeneralizedForce" | "TorqueActuator" | "PointActuator" | "PointToPointActuator" => {
                match read(&force, system)? {
                    Some(actuator) => system.actors.push(Actor::Actuator(Box::new(actuator))),
                    None => system.inactive.push(force.name()),
                }
            }
            class => {
                let applies = force.boolean("appliesForce", true)? && !force.boolean("isDisabled", false)?;
                force.ignore();
                if applies {
                    system.unsupported.push((force.name(), class.to_owned()));
                }
            }
        }
    }
    Ok(setup.unread())
}
