//! History dependence of muscle force.

use crate::effect::{
    Behaviour, Description, Effect, MuscleState, OsimForm, REACH_OF_PROPERTY, Stage, amplitude, shape,
};

/// A memory is not shorter than this [s], and the travel that completes the effect not than this [rad].
const LEAST: f64 = 0.02;

/// History dependence of muscle force. After shortening the muscle is weaker in proportion, `F (1 - h tanh(s/s0))`, s
/// the active shortening. After stretch it pulls with more, `F + e h F_max tanh(-s/s0)`: a parallel element carries
/// that force, which therefore outlasts the activation.
///
/// # References
/// Herzog & Leonard (2002), doi:10.1242/jeb.205.9.1275: most of the force that a long stretch of a cat soleus adds
/// remains when its stimulation ends, and disappears when it is shortened.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Muscle,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "F (1 - h tanh(s/s0)) after shortening, F + e h F_max tanh(-s/s0) after stretch; s the active \
        shortening (angle travelled × activation; of stretch negative), fading in a time T. A muscle that has \
        shortened is weaker, one that was stretched pulls with a force more that remains when activation ends",
    parameters: &[
        amplitude(
            "depression",
            "1",
            0.05,
            [0.0, 0.3],
            "residual enhancement is seen in voluntary contractions of some but not all people (review: Chapman et \
             al. 2018, doi:10.1123/jab.2017-0234); 16 % after 9 mm of stretch of a cat soleus (Herzog & Leonard 2002, \
             doi:10.1242/jeb.205.9.1275), 16 % of the torque of human plantar flexors at long lengths (Fukutani et \
             al. 2017, doi:10.3389/fphys.2017.00234); 0 to 30 % is taken for plausible",
        )
        .reaching(REACH_OF_PROPERTY),
        shape("enhancement_ratio", "1", 1.0, 0.4, [0.0, 2.0], "of stretch, over that of shortening; no source"),
        shape(
            "memory",
            "s",
            3.0,
            1.0,
            [0.2, 10.0],
            "no source: both last for seconds; what a stretch adds to a cat soleus falls by 40 % between 1 and 5 s \
             after it (Herzog & Leonard 2002)",
        ),
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
        each_share(values, muscle.into(), |k, share| factor[k] *= 1.0 - depression * share.max(0.0));
    }

    fn add_muscle_force(&self, values: &[f64], muscle: &MuscleState, force: &mut [f64]) {
        let [depression, enhancement, ..] = *values else { return };
        each_share(values, muscle.into(), |k, share| force[k] -= depression * enhancement * share.min(0.0));
    }
}

/// What history is made of, per sample.
#[derive(Clone, Copy)]
struct Past<'a> {
    /// [s].
    time: &'a [f64],
    /// [rad].
    angle: &'a [f64],
    moment_arm: &'a [f64],
    activation: &'a [f64],
}

impl<'a> From<&MuscleState<'a>> for Past<'a> {
    fn from(muscle: &MuscleState<'a>) -> Past<'a> {
        let MuscleState { trial, angle, moment_arm, activation, .. } = *muscle;
        Past { time: trial.time, angle, moment_arm, activation }
    }
}

/// tanh(s/s0) at every sample, positive after shortening; nothing where the effect is absent.
fn each_share(values: &[f64], past: Past, mut see: impl FnMut(usize, f64)) {
    let [depression, _, memory, travel] = *values else { return };
    if depression == 0.0 {
        return;
    }
    let (memory, full) = (memory.max(LEAST), travel.max(LEAST));
    let mut shortened = 0.0;
    for k in 0..past.time.len() {
        if k > 0 {
            let kept = (-(past.time[k] - past.time[k - 1]) / memory).exp();
            // A muscle that pulls towards larger angles shortens when the angle grows.
            let travel = (past.angle[k] - past.angle[k - 1]) * past.moment_arm[k].signum();
            shortened = shortened * kept + past.activation[k] * travel;
        }
        see(k, (shortened / full).tanh());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Held, moved by 0.2 rad in a second, held; active until 2 s after the movement.
    fn shares(arm: f64) -> Vec<f64> {
        let time: Vec<f64> = (0..600).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| -0.2 * (t - 1.0).clamp(0.0, 1.0)).collect();
        let activation: Vec<f64> = time.iter().map(|t| if *t < 4.0 { 1.0 } else { 0.01 }).collect();
        let moment_arm = vec![arm; time.len()];
        let mut shares = Vec::new();
        let past = Past { time: &time, angle: &angle, moment_arm: &moment_arm, activation: &activation };
        each_share(&[0.1, 1.0, 3.0, 0.2], past, |_, share| shares.push(share));
        shares
    }

    #[test]
    fn verif_what_a_stretch_adds_fades_with_its_time_and_not_with_activation() {
        let [stretched, shortened] = [0.02, -0.02].map(shares);
        assert!(stretched.iter().zip(&shortened).all(|(a, b)| a == &-b));
        // Active travel in closed form, decaying while it grows: 0.2 rad/s for 1 s with a time of 3 s.
        let grown = 0.2 * 3.0 * (1.0 - (-1.0_f64 / 3.0).exp());
        for (at, since) in [(300, 1.0), (399, 1.99), (401, 2.01), (500, 3.0)] {
            let expected = -(grown * (-since / 3.0_f64).exp() / 0.2).tanh();
            assert!((stretched[at] - expected).abs() < 2e-3, "{at}: {} {expected}", stretched[at]);
        }
        assert_eq!(stretched[50], 0.0);
    }
}
