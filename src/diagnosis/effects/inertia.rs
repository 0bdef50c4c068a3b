//! Inertia of the hand and the attachment.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude};

/// Inertia of the hand and the attachment: `-J q̈`.
pub struct Inertia;

static DESCRIPTION: Description = Description {
    id: "inertia",
    name: "Inertia of the hand and the attachment",
    stage: Stage::Inertia,
    equation: "-J q̈",
    parameters: &[amplitude("inertia", "kg·m²", 0.005, [0.0, 0.05], "0.002 to 0.02 kg·m² with the attachment")],
    signature: "follows acceleration",
    experiment: "fast start and stop",
    rivals: &["history_dependence", "time_shift"],
    osim_form: OsimForm::Native("inertia of the body"),
    unidentifiable: None,
};

impl Effect for Inertia {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [j] = *values else { return };
        for k in 0..moment.len() {
            moment[k] += -j * joint.acceleration[k];
        }
    }
}
