//! Electromechanical delay.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};
use crate::series::delayed;

/// Electromechanical delay: `e(t - d)`.
pub struct ElectromechanicalDelay;

static DESCRIPTION: Description = Description {
    id: "electromechanical_delay",
    name: "Electromechanical delay",
    stage: Stage::Excitation,
    order: 50,
    behaviour: Behaviour::PLAIN,
    equation: "e(t - d)",
    parameters: &[amplitude(
        "delay",
        "s",
        0.01,
        [0.0, 0.14],
        "0 to 70 ms are the bounds of EMG-driven models (PMC3399054); 20 to 140 ms: assumed, no published source; the \
         range takes in both",
    )],
    signature: "follows -dτ/dt of the active part",
    experiment: "ballistic pulses",
    rivals: &["time_shift", "activation_dynamics"],
    osim_form: OsimForm::Controls("delayed controls"),
    unidentifiable: None,
};

impl Effect for ElectromechanicalDelay {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn excite(&self, values: &[f64], trial: &TrialContext, excitation: &mut [Vec<f64>]) {
        let [delay] = *values else { return };
        if delay == 0.0 {
            return;
        }
        for e in excitation {
            *e = delayed(trial.time, e, delay);
        }
    }
}
