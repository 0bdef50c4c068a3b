//! Tendon compliance.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, amplitude};
use crate::osim::spec::{MuscleKind, MuscleSpec};

/// Tendon compliance: `strain of the tendon at maximum isometric force; its stiffness changes inversely`.
pub struct TendonCompliance;

static DESCRIPTION: Description = Description {
    id: "tendon_compliance",
    name: "Tendon compliance",
    stage: Stage::Muscle,
    equation: "strain of the tendon at maximum isometric force; its stiffness changes inversely",
    parameters: &[amplitude(
        "strain_at_one_norm_force",
        "1",
        0.3,
        [0.015, 0.10],
        "0.02 to 0.10; Loren and Lieber 1995 (tendon biomechanical properties of wrist muscles) give the lower part; numbers unverified",
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

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        let [ratio] = *values else { return false };
        if ratio == 0.0 {
            return false;
        }
        for muscle in muscles {
            if let MuscleKind::Millard2012Equilibrium(p) = &mut muscle.kind {
                p.tendon_force_length.strain_at_one_norm_force *= ratio.exp();
                if let Some(stiffness) = &mut p.tendon_force_length.stiffness_at_one_norm_force {
                    *stiffness *= (-ratio).exp();
                }
            }
        }
        true
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let usual = |m: &MuscleSpec| match &m.kind {
            MuscleKind::Millard2012Equilibrium(p) => Some(p.tendon_force_length.strain_at_one_norm_force),
            MuscleKind::PathOnly { .. } => None,
        };
        let known: Vec<f64> = muscles.iter().filter_map(usual).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        vec![mean * values[0].exp()]
    }
}
