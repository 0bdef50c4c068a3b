//! Weight of the hand.

use crate::effect::{Behaviour, Description, Effect, FlippedArm, JointState, NativeForm, OsimForm, Stage, amplitude};

/// Weight of the hand: `-(A cos q + B sin q); A² + B² = (m g l)²`, with the other sign where the forearm is turned
/// over.
pub struct Gravity;

static DESCRIPTION: Description = Description {
    id: "gravity",
    name: "Weight of the hand",
    stage: Stage::Inertia,
    order: 0,
    behaviour: Behaviour { flipped_arm: FlippedArm::Reversed, ..Behaviour::PLAIN },
    equation: "-(A cos q + B sin q); A² + B² = (m g l)²",
    parameters: &[
        amplitude(
            "moment_at_zero",
            "N·m",
            0.2,
            [-1.2, 1.2],
            "weight of the hand 0.2 to 0.6 N·m, and the attachment (assumed, no published source); up to 1.2 either \
             way, with a handle, is still taken for plausible",
        )
        .of_weight(),
        amplitude("moment_at_90_deg", "N·m", 0.2, [-1.2, 1.2], "the same, for another direction of gravity")
            .of_weight(),
    ],
    signature: "a sinusoid against angle, the same at every activation",
    experiment: "relaxed sweep, forearm turned over (arm = flipped in trials.csv: the other sign)",
    rivals: &["joint_stiffness", "torque_offset"],
    osim_form: OsimForm::Native(
        "ExpressionBasedCoordinateForce (the direction of gravity in the machine is not in the model, so that a \
         body's mass would not do)",
    ),
    unidentifiable: None,
};

impl Effect for Gravity {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [a, b] = *values else { return };
        if a == 0.0 && b == 0.0 {
            return;
        }
        let sign = if joint.trial.arm_flipped { 1.0 } else { -1.0 };
        for k in 0..moment.len() {
            moment[k] += sign * (a * joint.angle[k].cos() + b * joint.angle[k].sin());
        }
    }

    /// Of the arm as most trials have it, upright.
    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [a, b] = *values else { return None };
        Some(NativeForm::Formula(format!("-(({a:?})*cos(q)+({b:?})*sin(q))")))
    }
}
