//! Joint stiffness.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude, shape};

/// Joint stiffness: `-k (q - q0)`.
pub struct JointStiffness;

static DESCRIPTION: Description = Description {
    id: "joint_stiffness",
    name: "Joint stiffness",
    stage: Stage::Joint,
    equation: "-k (q - q0)",
    parameters: &[
        amplitude(
            "stiffness",
            "N·m/rad",
            0.3,
            [0.0, 3.0],
            "robot studies of the relaxed wrist, order 1 N·m/rad; near zero mid-range in Delp et al. 1996",
        ),
        shape("rest_angle", "rad", 0.0, 0.2, [-0.6, 0.6], "posture of the relaxed hand, ±35°"),
    ],
    signature: "a line against angle, the same at every activation",
    experiment: "slow sweep of the relaxed joint",
    rivals: &["gravity", "moment_arm_slope"],
    osim_form: OsimForm::Native("SpringGeneralizedForce"),
    unidentifiable: None,
};

impl Effect for JointStiffness {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [k, q0] = *values else { return };
        for k_ in 0..moment.len() {
            moment[k_] += -k * (joint.angle[k_] - q0);
        }
    }
}
