//! Trials as they were recorded, each with its place in the session.

use crate::study::{Trial, TrialInfo};

/// A recorded trial.
#[derive(Clone, Debug)]
pub struct TrialRecord {
    /// What the study says of it.
    pub info: TrialInfo,
    /// Time [s].
    pub time: Vec<f64>,
    /// Recorded angle [rad].
    pub angle: Vec<f64>,
    /// Recorded moment [N·m].
    pub moment: Vec<f64>,
    /// Recorded excitation of each active muscle.
    pub excitation: Vec<Vec<f64>>,
    /// Place in the session, 0 to 1.
    pub session: f64,
    /// ∫ e dt of every muscle before the trial [s].
    pub exposure: Vec<f64>,
}

/// Trials with their places in the session: by their start times where all are known, else by their order.
///
/// - `trials`: in the order of recording
/// - `muscles`: how many are active
pub(super) fn records(trials: &[Trial], muscles: usize) -> Vec<TrialRecord> {
    let known_start = trials.iter().all(|t| t.info.start_time.is_some());
    let start = |i: usize| if known_start { trials[i].info.start_time.unwrap_or(0.0) } else { i as f64 };
    let (first, last) = (start(0), start(trials.len() - 1));
    let span = if last > first { last - first } else { 1.0 };
    let mut exposure = vec![0.0; muscles];
    let mut out = Vec::with_capacity(trials.len());
    for (i, trial) in trials.iter().enumerate() {
        out.push(TrialRecord {
            info: trial.info.clone(),
            time: trial.time.clone(),
            angle: trial.angle.clone(),
            moment: trial.moment.clone(),
            excitation: trial.excitation.clone(),
            session: (start(i) - first) / span,
            exposure: exposure.clone(),
        });
        for (muscle, e) in exposure.iter_mut().zip(&trial.excitation) {
            *muscle += e.windows(2).zip(trial.time.windows(2)).map(|(e, t)| e[0] * (t[1] - t[0])).sum::<f64>();
        }
    }
    out
}
