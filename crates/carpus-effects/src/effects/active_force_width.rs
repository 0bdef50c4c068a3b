//! Width of the active force-length curve.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio, scale_property};
use carpus_osim::osim::spec::{MuscleProperty, MuscleSpec};

/// Width of the active force-length curve: `normalized lengths 1 + w (l - 1) of the active force-length curve; w is the
/// width ratio`.
pub struct ActiveForceWidth;

static DESCRIPTION: Description = Description {
    id: "active_force_width",
    name: "Width of the active force-length curve",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "normalized lengths 1 + w (l - 1) of the active force-length curve; w is the width ratio",
    parameters: &[log_ratio(
        "width_ratio",
        "1",
        0.1,
        [0.7, 1.4],
        "no source: width of the model's own curve, 0.7 to 1.4 times is taken for plausible",
    )],
    signature: "angle × activation",
    experiment: "five or more angles at maximal effort",
    rivals: &["moment_arm_slope", "activation_dependent_length"],
    osim_form: OsimForm::Native("ActiveForceLengthCurve"),
    unidentifiable: None,
};

impl Effect for ActiveForceWidth {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[MuscleProperty::ActiveForceWidth]
    }

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        scale_property(muscles, values[0], MuscleProperty::ActiveForceWidth)
    }

    fn reported(&self, values: &[f64], _: &[MuscleSpec]) -> Vec<f64> {
        vec![values[0].exp()]
    }
}
