//! A participant's recordings, processed.

use rayon::prelude::*;

use super::recording::Recorded;
use super::settings::ProcessingSettings;
use crate::dynamometer::{
    Alignment, AlignmentError, PassiveCurve, PassiveError, PassiveRun, RepetitionSignal, derivative, find_repetitions,
    fit_passive,
};
use crate::study::columns::Columns;
use crate::study::contents::Study;
use crate::study::emg_recorder::{EmgRecorder, EmgRecorderError};
use crate::study::fault::Fault;
use crate::study::limits::MIN_SAMPLES;
use crate::study::posture::is_same_posture;
use crate::study::problem::{Problem, StudyErrors};
use crate::study::trial_list::{Contraction, TrialInfo};
use carpus_numerics::signals::{SignalError, interpolate_linear};

/// A participant's recordings, processed.
#[derive(Clone, Debug)]
pub struct ProcessingResult {
    /// The relaxed limb's moment, where it was asked for.
    pub passive: Option<PassiveCurve>,
    /// The trials, one per repetition, in the order of recording.
    pub trials: Vec<ProcessedTrial>,
}

/// A trial, or a repetition of it.
#[derive(Clone, Debug)]
pub struct ProcessedTrial {
    /// The recording that it is of.
    pub info: TrialInfo,
    /// Which repetition of the recording, from 1; `None` if it was not cut.
    pub repetition: Option<u32>,
    /// Time \[s\].
    pub time: Vec<f64>,
    /// Angle \[rad\].
    pub angle: Vec<f64>,
    /// Velocity [rad/s].
    pub velocity: Vec<f64>,
    /// Moment of the person, less what was removed [N·m].
    pub moment: Vec<f64>,
    /// Moment as measured [N·m].
    pub measured: Vec<f64>,
    /// Moments about further coordinates [N·m], filtered as the moment, by column.
    pub further_moments: Vec<(String, Vec<f64>)>,
    /// EMG columns, as recorded.
    pub emg: Vec<(String, Vec<f64>)>,
    /// How the second recorder was brought to the dynamometer's clock.
    pub delay: Option<DelayFound>,
    /// Share of the samples outside of the angles of the passive trials.
    pub beyond_passive: f64,
}

/// The second recorder of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct DelayFound {
    /// Its file.
    pub file: std::path::PathBuf,
    /// What was found.
    pub alignment: Alignment,
}

/// Why recordings could not be processed.
#[derive(Debug, thiserror::Error)]
pub enum ProcessingError {
    /// Files.
    #[error(transparent)]
    Study(#[from] StudyErrors),
    /// A filter.
    #[error("{file}: {error}")]
    Signal {
        /// The trial's file.
        file: String,
        /// What is wrong.
        error: SignalError,
    },
    /// Two recorders.
    #[error("{file}: cannot be brought to the clock of {with}: {error}")]
    Alignment {
        /// The second recorder's file.
        file: String,
        /// The trial's file.
        with: String,
        /// What is wrong.
        error: AlignmentError,
    },
    /// The passive curve.
    #[error("participant {participant}: the relaxed limb's moment cannot be found: {error}")]
    Passive {
        /// The participant.
        participant: String,
        /// What is wrong.
        error: PassiveError,
    },
    /// One passive curve for arms upright and turned over.
    #[error(
        "{}:{line}: the arm is `flipped`: the relaxed limb's moment has its weight the other way, and one curve is \
         subtracted from all trials",
        file.display()
    )]
    ArmFlipped {
        /// The `trials.csv`.
        file: std::path::PathBuf,
        /// Line of the first such trial.
        line: usize,
    },
    /// One passive curve for trials in several postures.
    #[error(
        "{}:{line}: other joints are not held as in line {first}: the relaxed limb's moment differs between postures, \
         and one curve is subtracted from all trials",
        file.display()
    )]
    SeveralPostures {
        /// The `trials.csv`.
        file: std::path::PathBuf,
        /// Line of the first trial in another posture.
        line: usize,
        /// Line of the first trial.
        first: usize,
    },
    /// A recording in which no repetition was found.
    #[error("{file}: no repetition found; [processing.repetitions] does not suit this recording")]
    NoRepetition {
        /// The trial's file.
        file: String,
    },
}

impl ProcessingError {
    /// What to do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            ProcessingError::Passive { error: PassiveError::NoRun, .. } => {
                Some("list trials with contraction passive in trials.csv, or leave out subtract_passive")
            }
            ProcessingError::ArmFlipped { .. } => {
                Some("leave out subtract_passive, or process the trials with the arm flipped as a study of their own")
            }
            ProcessingError::SeveralPostures { .. } => {
                Some("leave out subtract_passive, or process the trials of each posture as a study of their own")
            }
            ProcessingError::NoRepetition { .. } => {
                Some("lower threshold or min_duration_s, or name other contractions there")
            }
            ProcessingError::Alignment {
                error: AlignmentError::AtLimit { .. } | AlignmentError::NoOverlap { .. },
                ..
            } => Some(
                "raise max_delay_s in [emg_recorder], or check that shared and shared_with are the same \
                 quantity and sign",
            ),
            _ => None,
        }
    }
}

impl Study {
    /// Processes all recordings of a participant as `[processing]` says.
    ///
    /// # Errors
    /// [`ProcessingError`].
    pub fn processed_trials(&self, participant: &str) -> Result<ProcessingResult, ProcessingError> {
        let settings = &self.settings.processing;
        let infos: Vec<&TrialInfo> = self.trials_of(participant).collect();
        let read: Vec<Result<ProcessedTrial, ProcessingError>> =
            infos.par_iter().map(|info| self.processed_trial(info)).collect();
        let mut trials = read.into_iter().collect::<Result<Vec<_>, _>>()?;
        if let Some(info) = infos.iter().find(|info| settings.passive_order.is_some() && info.arm_flipped) {
            let (file, line) = (self.folder.join("trials.csv"), info.line);
            return Err(ProcessingError::ArmFlipped { file, line });
        }
        if let Some((info, other)) = self.of_two_postures(&infos).filter(|_| settings.passive_order.is_some()) {
            let (file, line) = (self.folder.join("trials.csv"), other.line);
            return Err(ProcessingError::SeveralPostures { file, line, first: info.line });
        }
        let passive = settings.passive_order.map(|order| fit(&trials, order, participant)).transpose()?;
        if let Some(passive) = &passive {
            for trial in &mut trials {
                for i in 0..trial.time.len() {
                    trial.moment[i] -= passive.moment(trial.angle[i], trial.velocity[i]);
                }
                let beyond = trial.angle.iter().filter(|angle| !passive.covers(**angle)).count();
                trial.beyond_passive = beyond as f64 / trial.angle.len() as f64;
            }
        }
        let cut: Vec<Vec<ProcessedTrial>> =
            trials.into_iter().map(|trial| cut(trial, settings)).collect::<Result<_, _>>()?;
        Ok(ProcessingResult { passive, trials: cut.into_iter().flatten().collect() })
    }

    /// The first trial, and the first one in another posture of the joints that are held.
    fn of_two_postures<'t>(&self, infos: &[&'t TrialInfo]) -> Option<(&'t TrialInfo, &'t TrialInfo)> {
        let posture = |info: &TrialInfo| {
            let of_all = self.settings.posture.iter().filter(|held| info.held_at(&held.coordinate).is_none());
            of_all.chain(&info.held).cloned().collect::<Vec<_>>()
        };
        let (first, others) = infos.split_first()?;
        let of_first = posture(first);
        let other = others.iter().find(|info| !is_same_posture(&posture(info), &of_first))?;
        Some((first, other))
    }

    /// One recording up to the removal of the machine's drag.
    fn processed_trial(&self, info: &TrialInfo) -> Result<ProcessedTrial, ProcessingError> {
        let settings = &self.settings.processing;
        let columns = &self.settings.columns;
        let named_at = format!("{}:{}", self.folder.join("trials.csv").display(), info.line);
        let emg: Vec<&str> = columns.emg.iter().map(String::as_str).collect();
        let mut required = vec![columns.angle.as_str(), columns.moment.as_str()];
        required.extend(columns.further_moments.iter().map(|further| further.column.as_str()));
        if columns.velocity_required {
            required.push(&columns.velocity);
        }
        let recorder = self.settings.emg_recorder.as_ref();
        match recorder {
            Some(recorder) => required.extend(recorder.shared_with()),
            None => required.extend(&emg),
        }
        let optional = [columns.velocity.as_str()];
        let table = info.table.as_deref().or(columns.table.as_deref());
        let recorded = Recorded::read(&info.file, table, Some(&named_at), Some(&columns.time), &required, &optional)?;
        let mut recorded = recorded.in_seconds(columns.conversions.time, &info.file)?;
        let delay = recorder.map(|recorder| merge(&mut recorded, info, recorder, columns, &named_at)).transpose()?;
        for (name, samples) in &mut recorded.columns {
            let conversions = &columns.conversions;
            let own = [
                (&columns.angle, conversions.angle),
                (&columns.velocity, conversions.velocity),
                (&columns.moment, conversions.moment),
            ];
            let emg = columns.emg.iter().enumerate().map(|(i, column)| (column, conversions.emg(i)));
            if let Some((_, conversion)) = own.into_iter().chain(emg).find(|(column, _)| *column == name) {
                samples.iter_mut().for_each(|x| *x = conversion.of(*x));
            }
        }

        let file = info.file.display().to_string();
        let of_signal = |error| ProcessingError::Signal { file: file.clone(), error };
        let filter =
            settings.filter.map(|filter| filter.design(recorded.mean_rate_hz())).transpose().map_err(of_signal)?;
        let smooth = |x: Vec<f64>| match &filter {
            Some(filter) => filter.filter_zero_phase(&x).map_err(of_signal),
            None => Ok(x),
        };
        let column = |name: &str| recorded.column(name).unwrap_or_default().to_vec();
        let radians = |x: Vec<f64>| x.into_iter().map(|v| columns.angle_unit.to_radians(v)).collect::<Vec<f64>>();
        let angle = smooth(radians(column(&columns.angle)))?;
        let velocity = match recorded.column(&columns.velocity) {
            Some(velocity) => smooth(radians(velocity.to_vec()))?,
            None => derivative(&recorded.time, &angle),
        };
        let measured = column(&columns.moment);
        let mut moment = smooth(measured.clone())?;
        if settings.remove_drag {
            let damping = self.settings.dynamometer.damping;
            moment.iter_mut().zip(&velocity).for_each(|(m, v)| *m += damping * v);
        }
        let further_moments = columns
            .further_moments
            .iter()
            .map(|further| Ok((further.column.clone(), smooth(column(&further.column))?)))
            .collect::<Result<_, ProcessingError>>()?;
        let mut kept: Vec<(String, Vec<f64>)> = Vec::new();
        for name in &emg {
            if !kept.iter().any(|(known, _)| known == name) {
                kept.push(((*name).to_owned(), column(name)));
            }
        }
        Ok(ProcessedTrial {
            info: info.clone(),
            repetition: None,
            time: recorded.time,
            angle,
            velocity,
            moment,
            measured,
            further_moments,
            emg: kept,
            delay: delay.flatten(),
            beyond_passive: 0.0,
        })
    }
}

/// Brings the EMG of a recorder of its own to the dynamometer's clock; samples then stand at the instants of the faster
/// of both. `None` where the delay is known.
fn merge(
    recorded: &mut Recorded,
    info: &TrialInfo,
    recorder: &EmgRecorder,
    columns: &Columns,
    named_at: &str,
) -> Result<Option<DelayFound>, ProcessingError> {
    let with = || info.file.display().to_string();
    let shared = recorder.shared_with().and_then(|name| recorded.column(name)).unwrap_or_default();
    let found = recorder.read(info, columns, named_at, (&recorded.time, shared)).map_err(|error| match error {
        EmgRecorderError::Study(errors) => ProcessingError::Study(errors),
        EmgRecorderError::Alignment { file, error } => ProcessingError::Alignment { file, with: with(), error },
    })?;
    let other = &found.recorded;
    let failed = |error| ProcessingError::Alignment { file: found.file.display().to_string(), with: with(), error };
    let overlap = [recorded.time[0].max(other.time[0]), last(&recorded.time).min(last(&other.time))];
    let faster = if other.mean_rate_hz() > recorded.mean_rate_hz() { &other.time } else { &recorded.time };
    // The clock stays the dynamometer's.
    let time: Vec<f64> = faster.iter().copied().filter(|t| *t >= overlap[0] && *t <= overlap[1]).collect();
    if time.len() < MIN_SAMPLES {
        let [common_s, trial_s] = [(overlap[1] - overlap[0]).max(0.0), last(&recorded.time) - recorded.time[0]];
        let errors = vec![Problem::error(&found.file, None, Fault::LittleInCommon { common_s, trial_s })];
        return Err(StudyErrors { errors, ..StudyErrors::default() }.into());
    }
    // EMG is the recorder's own, everything else the dynamometer's.
    let of_emg = |(name, _): &&(String, Vec<f64>)| columns.emg.contains(name);
    let own = recorded.columns.iter().filter(|column| !of_emg(column)).map(|column| (&recorded.time, column));
    let theirs = other.columns.iter().map(|column| (&other.time, column));
    let mut merged = Vec::new();
    for (from, (name, samples)) in own.chain(theirs) {
        let values = interpolate_linear(from, samples, &time).map_err(|error| failed(error.into()))?;
        merged.push((name.clone(), values));
    }
    *recorded = Recorded { time, columns: merged };
    Ok(found.alignment.map(|alignment| DelayFound { file: found.file, alignment }))
}

fn last(time: &[f64]) -> f64 {
    time.last().copied().unwrap_or(f64::NAN)
}

fn fit(trials: &[ProcessedTrial], order: usize, participant: &str) -> Result<PassiveCurve, ProcessingError> {
    let passive = trials.iter().filter(|trial| trial.info.contraction == Contraction::Passive);
    let runs: Vec<PassiveRun<'_>> = passive
        .map(|trial| PassiveRun { angle: &trial.angle, velocity: &trial.velocity, moment: &trial.moment })
        .collect();
    fit_passive(&runs, order).map_err(|error| ProcessingError::Passive { participant: participant.to_owned(), error })
}

/// The repetitions of a recording, or the recording.
fn cut(trial: ProcessedTrial, settings: &ProcessingSettings) -> Result<Vec<ProcessedTrial>, ProcessingError> {
    let Some((repetitions, contractions)) = &settings.repetitions else { return Ok(vec![trial]) };
    // A trial that trials.csv numbers is one repetition already.
    if !contractions.contains(&trial.info.contraction) || trial.info.repetition.is_some() {
        return Ok(vec![trial]);
    }
    let signal = match repetitions.signal {
        RepetitionSignal::Moment => &trial.moment,
        RepetitionSignal::Movement => &trial.velocity,
    };
    let found = find_repetitions(&trial.time, signal, repetitions);
    let long_enough: Vec<_> = found.into_iter().filter(|range| range.len() >= MIN_SAMPLES).collect();
    if long_enough.is_empty() {
        return Err(ProcessingError::NoRepetition { file: trial.info.file.display().to_string() });
    }
    let piece = |(i, range): (usize, std::ops::Range<usize>)| {
        let take = |x: &[f64]| x[range.clone()].to_vec();
        ProcessedTrial {
            info: trial.info.clone(),
            repetition: Some(i as u32 + 1),
            time: take(&trial.time),
            angle: take(&trial.angle),
            velocity: take(&trial.velocity),
            moment: take(&trial.moment),
            measured: take(&trial.measured),
            further_moments: trial
                .further_moments
                .iter()
                .map(|(name, samples)| (name.clone(), take(samples)))
                .collect(),
            emg: trial.emg.iter().map(|(name, samples)| (name.clone(), take(samples))).collect(),
            delay: trial.delay.clone(),
            beyond_passive: trial.beyond_passive,
        }
    };
    Ok(long_enough.into_iter().enumerate().map(piece).collect())
}
