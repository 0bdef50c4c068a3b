//! Gain of the EMG channels.

use crate::effect::{Behaviour, Description, Effect, ExcitationScope, OsimForm, Stage, TrialContext, amplitude};

/// Gain of the EMG channels: `e/(1 + g)`.
pub struct EmgGain;

static DESCRIPTION: Description = Description {
    id: "emg_gain",
    name: "Gain of the EMG channels",
    stage: Stage::Excitation,
    order: 30,
    behaviour: Behaviour { excitation: ExcitationScope::Sample, ..Behaviour::PLAIN },
    equation: "e/(1 + g), the same in all channels",
    parameters: &[amplitude("gain_error", "1", 0.1, [-0.3, 0.3], "1 + g of 0.7 to 1.3 (assumed, no published source)")],
    signature: "none of its own: a pure gain",
    experiment: "repeat the maximal contraction that EMG is normalized by",
    rivals: &["torque_gain"],
    osim_form: OsimForm::Controls("scaled controls"),
    unidentifiable: Some(
        "a nuisance: another maximum isometric force of the muscle does the same, exactly in proportion to activation",
    ),
};

impl Effect for EmgGain {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], _: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [gain] = *values else { return };
        if gain == 0.0 {
            return;
        }
        excitation.iter_mut().flatten().for_each(|e| *e /= 1.0 + gain);
    }
}
