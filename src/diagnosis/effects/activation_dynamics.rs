//! Activation and deactivation times.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, amplitude};
use crate::osim::spec::{MuscleKind, MuscleSpec};

/// Activation and deactivation times: `ȧ = (e - a)/τ(a, e) with other τ_act, τ_deact; all muscles scaled together`.
pub struct ActivationDynamics;

static DESCRIPTION: Description = Description {
    id: "activation_dynamics",
    name: "Activation and deactivation times",
    stage: Stage::Activation,
    equation: "ȧ = (e - a)/τ(a, e) with other τ_act, τ_deact; all muscles scaled together",
    parameters: &[
        amplitude(
            "deactivation_time_constant",
            "s",
            0.4,
            [0.015, 0.16],
            "20 to 120 ms; range from the design catalogue, source unverified",
        ),
        amplitude(
            "activation_time_constant",
            "s",
            0.4,
            [0.004, 0.05],
            "5 to 30 ms; range from the design catalogue, source unverified",
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

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        let [deactivation, activation] = *values else { return false };
        if deactivation == 0.0 && activation == 0.0 {
            return false;
        }
        for muscle in muscles {
            if let MuscleKind::Millard2012Equilibrium(p) = &mut muscle.kind {
                p.deactivation_time_constant *= deactivation.exp();
                p.activation_time_constant *= activation.exp();
            }
        }
        true
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let usual = muscles.iter().find_map(|m| match &m.kind {
            MuscleKind::Millard2012Equilibrium(p) => Some([p.deactivation_time_constant, p.activation_time_constant]),
            MuscleKind::PathOnly { .. } => None,
        });
        let usual = usual.unwrap_or([0.04, 0.01]);
        vec![usual[0] * values[0].exp(), usual[1] * values[1].exp()]
    }
}
