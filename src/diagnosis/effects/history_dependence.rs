//! History dependence of muscle force.

use crate::diagnosis::effect::{Description, Effect, OsimForm, Stage, TrialContext, amplitude};

/// History dependence of muscle force: `τ (1 - h tanh(s sign(τ)/0.2 rad)), s the travel since the trial began, fading in 3 s; a muscle that has shortened is weaker, one that was stretched is stronger`.
pub struct HistoryDependence;

static DESCRIPTION: Description = Description {
    id: "history_dependence",
    name: "History dependence of muscle force",
    stage: Stage::Sensor,
    equation: "τ (1 - h tanh(s sign(τ)/0.2 rad)), s the travel since the trial began, fading in 3 s; a muscle that has shortened is weaker, one that was stretched is stronger",
    parameters: &[amplitude(
        "depression",
        "1",
        0.05,
        [0.0, 0.3],
        "residual enhancement is seen in voluntary contractions of some but not all people (review: Chapman et al. 2018, doi:10.1123/jab.2017-0234); 5 to 20 %, numbers unverified",
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
        if depression == 0.0 {
            return;
        }
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
