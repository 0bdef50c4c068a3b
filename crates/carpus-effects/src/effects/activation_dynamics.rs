//! Activation and deactivation times.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio, scale_property, scaled_mean};
use carpus_osim::osim::spec::{MuscleProperty, MuscleSpec};

/// Activation and deactivation times: `ȧ = (e - a)/τ(a, e) with other τ_act, τ_deact; all muscles scaled together`.
pub struct ActivationDynamics;

static DESCRIPTION: Description = Description {
    id: "activation_dynamics",
    name: "Activation and deactivation times",
    stage: Stage::Activation,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "ȧ = (e - a)/τ(a, e) with other τ_act, τ_deact; all muscles scaled together",
    parameters: &[
        log_ratio(
            "deactivation_time_constant",
            "s",
            0.4,
            [0.015, 0.16],
            "20 to 120 ms (assumed, no published source); 15 to 160 ms is still taken for plausible",
        ),
        log_ratio(
            "activation_time_constant",
            "s",
            0.4,
            [0.004, 0.05],
            "5 to 30 ms (assumed, no published source); 4 to 50 ms is still taken for plausible",
        ),
    ],
    signature: "rise differs from fall",
    experiment: "pulses and releases",
    rivals: &["electromechanical_delay", "sensor_bandwidth"],
    osim_form: OsimForm::Native("activation_time_constant, deactivation_time_constant"),
    unidentifiable: None,
};

impl Effect for ActivationDynamics {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[MuscleProperty::ActivationTimeConstant, MuscleProperty::DeactivationTimeConstant]
    }

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        let slower = scale_property(muscles, values[0], MuscleProperty::DeactivationTimeConstant);
        scale_property(muscles, values[1], MuscleProperty::ActivationTimeConstant) || slower
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        vec![
            scaled_mean(muscles, values[0], MuscleProperty::DeactivationTimeConstant),
            scaled_mean(muscles, values[1], MuscleProperty::ActivationTimeConstant),
        ]
    }
}
