//! Moment arms that change with the angle.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Moment arms that change with the angle: `r (1 + s q)`.
pub struct MomentArmSlope;

static DESCRIPTION: Description = Description {
    id: "moment_arm_slope",
    name: "Moment arms that change with the angle",
    stage: Stage::Geometry,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "r (1 + s q)",
    parameters: &[amplitude(
        "slope",
        "1/rad",
        0.1,
        [-0.4, 0.4],
        "±0.3 per rad (assumed, no published source); ±0.4 is still taken for plausible",
    )],
    signature: "angle × activation",
    experiment: "five or more isometric angles",
    rivals: &["angle_offset", "unmodelled_muscles", "active_force_width", "axis_misalignment", "emg_gain_drift"],
    osim_form: OsimForm::SideCar("no stock path scales its arm and keeps its length; moved path points come close"),
    unidentifiable: None,
};

impl Effect for MomentArmSlope {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn moment_factor(&self, values: &[f64], _: &TrialContext, _: usize, angle: f64) -> f64 {
        let [slope] = *values else { return 1.0 };
        1.0 + slope * angle
    }
}
