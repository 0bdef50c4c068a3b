//! Passive springs at the ends of the range.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude, shape};

/// Passive springs at the ends of the range: `a1 exp(-b (q - q1)) - a2 exp(b (q - q2))`.
pub struct EndRangeSpring;

static DESCRIPTION: Description = Description {
    id: "end_range_spring",
    name: "Passive springs at the ends of the range",
    stage: Stage::Joint,
    equation: "a1 exp(-b (q - q1)) - a2 exp(b (q - q2))",
    parameters: &[
        amplitude("extension_moment", "N·m at 90° extension", 0.6, [0.0, 4.0], "about 1.2 N·m at 90° extension"),
        amplitude("flexion_moment", "N·m at 90° flexion", 0.6, [0.0, 4.0], "about 0.5 N·m at 90° flexion"),
        shape(
            "steepness",
            "1/rad",
            4.0,
            1.5,
            [2.0, 10.0],
            "double-exponential fits of passive joint moments, 3 to 10 per rad",
        ),
    ],
    signature: "curves up at the ends of the range",
    experiment: "sweep beyond ±35°",
    rivals: &["ligament_stop"],
    osim_form: OsimForm::Native("ExpressionBasedCoordinateForce"),
    unidentifiable: None,
};

impl Effect for EndRangeSpring {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [extension, flexion, steepness] = *values else { return };
        let quarter_turn = std::f64::consts::FRAC_PI_2;
        for k in 0..moment.len() {
            let q = joint.angle[k];
            moment[k] += extension * (-steepness * (q + quarter_turn)).exp();
            moment[k] -= flexion * (steepness * (q - quarter_turn)).exp();
        }
    }
}
