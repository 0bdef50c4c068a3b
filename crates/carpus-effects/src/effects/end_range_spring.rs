//! Passive springs at the ends of the range.

use crate::effect::{Behaviour, Description, Effect, JointState, NativeForm, OsimForm, Stage, amplitude, shape};

/// Passive springs at the ends of the range: `a1 exp(-b1 (q - qn + 90°)) - a2 exp(b2 (q - qn - 90°))`, q positive in
/// flexion, qn the joint's neutral angle.
pub struct EndRangeSpring;

static DESCRIPTION: Description = Description {
    id: "end_range_spring",
    name: "Passive springs at the ends of the range",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "a1 exp(-b1 (q - qn + 90°)) - a2 exp(b2 (q - qn - 90°)), q positive in flexion, qn the joint's neutral \
        angle: 0, or the middle of the coordinate's range where 0 is not in its middle half",
    parameters: &[
        amplitude(
            "extension_moment",
            "N·m at 90° extension",
            0.6,
            [0.0, 4.0],
            "Delp, Grierson and Buchanan 1996: 1.2 N·m on average at 90° extension; 0 to 4 is still taken for \
             plausible, no source",
        )
        .of_strength(),
        amplitude(
            "flexion_moment",
            "N·m at 90° flexion",
            0.6,
            [0.0, 4.0],
            "Delp, Grierson and Buchanan 1996: 0.5 N·m on average at 90° flexion; 0 to 4 is still taken for \
             plausible, no source",
        )
        .of_strength(),
        shape(
            "extension_steepness",
            "1/rad",
            4.0,
            1.5,
            [2.0, 10.0],
            "3 to 10 (assumed, no published source); from 2 on is still taken for plausible",
        ),
        shape(
            "flexion_steepness",
            "1/rad",
            4.0,
            1.5,
            [2.0, 10.0],
            "3 to 10 (assumed, no published source); from 2 on is still taken for plausible",
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
        let [extension, flexion, below, above] = *values else { return };
        if extension == 0.0 && flexion == 0.0 {
            return;
        }
        let quarter_turn = std::f64::consts::FRAC_PI_2;
        for k in 0..moment.len() {
            let q = joint.angle[k] - joint.trial.neutral_angle;
            moment[k] += extension * (-below * (q + quarter_turn)).exp();
            moment[k] -= flexion * (above * (q - quarter_turn)).exp();
        }
    }

    fn native_form(&self, values: &[f64], neutral_angle: f64) -> Option<NativeForm> {
        let [extension, flexion, below, above] = *values else { return None };
        let quarter_turn = std::f64::consts::FRAC_PI_2;
        let (low, high) = (neutral_angle - quarter_turn, neutral_angle + quarter_turn);
        let lower = format!("{extension:?}*exp(-({below:?})*(q-({low:?})))");
        Some(NativeForm::Formula(format!("{lower}-({flexion:?})*exp(({above:?})*(q-({high:?})))")))
    }
}
