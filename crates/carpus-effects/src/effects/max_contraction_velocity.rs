//! Maximum contraction velocity.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio, scale_property, scaled_mean};
use carpus_osim::osim::spec::{MuscleProperty, MuscleSpec};

/// Maximum contraction velocity: `v_max of all active muscles, scaled together`.
pub struct MaxContractionVelocity;

static DESCRIPTION: Description = Description {
    id: "max_contraction_velocity",
    name: "Maximum contraction velocity",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "v_max of all active muscles, scaled together",
    parameters: &[log_ratio(
        "max_contraction_velocity",
        "optimal fibre lengths/s",
        0.3,
        [4.0, 16.0],
        "5 to 15 per second (assumed, no published source); OpenSim's default and usual value is 10; 4 to 16 is still \
         taken for plausible",
    )],
    signature: "velocity × activation",
    experiment: "two loads and a passive sweep",
    rivals: &["joint_damping"],
    osim_form: OsimForm::Native("max_contraction_velocity"),
    unidentifiable: None,
};

impl Effect for MaxContractionVelocity {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[MuscleProperty::MaxContractionVelocity]
    }

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        scale_property(muscles, values[0], MuscleProperty::MaxContractionVelocity)
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        vec![scaled_mean(muscles, values[0], MuscleProperty::MaxContractionVelocity)]
    }
}
