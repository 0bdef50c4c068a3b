//! Optimal fibre length that depends on activation.

use crate::effect::{Behaviour, Description, Effect, OsimForm, REACH_OF_PROPERTY, Stage, amplitude};

/// Optimal fibre length that depends on activation: `lo (1 + λ (1 - a))`.
pub struct ActivationDependentLength;

static DESCRIPTION: Description = Description {
    id: "activation_dependent_length",
    name: "Optimal fibre length that depends on activation",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "lo (1 + λ (1 - a)) in the active force-length curve of all active muscles",
    parameters: &[amplitude(
        "lengthening",
        "1",
        0.1,
        [0.0, 0.25],
        "λ = 0.15 is usual in EMG-driven models (Lloyd and Besier 2003); 0 to 0.25: assumed, no published source",
    )
    .reaching(REACH_OF_PROPERTY)],
    signature: "angle × level of effort",
    experiment: "isometric angles at three levels of effort",
    rivals: &["active_force_width", "moment_arm_slope"],
    osim_form: OsimForm::SideCar("no stock muscle has it"),
    unidentifiable: None,
};

impl Effect for ActivationDependentLength {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn length_by_activation(&self, values: &[f64]) -> f64 {
        values.first().copied().unwrap_or(0.0)
    }
}
