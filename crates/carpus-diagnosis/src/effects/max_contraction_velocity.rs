//! Maximum contraction velocity.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio};
use carpus_osim::osim::spec::MuscleSpec;

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
        "5 to 15 per second (assumed, no published source); OpenSim's default and usual value is 10; 4 to 16 is still taken for plausible",
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

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        let [ratio] = *values else { return false };
        if ratio == 0.0 {
            return false;
        }
        for muscle in muscles {
            muscle.max_contraction_velocity *= ratio.exp();
        }
        true
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let usual = |m: &MuscleSpec| Some(m.max_contraction_velocity);
        let known: Vec<f64> = muscles.iter().filter_map(usual).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        vec![mean * values[0].exp()]
    }
}
