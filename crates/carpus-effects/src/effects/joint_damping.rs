//! Viscous damping of the joint.

use crate::effect::{Behaviour, Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude};

/// Viscous damping of the joint: `-b q̇`.
pub struct JointDamping;

static DESCRIPTION: Description = Description {
    id: "joint_damping",
    name: "Viscous damping of the joint",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-b q̇",
    parameters: &[amplitude(
        "damping",
        "N·m·s/rad",
        0.03,
        [0.0, 0.2],
        "Falzarano et al. 2021 (doi:10.3389/fnhum.2021.726841) measured it; 0.01 to 0.1 (assumed, no published \
         source); 0 to 0.2 is still taken for plausible",
    )
    .of_strength()],
    signature: "a line against velocity, nothing in isometric trials",
    experiment: "fast passive sweep",
    rivals: &["max_contraction_velocity", "coulomb_friction", "power_law_damping"],
    osim_form: OsimForm::Native("SpringGeneralizedForce (viscosity)"),
    unidentifiable: None,
};

impl Effect for JointDamping {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [b] = *values else { return };
        if b == 0.0 {
            return;
        }
        for k in 0..moment.len() {
            moment[k] += -b * joint.speed[k];
        }
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [viscosity] = *values else { return None };
        Some(NativeForm::Spring { stiffness: 0.0, rest_angle: 0.0, viscosity })
    }
}
