//! All EMG of a participant, processed, for those who want to see it and not only simulate with it.

use rayon::prelude::*;

use super::contents::{Study, gather};
use super::fault::Fault;
use super::problem::{Problem, StudyErrors};
use super::raw_emg::{self, EmgSignal};
use super::trial::Trial;
use super::trial_list::TrialInfo;
use carpus_numerics::signals::{
    EmgProcessing, Finding, QualityLimits, check_artefact, check_channel, check_excitation, mvc_level, resample,
};

/// The EMG of a participant.
#[derive(Clone, Debug)]
pub struct ParticipantEmg {
    /// Each active muscle's channel's level at maximum voluntary contraction, in the channel's unit.
    pub levels: Vec<f64>,
    /// The MVC trial that each level was found in, its name.
    pub level_trials: Vec<String>,
    /// All trials that are not ignored, in the order of recording.
    pub trials: Vec<ProcessedEmg>,
}

/// The EMG of a trial, raw and normalized, one channel per active muscle.
#[derive(Clone, Debug)]
pub struct ProcessedEmg {
    /// The trial.
    pub info: TrialInfo,
    /// Instants of the raw samples \[s\].
    pub recorded_time: Vec<f64>,
    /// Samples per second of the raw channels \[Hz\].
    pub recorded_rate_hz: f64,
    /// Raw samples.
    pub raw: Vec<Vec<f64>>,
    /// Instants of the normalized samples \[s\].
    pub time: Vec<f64>,
    /// Envelope over MVC level, 0 or more; above 1 where the trial exceeds the maximum contraction.
    pub normalized: Vec<Vec<f64>>,
    /// What is doubtful about each channel.
    pub findings: Vec<Vec<Finding>>,
    /// What a person should look at.
    pub warnings: Vec<Problem>,
}

impl Study {
    /// The EMG of a participant from raw channels to normalized envelopes, at the study's rate.
    ///
    /// # Errors
    /// The problems of the trials; no MVC trial. A study with normalized EMG has none to process: no trials.
    pub fn processed_emg(&self, participant: &str) -> Result<ParticipantEmg, StudyErrors> {
        let EmgSignal::Raw(processing) = &self.settings.emg else {
            return Ok(ParticipantEmg { levels: Vec::new(), level_trials: Vec::new(), trials: Vec::new() });
        };
        let levels = self.mvc_levels(participant)?.unwrap_or_default();
        let trials_file = self.folder.join("trials.csv");
        let infos: Vec<&TrialInfo> = self.trials_of(participant).collect();
        let read = |info: &&TrialInfo| self.samples(info, &trials_file, None);
        let recorded = gather(infos.par_iter().map(read).collect())?;
        let trials: Vec<ProcessedEmg> = recorded
            .into_par_iter()
            .map(|trial| processed(trial, processing, &levels, &self.settings.columns.emg))
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<_, _>>()?;
        let level_trials = (0..levels.len()).map(|i| level_trial(&trials, i, processing)).collect();
        Ok(ParticipantEmg { levels, level_trials, trials })
    }
}

/// Name of the MVC trial with a channel's largest envelope.
fn level_trial(trials: &[ProcessedEmg], channel: usize, processing: &EmgProcessing) -> String {
    let mut best = (f64::NEG_INFINITY, String::new());
    for trial in trials.iter().filter(|trial| trial.info.is_mvc()) {
        let Ok(envelope) = processing.envelope(&trial.raw[channel], trial.recorded_rate_hz) else { continue };
        let level = mvc_level(&[(&envelope, trial.recorded_rate_hz)], processing.mvc_level).unwrap_or(0.0);
        if level > best.0 {
            best = (level, trial.info.name.clone());
        }
    }
    best.1
}

fn processed(
    trial: Trial,
    processing: &EmgProcessing,
    levels: &[f64],
    columns: &[String],
) -> Result<ProcessedEmg, StudyErrors> {
    let limits = QualityLimits::default();
    let rate = raw_emg::emg_rate_hz(&trial);
    let mut normalized: Vec<Vec<f64>> = Vec::with_capacity(columns.len());
    let mut findings: Vec<Vec<Finding>> = Vec::with_capacity(columns.len());
    let mut problems = Vec::new();
    for (i, raw) in trial.excitation.iter().enumerate() {
        let mut found = check_channel(raw, rate, &limits);
        let envelope = processing.envelope(raw, rate).and_then(|mut envelope| {
            envelope.iter_mut().for_each(|e| *e /= levels[i]);
            found.extend(check_artefact(raw, &envelope, rate, &limits));
            found.extend(check_excitation(&envelope, &limits));
            match processing.resample_hz {
                // What the lower rate cannot carry is filtered away, which undershoots.
                Some(to) => Ok(resample(&envelope, rate, to)?.into_iter().map(|e| e.max(0.0)).collect()),
                None => Ok(envelope),
            }
        });
        match envelope {
            Ok(envelope) => normalized.push(envelope),
            Err(error) if !columns[..i].contains(&columns[i]) => {
                let fault = Fault::RawEmg { column: columns[i].clone(), error };
                problems.push(Problem::error(&trial.info.file, None, fault));
            }
            Err(_) => {}
        }
        findings.push(found);
    }
    StudyErrors::settle(problems)?;
    let recorded_time = raw_emg::emg_time(&trial).to_vec();
    let time = match processing.resample_hz {
        Some(to) => (0..normalized.first().map_or(0, Vec::len)).map(|i| recorded_time[0] + i as f64 / to).collect(),
        None => recorded_time.clone(),
    };
    Ok(ProcessedEmg {
        info: trial.info,
        recorded_time,
        recorded_rate_hz: rate,
        raw: trial.excitation,
        time,
        normalized,
        findings,
        warnings: trial.warnings,
    })
}
