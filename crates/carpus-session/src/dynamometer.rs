//! Recordings filtered, corrected, cut and aligned, as a new study.

use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;

use super::account::{csv_text, digits, fixed};
use super::diagnostic::{Diagnostic, Failure};
use super::json::{pretty, value};
use super::outcomes::Outcomes;
use super::output::OutputFolder;
use super::processed_study::{NewTrial, trial_file, write_tables, write_trial};
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file};
use super::study::Study;
use carpus_numerics::signals::Band;
use carpus_report::results::InputFile;
use carpus_report::signals::{SignalFigure, SignalPanel, SignalReport, SignalSection, SignalTable, thinned_signal};
use carpus_report::{render_signals, significant};
use carpus_study::study::{
    Participant, ProcessedTrial, ProcessingError, ProcessingResult, ProcessingSettings, named_file,
};

/// Points of a drawn signal.
const DRAWN: usize = 400;

/// A participant's processing.
#[derive(Clone, Debug, Serialize)]
pub struct ParticipantProcessing {
    /// The participant.
    pub participant: String,
    /// The relaxed limb, if it was subtracted.
    pub passive: Option<Passive>,
    /// The trials that came of the recordings.
    pub trials: Vec<TrialMade>,
    /// What a person should look at: file and text.
    #[serde(skip)]
    pub findings: Vec<(String, String)>,
    #[serde(skip)]
    result: Option<ProcessingResult>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

/// The moment of the relaxed limb: a polynomial in the angle, and viscous damping.
#[derive(Clone, Debug, Serialize)]
pub struct Passive {
    /// Angles of the passive trials.
    pub range_deg: [f64; 2],
    /// Coefficients of the polynomial.
    pub coefficients_n_m: Vec<f64>,
    /// Damping.
    pub damping_n_m_s_per_deg: f64,
    /// Largest speed of the passive trials.
    pub speed_deg_per_s: f64,
    /// Root mean square of what the fit leaves.
    pub residual_n_m: f64,
    /// Coefficient of determination.
    pub r_squared: f64,
}

/// A trial of the new study.
#[derive(Clone, Debug, Serialize)]
pub struct TrialMade {
    /// The recording that it is of.
    pub recording: String,
    /// Its file.
    pub file: String,
    /// Its number among the repetitions of the recording.
    pub repetition: Option<u32>,
    /// Its samples.
    pub samples: usize,
    /// Its first time.
    pub start_s: f64,
    /// Its last time.
    pub end_s: f64,
    /// How a second recorder's clock was set.
    pub second_recorder: Option<SecondRecorder>,
    /// Share of samples outside of the angles of the passive trials.
    pub beyond_passive: f64,
}

/// How a second recorder's clock was set.
#[derive(Clone, Debug, Serialize)]
pub struct SecondRecorder {
    /// Its file.
    pub file: String,
    /// What is added to its clock.
    pub shift_s: f64,
    /// Correlation of what both recorded.
    pub correlation: f64,
    /// Correlation at the next highest peak.
    pub next_highest: f64,
}

/// A processing of recordings; what is done stands in `[processing]` of study.toml.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Processing {
    /// Written into the results; nothing in it is random.
    pub seed: u64,
}

impl Default for Processing {
    fn default() -> Self {
        Processing { seed: DEFAULT_SEED }
    }
}

/// The recordings of every participant as the trials of a new study.
#[derive(Debug)]
pub struct ProcessingResults {
    /// What was done to the recordings of every participant.
    pub participants: Vec<ParticipantProcessing>,
    /// What is written as `dynamometer.json`.
    pub value: Value,
    /// Why participants' recordings could not be processed.
    pub failed: Vec<Diagnostic>,
}

impl Study {
    /// Processes the recordings of every participant as `[processing]` says and writes them as a study, with a page
    /// each.
    ///
    /// - `out`: [`Study::output_folder`] of `carpus dynamometer`
    ///
    /// # Errors
    /// A study without `[processing]`; no participant whose recordings could be processed; the disk; a request to stop.
    pub fn process_recordings(
        &self,
        request: &Processing,
        out: &OutputFolder,
        progress: &dyn Progress,
    ) -> Result<ProcessingResults, Failure> {
        out.refuse_input(&out.path().join("study.toml"))?;
        let settings = &self.tables.settings;
        if settings.processing == ProcessingSettings::default() && settings.emg_recorder.is_none() {
            let message =
                Diagnostic::error("the study has no [processing]: there is nothing to do").in_file(&self.tables.file);
            let hint = "e.g.\n  [processing]\n  filter_hz = 6\n  remove_drag = true\n  subtract_passive = true";
            return Err(message.hint(hint).into());
        }
        let outcomes = process(self, request, out, progress)?;
        for (file, text) in outcomes.done.iter().flat_map(|o| &o.findings) {
            progress.warning(&Diagnostic::warning(text.clone()).in_file(&named_file(&self.tables.folder, file)));
        }
        let mut inputs: Vec<InputFile> = Vec::new();
        for file in outcomes.done.iter().flat_map(|outcome| &outcome.inputs) {
            if !inputs.contains(file) {
                inputs.push(file.clone());
            }
        }
        let value = value(&serde_json::json!({
            "schema": "carpus.dynamometer/1",
            "provenance": self.provenance(request, request.seed, inputs),
            "participants": outcomes.done,
        }))?;
        out.write("dynamometer.json", pretty(&value)?.as_bytes())?;
        Ok(ProcessingResults { participants: outcomes.done, value, failed: outcomes.failed })
    }
}

/// Processes the recordings of all participants and writes them as a study, with a page each.
///
/// # Errors
/// The recordings, or the output folder.
pub(super) fn process(
    study: &Study,
    request: &Processing,
    out: &OutputFolder,
    progress: &dyn Progress,
) -> Result<Outcomes<ParticipantProcessing>, Failure> {
    let outcomes =
        study.each("processing", progress, |participant| processed(study, participant.about(), request, out))?;
    let all: Vec<&ProcessedTrial> =
        outcomes.done.iter().filter_map(|o| o.result.as_ref()).flat_map(|result| &result.trials).collect();
    let new: Vec<NewTrial<'_>> = all.iter().map(|trial| NewTrial { file: trial_file(trial), trial }).collect();
    for (i, trial) in new.iter().enumerate() {
        // Names that differ by case alone are one file on some disks.
        if new[..i].iter().any(|before| before.file.to_lowercase() == trial.file.to_lowercase()) {
            let text = format!("two recordings would both become {}", trial.file);
            return Err(Diagnostic::error(text).hint("give the files of a participant different names").into());
        }
    }
    let written: Vec<Result<(), Failure>> =
        new.par_iter().map(|trial| write_trial(&study.tables, out, trial)).collect();
    written.into_iter().collect::<Result<(), Failure>>()?;
    let participants: Vec<Participant> = study
        .chosen()
        .iter()
        .filter(|p| outcomes.done.iter().any(|outcome| outcome.participant == p.name))
        .cloned()
        .collect();
    write_tables(&study.tables, out, &participants, &new)?;
    Ok(outcomes)
}

fn processed(
    study: &Study,
    participant: &Participant,
    request: &Processing,
    out: &OutputFolder,
) -> Result<ParticipantProcessing, Failure> {
    let result = study.tables.processed_trials(&participant.name).map_err(refused)?;
    let mut inputs = vec![input_file(&study.tables.file, "study.toml", "study")?];
    for (name, role) in [("participants.csv", "participants"), ("trials.csv", "trials")] {
        inputs.push(input_file(&study.tables.folder.join(name), name, role)?);
    }
    let mut findings: Vec<(String, String)> = Vec::new();
    for trial in &result.trials {
        if trial.repetition.is_some_and(|r| r > 1) {
            continue;
        }
        inputs.push(input_file(&trial.info.file, &trial.info.file_as_written, "trial")?);
        if let Some(delay) = &trial.delay {
            inputs.push(input_file(&delay.file, &delay.file.display().to_string(), "second recorder")?);
            let a = delay.alignment;
            if a.is_doubtful() {
                let text = format!(
                    "the delay is uncertain: the two recorders' common quantity correlates by {:.3} at {:.4} \
                     s, by {:.3} at another peak",
                    a.correlation, a.shift, a.runner_up
                );
                findings.push((trial.info.file_as_written.clone(), text));
            }
        }
        if trial.beyond_passive > 0.0 {
            let share = 100.0 * trial.beyond_passive;
            let text = format!("{share:.1} % of the samples are outside of the angles of the passive trials");
            findings.push((trial.info.file_as_written.clone(), text));
        }
    }
    if result.passive.as_ref().is_some_and(|passive| passive.drives_the_machine()) {
        let text = "the relaxed limb seems to drive the machine: the moment has to be positive in the direction in \
                    which the angle grows";
        findings.push(("trials.csv".to_owned(), text.to_owned()));
    }
    let outcome = ParticipantProcessing {
        participant: participant.name.clone(),
        passive: result.passive.as_ref().map(|p| Passive {
            range_deg: p.range.map(f64::to_degrees),
            coefficients_n_m: p.coefficients.clone(),
            damping_n_m_s_per_deg: p.damping * 1f64.to_radians(),
            speed_deg_per_s: p.speed.to_degrees(),
            residual_n_m: p.residual,
            r_squared: p.r_squared,
        }),
        trials: result.trials.iter().map(summary).collect(),
        findings: findings.clone(),
        inputs: inputs.clone(),
        result: None,
    };
    let section = SignalSection { title: "Moments".to_owned(), panels: result.trials.iter().map(panel).collect() };
    let report = SignalReport {
        kicker: format!("Dynamometer · {}", study.tables.settings.name),
        title: format!("Processed recordings of {}", participant.name),
        lead: format!("{} trials; every number can be made again from the files below.", result.trials.len()),
        facts: constants(&study.tables.settings.processing, study.tables.settings.dynamometer.damping),
        findings,
        tables: vec![trials_table(&outcome)],
        legend: vec![("measured", "moment as measured [N·m]".to_owned()), ("after", "processed [N·m]".to_owned())],
        sections: vec![section],
        provenance: study.provenance(request, request.seed, inputs),
    };
    out.write(Path::new("reports").join(format!("{}.html", participant.name)), render_signals(&report).as_bytes())?;
    Ok(ParticipantProcessing { result: Some(result), ..outcome })
}

/// What to tell about a processing that failed.
fn refused(error: ProcessingError) -> Failure {
    let hint = error.hint();
    match error {
        ProcessingError::Study(errors) => errors.into(),
        other => hint.into_iter().fold(Diagnostic::error(other.to_string()), Diagnostic::hint).into(),
    }
}

fn summary(trial: &ProcessedTrial) -> TrialMade {
    TrialMade {
        recording: trial.info.file_as_written.clone(),
        file: trial_file(trial),
        repetition: trial.repetition,
        samples: trial.time.len(),
        start_s: trial.time[0],
        end_s: trial.time[trial.time.len() - 1],
        second_recorder: trial.delay.as_ref().map(|delay| SecondRecorder {
            file: delay.file.display().to_string(),
            shift_s: delay.alignment.shift,
            correlation: delay.alignment.correlation,
            next_highest: delay.alignment.runner_up,
        }),
        beyond_passive: trial.beyond_passive,
    }
}

fn panel(trial: &ProcessedTrial) -> SignalPanel {
    let (time, processed) = thinned_signal(&trial.time, &trial.moment, DRAWN);
    // The same instants for both, so that they can be compared by eye.
    let nearest = |t: &f64| trial.measured[trial.time.partition_point(|known| known < t).min(trial.time.len() - 1)];
    let measured = time.iter().map(nearest).collect();
    SignalPanel {
        title: trial_file(trial).rsplit('/').next().unwrap_or_default().trim_end_matches(".csv").to_owned(),
        note: format!("{} samples", trial.time.len()),
        findings: Vec::new(),
        figures: vec![SignalFigure {
            description: format!("moment of {}", trial.info.name),
            x_name: ("t", "s"),
            x: time,
            unit: "N·m",
            curves: vec![("measured", "measured".to_owned(), measured), ("after", "processed".to_owned(), processed)],
            include: vec![0.0],
            height: 150.0,
        }],
    }
}

fn trials_table(outcome: &ParticipantProcessing) -> SignalTable {
    // Columns for what was not asked for would be empty.
    let aligned = outcome.trials.iter().any(|t| t.second_recorder.is_some());
    let columns = if aligned { 5 } else { 3 };
    let row = |t: &TrialMade| {
        let delay = t.second_recorder.as_ref();
        let mut row = vec![
            t.recording.clone(),
            t.repetition.map(|r| r.to_string()).unwrap_or_default(),
            format!("{}–{} s", fixed(t.start_s, 2), fixed(t.end_s, 2)),
            delay.map(|d| format!("{:.5} s", d.shift_s)).unwrap_or_default(),
            delay.map(|d| format!("{:.4}", d.correlation)).unwrap_or_default(),
        ];
        row.truncate(columns);
        row
    };
    SignalTable {
        title: "Trials".to_owned(),
        header: ["recording", "repetition", "from–to", "second recorder's clock +", "correlation"][..columns]
            .iter()
            .map(|name| (*name).to_owned())
            .collect(),
        rows: outcome.trials.iter().map(row).collect(),
    }
}

/// The constants of the processing, in words.
pub fn constants(p: &ProcessingSettings, damping: f64) -> Vec<(String, String)> {
    let filter = p.filter.map_or("none".to_owned(), |f| match f.band {
        Band::LowPass { cutoff_hz } => {
            format!(
                "low-pass {cutoff_hz} Hz, Butterworth of order {}, forward and backward (gain 1/2 at the cutoff)",
                f.order
            )
        }
        _ => String::new(),
    });
    let drag = match p.remove_drag {
        true => format!("{} N·m·s/deg × velocity added", significant(damping * 1f64.to_radians(), 4)),
        false => "left in".to_owned(),
    };
    let passive = p.passive_order.map_or("left in".to_owned(), |order| {
        format!("polynomial of order {order} in the angle and viscous damping, from the passive trials, subtracted")
    });
    let repetitions = p.repetitions.as_ref().map_or("not cut".to_owned(), |(r, _)| {
        format!("above {} of the largest, at least {} s, pauses up to {} s", r.threshold, r.min_duration, r.max_pause)
    });
    [("Filter", filter), ("Drag of the machine", drag), ("Relaxed limb", passive), ("Repetitions", repetitions)]
        .map(|(name, value)| (name.to_owned(), value))
        .to_vec()
}

/// Columns of [`rows`].
pub const COLUMNS: [&str; 6] =
    ["participant", "recordings", "trials", "passive R²", "passive rest N·m", "lowest correlation"];

/// A row of numbers for every participant.
pub fn rows(outcomes: &[ParticipantProcessing]) -> Vec<Vec<String>> {
    let row = |outcome: &ParticipantProcessing| {
        let recordings: std::collections::BTreeSet<&str> =
            outcome.trials.iter().map(|t| t.recording.as_str()).collect();
        let correlations = outcome.trials.iter().filter_map(|t| t.second_recorder.as_ref()).map(|s| s.correlation);
        let lowest = correlations.fold(f64::INFINITY, f64::min);
        vec![
            outcome.participant.clone(),
            recordings.len().to_string(),
            outcome.trials.len().to_string(),
            outcome.passive.as_ref().map(|p| fixed(p.r_squared, 4)).unwrap_or_default(),
            outcome.passive.as_ref().map(|p| fixed(p.residual_n_m, 4)).unwrap_or_default(),
            if lowest.is_finite() { fixed(lowest, 4) } else { String::new() },
        ]
    };
    outcomes.iter().map(row).collect()
}

/// Every trial that came of the recordings as CSV.
///
/// # Errors
/// None that input can cause.
pub fn trials_csv(outcomes: &[ParticipantProcessing]) -> Result<String, Failure> {
    let header =
        ["participant", "recording", "file", "repetition", "samples", "start_s", "end_s", "shift_s", "correlation"];
    let rows = outcomes.iter().flat_map(|o| {
        o.trials.iter().map(move |t| {
            let second = t.second_recorder.as_ref();
            let mut row = vec![o.participant.clone(), t.recording.clone(), t.file.clone()];
            row.push(t.repetition.map(|r| r.to_string()).unwrap_or_default());
            row.push(t.samples.to_string());
            row.extend([t.start_s, t.end_s].map(digits));
            row.push(second.map(|s| digits(s.shift_s)).unwrap_or_default());
            row.push(second.map(|s| digits(s.correlation)).unwrap_or_default());
            row
        })
    });
    csv_text(header.iter(), rows)
}
