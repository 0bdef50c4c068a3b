//! Fatigue.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude, shape};

/// Fatigue: `e (1 - y/(1 + κ y)), y = f ∫e dt / 60 s`, ∫ over the session; factor kept within 0.1 to 2.
pub struct Fatigue;

static DESCRIPTION: Description = Description {
    id: "fatigue",
    name: "Fatigue",
    stage: Stage::Excitation,
    order: 80,
    behaviour: Behaviour::PLAIN,
    equation: "e (1 - y/(1 + κ y)), y = f ∫e dt / 60 s, ∫ over the session; factor kept within 0.1 to 2",
    parameters: &[
        amplitude(
            "loss_per_minute",
            "1/min of full excitation",
            0.2,
            [0.0, 2.0],
            "maximal isometric force halves in about a minute, unverified; up to 2 is still taken for plausible, no \
             source",
        ),
        shape(
            "saturation",
            "1",
            0.25,
            0.25,
            [0.0, 1.0],
            "κ: 0 where the loss goes on in proportion, near 1/2 where what is left falls exponentially; no source",
        ),
    ],
    signature: "time × activation, session",
    experiment: "hold for 30 to 60 s",
    rivals: &["torque_drift", "emg_gain_drift", "potentiation"],
    osim_form: OsimForm::Controls("controls that fall with use"),
    unidentifiable: None,
};

impl Effect for Fatigue {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [f, saturation] = *values else { return };
        if f == 0.0 {
            return;
        }
        for (muscle, e) in excitation.iter_mut().enumerate() {
            let mut used = trial.exposure[muscle];
            for k in 0..e.len() {
                let recorded = e[k];
                let loss = f * used / 60.0;
                e[k] = recorded * (1.0 - loss / (1.0 + saturation * loss).max(0.1)).clamp(0.1, 2.0);
                let h = if k + 1 < e.len() { trial.time[k + 1] - trial.time[k] } else { 0.0 };
                used += recorded * h;
            }
        }
    }
}
