//! History dependence of muscle force.

use crate::diagnosis::effect::{Description, Effect, MuscleState, OsimForm, Stage, amplitude};

/// Active shortening at which the effect is three quarters complete [rad].
const FULL_TRAVEL: f64 = 0.2;
/// Time in which it fades [s].
const MEMORY: f64 = 3.0;

/// History dependence of muscle force: `F (1 - h tanh(s/0.2))`, s the active shortening.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Muscle,
    equation: "F (1 - h tanh(s/0.2 rad)), s the active shortening (angle travelled × activation), fading in 3 s; stretch counts negative: a muscle that has shortened is weaker, one that was stretched stronger",
    parameters: &[amplitude(
        "depression",
        "1",
        0.05,
        [0.0, 0.3],
        "residual enhancement is seen in voluntary contractions of some but not all people (review: Chapman et al. 2018, doi:10.1123/jab.2017-0234); 5 to 20 %, numbers unverified",
    )],
    signature: "offset after a sweep",
    experiment: "isometric, sweep, isometric",
    rivals: &["inertia", "joint_compliance"],
    osim_form: OsimForm::SideCar("needs a state of its own"),
    unidentifiable: None,
};

impl Effect for HistoryDependence {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn scale_muscle(&self, values: &[f64], muscle: &MuscleState, factor: &mut [f64]) {
        let [depression] = *values else { return };
        if depression == 0.0 {
            return;
        }
        let time = muscle.trial.time;
        let mut shortened = 0.0;
        for k in 0..factor.len() {
            if k > 0 {
                let kept = (-(time[k] - time[k - 1]) / MEMORY).exp();
                // A muscle that pulls towards larger angles shortens when the angle grows.
                let travel = (muscle.angle[k] - muscle.angle[k - 1]) * muscle.moment_arm[k].signum();
                shortened = shortened * kept + muscle.activation[k] * travel;
            }
            factor[k] *= 1.0 - depression * (shortened / FULL_TRAVEL).tanh();
        }
    }
}
