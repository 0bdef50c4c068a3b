//! History dependence of muscle force.

use crate::diagnosis::effect::{Description, Effect, MuscleState, OsimForm, Stage, amplitude, shape};

/// A memory is not shorter than this [s], and the travel that completes the effect not than this [rad].
const LEAST: f64 = 0.02;

/// History dependence of muscle force. After shortening the muscle is weaker in proportion, `F (1 - h tanh(s/s0))`, s the active
/// shortening. After stretch it pulls with more, `F + e h F_max tanh(-s/s0)`: a parallel element carries that force, which therefore
/// outlasts the activation.
///
/// # References
/// Herzog & Leonard (2002), doi:10.1242/jeb.205.9.1275: most of the force that a long stretch of a cat soleus adds remains when its
/// stimulation ends, and disappears when it is shortened. Pinniger & Cresswell (2007), doi:10.1152/japplphysiol.00786.2006:
/// enhancement in voluntary contractions of muscles at the ankle.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Muscle,
    equation: "F (1 - h tanh(s/s0)) after shortening, F + e h F_max tanh(-s/s0) after stretch; s the active shortening (angle travelled × activation; of stretch negative), fading in a time T. A muscle that has shortened is weaker, one that was stretched pulls with a force more that remains when activation ends",
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
        let [depression, ..] = *values else { return };
        each_share(values, muscle, |k, share| factor[k] *= 1.0 - depression * share.max(0.0));
    }

    fn add_muscle_force(&self, values: &[f64], muscle: &MuscleState, force: &mut [f64]) {
        let [depression, enhancement, ..] = *values else { return };
        each_share(values, muscle, |k, share| force[k] -= depression * enhancement * share.min(0.0));
    }
}

/// tanh(s/s0) at every sample, positive after shortening; nothing where the effect is absent.
fn each_share(values: &[f64], muscle: &MuscleState, mut see: impl FnMut(usize, f64)) {
    let [depression, _, memory, travel] = *values else { return };
    if depression == 0.0 {
        return;
    }
    let (memory, full) = (memory.max(LEAST), travel.max(LEAST));
    let time = muscle.trial.time;
    let mut shortened = 0.0;
    for k in 0..time.len() {
        if k > 0 {
            let kept = (-(time[k] - time[k - 1]) / memory).exp();
            // A muscle that pulls towards larger angles shortens when the angle grows.
            let travel = (muscle.angle[k] - muscle.angle[k - 1]) * muscle.moment_arm[k].signum();
            shortened = shortened * kept + muscle.activation[k] * travel;
        }
        see(k, (shortened / full).tanh());
    }
}
