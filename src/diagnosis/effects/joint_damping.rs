//! Viscous damping of the joint.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude};

/// Viscous damping of the joint: `-b q̇`.
pub struct JointDamping;

static DESCRIPTION: Description = Description {
    id: "joint_damping",
    name: "Viscous damping of the joint",
    stage: Stage::Joint,
    equation: "-b q̇",
    parameters: &[amplitude(
        "damping",
        "N·m·s/rad",
        0.03,
        [0.0, 0.2],
        "0.01 to 0.1 N·m·s/rad in perturbation studies of the wrist",
    )],
    signature: "a line against velocity, nothing in isometric trials",
    experiment: "fast passive sweep",
    rivals: &["max_contraction_velocity", "coulomb_friction", "power_law_damping"],
    osim_form: OsimForm::Native("SpringGeneralizedForce, viscosity"),
    unidentifiable: None,
};

impl Effect for JointDamping {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [b] = *values else { return };
        for k in 0..moment.len() {
            moment[k] += -b * joint.speed[k];
        }
    }
}
