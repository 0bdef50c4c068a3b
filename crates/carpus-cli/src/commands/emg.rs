//! `carpus emg`: raw EMG to normalized EMG, with checks and plots.

use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::args::{EmgArgs, Global};
use crate::failure::{self, Diagnostic, Failure};
use crate::provenance::provenance;
use crate::study_run::{StudyRun, progress};
use crate::table::{fixed, table};
use carpus_numerics::signals::{EmgProcessing, EnvelopeKind, MvcLevel};
use carpus_report::results::{InputFile, rounded};
use carpus_report::signals::{SignalFigure, SignalPanel, SignalReport, SignalSection, SignalTable, thinned_signal};
use carpus_report::{render_signals, significant};
use carpus_session::account::csv_text;
use carpus_session::provenance::input_file;
use carpus_study::study::{EmgSignal, Participant, ProcessedEmg};

/// Points of a drawn signal.
const DRAWN: usize = 400;

/// A participant's EMG.
#[derive(Serialize, Deserialize)]
pub struct Outcome {
    /// The participant.
    pub participant: String,
    channels: Vec<Channel>,
    trials: Vec<Trial>,
    #[serde(skip)]
    warnings: Vec<Diagnostic>,
    #[serde(skip)]
    inputs: Vec<InputFile>,
}

/// A channel and its level at maximum voluntary contraction.
#[derive(Serialize, Deserialize)]
struct Channel {
    column: String,
    muscles: Vec<String>,
    /// In the channel's unit.
    mvc_level: f64,
    mvc_trial: String,
}

#[derive(Serialize, Deserialize)]
struct Trial {
    trial: String,
    file: String,
    sample_rate_hz: f64,
    channels: Vec<ChannelOfTrial>,
}

#[derive(Serialize, Deserialize)]
struct ChannelOfTrial {
    column: String,
    highest: f64,
    mean: f64,
    findings: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// A study whose EMG is normalized already, its trials, or the output folder.
pub fn run(args: &EmgArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "emg")?;
    let EmgSignal::Raw(processing) = &study.study.tables.settings.emg else {
        let message = Diagnostic::error("the study's EMG is normalized already: there is nothing to process");
        return Err(message
            .in_file(&study.study.tables.file)
            .hint("raw channels are declared by [emg] kind = \"raw\"")
            .into());
    };
    let bar = progress(global, study.participants().len() as u64, "EMG");
    let outcomes = study.each(|participant| {
        let outcome = processed(&study, participant, processing, global, Path::new(&participant.name))?;
        failure::print(&outcome.warnings);
        bar.inc(1);
        Ok(outcome)
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    let mut inputs: Vec<InputFile> = Vec::new();
    for file in outcomes.done.iter().flat_map(|outcome| &outcome.inputs) {
        if !inputs.contains(file) {
            inputs.push(file.clone());
        }
    }
    let results = serde_json::json!({
        "schema": "carpus.emg/1",
        "provenance": provenance(global, inputs),
        "processing": constants(processing).into_iter().collect::<std::collections::BTreeMap<_, _>>(),
        "participants": outcomes.done,
    });
    let json = serde_json::to_string_pretty(&results).map_err(|e| Failure::Internal(e.to_string()))?;
    study.out.write("emg.json", json.as_bytes())?;
    let text = if global.json { results.to_string() } else { readable(&outcomes.done, study.out.path()) };
    outcomes.print(&study, "emg", &text)
}

/// A participant's EMG, written with a page into a folder of the results.
///
/// # Errors
/// The trials; the disk.
pub fn processed(
    study: &StudyRun,
    participant: &Participant,
    processing: &EmgProcessing,
    global: &Global,
    folder: &Path,
) -> Result<Outcome, Failure> {
    let settings = &study.study.tables.settings;
    let emg = study.study.tables.processed_emg(&participant.name)?;
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
        study.out.write(folder.join("emg").join(format!("{}.csv", trial.info.name)), text.as_bytes())?;
        Ok(())
    };
    emg.trials.par_iter().map(write).collect::<Vec<_>>().into_iter().collect::<Result<(), Failure>>()?;

    let mut inputs = vec![input_file(&study.study.tables.file, "study.toml", "study")?];
    for (name, role) in [("participants.csv", "participants"), ("trials.csv", "trials")] {
        inputs.push(input_file(&study.study.tables.folder.join(name), name, role)?);
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
    let trial = |t: &ProcessedEmg| Trial {
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
    let outcome = Outcome {
        participant: participant.name.clone(),
        channels: of_muscles.iter().map(channel).collect(),
        trials: emg.trials.iter().map(trial).collect(),
        warnings,
        inputs: inputs.clone(),
    };
    let section = |(t, summary): (&ProcessedEmg, &Trial)| SignalSection {
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
        provenance: provenance(global, inputs),
    };
    study.out.write(folder.join("report.html"), render_signals(&report).as_bytes())?;
    Ok(outcome)
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn levels_table(outcome: &Outcome) -> SignalTable {
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
pub fn rows(outcomes: &[Outcome]) -> Vec<Vec<String>> {
    let of_channels = |outcome: &Outcome| {
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
pub fn findings(outcomes: &[Outcome]) -> Vec<[String; 4]> {
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

fn readable(outcomes: &[Outcome], folder: &Path) -> String {
    let mut text = table(&COLUMNS, 3, rows(outcomes));
    text.push_str("\n\n");
    for outcome in outcomes {
        text.push_str(&format!("{}\n", folder.join(&outcome.participant).join("report.html").display()));
    }
    text
}
