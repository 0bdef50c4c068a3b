//! Generalized forces that draw every coordinate to a given motion: OpenSim's `CorrectionController`.
//!
//! ```text
//! force = kp·(q_desired − q) + kv·(u_desired − u)
//! ```
//! OpenSim 4.6 makes it act in a `ForwardTool` alone, from the setup's own `ControllerSet`: of a model's, every tool stops
//! ("already has a connectee") or crashes, as does an `AnalyzeTool` of a setup that has one.

use super::error::{ToolError, ToolProblem};
use super::setup::Properties;
use super::system::{System, SystemState};
use carpus_multibody::forces::AppliedForces;
use carpus_osim::osim::spec::ForceKind;
use carpus_osim::storage::Storage;

/// The class.
const CLASS: &str = "CorrectionController";
/// What to do instead where it does not act.
pub const ELSEWHERE: &str =
    "OpenSim 4.6 runs it only in the <ControllerSet> of a ForwardTool's setup, with a states_file";

/// A `CorrectionController`: one force on every coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Name of the controller.
    pub name: String,
    /// Names of its forces, by coordinate.
    pub labels: Vec<String>,
    /// Force by error of a coordinate [N/m or N·m/rad] (`kp`); 0 where the controller is not enabled.
    position_gain: f64,
    /// Force by error of a speed [N·s/m or N·m·s/rad] (`kv`); 0 where the controller is not enabled.
    speed_gain: f64,
    /// Coordinates on which there is no force: locked, prescribed or dependent ones.
    held: Vec<bool>,
    /// Value and speed of every coordinate over time, straight between rows and beyond them.
    desired: Storage,
}

impl Correction {
    /// Whether a tool follows this controller of its setup.
    pub fn acts_in(tool: &Properties, controller: &Properties) -> bool {
        controller.class() == CLASS && tool.class() == "ForwardTool"
    }

    /// Reads the one of a setup, if it has one. A second one does nothing, as in OpenSim, where it finds the first one's
    /// actuators under the names of its own; that is the second string.
    ///
    /// - `desired`: the rows of the `states_file`
    ///
    /// # Errors
    /// Gains that are no numbers, no `states_file`, or an actuator of the model that has the name of one of its own.
    pub fn read(
        tool: &Properties,
        system: &System,
        desired: &[SystemState],
    ) -> Result<Option<(Correction, Option<String>)>, ToolError> {
        let all: Vec<_> = tool.objects("ControllerSet").into_iter().filter(|c| Self::acts_in(tool, c)).collect();
        let Some(controller) = all.first() else { return Ok(None) };
        all.iter().for_each(|c| c.ignore_all(&["actuator_list", "socket_actuators", "isDisabled", "enabled"]));
        all[1..].iter().for_each(|c| c.ignore_all(&["kp", "kv"]));
        let gains = [controller.number("kp", 100.0)?, controller.number("kv", 20.0)?];
        let enabled = controller.is_enabled()?;
        if enabled && desired.is_empty() {
            return Err(tool.missing("states_file", "the states that a CorrectionController follows"));
        }
        let [position_gain, speed_gain] = if enabled { gains } else { [0.0; 2] };
        let coordinates = &system.model.coordinates;
        let correction = Correction {
            name: controller.name(),
            labels: coordinates.iter().map(|c| format!("{}_corrector", c.name)).collect(),
            position_gain,
            speed_gain,
            held: (0..coordinates.len()).map(|i| system.is_constrained(i)).collect(),
            desired: coordinates_over_time(desired),
        };
        correction.require_own_names(controller, system)?;
        let second =
            all.get(1).map(|c| format!("{} does nothing, as in OpenSim: one {CLASS} is there already", c.name()));
        Ok(Some((correction, second)))
    }

    /// OpenSim takes actuators that have these names for its own, and then lets others follow wrong coordinates.
    fn require_own_names(&self, controller: &Properties, system: &System) -> Result<(), ToolError> {
        let is_actuator = |kind: &ForceKind| matches!(kind, ForceKind::Actuator(_));
        let names = system.spec.forces.iter().filter(|force| is_actuator(&force.kind)).map(|force| &force.name);
        let Some(taken) = names.into_iter().find(|name| self.labels.contains(name)) else { return Ok(()) };
        let what =
            format!("a {CLASS} makes an actuator `{taken}`, and the model has one of this name: give it another");
        Err(controller.error_at(CLASS, ToolProblem::Data { what }))
    }

    /// The force on every coordinate [N or N·m].
    ///
    /// - `q`, `u`: coordinates [m or rad] and speeds
    pub fn forces(&self, time: f64, q: &[f64], u: &[f64]) -> Vec<f64> {
        let mut forces = vec![0.0; self.held.len()];
        if self.position_gain == 0.0 && self.speed_gain == 0.0 {
            return forces;
        }
        let desired = self.desired.at(time);
        for (i, force) in forces.iter_mut().enumerate().filter(|(i, _)| !self.held[*i]) {
            *force = self.position_gain * (desired[2 * i] - q[i]) + self.speed_gain * (desired[2 * i + 1] - u[i]);
        }
        forces
    }

    /// Adds its forces.
    pub fn apply(&self, time: f64, q: &[f64], u: &[f64], applied: &mut AppliedForces) {
        applied.mobility.iter_mut().zip(self.forces(time, q, u)).for_each(|(sum, force)| *sum += force);
    }
}

fn coordinates_over_time(states: &[SystemState]) -> Storage {
    let rows = states.iter().map(|s| s.q.iter().zip(&s.u).flat_map(|(q, u)| [*q, *u]).collect());
    Storage { time: states.iter().map(|s| s.time).collect(), rows: rows.collect(), ..Storage::default() }
}
