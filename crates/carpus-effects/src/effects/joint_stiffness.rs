//! Joint stiffness.

use crate::effect::{
    Behaviour, Description, Effect, JointState, NativeForm, NeutralShift, OsimForm, Stage, amplitude, angle,
};

/// Joint stiffness: `-k (q - q0)`.
pub struct JointStiffness;

static DESCRIPTION: Description = Description {
    id: "joint_stiffness",
    name: "Joint stiffness",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-k (q - q0)",
    parameters: &[
        amplitude(
            "stiffness",
            "N·m/rad",
            0.3,
            [0.0, 3.0],
            "Delp, Grierson and Buchanan 1996 (maximum isometric moments of the wrist muscles): passive moment near \
             zero over the central 150°; passive stiffness measured by robots: Formica et al. 2012 (The passive \
             stiffness of the wrist and forearm); 0 to 3: assumed, no published source",
        )
        .of_strength(),
        angle(
            "rest_angle",
            NeutralShift::Along,
            0.0,
            0.2,
            [-0.6, 0.6],
            "no source: within 34° of the joint's neutral \
            angle",
        ),
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
        if k == 0.0 {
            return;
        }
        for k_ in 0..moment.len() {
            moment[k_] += -k * (joint.angle[k_] - q0);
        }
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [stiffness, rest_angle] = *values else { return None };
        Some(NativeForm::Spring { stiffness, rest_angle, viscosity: 0.0 })
    }
}
