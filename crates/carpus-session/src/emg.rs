//! Raw EMG to normalized EMG, with checks and plots.

use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::account::{csv_text, fixed};
use super::diagnostic::{Diagnostic, Failure};
use super::json::{pretty, value};
use super::output::OutputFolder;
use super::progress::Progress;
use super::provenance::{DEFAULT_SEED, input_file};
use super::study::Study;
use carpus_numerics::signals::{EmgProcessing, EnvelopeKind, MvcLevel};
use carpus_report::results::{InputFile, rounded};
use carpus_report::signals::{SignalFigure, SignalPanel, SignalReport, SignalSection, SignalTable, thinned_signal};
use carpus_report::{render_signals, significant};
use carpus_study::study::{EmgSignal, Participant, ProcessedEmg};

/// Points of a drawn signal.
const DRAWN: usize = 400;

/// A processing of raw EMG; how stands in `[emg]` of study.toml.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emg {
    /// Written into the results; nothing in it is random.
    pub seed: u64,
}

impl Default for Emg {
    fn default() -> Self {
        Emg { seed: DEFAULT_SEED }
    }
}

/// The EMG of every participant.
#[derive(Debug)]
pub struct EmgResults {
    /// Channels and trials of every participant.
    pub participants: Vec<ParticipantEmg>,
    /// What is written as `emg.json`.
    pub value: Value,
    /// Why participants' EMG could not be processed.
    pub failed: Vec<Diagnostic>,
}

/// A participant's EMG.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ParticipantEmg {
    /// The participant.
    pub participant: String,
    /// Its channels.
    pub channels: Vec<Channel>,
    /// Its trials.
    pub trials: Vec<EmgTrial>,
    /// What a person should look at.
    #[serde(skip)]
    pub warnings: Vec<Diagnostic>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

/// A channel and its level at maximum voluntary contraction.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Channel {
    /// Its column.
    pub column: String,
    /// The muscles that it stands for.
    pub muscles: Vec<String>,
    /// In the channel's unit.
    pub mvc_level: f64,
    /// The trial that has the level.
    pub mvc_trial: String,
}

/// A trial.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EmgTrial {
    /// Its name.
    pub trial: String,
    /// Its file.
    pub file: String,
    /// As recorded [Hz].
    pub sample_rate_hz: f64,
    /// Its channels, in the order of the participant's.
    pub channels: Vec<ChannelOfTrial>,
}

/// A channel of a trial.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChannelOfTrial {
    /// Its column.
    pub column: String,
    /// Largest excitation; 1 is the maximum voluntary contraction.
    pub highest: f64,
    /// Mean excitation.
    pub mean: f64,
    /// What is doubtful about it.
    pub findings: Vec<String>,
}

impl Study {
    /// Processes the raw EMG of every participant, with a page each.
    ///
    /// - `out`: [`Study::output_folder`] of `carpus emg`; what is made is written as the work goes on
    ///
    /// # Errors
    /// A study whose EMG is normalized already; no participant whose trials could be processed; the disk; a request to
    /// stop.
    pub fn emg(&self, request: &Emg, out: &OutputFolder, progress: &dyn Progress) -> Result<EmgResults, Failure> {
        let EmgSignal::Raw(processing) = &self.tables.settings.emg else {
            let message = Diagnostic::error("the study's EMG is normalized already: there is nothing to process");
            return Err(message
                .in_file(&self.tables.file)
                .hint("raw channels are declared by [emg] kind = \"raw\"")
                .into());
        };
        let outcomes = self.each("EMG", progress, |participant| {
            let about = participant.about();
            let done = processed(self, out, about, processing, request, Path::new(&about.name))?;
            progress.warnings(&done.warnings);
            Ok(done)
        })?;
        let mut inputs: Vec<InputFile> = Vec::new();
        for file in outcomes.done.iter().flat_map(|outcome| &outcome.inputs) {
            if !inputs.contains(file) {
                inputs.push(file.clone());
            }
        }
        let value = value(&serde_json::json!({
            "schema": "carpus.emg/1",
            "provenance": self.provenance(request, request.seed, inputs),
            "processing": constants(processing).into_iter().collect::<std::collections::BTreeMap<_, _>>(),
            "participants": outcomes.done,
        }))?;
        out.write("emg.json", pretty(&value)?.as_bytes())?;
        Ok(EmgResults { participants: outcomes.done, value, failed: outcomes.failed })
    }
}

/// A participant's EMG, written with a page into a folder of the results.
///
/// # Errors
/// The trials; the disk.
pub(super) fn processed(
    study: &Study,
    out: &OutputFolder,
    participant: &Participant,
    processing: &EmgProcessing,
    request: &Emg,
    folder: &Path,
) -> Result<ParticipantEmg, Failure> {
    let settings = &study.tables.settings;
    let emg = study.tables.processed_emg(&participant.name)?;
    let write = |trial: &ProcessedEmg| -> Result<(), Failure> {
        let mut header: Vec<String> = vec!["time_s".to_owned()];
        header.extend(settings.active_muscles.iter().map(|muscle| format!("emg_{muscle}")));
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let rows = (0..trial.time.len()).map(|i| {
            let mut row = vec![trial.time[i].to_string()];
            row.extend(trial.normalized.iter().map(|channel| channel[i].to_string()));
            row
        });
        let text = csv_text(header.iter(), rows)?;
        out.write(folder.join("emg").join(format!("{}.csv", trial.info.name)), text.as_bytes())?;
        Ok(())
    };
    emg.trials.par_iter().map(write).collect::<Vec<_>>().into_iter().collect::<Result<(), Failure>>()?;

    let mut inputs = vec![input_file(&study.tables.file, "study.toml", "study")?];
    for (name, role) in [("participants.csv", "participants"), ("trials.csv", "trials")] {
        inputs.push(input_file(&study.tables.folder.join(name), name, role)?);
    }
    for trial in &emg.trials {
        inputs.push(input_file(&trial.info.file, &trial.info.file_as_written, "trial")?);
    }
    let warnings = emg.trials.iter().flat_map(|t| t.warnings.iter().map(Diagnostic::from)).collect::<Vec<_>>();

    // Muscles that share a channel are one channel here.
    let columns = &settings.columns.emg;
    let of_muscles: Vec<usize> = (0..columns.len()).filter(|i| !columns[..*i].contains(&columns[*i])).collect();
    let channel = |i: &usize| Channel {
        column: columns[*i].clone(),
        muscles: (0..columns.len())
            .filter(|k| columns[*k] == columns[*i])
            .map(|k| settings.active_muscles[k].clone())
            .collect(),
        mvc_level: emg.levels[*i],
        mvc_trial: emg.level_trials[*i].clone(),
    };
    let trial = |t: &ProcessedEmg| EmgTrial {
        trial: t.info.name.clone(),
        file: t.info.file_as_written.clone(),
        sample_rate_hz: t.recorded_rate_hz,
        channels: of_muscles
            .iter()
            .map(|i| ChannelOfTrial {
                column: columns[*i].clone(),
                highest: t.normalized[*i].iter().copied().fold(0.0, f64::max),
                mean: t.normalized[*i].iter().sum::<f64>() / t.normalized[*i].len() as f64,
                findings: t.findings[*i].iter().map(ToString::to_string).collect(),
            })
            .collect(),
    };
    let outcome = ParticipantEmg {
        participant: participant.name.clone(),
        channels: of_muscles.iter().map(channel).collect(),
        trials: emg.trials.iter().map(trial).collect(),
        warnings,
        inputs: inputs.clone(),
    };
    let section = |(t, summary): (&ProcessedEmg, &EmgTrial)| SignalSection {
        title: format!("{} ({})", summary.trial, t.info.contraction.word()),
        panels: of_muscles.iter().zip(&summary.channels).map(|(i, c)| panel(t, *i, c)).collect(),
    };
    let findings = outcome.trials.iter().flat_map(|t| {
        t.channels
            .iter()
            .flat_map(move |c| c.findings.iter().map(move |f| (format!("{}, {}", t.trial, c.column), f.clone())))
    });
    let report = SignalReport {
        kicker: format!("EMG · {}", settings.name),
        title: format!("Normalized EMG of {}", participant.name),
        lead: format!(
            "{} in {}: from raw channels to excitations, 1 being the maximum voluntary contraction.",
            counted(outcome.channels.len(), "channel"),
            counted(outcome.trials.len(), "trial")
        ),
        facts: constants(processing),
        findings: findings.collect(),
        tables: vec![levels_table(&outcome)],
        legend: vec![("raw", "raw channel".to_owned()), ("after", "normalized envelope".to_owned())],
        sections: emg.trials.iter().zip(&outcome.trials).map(section).collect(),
        provenance: study.provenance(request, request.seed, inputs),
    };
    out.write(folder.join("report.html"), render_signals(&report).as_bytes())?;
    Ok(outcome)
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn levels_table(outcome: &ParticipantEmg) -> SignalTable {
    SignalTable {
        title: "Level at maximum voluntary contraction".to_owned(),
        header: ["channel", "muscles", "level, in the channel's unit", "found in"].map(str::to_owned).to_vec(),
        rows: outcome
            .channels
            .iter()
            .map(|c| vec![c.column.clone(), c.muscles.join(", "), significant(c.mvc_level, 4), c.mvc_trial.clone()])
            .collect(),
    }
}

fn panel(trial: &ProcessedEmg, channel: usize, summary: &ChannelOfTrial) -> SignalPanel {
    let (raw_time, raw) = thinned_signal(&trial.recorded_time, &trial.raw[channel], DRAWN);
    let (time, normalized) = thinned_signal(&trial.time, &trial.normalized[channel], DRAWN);
    SignalPanel {
        title: summary.column.clone(),
        note: format!("highest {}", significant(summary.highest, 3)),
        findings: summary.findings.clone(),
        figures: vec![
            SignalFigure {
                description: format!("normalized envelope of {}", summary.column),
                x_name: ("t", "s"),
                x: time,
                unit: "MVC",
                curves: vec![("after", "normalized".to_owned(), normalized)],
                include: vec![0.0, 1.0],
                height: 150.0,
            },
            SignalFigure {
                description: format!("raw channel {}", summary.column),
                x_name: ("t", "s"),
                x: raw_time,
                unit: "",
                curves: vec![("raw", "raw".to_owned(), raw)],
                include: Vec::new(),
                height: 100.0,
            },
        ],
    }
}

/// The constants of the processing, in words.
pub fn constants(p: &EmgProcessing) -> Vec<(String, String)> {
    let band = p.band_pass_hz.map_or("none".to_owned(), |[low, high]| {
        format!(
            "{low}–{high} Hz, Butterworth of order {} ({} poles), forward and backward",
            p.filter_order,
            2 * p.filter_order
        )
    });
    let envelope = match p.envelope {
        EnvelopeKind::MovingRms => "moving root mean square",
        EnvelopeKind::MovingMeanOfRectified => "moving mean of the rectified signal",
    };
    let smoothing = p.savitzky_golay.map_or("none".to_owned(), |s| format!("order {}, {} s", s.order, s.window_s));
    let level = match p.mvc_level {
        MvcLevel::Peak => "largest sample of the envelope over the MVC trials".to_owned(),
        MvcLevel::LargestMean { window_s } => {
            format!("largest mean of the envelope over {window_s} s of the MVC trials")
        }
    };
    let rate = p.resample_hz.map_or("as recorded".to_owned(), |rate| format!("{rate} Hz"));
    [
        ("Band-pass", band),
        ("Envelope", format!("{envelope}, {} s", p.rms_window_s)),
        ("Savitzky–Golay", smoothing),
        ("MVC level", level),
        ("Written at", rate),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .to_vec()
}

/// Columns of [`rows`].
pub const COLUMNS: [&str; 7] = ["participant", "channel", "MVC found in", "MVC level", "trials", "highest", "findings"];

/// A row of numbers for every channel of every participant.
pub fn rows(outcomes: &[ParticipantEmg]) -> Vec<Vec<String>> {
    let of_channels = |outcome: &ParticipantEmg| {
        let row = |(i, channel): (usize, &Channel)| {
            let of_trials = || outcome.trials.iter().map(move |t| &t.channels[i]);
            vec![
                outcome.participant.clone(),
                channel.column.clone(),
                channel.mvc_trial.clone(),
                rounded(channel.mvc_level, 4).to_string(),
                outcome.trials.len().to_string(),
                fixed(of_trials().map(|c| c.highest).fold(0.0, f64::max), 3),
                of_trials().map(|c| c.findings.len()).sum::<usize>().to_string(),
            ]
        };
        outcome.channels.iter().enumerate().map(row).collect::<Vec<_>>()
    };
    outcomes.iter().flat_map(of_channels).collect()
}

/// What was found in the channels: participant, trial, channel, finding.
pub fn findings(outcomes: &[ParticipantEmg]) -> Vec<[String; 4]> {
    let mut found = Vec::new();
    for outcome in outcomes {
        for trial in &outcome.trials {
            for channel in &trial.channels {
                let row =
                    |f: &String| [outcome.participant.clone(), trial.trial.clone(), channel.column.clone(), f.clone()];
                found.extend(channel.findings.iter().map(row));
            }
        }
    }
    found
}
