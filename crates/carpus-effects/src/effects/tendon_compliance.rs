//! Tendon compliance.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio, scale_property, scaled_mean};
use carpus_osim::osim::spec::{MuscleProperty, MuscleSpec};

/// Tendon compliance: `strain of the tendon at maximum isometric force; its stiffness changes inversely`.
pub struct TendonCompliance;

static DESCRIPTION: Description = Description {
    id: "tendon_compliance",
    name: "Tendon compliance",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "strain of the tendon at maximum isometric force; its stiffness changes inversely",
    parameters: &[log_ratio(
        "strain_at_one_norm_force",
        "1",
        0.3,
        [0.015, 0.10],
        "0.02 to 0.10; Loren and Lieber 1995 (tendon biomechanical properties of wrist muscles) give the lower part, \
         numbers unverified; from 0.015 on is still taken for plausible",
    )],
    signature: "slow rise of the moment, level × angle",
    experiment: "fast ramps",
    rivals: &["emg_nonlinearity", "activation_dynamics"],
    osim_form: OsimForm::Native("TendonForceLengthCurve"),
    unidentifiable: None,
};

impl Effect for TendonCompliance {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[MuscleProperty::TendonStrain]
    }

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        scale_property(muscles, values[0], MuscleProperty::TendonStrain)
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        vec![scaled_mean(muscles, values[0], MuscleProperty::TendonStrain)]
    }
}
