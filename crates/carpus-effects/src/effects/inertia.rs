//! Inertia of the hand and the attachment.

use crate::effect::{Behaviour, Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude};

/// Inertia of the hand and the attachment: `-J q̈`.
pub struct Inertia;

static DESCRIPTION: Description = Description {
    id: "inertia",
    name: "Inertia of the hand and the attachment",
    stage: Stage::Inertia,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-J q̈",
    parameters: &[amplitude(
        "inertia",
        "kg·m²",
        0.005,
        [0.0, 0.05],
        "0.002 to 0.02 (assumed, no published source); 0 to 0.05 is still taken for plausible",
    )
    .of_weight()],
    signature: "follows acceleration",
    experiment: "fast start and stop",
    rivals: &["history_dependence", "time_shift"],
    osim_form: OsimForm::Native("inertia of the body, where the moment of the study includes inertia"),
    unidentifiable: None,
};

impl Effect for Inertia {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [j] = *values else { return };
        if j == 0.0 {
            return;
        }
        for k in 0..moment.len() {
            moment[k] += -j * joint.acceleration[k];
        }
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [j] = *values else { return None };
        Some(NativeForm::Inertia(j))
    }
}
