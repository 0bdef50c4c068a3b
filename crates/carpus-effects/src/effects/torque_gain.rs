//! Gain of the sensor.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Gain of the sensor: `τ (1 + g)`.
pub struct TorqueGain;

static DESCRIPTION: Description = Description {
    id: "torque_gain",
    name: "Gain of the sensor",
    stage: Stage::Sensor,
    order: 40,
    behaviour: Behaviour::PLAIN,
    equation: "τ (1 + g)",
    parameters: &[amplitude(
        "gain_error",
        "1",
        0.05,
        [-0.1, 0.1],
        "calibration within ±5 % (assumed, no published source); up to twice that is still taken for plausible",
    )],
    signature: "none",
    experiment: "hung weights",
    rivals: &[],
    osim_form: OsimForm::SideCar("a property of the sensor"),
    unidentifiable: Some(
        "the same as another maximum isometric force of all muscles; only weights hung on the sensor tell",
    ),
};

impl Effect for TorqueGain {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], _: &TrialContext, moment: &mut Vec<f64>) {
        let [gain] = *values else { return };
        if gain == 0.0 {
            return;
        }
        moment.iter_mut().for_each(|m| *m *= 1.0 + gain);
    }
}
