//! Drift of the EMG gain.

use crate::effect::{Behaviour, Description, Effect, ExcitationScope, OsimForm, Stage, TrialContext, amplitude};

/// Drift of the EMG gain: `e (1 + d s), s = 0 to 1 over the session; the part that follows the angle is
/// moment_arm_slope but for saturation and is left to it`.
pub struct EmgGainDrift;

static DESCRIPTION: Description = Description {
    id: "emg_gain_drift",
    name: "Drift of the EMG gain",
    stage: Stage::Excitation,
    order: 40,
    behaviour: Behaviour { excitation: ExcitationScope::Sample, ..Behaviour::PLAIN },
    equation: "e (1 + d s), s = 0 to 1 over the session; the part that follows the angle is moment_arm_slope but for \
        saturation and is left to it",
    parameters: &[amplitude(
        "drift",
        "1 per session",
        0.1,
        [-0.5, 0.5],
        "no source: half as much again or half as little over a session is taken for plausible",
    )],
    signature: "session × activation",
    experiment: "repeated reference contractions",
    rivals: &["fatigue", "potentiation", "torque_drift"],
    osim_form: OsimForm::Controls("scaled controls"),
    unidentifiable: None,
};

impl Effect for EmgGainDrift {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [drift] = *values else { return };
        if drift == 0.0 {
            return;
        }
        let gain = 1.0 + drift * trial.session;
        excitation.iter_mut().flatten().for_each(|e| *e *= gain);
    }
}
