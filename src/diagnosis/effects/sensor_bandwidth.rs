//! Slow sensor.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// Slow sensor: `T ẏ = τ - y`.
pub struct SensorBandwidth;

static DESCRIPTION: Description = Description {
    id: "sensor_bandwidth",
    name: "Slow sensor",
    stage: Stage::Sensor,
    equation: "T ẏ = τ - y",
    parameters: &[amplitude(
        "time_constant",
        "s",
        0.01,
        [0.0, 0.06],
        "low-pass filters of 2 to 50 ms; range from the design catalogue, source unverified",
    )],
    signature: "rounded onsets",
    experiment: "a tap that all channels see",
    rivals: &["time_shift", "electromechanical_delay", "activation_dynamics"],
    osim_form: OsimForm::SideCar("a property of the recording"),
    unidentifiable: None,
};

impl Effect for SensorBandwidth {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let [constant] = *values else { return };
        if constant == 0.0 {
            return;
        }
        // Exact for a moment that is linear between samples; mirrored for negative constants, so that fits may cross zero.
        let c = constant.abs();
        let original = moment.clone();
        let mut y = original[0];
        for k in 1..moment.len() {
            let h = trial.time[k] - trial.time[k - 1];
            let slope = (original[k] - original[k - 1]) / h;
            let lag = y - original[k - 1] + c * slope;
            y = original[k] - c * slope + lag * (-h / c).exp();
            moment[k] = if constant > 0.0 { y } else { 2.0 * original[k] - y };
        }
    }
}
