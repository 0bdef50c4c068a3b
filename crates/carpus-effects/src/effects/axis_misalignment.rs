//! Axes of joint and machine apart.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Axes of joint and machine apart: `τ (1 + s sin q + c cos q) = τ (1 + (e/L) cos(q - φ))`, e/L the offset over the
/// lever.
pub struct AxisMisalignment;

static DESCRIPTION: Description = Description {
    id: "axis_misalignment",
    name: "Axes of joint and machine apart",
    stage: Stage::Sensor,
    order: 10,
    behaviour: Behaviour::PLAIN,
    equation: "τ (1 + s sin q + c cos q) = τ (1 + (e/L) cos(q - φ)), e/L the offset over the lever",
    parameters: &[
        amplitude(
            "sine_part",
            "1",
            0.05,
            [-0.2, 0.2],
            "offset over lever, to 20 % (assumed, no published source), in either part",
        ),
        amplitude(
            "cosine_part",
            "1",
            0.05,
            [-0.2, 0.2],
            "as the sine part; hardly to be told from the muscles' strength",
        ),
    ],
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
        let [sine, cosine] = *values else { return };
        if sine == 0.0 && cosine == 0.0 {
            return;
        }
        for (m, q) in moment.iter_mut().zip(trial.recorded_angle) {
            *m *= 1.0 + sine * q.sin() + cosine * q.cos();
        }
    }
}
