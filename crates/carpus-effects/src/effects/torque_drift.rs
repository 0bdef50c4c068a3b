//! Drift of the sensor.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude, shape};

/// Drift of the sensor: `τ + d (s + c s (1 - s))`, s = 0 to 1 over the session.
pub struct TorqueDrift;

static DESCRIPTION: Description = Description {
    id: "torque_drift",
    name: "Drift of the sensor",
    stage: Stage::Sensor,
    order: 60,
    behaviour: Behaviour::PLAIN,
    equation: "τ + d (s + c s (1 - s)), s = 0 to 1 over the session",
    parameters: &[
        amplitude(
            "drift",
            "N·m per session",
            0.1,
            [-0.8, 0.8],
            "±0.4 N·m per session (assumed, no published source); up to twice that is still taken for plausible",
        )
        .of_strength(),
        shape(
            "slackening",
            "1",
            0.0,
            0.5,
            [-1.0, 2.0],
            "c: above 0 where a sensor warms up and comes to rest; no source",
        ),
    ],
    signature: "follows the order of the session",
    experiment: "zero of the sensor after every trial",
    rivals: &["fatigue", "emg_gain_drift", "torque_offset"],
    osim_form: OsimForm::SideCar("a property of the sensor"),
    unidentifiable: None,
};

impl Effect for TorqueDrift {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let [drift, slackening] = *values else { return };
        if drift == 0.0 {
            return;
        }
        let so_far = trial.session * (1.0 + slackening * (1.0 - trial.session));
        moment.iter_mut().for_each(|m| *m += drift * so_far);
    }
}
