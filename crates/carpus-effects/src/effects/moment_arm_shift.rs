//! Longer or shorter moment arms.

use crate::effect::{Behaviour, Description, Effect, MuscleState, OsimForm, Stage, amplitude};

/// Moment arms below this [m] are taken as this: where an arm changes sign, a factor of it means nothing.
const SHORTEST_ARM: f64 = 1e-3;

/// Longer or shorter moment arms: `r + δ sign(r)`.
pub struct MomentArmShift;

static DESCRIPTION: Description = Description {
    id: "moment_arm_shift",
    name: "Longer or shorter moment arms",
    stage: Stage::Geometry,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "r + δ sign(r), the same in all active muscles; lengths stay",
    parameters: &[amplitude("shift", "m", 0.001, [-0.003, 0.003], "±3 mm (assumed, no published source)")],
    signature: "a gain of each muscle, hardly anything else",
    experiment: "none by moments alone: imaging of the tendons",
    rivals: &["moment_arm_slope", "emg_gain"],
    osim_form: OsimForm::SideCar("no stock path changes its arm and keeps its length; moved path points come close"),
    unidentifiable: None,
};

impl Effect for MomentArmShift {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn scale_muscle(&self, values: &[f64], muscle: &MuscleState, factor: &mut [f64]) {
        let [shift] = *values else { return };
        if shift == 0.0 {
            return;
        }
        for (factor, arm) in factor.iter_mut().zip(muscle.moment_arm) {
            *factor *= 1.0 + shift / arm.abs().max(SHORTEST_ARM);
        }
    }
}
