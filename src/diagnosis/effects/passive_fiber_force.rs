//! Stiffness of passive fibres.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, amplitude, scale_property, scaled_mean};
use crate::osim::spec::MuscleSpec;

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
        scale_property(muscles, values[0], |p, factor| {
            let curve = &mut p.fiber_force_length;
            let range = curve.strain_at_one_norm_force - curve.strain_at_zero_force;
            curve.strain_at_one_norm_force = curve.strain_at_zero_force + range * factor;
            curve.stiffness_at_low_force.iter_mut().for_each(|stiffness| *stiffness /= factor);
            curve.stiffness_at_one_norm_force.iter_mut().for_each(|stiffness| *stiffness /= factor);
        })
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        vec![scaled_mean(muscles, values[0], |p| p.fiber_force_length.strain_at_one_norm_force)]
    }
}
