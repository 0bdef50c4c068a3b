//! Damping that saturates.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude, shape};

/// Damping that saturates: `-b sign(q̇) |q̇|^p`.
pub struct PowerLawDamping;

static DESCRIPTION: Description = Description {
    id: "power_law_damping",
    name: "Damping that saturates",
    stage: Stage::Joint,
    equation: "-b sign(q̇) |q̇|^p",
    parameters: &[
        amplitude("damping", "N·m·(s/rad)^p", 0.1, [0.0, 0.6], "passive loops that hardly depend on speed"),
        shape("exponent", "1", 0.17, 0.08, [0.05, 0.5], "about 0.17"),
    ],
    signature: "concave against velocity",
    experiment: "passive sweeps at three or more speeds",
    rivals: &["coulomb_friction", "joint_damping"],
    osim_form: OsimForm::SideCar("a power of speed is not in the expression parser without kinks"),
    unidentifiable: None,
};

impl Effect for PowerLawDamping {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [damping, exponent] = *values else { return };
        for k in 0..moment.len() {
            let speed = joint.speed[k];
            // Smooth through rest: below 0.02 rad/s measured speed is mostly noise.
            let magnitude = (speed * speed + 4e-4).powf(0.5 * exponent - 0.5);
            moment[k] += -damping * speed * magnitude;
        }
    }
}
