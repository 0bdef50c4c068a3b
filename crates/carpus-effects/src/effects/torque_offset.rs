//! Offset of the sensor.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Offset of the sensor: `τ + b`.
pub struct TorqueOffset;

static DESCRIPTION: Description = Description {
    id: "torque_offset",
    name: "Offset of the sensor",
    stage: Stage::Sensor,
    order: 50,
    behaviour: Behaviour::PLAIN,
    equation: "τ + b",
    parameters: &[amplitude(
        "offset",
        "N·m",
        0.1,
        [-0.6, 0.6],
        "zero of dynamometers, ±0.3 N·m (assumed, no published source); up to twice that is still taken for plausible",
    )
    .of_strength()],
    signature: "a constant",
    experiment: "unloaded zero of the sensor",
    rivals: &["gravity", "joint_stiffness"],
    osim_form: OsimForm::SideCar("a property of the sensor"),
    unidentifiable: None,
};

impl Effect for TorqueOffset {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], _: &TrialContext, moment: &mut Vec<f64>) {
        let [offset] = *values else { return };
        if offset == 0.0 {
            return;
        }
        moment.iter_mut().for_each(|m| *m += offset);
    }
}
