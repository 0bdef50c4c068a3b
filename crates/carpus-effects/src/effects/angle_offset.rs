//! Offset of the goniometer.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Offset of the goniometer: `q + δ`.
pub struct AngleOffset;

static DESCRIPTION: Description = Description {
    id: "angle_offset",
    name: "Offset of the goniometer",
    stage: Stage::Geometry,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "q + δ",
    parameters: &[amplitude(
        "offset",
        "rad",
        0.05,
        [-0.18, 0.18],
        "placement of goniometers, ±3 to ±10° (assumed, no published source)",
    )],
    signature: "angle × activation",
    experiment: "check of the goniometer in the neutral posture",
    rivals: &["moment_arm_slope", "joint_stiffness"],
    osim_form: OsimForm::SideCar("a property of the recording"),
    unidentifiable: None,
};

impl Effect for AngleOffset {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn change_angle(&self, values: &[f64], _: &TrialContext, angle: &mut [f64]) {
        let [offset] = *values else { return };
        if offset == 0.0 {
            return;
        }
        angle.iter_mut().for_each(|q| *q += offset);
    }
}
