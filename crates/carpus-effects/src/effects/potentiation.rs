//! Potentiation.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude, shape};

/// Potentiation: `e (1 + p (1 - exp(-∫e dt/T))), ∫ over the session; no decay`.
pub struct Potentiation;

static DESCRIPTION: Description = Description {
    id: "potentiation",
    name: "Potentiation",
    stage: Stage::Excitation,
    order: 70,
    behaviour: Behaviour::PLAIN,
    equation: "e (1 + p (1 - exp(-∫e dt/T))), ∫ over the session; no decay",
    parameters: &[
        amplitude(
            "gain",
            "1",
            0.1,
            [0.0, 0.4],
            "voluntary performance 7 to 8 % higher some minutes after a conditioning contraction \
             (doi:10.1101/2022.04.12.22273776); 5 to 20 %: assumed, no published source; 0 to 40 % is still taken for \
             plausible",
        ),
        shape("time", "s", 3.0, 1.5, [0.5, 10.0], "no source: of full excitation, within a few seconds"),
    ],
    signature: "opposite sign to fatigue, saturates",
    experiment: "conditioning maximal contraction",
    rivals: &["fatigue", "emg_gain_drift"],
    osim_form: OsimForm::Controls("controls that rise with use"),
    unidentifiable: None,
};

impl Effect for Potentiation {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [p, time] = *values else { return };
        if p == 0.0 {
            return;
        }
        for (muscle, e) in excitation.iter_mut().enumerate() {
            let mut used = trial.exposure[muscle];
            for k in 0..e.len() {
                let recorded = e[k];
                e[k] = recorded * (1.0 + p * (1.0 - (-used / time.max(0.1)).exp()));
                let h = if k + 1 < e.len() { trial.time[k + 1] - trial.time[k] } else { 0.0 };
                used += recorded * h;
            }
        }
    }
}
