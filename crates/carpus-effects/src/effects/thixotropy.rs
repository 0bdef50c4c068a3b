//! Thixotropy: short-range elasticity of passive muscle.

use crate::effect::{Behaviour, Description, Effect, JointState, OsimForm, Stage, amplitude, shape};

/// Thixotropy: short-range elasticity of passive muscle: `-σ z, ż = q̇ - |q̇| z/z0; no recovery at rest`.
pub struct Thixotropy;

static DESCRIPTION: Description = Description {
    id: "thixotropy",
    name: "Thixotropy: short-range elasticity of passive muscle",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-σ z, ż = q̇ - |q̇| z/z0; no recovery at rest",
    parameters: &[
        amplitude(
            "stiffness",
            "N·m/rad",
            3.0,
            [0.0, 30.0],
            "Lakie, Walsh and Wright 1984 (J Physiol 353:265): the relaxed wrist is thixotropic, memory 1 to 2 s; \
             0.05 to 0.5 N·m over 1 to 3°, unverified, is 1 to 29; 0 to 30 is taken for plausible",
        )
        .of_strength(),
        shape("range", "rad", 0.035, 0.01, [0.0175, 0.0525], "1 to 3° (assumed, no published source)"),
    ],
    signature: "a loop after every reversal",
    experiment: "rest, then a small sweep",
    rivals: &["coulomb_friction"],
    osim_form: OsimForm::SideCar("needs a state of its own"),
    unidentifiable: None,
};

impl Effect for Thixotropy {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [stiffness, range] = *values else { return };
        if stiffness == 0.0 {
            return;
        }
        let mut z = 0.0;
        for k in 0..moment.len() {
            if k > 0 {
                // Exact for constant speed over the interval.
                let travel = joint.angle[k] - joint.angle[k - 1];
                let target = range * travel.signum();
                z = target + (z - target) * (-travel.abs() / range).exp();
            }
            moment[k] += -stiffness * z;
        }
    }
}
