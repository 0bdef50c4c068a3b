//! Ligament stop.

use crate::diagnosis::effect::{Description, Effect, JointState, OsimForm, Stage, amplitude, shape};

/// Ligament stop: `-k max(0, q - q1) + k max(0, -q - q1)`.
pub struct LigamentStop;

static DESCRIPTION: Description = Description {
    id: "ligament_stop",
    name: "Ligament stop",
    stage: Stage::Joint,
    equation: "-k max(0, q - q1) + k max(0, -q - q1)",
    parameters: &[
        amplitude("stiffness", "N·m/rad", 1.0, [0.0, 20.0], "0.5 to 20 N·m/rad beyond the limit"),
        shape("limit", "rad", 0.4, 0.1, [0.2, 1.2], "no moment within ±20 to ±70°"),
    ],
    signature: "a hinge against angle",
    experiment: "sweep beyond ±35°",
    rivals: &["end_range_spring", "joint_stiffness"],
    osim_form: OsimForm::Native("CoordinateLimitForce"),
    unidentifiable: None,
};

impl Effect for LigamentStop {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [stiffness, limit] = *values else { return };
        for k in 0..moment.len() {
            let q = joint.angle[k];
            moment[k] += stiffness * ((-q - limit).max(0.0) - (q - limit).max(0.0));
        }
    }
}
