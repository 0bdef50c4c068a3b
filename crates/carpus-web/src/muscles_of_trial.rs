//! What every muscle does in a trial, and the model's posture at a sample of it.

use super::scene::{Scene, SceneError};
use super::workbench::{Workbench, WorkbenchError};
use carpus_effects::forward_model::Setting;
use carpus_simulation::simulation::{HeldCoordinate, MuscleParameters};

/// Parameters per muscle by which moments are derived: the first is the maximum isometric force.
const PER_MUSCLE: usize = 3;

/// Moment arm below which a force is not taken from the moment [m].
const NO_ARM: f64 = 1e-9;

/// What an active muscle does, at the samples of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleOfTrial {
    /// Activation.
    pub activation: Vec<f64>,
    /// Force of its tendon on the bones [N].
    pub force: Vec<f64>,
    /// Moment about the moving coordinate [N·m].
    pub moment: Vec<f64>,
}

impl Workbench {
    /// Every active muscle in a trial, with effects on muscles and what drives them.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn muscles_of_trial(
        &self,
        trial: usize,
        muscles: &[MuscleParameters],
        effects: &[Setting],
    ) -> Result<Vec<MuscleOfTrial>, WorkbenchError> {
        if trial >= self.trials.len() {
            return Ok(Vec::new());
        }
        let variant = self.forward.variant(effects)?;
        let input = self.forward.recorded_input(trial);
        let core = self.forward.core(&variant, trial, &input, muscles, effects, true)?;
        let of = |(i, kinematics): (usize, &carpus_simulation::simulation::MuscleKinematics)| {
            // A moment is proportional to the force: its derivative by the force's logarithm is the moment itself.
            let moment = core.by_parameters[PER_MUSCLE * i].clone();
            let unit = &core.solutions[i].force;
            let alone = |k: usize| muscles[i].max_isometric_force * core.factors[i][k] * unit[k];
            let force = |(k, arm): (usize, &f64)| if arm.abs() > NO_ARM { moment[k] / arm } else { alone(k) };
            let force = kinematics.moment_arm.iter().enumerate().map(force).collect();
            MuscleOfTrial { activation: kinematics.activation.clone(), force, moment }
        };
        Ok(core.prepared.kinematics().muscles.iter().enumerate().map(of).collect())
    }

    /// The model, to be drawn.
    ///
    /// # Errors
    /// The path of a muscle that no trial uses.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        Scene::of(&self.file)
    }

    /// All coordinates at a sample of a trial [rad or m]: the study's posture, the moving coordinate as recorded, those
    /// that follow it.
    pub fn coordinates_at(&self, trial: usize, sample: usize) -> Vec<f64> {
        let Some(trial) = self.trials.get(trial) else { return self.model.posture.clone() };
        let held: Vec<HeldCoordinate> = trial.info.held.iter().map(HeldCoordinate::from).collect();
        // Trials were prepared in their postures, so that each can be taken.
        let mut q = self.model.posture_with(&held).unwrap_or_else(|_| self.model.posture.clone());
        if let Some(angle) = trial.angle.get(sample) {
            q[self.model.coordinate().0] = *angle;
            self.model.skeleton().satisfy_couplers(&mut q);
        }
        q
    }
}
