//! Damping that saturates.

use crate::effect::{Behaviour, Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude, shape};

/// Rest is not sharper than this speed [rad/s].
const LEAST_REST_SPEED: f64 = 1e-3;

/// Damping that saturates: `-b q̇ (q̇² + v0²)^((p-1)/2): -b sign(q̇) |q̇|^p, smooth through rest`.
pub struct PowerLawDamping;

static DESCRIPTION: Description = Description {
    id: "power_law_damping",
    name: "Damping that saturates",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-b q̇ (q̇² + v0²)^((p-1)/2): -b sign(q̇) |q̇|^p, smooth through rest below v0",
    parameters: &[
        amplitude("damping", "N·m·(s/rad)^p", 0.1, [0.0, 0.6], "no source: at 1 rad/s as large as dry friction may be")
            .of_strength(),
        shape(
            "exponent",
            "1",
            0.17,
            0.08,
            [0.05, 0.5],
            "Gielen and Houk 1984 (Nonlinear viscosity of human wrist): mean exponent 0.17 for force; 0.05 to 0.5 is \
             still taken for plausible, no source",
        ),
        shape(
            "rest_speed",
            "rad/s",
            0.02,
            0.01,
            [0.001, 0.05],
            "below which it is as viscous damping; no source: recorded speeds below 0.02 rad/s are mostly noise",
        ),
    ],
    signature: "concave against velocity",
    experiment: "passive sweeps at three or more speeds",
    rivals: &["coulomb_friction", "joint_damping"],
    osim_form: OsimForm::Native("ExpressionBasedCoordinateForce"),
    unidentifiable: None,
};

impl Effect for PowerLawDamping {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [damping, exponent, rest] = *values else { return };
        if damping == 0.0 {
            return;
        }
        let rest = rest.max(LEAST_REST_SPEED);
        for k in 0..moment.len() {
            let speed = joint.speed[k];
            let magnitude = (speed * speed + rest * rest).powf(0.5 * exponent - 0.5);
            moment[k] += -damping * speed * magnitude;
        }
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [damping, exponent, rest] = *values else { return None };
        let (power, square) = (0.5 * exponent - 0.5, rest.max(LEAST_REST_SPEED).powi(2));
        Some(NativeForm::Formula(format!("-({damping:?})*qdot*(qdot*qdot+{square:?})^({power:?})")))
    }
}
