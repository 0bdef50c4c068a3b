//! Dry friction.

use crate::effect::{Behaviour, Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude, shape};

/// Speed up to which breakaway friction acts [rad/s].
const BREAKAWAY_SPEED: f64 = 0.1;
/// A step is not steeper than over this speed [rad/s].
const LEAST_TRANSITION_SPEED: f64 = 0.002;

/// Dry friction: `-Tc (1 + (r - 1) exp(-(q̇/vs)²)) tanh(q̇/vε)`, r = Ts/Tc, vs = 0.1 rad/s.
pub struct CoulombFriction;

static DESCRIPTION: Description = Description {
    id: "coulomb_friction",
    name: "Dry friction",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-Tc (1 + (r - 1) exp(-(q̇/vs)²)) tanh(q̇/vε), r = Ts/Tc; fixed: vs = 0.1 rad/s",
    parameters: &[
        amplitude(
            "friction",
            "N·m",
            0.1,
            [0.0, 0.6],
            "0.05 to 0.5 (assumed, no published source); 0 to 0.6 is still taken for plausible",
        )
        .of_strength(),
        shape(
            "static_ratio",
            "1",
            1.2,
            0.2,
            [0.5, 2.0],
            "friction at rest over that in motion; dry contacts 1 to 2, source unverified; below 1 it grows with speed",
        ),
        shape(
            "transition_speed",
            "rad/s",
            0.04,
            0.02,
            [0.002, 0.1],
            "over which the step at reversal is smooth; no source: as sharp as recorded speeds show, 0.01 to 0.1 in \
             simulations",
        ),
    ],
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
        let [friction, ratio, transition] = *values else { return };
        if friction == 0.0 {
            return;
        }
        let transition = transition.max(LEAST_TRANSITION_SPEED);
        for k in 0..moment.len() {
            let speed = joint.speed[k];
            let breakaway = 1.0 + (ratio - 1.0) * (-(speed / BREAKAWAY_SPEED).powi(2)).exp();
            moment[k] += -friction * breakaway * (speed / transition).tanh();
        }
    }

    fn moment_derivative(&self, values: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        let [friction, ratio, given] = *values else { return None };
        let transition = given.max(LEAST_TRANSITION_SPEED);
        let by = |speed: &f64| {
            let (excess, slide) = ((-(speed / BREAKAWAY_SPEED).powi(2)).exp(), (speed / transition).tanh());
            let breakaway = 1.0 + (ratio - 1.0) * excess;
            match parameter {
                0 => -breakaway * slide,
                1 => -friction * excess * slide,
                _ if given < LEAST_TRANSITION_SPEED => 0.0,
                _ => friction * breakaway * (1.0 - slide * slide) * speed / (transition * transition),
            }
        };
        Some(joint.speed.iter().map(by).collect())
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [friction, ratio, transition] = *values else { return None };
        let (excess, transition) = (ratio - 1.0, transition.max(LEAST_TRANSITION_SPEED));
        let breakaway = format!("(1+({excess:?})*exp(-square(qdot/{BREAKAWAY_SPEED:?})))");
        Some(NativeForm::Formula(format!("-({friction:?})*{breakaway}*tanh(qdot/{transition:?})")))
    }
}
