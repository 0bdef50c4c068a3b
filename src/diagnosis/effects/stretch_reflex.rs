//! Stretch reflex.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude, delayed};

/// Stretch reflex: `-b q̇(t - 40 ms) m(t), m = |moment of the muscles| / its largest in the trial (at least 1 N·m)`.
pub struct StretchReflex;

static DESCRIPTION: Description = Description {
    id: "stretch_reflex",
    name: "Stretch reflex",
    stage: Stage::Joint,
    equation: "-b q̇(t - 40 ms) m(t), m = |moment of the muscles| / its largest in the trial (at least 1 N·m)",
    parameters: &[amplitude(
        "gain",
        "N·m·s/rad",
        0.05,
        [0.0, 0.5],
        "range from the design catalogue, source unverified",
    )],
    signature: "as damping, delayed and only while active",
    experiment: "perturbations",
    rivals: &["joint_damping"],
    osim_form: OsimForm::SideCar("a delayed feedback"),
    unidentifiable: None,
};

impl Effect for StretchReflex {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn needs_moment(&self) -> bool {
        true
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [gain] = *values else { return };
        if gain == 0.0 {
            return;
        }
        let peak = joint.trial.muscle_moment.iter().fold(0.0_f64, |m, v| m.max(v.abs())).max(1.0);
        let speed = delayed(joint.trial.time, joint.speed, 0.04);
        for ((moment, speed), of_muscles) in moment.iter_mut().zip(speed).zip(joint.trial.muscle_moment) {
            *moment += -gain * speed * (of_muscles.abs() / peak).min(1.0);
        }
    }
}
