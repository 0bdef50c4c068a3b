//! Stiffness of passive fibres.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, amplitude};
use crate::osim::spec::{MuscleKind, MuscleSpec};

/// Stiffness of passive fibres: `strain of the fibre at which its passive force is F_max; all muscles scaled together`.
pub struct PassiveFiberForce;

static DESCRIPTION: Description = Description {
    id: "passive_fiber_force",
    name: "Stiffness of passive fibres",
    stage: Stage::Muscle,
    equation: "strain of the fibre at which its passive force is F_max; all muscles scaled together",
    parameters: &[amplitude(
        "strain_at_one_norm_force",
        "1",
        0.2,
        [0.3, 1.2],
        "0.5 to 0.9 between muscles; range from the design catalogue, source unverified",
    )],
    signature: "follows the angle, no activation",
    experiment: "five or more angles, relaxed",
    rivals: &["joint_stiffness"],
    osim_form: OsimForm::Native("FiberForceLengthCurve"),
    unidentifiable: None,
};

impl Effect for PassiveFiberForce {
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
                let curve = &mut p.fiber_force_length;
                let range = curve.strain_at_one_norm_force - curve.strain_at_zero_force;
                curve.strain_at_one_norm_force = curve.strain_at_zero_force + range * ratio.exp();
                for stiffness in
                    [&mut curve.stiffness_at_low_force, &mut curve.stiffness_at_one_norm_force].into_iter().flatten()
                {
                    *stiffness *= (-ratio).exp();
                }
            }
        }
        true
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        let usual = |m: &MuscleSpec| match &m.kind {
            MuscleKind::Millard2012Equilibrium(p) => Some(p.fiber_force_length.strain_at_one_norm_force),
            MuscleKind::PathOnly { .. } => None,
        };
        let known: Vec<f64> = muscles.iter().filter_map(usual).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        vec![mean * values[0].exp()]
    }
}
