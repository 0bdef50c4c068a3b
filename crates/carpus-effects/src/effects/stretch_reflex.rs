//! Stretch reflex.

use crate::effect::{Behaviour, Description, Effect, JointState, MomentUse, OsimForm, Stage, amplitude, shape};
use crate::series::delayed;

/// Least moment at which a reflex is half of its largest [N·m].
const LEAST_HALF: f64 = 0.05;

/// Stretch reflex: `-b q̇(t - d) m(t), m = |M| / (|M| + M0)`, M the moment of the muscles.
pub struct StretchReflex;

static DESCRIPTION: Description = Description {
    id: "stretch_reflex",
    name: "Stretch reflex",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour { muscle_moment: MomentUse::Reads, ..Behaviour::PLAIN },
    equation: "-b q̇(t - d) m(t), m = |M| / (|M| + M0), M the moment of the muscles: grows with it, and saturates",
    parameters: &[
        amplitude(
            "gain",
            "N·m·s/rad",
            0.05,
            [0.0, 0.5],
            "no source: 0 to 0.5 is taken for plausible, several times the joint's damping",
        )
        .of_strength(),
        shape(
            "delay",
            "s",
            0.04,
            0.012,
            [0.02, 0.1],
            "from stretch to moment: 25 ms to the EMG's short and 50 ms to its long latency (wrist; unverified), and \
             the muscle's own delay unless the EMG is simulated",
        ),
        shape(
            "half_moment",
            "N·m",
            2.0,
            1.0,
            [0.05, 10.0],
            "M0, at which it is half of its largest: reflexes grow with the contraction (automatic gain compensation: \
             Matthews 1986, doi:10.1113/jphysiol.1986.sp016066), here up to a largest one; the number has no source",
        )
        .of_strength(),
    ],
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

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [gain, delay, half] = *values else { return };
        if gain == 0.0 {
            return;
        }
        let half = half.max(LEAST_HALF);
        let speed = delayed(joint.trial.time, joint.speed, delay);
        for ((moment, speed), of_muscles) in moment.iter_mut().zip(speed).zip(joint.trial.muscle_moment) {
            *moment += -gain * speed * (of_muscles.abs() / (of_muscles.abs() + half));
        }
    }
}
