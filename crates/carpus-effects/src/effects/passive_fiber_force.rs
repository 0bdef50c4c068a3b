//! Stiffness of passive fibres.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, log_ratio, scale_property, scaled_mean};
use carpus_osim::osim::spec::{MuscleKind, MuscleProperty, MuscleSpec};

/// Stiffness of passive fibres: `strain of the fibre at which its passive force is F_max; all muscles scaled together`.
pub struct PassiveFiberForce;

static DESCRIPTION: Description = Description {
    id: "passive_fiber_force",
    name: "Stiffness of passive fibres",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "strain of the fibre at which its passive force is F_max; its excess over that at which force begins is \
        scaled, in all muscles together",
    parameters: &[log_ratio(
        "strain_at_one_norm_force",
        "1",
        0.2,
        [0.3, 1.2],
        "0.5 to 0.9 between muscles, unverified; 0.3 to 1.2 is still taken for plausible",
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

    fn muscle_properties(&self) -> &'static [MuscleProperty] {
        &[MuscleProperty::PassiveFiberStrain]
    }

    fn change_muscles(&self, values: &[f64], muscles: &mut [MuscleSpec]) -> bool {
        scale_property(muscles, values[0], MuscleProperty::PassiveFiberStrain)
    }

    fn reported(&self, values: &[f64], muscles: &[MuscleSpec]) -> Vec<f64> {
        // The strain at which force begins stays.
        let begin: Vec<f64> = muscles
            .iter()
            .filter(|muscle| MuscleProperty::PassiveFiberStrain.of(muscle).is_some())
            .map(|muscle| match &muscle.kind {
                MuscleKind::Millard2012Equilibrium(own) => own.fiber_force_length.strain_at_zero_force,
                MuscleKind::OtherClass { .. } => 0.0,
            })
            .collect();
        let begin = begin.iter().sum::<f64>() / begin.len().max(1) as f64;
        vec![begin + scaled_mean(muscles, values[0], MuscleProperty::PassiveFiberStrain)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_osim::osim::OsimFile;

    #[test]
    fn verif_what_is_reported_is_what_the_muscles_have() {
        let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("models/wrist.osim");
        let mut muscles = OsimFile::read(path).unwrap().spec.muscles;
        for (i, muscle) in muscles.iter_mut().enumerate() {
            if let MuscleKind::Millard2012Equilibrium(p) = &mut muscle.kind {
                p.fiber_force_length.strain_at_zero_force = -0.1 + 0.05 * i as f64;
            }
        }
        for ratio in [-0.4, 0.0, 0.3] {
            let mut changed = muscles.clone();
            PassiveFiberForce.change_muscles(&[ratio], &mut changed);
            let strain = |m: &MuscleSpec| match &m.kind {
                MuscleKind::Millard2012Equilibrium(own) => own.fiber_force_length.strain_at_one_norm_force,
                MuscleKind::OtherClass { .. } => f64::NAN,
            };
            let has = changed.iter().map(strain).sum::<f64>() / changed.len() as f64;
            let reported = PassiveFiberForce.reported(&[ratio], &muscles)[0];
            assert!((reported - has).abs() < 1e-12, "{reported} {has}");
        }
    }
}
