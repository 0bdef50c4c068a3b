//! Baseline of the EMG.

use crate::effect::{Behaviour, Description, Effect, ExcitationScope, OsimForm, Stage, TrialContext, amplitude};

/// Standard deviation expected of an EMG channel's baseline: what a channel at rest shows of its maximum is 0 to 2 %.
/// Narrower, and baselines that are there are taken for passive forces, drag or reflexes.
pub const BASELINE_SD: f64 = 0.01;

/// Baseline of the EMG: `max(0, e - b)`.
pub struct EmgFloor;

static DESCRIPTION: Description = Description {
    id: "emg_floor",
    name: "Baseline of the EMG",
    stage: Stage::Excitation,
    order: 10,
    behaviour: Behaviour { excitation: ExcitationScope::Sample, ..Behaviour::PLAIN },
    equation: "max(0, e - b)",
    parameters: &[amplitude(
        "baseline",
        "1",
        0.005,
        [0.0, 0.04],
        "0 to 0.03 of maximal EMG (assumed, no published source); up to 0.04 is still taken for plausible. Up to 0.01 \
         every channel may have and explains nothing",
    )],
    signature: "moment at rest",
    experiment: "a rest segment",
    rivals: &["torque_offset"],
    osim_form: OsimForm::Controls("controls without baseline"),
    unidentifiable: None,
};

impl Effect for EmgFloor {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    /// Up to 1 % of maximum, which every channel's own baseline may be in any case. Nevertheless it would be nearer to
    /// moments and EMG: muscles at rest come to their least activation, and the EMG's noise passes no more.
    fn is_within_noise(&self, values: &[f64]) -> bool {
        values.iter().all(|b| b.abs() <= BASELINE_SD)
    }

    fn excite(&self, values: &[f64], _: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [b] = *values else { return };
        if b == 0.0 {
            return;
        }
        excitation.iter_mut().flatten().for_each(|e| *e = (*e - b).max(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_baseline_that_any_channel_may_have_is_within_noise() {
        assert!(EmgFloor.is_within_noise(&[0.009]));
        assert!(EmgFloor.is_within_noise(&[-0.009]));
        assert!(!EmgFloor.is_within_noise(&[0.014]));
    }
}
