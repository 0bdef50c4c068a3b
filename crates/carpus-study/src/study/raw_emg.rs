//! Raw EMG as a study has it: the constants of `[emg]`, each channel's level at maximum voluntary contraction, and the
//! way of a trial from raw channels to excitation.

use std::path::Path;

use super::columns::Columns;
use super::fault::Fault;
use super::problem::Problem;
use super::toml_section::{Sections, TomlSection};
use super::trial::Trial;
use carpus_numerics::signals::{
    EmgProcessing, EnvelopeKind, Finding, MvcLevel, QualityLimits, SavitzkyGolay, check_artefact, check_channel,
    check_excitation, interpolate_linear, mvc_level,
};

/// Steps of a raw recording stay within this fraction of their mean: filters need equal steps, and times written with
/// few decimals are equal to that.
const STEP_TOLERANCE: f64 = 0.5;

/// What the EMG columns hold.
#[derive(Clone, Debug, PartialEq, Default)]
pub enum EmgSignal {
    /// Envelopes, 0 to 1 of the maximum voluntary contraction: excitations as they are.
    #[default]
    Normalized,
    /// Raw channels in any unit; the MVC level is found over the participant's MVC trials.
    Raw(EmgProcessing),
}

/// Reads `[emg]`.
pub(crate) fn settings(sections: &Sections<'_>, problems: &mut Vec<Problem>) -> EmgSignal {
    let mut section = sections.section("emg");
    let kind = section.optional_word("kind", "EMG kind", &[("normalized", false), ("raw", true)]);
    let signal = if kind == Some(true) { EmgSignal::Raw(processing(&mut section)) } else { EmgSignal::Normalized };
    section.finish(problems);
    signal
}

fn processing(section: &mut TomlSection<'_>) -> EmgProcessing {
    let mut emg = EmgProcessing::default();
    let seconds = "a positive number of seconds, 0.001 to 10";
    let is_window = |v: f64| (1e-3..=10.0).contains(&v);
    let whole = |v: f64, from: f64, to: f64| (from..=to).contains(&v) && v.fract() == 0.0;
    let band = "[lower, upper] in Hz, 1 ≤ lower < upper";
    if let Some(band) = section.optional_pair("band_pass_hz", band, |[a, b]| a >= 1.0 && a < b) {
        emg.band_pass_hz = Some(band);
    }
    if let Some(order) = section.optional_number("filter_order", "1 to 20", |v| whole(v, 1.0, 20.0)) {
        emg.filter_order = order as usize;
    }
    let kinds =
        [("moving_rms", EnvelopeKind::MovingRms), ("moving_mean_of_rectified", EnvelopeKind::MovingMeanOfRectified)];
    if let Some(kind) = section.optional_word("envelope", "envelope", &kinds) {
        emg.envelope = kind;
    }
    if let Some(window_s) = section.optional_number("rms_window_s", seconds, is_window) {
        emg.rms_window_s = window_s;
    }
    emg.resample_hz =
        section.optional_number("resample_hz", "a positive rate in Hz, 10 to 100000", |v| (10.0..=1e5).contains(&v));
    if let Some(window_s) = section.optional_number("mvc_window_s", seconds, is_window) {
        emg.mvc_level = MvcLevel::LargestMean { window_s };
    }
    let expected = "a table { order = …, window_s = … }";
    let smoothing = section.optional_table("savitzky_golay", expected, |table| {
        let order = table.optional_number("order", "0 to 9", |v| whole(v, 0.0, 9.0));
        (order, table.optional_number("window_s", seconds, is_window))
    });
    if let (Some((order, window_s)), Some(SavitzkyGolay { order: usual_order, window_s: usual_window })) =
        (smoothing, emg.savitzky_golay)
    {
        let order = order.map_or(usual_order, |order| order as usize);
        emg.savitzky_golay = Some(SavitzkyGolay { order, window_s: window_s.unwrap_or(usual_window) });
    }
    emg
}

/// Each channel's level at maximum voluntary contraction, in the channel's unit: the largest over all trials given.
///
/// - `trials`: a participant's MVC trials, with raw samples in place of excitations
/// - `trials_file`: where the lack of such trials is reported
pub(crate) fn mvc_levels(
    trials: &[Trial],
    emg: &EmgProcessing,
    columns: &Columns,
    participant: &str,
    trials_file: &Path,
    problems: &mut Vec<Problem>,
) -> Vec<f64> {
    let mut levels: Vec<f64> = Vec::with_capacity(columns.emg.len());
    if trials.is_empty() {
        problems.push(Problem::error(trials_file, None, Fault::NoMvcTrial { participant: participant.to_owned() }));
        return levels;
    }
    for (channel, column) in columns.emg.iter().enumerate() {
        if let Some(same) = columns.emg[..channel].iter().position(|before| before == column) {
            levels.push(levels[same]);
            continue;
        }
        let mut envelopes = Vec::with_capacity(trials.len());
        for trial in trials {
            let rate = emg_rate_hz(trial);
            match emg.envelope(&trial.excitation[channel], rate) {
                Ok(envelope) => envelopes.push((envelope, rate)),
                Err(error) => {
                    let fault = Fault::RawEmg { column: column.clone(), error };
                    problems.push(Problem::error(&trial.info.file, None, fault));
                }
            }
        }
        let borrowed: Vec<(&[f64], f64)> = envelopes.iter().map(|(e, rate)| (e.as_slice(), *rate)).collect();
        levels.push(match mvc_level(&borrowed, emg.mvc_level) {
            Ok(level) => level,
            Err(_) if envelopes.len() < trials.len() => f64::NAN, // reported above
            Err(error) => {
                let fault = Fault::RawEmg { column: column.clone(), error };
                problems.push(Problem::error(&trials[0].info.file, None, fault));
                f64::NAN
            }
        });
    }
    levels
}

/// Reports steps of unequal length. False if there are any.
pub(crate) fn check_steps(trial: &Trial, problems: &mut Vec<Problem>) -> bool {
    let mean = 1.0 / emg_rate_hz(trial);
    let unequal = |step: f64| !((step / mean - 1.0).abs() < STEP_TOLERANCE);
    let steps = || emg_time(trial).windows(2).map(|t| t[1] - t[0]).enumerate().filter(|(_, step)| unequal(*step));
    let Some((first, step_s)) = steps().next() else { return true };
    let fault = Fault::UnequalSteps { step_s, mean_step_s: mean, more: steps().count() - 1 };
    let line = trial.line_of_sample(first + 1).filter(|_| trial.emg_time.is_none());
    problems.push(Problem::error(&trial.info.file, line, fault));
    false
}

/// Replaces a trial's raw samples by excitations, 0 to 1, and reports what is doubtful about its channels.
///
/// - `levels`: each channel's level at maximum voluntary contraction
pub(crate) fn to_excitation(
    trial: &mut Trial,
    emg: &EmgProcessing,
    levels: &[f64],
    columns: &Columns,
    problems: &mut Vec<Problem>,
) {
    let limits = QualityLimits::default();
    let rate = emg_rate_hz(trial);
    for (channel, column) in columns.emg.iter().enumerate() {
        if let Some(same) = columns.emg[..channel].iter().position(|before| before == column) {
            trial.excitation[channel] = trial.excitation[same].clone();
            continue;
        }
        let raw = &trial.excitation[channel];
        let mut report = |finding: Finding| {
            let fault = Fault::EmgChannel { column: column.clone(), finding };
            problems.push(Problem::warning(&trial.info.file, None, fault));
        };
        check_channel(raw, rate, &limits).into_iter().for_each(&mut report);
        match emg.envelope(raw, rate) {
            Ok(mut excitation) => {
                excitation.iter_mut().for_each(|e| *e /= levels[channel]);
                check_artefact(raw, &excitation, rate, &limits).into_iter().for_each(&mut report);
                check_excitation(&excitation, &limits).into_iter().for_each(&mut report);
                excitation.iter_mut().for_each(|e| *e = e.min(1.0));
                trial.excitation[channel] = excitation;
            }
            Err(error) => {
                let fault = Fault::RawEmg { column: column.clone(), error };
                problems.push(Problem::error(&trial.info.file, None, fault));
            }
        }
    }
}

/// Brings what is in `excitation` to the times of the trial. Envelopes are slower than either recorder.
pub(crate) fn to_trial_times(trial: &mut Trial, problems: &mut Vec<Problem>) {
    let Some(emg_time) = trial.emg_time.take() else { return };
    for samples in &mut trial.excitation {
        match interpolate_linear(&emg_time, samples, &trial.time) {
            Ok(values) => *samples = values,
            Err(error) => {
                let fault = Fault::RawEmg { column: "emg".to_owned(), error };
                problems.push(Problem::error(&trial.info.file, None, fault));
            }
        }
    }
}

/// Times of the EMG's samples \[s\].
pub(crate) fn emg_time(trial: &Trial) -> &[f64] {
    trial.emg_time.as_deref().unwrap_or(&trial.time)
}

/// Samples of EMG per second over the whole trial \[Hz\]: single steps carry the rounding of written times.
pub(crate) fn emg_rate_hz(trial: &Trial) -> f64 {
    let time = emg_time(trial);
    let span = time.last().zip(time.first()).map_or(0.0, |(last, first)| last - first);
    (time.len() as f64 - 1.0) / span
}
