//! Axes of joint and machine apart.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Axes of joint and machine apart: `τ (1 + s sin q); the part with cos q is a gain but for 1 - cos q and is left to it`.
pub struct AxisMisalignment;

static DESCRIPTION: Description = Description {
    id: "axis_misalignment",
    name: "Axes of joint and machine apart",
    stage: Stage::Sensor,
    equation: "τ (1 + s sin q); the part with cos q is a gain but for 1 - cos q and is left to it",
    parameters: &[amplitude(
        "sine_part",
        "1",
        0.05,
        [-0.2, 0.2],
        "offset over lever, to 20 %; range from the design catalogue, source unverified",
    )],
    signature: "multiplies every moment, with the angle",
    experiment: "realign and repeat",
    rivals: &["moment_arm_slope"],
    osim_form: OsimForm::SideCar("a property of the machine"),
    unidentifiable: None,
};

impl Effect for AxisMisalignment {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let [sine] = *values else { return };
        if sine == 0.0 {
            return;
        }
        for (m, q) in moment.iter_mut().zip(trial.recorded_angle) {
            *m *= 1.0 + sine * q.sin();
        }
    }
}
