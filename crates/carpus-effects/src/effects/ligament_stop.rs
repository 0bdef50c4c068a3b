//! Ligament stop.

use crate::effect::{
    Behaviour, Description, Effect, JointState, NativeForm, NeutralShift, OsimForm, Stage, amplitude, angle,
};

/// Angle over which the stiffness sets in [rad]: 1°.
const TRANSITION: f64 = 0.017453292519943295;

/// OpenSim's smooth step, 0 to 1 over the transition.
fn step(beyond: f64) -> f64 {
    let x = (beyond / TRANSITION).clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// Ligament stop: `-k s(q - q1) (q - q1) + k s(-q - q2) (-q - q2)`, as OpenSim's `CoordinateLimitForce`.
pub struct LigamentStop;

static DESCRIPTION: Description = Description {
    id: "ligament_stop",
    name: "Ligament stop",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "-k s(q - q1) (q - q1) + k s(-q - q2) (-q - q2), s a smooth step from 0 to 1 over 1°, q positive in \
        flexion; on one side only if the other limit is out of reach",
    parameters: &[
        amplitude(
            "stiffness",
            "N·m/rad",
            1.0,
            [0.0, 20.0],
            "0.5 to 20 (assumed, no published source); less is still taken for plausible",
        )
        .of_strength(),
        angle(
            "flexion_limit",
            NeutralShift::Along,
            0.4,
            0.35,
            [0.1, 1.6],
            "no source: from near the middle of the range to its anatomical end",
        ),
        angle(
            "extension_limit",
            NeutralShift::Against,
            0.4,
            0.35,
            [0.1, 1.6],
            "no source: from near the middle of the range to its anatomical end",
        ),
    ],
    signature: "a hinge against angle",
    experiment: "sweep beyond ±35°",
    rivals: &["end_range_spring", "joint_stiffness"],
    osim_form: OsimForm::Native("CoordinateLimitForce"),
    unidentifiable: None,
};

impl Effect for LigamentStop {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    /// On one side only.
    fn further_starts(&self) -> &'static [&'static [f64]] {
        &[&[0.0, 0.4, 1.2], &[0.0, 1.2, 0.4]]
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [stiffness, upper, lower] = *values else { return };
        if stiffness == 0.0 {
            return;
        }
        for k in 0..moment.len() {
            let q = joint.angle[k];
            let (above, below) = (q - upper, -q - lower);
            moment[k] += stiffness * (step(below) * below - step(above) * above);
        }
    }

    fn native_form(&self, values: &[f64], _: f64) -> Option<NativeForm> {
        let [stiffness, upper, lower] = *values else { return None };
        // OpenSim takes no limits that overlap.
        let limit = [-lower, upper];
        (limit[0] < limit[1]).then_some(NativeForm::Limit { stiffness, limit, transition: TRANSITION })
    }
}
