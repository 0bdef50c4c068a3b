//! History dependence of muscle force.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// History dependence of muscle force: `τ (1 + h tanh(s/0.2)), s the stretch since the trial began, fading in 3 s`.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Sensor,
    equation: "τ (1 + h tanh(s/0.2)), s the stretch since the trial began, fading in 3 s",
    parameters: &[amplitude(
        "depression",
        "1",
        0.05,
        [0.0, 0.3],
        "residual enhancement and depression, 5 to 20 % in voluntary contractions",
    )],
    signature: "offset after a sweep",
    experiment: "isometric, sweep, isometric",
    rivals: &["inertia", "joint_compliance"],
    osim_form: OsimForm::SideCar("needs a state of its own"),
    unidentifiable: None,
};

impl Effect for HistoryDependence {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn sense(&self, values: &[f64], trial: &TrialContext, moment: &mut Vec<f64>) {
        let [depression] = *values else { return };
        let mut moved = 0.0;
        for k in 0..moment.len() {
            if k > 0 {
                let h = trial.time[k] - trial.time[k - 1];
                moved = moved * (-h / 3.0).exp() + trial.recorded_angle[k] - trial.recorded_angle[k - 1];
            }
            // A muscle that pulls towards larger angles shortens when the angle grows: less force then.
            let along = moved * moment[k].signum();
            moment[k] *= 1.0 - depression * (along / 0.2).tanh();
        }
    }
}
