//! Actuators that follow a control: `CoordinateActuator`, from a model or from a file of forces.

use std::path::Path;

use super::controls::Controls;
use super::error::ToolError;
use super::setup::{Properties, Setup};
use super::system::{Actor, System};
use crate::osim::spec::CoordinateIndex;

/// `CoordinateActuator`: control times optimal force, along a coordinate.
#[derive(Clone, Debug)]
pub struct CoordinateActuator {
    /// Name.
    pub name: String,
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// Force for a control of 1 [N·m or N].
    pub optimal_force: f64,
    /// Lowest and highest control.
    pub control_range: [f64; 2],
}

impl CoordinateActuator {
    /// Force at a time [N·m or N]; without a control, none.
    pub fn force(&self, controls: &Controls, time: f64) -> f64 {
        let [low, high] = self.control_range;
        controls.at(&self.name, time).unwrap_or(0.0).max(low).min(high) * self.optimal_force
    }
}

fn read(force: &Properties, system: &System) -> Result<Option<CoordinateActuator>, ToolError> {
    let applies = force.boolean("appliesForce", true)? && !force.boolean("isDisabled", false)?;
    let name = force.string("coordinate");
    let Some(coordinate) = system.model.coordinate(&name) else {
        let names = system.model.coordinates.iter().map(|c| c.name.as_str());
        let nearest = crate::osim::error::nearest(&name, names);
        let problem = super::error::ToolProblem::Unknown { kind: "coordinate", name, nearest };
        return Err(force.error_at("coordinate", problem));
    };
    let actuator = CoordinateActuator {
        name: force.name(),
        coordinate,
        optimal_force: force.number("optimal_force", 1.0)?,
        control_range: [force.number("min_control", f64::NEG_INFINITY)?, force.number("max_control", f64::INFINITY)?],
    };
    Ok(applies.then_some(actuator))
}

/// Takes the coordinate actuators of the model itself from the list of what is not computed.
///
/// # Errors
/// A coordinate that the model does not have.
pub fn adopt_model_actuators(setup: &Setup, system: &mut System) -> Result<(), ToolError> {
    let found: Vec<(usize, String)> = system
        .spec
        .forces
        .iter()
        .filter(|f| system.unsupported.iter().any(|(n, class)| *n == f.name && class == "CoordinateActuator"))
        .filter_map(|f| f.at.element.map(|e| (e, f.name.clone())))
        .collect();
    for (element, name) in found {
        if let Some(actuator) = read(&setup.at_element(element), system)? {
            system.actors.push(Actor::Coordinate(Box::new(CoordinateActuator { name: name.clone(), ..actuator })));
        }
        system.unsupported.retain(|(n, _)| *n != name);
    }
    Ok(())
}

/// Adds the forces of a file (`force_set_files`).
///
/// # Errors
/// The file; a class that is not supported here; a coordinate that the model does not have.
pub fn add_force_set(path: &Path, system: &mut System) -> Result<Vec<(usize, String)>, ToolError> {
    let setup = Setup::read(path)?;
    let set = setup.object();
    if set.class() != "ForceSet" && set.class() != "ActuatorSet" {
        return Err(set.unsupported(set.class(), "expected a ForceSet"));
    }
    for force in set.objects("") {
        match force.class() {
            "CoordinateActuator" | "GeneralizedForce" => {
                if let Some(actuator) = read(&force, system)? {
                    system.actors.push(Actor::Coordinate(Box::new(actuator)));
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
