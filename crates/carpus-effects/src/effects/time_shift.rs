//! Clock difference between moment and EMG.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude};
use crate::series::delayed;

/// Clock difference between moment and EMG: `τ(t - d)`.
pub struct TimeShift;

static DESCRIPTION: Description = Description {
    id: "time_shift",
    name: "Clock difference between moment and EMG",
    stage: Stage::Sensor,
    order: 20,
    behaviour: Behaviour::PLAIN,
    equation: "τ(t - d)",
    parameters: &[amplitude(
        "shift",
        "s",
        0.01,
        [-0.05, 0.05],
        "within 50 ms between devices (assumed, no published source)",
    )],
    signature: "follows dτ/dt, passive parts included",
    experiment: "a tap that all channels see",
    rivals: &["electromechanical_delay", "sensor_bandwidth", "inertia"],
    osim_form: OsimForm::SideCar("a property of the recording"),
    unidentifiable: None,
};

impl Effect for TimeShift {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let [shift] = *values else { return };
        if shift != 0.0 {
            *moment = delayed(trial.time, moment, shift);
        }
    }
}
