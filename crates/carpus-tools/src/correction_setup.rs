//! Reads a `CorrectionController` of a setup.

use super::correction::{CLASS, Correction};
use super::error::{ToolError, ToolProblem};
use super::setup::Properties;
use super::system::{System, SystemState};
use carpus_osim::osim::spec::ForceKind;
use carpus_osim::storage::Storage;

impl Correction {
    /// Reads the one of a setup, if it has one. A second one does nothing, as in OpenSim, where it finds the first
    /// one's actuators under the names of its own; that is the second string.
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
}

fn coordinates_over_time(states: &[SystemState]) -> Storage {
    let rows = states.iter().map(|s| s.q.iter().zip(&s.u).flat_map(|(q, u)| [*q, *u]).collect());
    Storage { time: states.iter().map(|s| s.time).collect(), rows: rows.collect(), ..Storage::default() }
}
