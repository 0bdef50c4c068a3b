//! Muscles that act but are not activated in the study.

use crate::effect::{Behaviour, Description, Effect, JointState, OsimForm, Stage, amplitude};
use crate::silent_muscles::SilentMuscles;

/// Time constant with which the silent muscles follow the recorded ones [s].
const TIME_CONSTANT: f64 = 0.04;
/// Time after which 2·10⁻⁹ of a change is left [s].
const MEMORY: f64 = 20.0 * TIME_CONSTANT;

/// Muscles that act but are not activated in the study: `κ ā(t) M(q)`.
pub struct UnmodelledMuscles;

static DESCRIPTION: Description = Description {
    id: "unmodelled_muscles",
    name: "Muscles that act but are not activated in the study",
    stage: Stage::Joint,
    order: 0,
    behaviour: Behaviour::PLAIN,
    equation: "κ ā(t) M(q) per direction: M the active isometric moment of the model's silent muscles at full \
        activation, ā the \
               mean excitation of the recorded muscles of that direction through a low-pass of 40 ms",
    parameters: &[
        amplitude(
            "increasing_share",
            "1",
            0.2,
            [0.0, 1.0],
            "by definition: a share of the silent muscles' full activation",
        ),
        amplitude(
            "decreasing_share",
            "1",
            0.2,
            [0.0, 1.0],
            "by definition: a share of the silent muscles' full activation",
        ),
    ],
    signature: "a gain of one direction with an angle shape of its own; nothing if the model has no silent muscles",
    experiment: "EMG of the finger muscles, grip force",
    rivals: &["moment_arm_slope", "emg_gain_drift"],
    osim_form: OsimForm::Controls("controls of the silent muscles"),
    unidentifiable: None,
};

impl Effect for UnmodelledMuscles {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excitation_memory(&self, silent_muscles: &SilentMuscles) -> Option<f64> {
        (!silent_muscles.names.is_empty()).then_some(MEMORY)
    }

    fn moment_derivative(&self, _: &[f64], parameter: usize, joint: &JointState) -> Option<Vec<f64>> {
        // In proportion to both.
        let mut unit = [0.0; 2];
        *unit.get_mut(parameter)? = 1.0;
        let mut by = vec![0.0; joint.angle.len()];
        self.add_moment(&unit, joint, &mut by);
        Some(by)
    }

    fn add_moment(&self, values: &[f64], joint: &JointState, moment: &mut [f64]) {
        let [increasing, decreasing] = *values else { return };
        let trial = joint.trial;
        if (increasing == 0.0 && decreasing == 0.0) || trial.silent_muscles.names.is_empty() {
            return;
        }
        let mean = |sign: f64, k: usize| {
            let same = || trial.excitation.iter().zip(trial.directions).filter(|(_, d)| **d == sign);
            same().map(|(e, _)| e[k]).sum::<f64>() / same().count().max(1) as f64
        };
        let mut level = [mean(-1.0, 0), mean(1.0, 0)];
        for k in 0..moment.len() {
            if k > 0 {
                let follow = 1.0 - (-(trial.time[k] - trial.time[k - 1]) / TIME_CONSTANT).exp();
                level[0] += follow * (mean(-1.0, k) - level[0]);
                level[1] += follow * (mean(1.0, k) - level[1]);
            }
            let silent = trial.silent_muscles.moments(joint.angle[k]);
            moment[k] += decreasing * level[0] * silent[0] + increasing * level[1] * silent[1];
        }
    }
}
