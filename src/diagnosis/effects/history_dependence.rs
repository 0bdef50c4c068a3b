//! History dependence of muscle force.

use crate::diagnosis::effect::{Description, Effect, MuscleState, OsimForm, Stage, amplitude, shape};

/// A memory is not shorter than this [s], and the travel that completes the effect not than this [rad].
const LEAST: f64 = 0.02;

/// History dependence of muscle force: `F (1 - h tanh(s/s0))`, s the active shortening; of stretch `F (1 - e h tanh(s/s0))`.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Muscle,
    equation: "F (1 - h tanh(s/s0)), s the active shortening (angle travelled × activation), fading in a time T; stretch counts negative, and e times as much: a muscle that has shortened is weaker, one that was stretched stronger",
    parameters: &[
        amplitude(
            "depression",
            "1",
            0.05,
            [0.0, 0.3],
            "residual enhancement is seen in voluntary contractions of some but not all people (review: Chapman et al. 2018, doi:10.1123/jab.2017-0234); 5 to 20 %, numbers unverified; 0 to 30 % is still taken for plausible",
        ),
        shape("enhancement_ratio", "1", 1.0, 0.4, [0.0, 2.0], "of stretch, over that of shortening; no source"),
        shape("memory", "s", 3.0, 1.0, [0.2, 10.0], "no source: both last for seconds while activation does"),
        shape("travel", "rad", 0.2, 0.06, [0.05, 0.6], "at which it is three quarters complete; no source"),
    ],
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
        let [depression, enhancement, memory, travel] = *values else { return };
        if depression == 0.0 {
            return;
        }
        let (memory, full) = (memory.max(LEAST), travel.max(LEAST));
        let time = muscle.trial.time;
        let mut shortened = 0.0;
        for k in 0..factor.len() {
            if k > 0 {
                let kept = (-(time[k] - time[k - 1]) / memory).exp();
                // A muscle that pulls towards larger angles shortens when the angle grows.
                let travel = (muscle.angle[k] - muscle.angle[k - 1]) * muscle.moment_arm[k].signum();
                shortened = shortened * kept + muscle.activation[k] * travel;
            }
            let share = if shortened < 0.0 { enhancement } else { 1.0 };
            factor[k] *= 1.0 - depression * share * (shortened / full).tanh();
        }
    }
}
