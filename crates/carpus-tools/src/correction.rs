//! Generalized forces that draw every coordinate to a given motion: OpenSim's `CorrectionController`.
//!
//! ```text
//! force = kp·(q_desired − q) + kv·(u_desired − u)
//! ```
//! OpenSim 4.6 makes it act in a `ForwardTool` alone, from the setup's own `ControllerSet`: of a model's, every tool
//! stops ("already has a connectee") or crashes, as does an `AnalyzeTool` of a setup that has one.

use super::setup::Properties;
use carpus_multibody::forces::AppliedForces;
use carpus_osim::storage::Storage;

/// The class.
pub(super) const CLASS: &str = "CorrectionController";
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
    pub(super) position_gain: f64,
    /// Force by error of a speed [N·s/m or N·m·s/rad] (`kv`); 0 where the controller is not enabled.
    pub(super) speed_gain: f64,
    /// Coordinates on which there is no force: locked, prescribed or dependent ones.
    pub(super) held: Vec<bool>,
    /// Value and speed of every coordinate over time, straight between rows and beyond them.
    pub(super) desired: Storage,
}

impl Correction {
    /// Whether a tool follows this controller of its setup.
    pub fn acts_in(tool: &Properties, controller: &Properties) -> bool {
        controller.class() == CLASS && tool.class() == "ForwardTool"
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
