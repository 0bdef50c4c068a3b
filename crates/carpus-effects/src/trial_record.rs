//! Trials as they were recorded, each with its place in the session.

use carpus_study::study::{Trial, TrialInfo};

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
    /// Samples for one of the moment's own, 1 or more.
    pub rows_per_moment: f64,
    /// Recorded excitation of each active muscle.
    pub excitation: Vec<Vec<f64>>,
    /// Place in the session, 0 to 1.
    pub session: f64,
    /// ∫ e dt of every muscle before the trial [s].
    pub exposure: Vec<f64>,
}

impl TrialRecord {
    /// ∫ e dt of every muscle up to the end of the trial [s].
    pub fn exposure_after(&self) -> Vec<f64> {
        self.exposure.iter().zip(&self.excitation).map(|(before, e)| before + integral(e, &self.time)).collect()
    }
}

/// ∫ e dt over a trial [s].
fn integral(excitation: &[f64], time: &[f64]) -> f64 {
    excitation.windows(2).zip(time.windows(2)).map(|(e, t)| e[0] * (t[1] - t[0])).sum()
}

/// Trials with their places in the session: by their start times where all are known, else by their rows among all of
/// the participant, ignored ones included.
///
/// - `trials`: in the order of recording
/// - `muscles`: how many are active
pub(super) fn records(trials: &[Trial], muscles: usize) -> Vec<TrialRecord> {
    let known_start = trials.iter().all(|t| t.info.start_time.is_some());
    // Trials that are not rows of one table, one after the other, go by the order they are given in.
    let in_rows = trials.windows(2).all(|pair| pair[0].info.place < pair[1].info.place);
    let start = |i: usize| match &trials[i].info {
        info if known_start => info.start_time.unwrap_or(0.0),
        info if in_rows => info.place as f64,
        _ => i as f64,
    };
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
            rows_per_moment: trial.rows_per_moment(),
            excitation: trial.excitation.clone(),
            session: (start(i) - first) / span,
            exposure: exposure.clone(),
        });
        for (muscle, e) in exposure.iter_mut().zip(&trial.excitation) {
            *muscle += integral(e, &trial.time);
        }
    }
    out
}
