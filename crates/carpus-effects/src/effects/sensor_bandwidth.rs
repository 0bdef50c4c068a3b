//! Slow sensor.

use crate::effect::{Behaviour, Description, Effect, OsimForm, Stage, TrialContext, amplitude, shape};

/// Slow sensor: two low-passes in a row, `T (1 - r) ẋ = τ - x`, `T r ẏ = x - y`.
pub struct SensorBandwidth;

static DESCRIPTION: Description = Description {
    id: "sensor_bandwidth",
    name: "Slow sensor",
    stage: Stage::Sensor,
    order: 30,
    behaviour: Behaviour::PLAIN,
    equation: "T (1 - r) ẋ = τ - x, T r ẏ = x - y: of first order at r = 0, of second, critically damped, at r = 1/2",
    parameters: &[
        amplitude(
            "time_constant",
            "s",
            0.01,
            [0.0, 0.06],
            "T, by which slow changes come late; low-pass filters of 2 to 50 ms (assumed, no published source); 0 to \
             60 ms is still taken for plausible",
        ),
        shape("second_share", "1", 0.15, 0.15, [0.0, 0.5], "r; filters of first and second order"),
    ],
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
        let [constant, second_share] = *values else { return };
        if constant == 0.0 {
            return;
        }
        let second = constant.abs() * second_share.clamp(0.0, 0.5);
        let mut slow = moment.clone();
        low_pass(trial.time, constant.abs() - second, &mut slow);
        if second > 0.0 {
            low_pass(trial.time, second, &mut slow);
        }
        // Mirrored for negative constants, so that fits may cross zero.
        for (moment, slow) in moment.iter_mut().zip(slow) {
            *moment = if constant > 0.0 { slow } else { 2.0 * *moment - slow };
        }
    }
}

/// First-order low-pass, exact for a series that is linear between samples; starts at rest.
fn low_pass(time: &[f64], constant: f64, series: &mut [f64]) {
    let mut before = series[0];
    let mut y = before;
    for k in 1..series.len() {
        let h = time[k] - time[k - 1];
        let now = series[k];
        let slope = (now - before) / h;
        let lag = y - before + constant * slope;
        y = now - constant * slope + lag * (-h / constant).exp();
        (series[k], before) = (y, now);
    }
}
