//! Dry friction.

use crate::diagnosis::effect::{Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude};

/// Dry friction: `-(Tc + (Ts - Tc) exp(-(q̇/vs)²)) tanh(q̇/vε); fixed: Ts = 1.25 Tc, vs = 0.1 rad/s, vε = 0.03 rad/s`.
pub struct CoulombFriction;

static DESCRIPTION: Description = Description {
    id: "coulomb_friction",
    name: "Dry friction",
    stage: Stage::Joint,
    equation: "-(Tc + (Ts - Tc) exp(-(q̇/vs)²)) tanh(q̇/vε); fixed: Ts = 1.25 Tc, vs = 0.1 rad/s, vε = 0.03 rad/s",
    parameters: &[amplitude("friction", "N·m", 0.1, [0.0, 0.6], "range from the design catalogue, source unverified")],
    signature: "a step where the movement reverses",
    experiment: "slow sweep with reversals",
    rivals: &["joint_damping", "power_law_damping", "thixotropy"],
    osim_form: OsimForm::Native("ExpressionBasedCoordinateForce"),
    unidentifiable: None,
};

impl Effect for CoulombFriction {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [friction] = *values else { return };
        if friction == 0.0 {
            return;
        }
        for k in 0..moment.len() {
            let speed = joint.speed[k];
            let breakaway = 1.0 + 0.25 * (-(speed / 0.1).powi(2)).exp();
            moment[k] += -friction * breakaway * (speed / 0.03).tanh();
        }
    }

    fn native_form(&self, values: &[f64]) -> Option<NativeForm> {
        let [friction] = *values else { return None };
        Some(NativeForm::Formula(format!("-({friction:?})*(1+0.25*exp(-square(qdot/0.1)))*tanh(qdot/0.03)")))
    }
}
