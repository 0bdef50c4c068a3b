//! Compliance between the joint and the machine.

use crate::effect::{Behaviour, Description, Effect, MomentUse, OsimForm, Stage, TrialContext, amplitude};

/// Compliance between the joint and the machine: `q + c τ, τ the moment of the muscles`.
pub struct JointCompliance;

static DESCRIPTION: Description = Description {
    id: "joint_compliance",
    name: "Compliance between the joint and the machine",
    stage: Stage::Geometry,
    order: 0,
    behaviour: Behaviour { muscle_moment: MomentUse::FedBack, ..Behaviour::PLAIN },
    equation: "q + c τ, τ the moment of the muscles",
    parameters: &[amplitude(
        "compliance",
        "rad/(N·m)",
        0.01,
        [0.0, 0.06],
        "0.5 to 3°/(N·m), which is 0.009 to 0.052 (assumed, no published source); 0 to 0.06 is still taken for \
         plausible",
    )
    .against_strength()],
    signature: "loading differs from unloading",
    experiment: "ramps of force at a held angle",
    rivals: &["tendon_compliance", "angle_offset"],
    osim_form: OsimForm::SideCar("the angle depends on the moment"),
    unidentifiable: None,
};

impl Effect for JointCompliance {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn change_angle(&self, values: &[f64], trial: &TrialContext, angle: &mut [f64]) {
        let [compliance] = *values else { return };
        if compliance != 0.0 {
            for (q, moment) in angle.iter_mut().zip(trial.muscle_moment) {
                *q += compliance * moment;
            }
        }
    }
}
