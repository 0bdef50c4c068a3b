//! Reads the file of a trial, and settles whether its samples can be used.

use std::path::Path;

use super::emg_recorder::{EmgRecorder, EmgRecorderError};
use super::fault::Fault;
use super::limits::{MAX_SAMPLES, MIN_SAMPLES};
use super::nearest::nearest;
use super::problem::{Problem, Severity, StudyErrors};
use super::raw_emg::{self, EmgSignal};
use super::recording_file::{Recording, Source};
use super::settings::Settings;
use super::table::{is_of_a_study, missing_column};
use super::trial::Trial;
use super::trial_checks::{check_arrays, check_excitation, check_time, note_resampled};
use super::trial_list::TrialInfo;
use crate::dynamometer::Alignment;
use carpus_numerics::signals::independent_samples;

impl Trial {
    /// Reads and checks the file of a trial, except for what needs the rest of the study.
    ///
    /// - `mvc_levels`: of raw EMG, each channel's level at maximum voluntary contraction; without them `excitation`
    ///   keeps the raw samples
    pub(crate) fn read(
        info: &TrialInfo,
        settings: &Settings,
        trials_file: &Path,
        mvc_levels: Option<&[f64]>,
    ) -> Result<Trial, StudyErrors> {
        let mut problems = Vec::new();
        let trial = read_samples(info, settings, trials_file, &mut problems);
        let in_table = |problems: &mut [Problem]| Problem::set_table(problems, &info.file, table_of(info, settings));
        Self::settled(trial, settings, mvc_levels, problems).map_or_else(
            |mut errors| {
                in_table(&mut errors.errors);
                in_table(&mut errors.warnings);
                Err(errors)
            },
            |mut trial| {
                in_table(&mut trial.warnings);
                Ok(trial)
            },
        )
    }

    /// As [`Trial::read`], of samples that are in memory.
    pub(super) fn checked(&self, settings: &Settings, mvc_levels: Option<&[f64]>) -> Result<Trial, StudyErrors> {
        let mut problems = Vec::new();
        check_arrays(self, settings.active_muscles.len(), &mut problems);
        let trial = problems.is_empty().then(|| self.clone());
        Self::settled(trial, settings, mvc_levels, problems)
    }

    /// - `trial`: `None` only with an error among the problems
    fn settled(
        trial: Option<Trial>,
        settings: &Settings,
        mvc_levels: Option<&[f64]>,
        mut problems: Vec<Problem>,
    ) -> Result<Trial, StudyErrors> {
        let trial = trial.map(|mut trial| {
            let before = problems.len();
            check_time(&trial, settings.max_gap, &mut problems);
            trial.moment_samples = independent_samples(&trial.moment);
            note_resampled(&trial, settings, &mut problems);
            match &settings.emg {
                EmgSignal::Normalized => check_excitation(&mut trial, settings, &mut problems),
                EmgSignal::Raw(emg) => {
                    // Remarks do not matter here: samples in volts must not pass for excitations.
                    let sound = problems[before..].iter().all(|p| p.severity == Severity::Warning);
                    let equal_steps = sound && raw_emg::check_steps(&trial, &mut problems);
                    if let Some(levels) = mvc_levels.filter(|_| equal_steps) {
                        raw_emg::to_excitation(&mut trial, emg, levels, &settings.columns, &mut problems);
                    }
                }
            }
            trial
        });
        let warnings = StudyErrors::settle(problems)?;
        // No samples and no error cannot be: every way out of `read_samples` reports.
        trial.map(|trial| Trial { warnings, ..trial }).ok_or_else(StudyErrors::default)
    }
}

/// The table of a trial's file that is stated.
fn table_of<'s>(info: &'s TrialInfo, settings: &'s Settings) -> Option<&'s str> {
    info.table.as_deref().or(settings.columns.table.as_deref())
}

/// Where each quantity stands in the header; EMG of a recorder of its own stands nowhere.
struct Layout {
    time: usize,
    angle: usize,
    velocity: Option<usize>,
    moment: usize,
    further: Vec<usize>,
    emg: Vec<usize>,
    shared: Option<usize>,
}

fn layout(header: &[String], settings: &Settings, file: &Path, problems: &mut Vec<Problem>) -> Option<Layout> {
    let before = problems.len();
    let (columns, muscles) = (&settings.columns, &settings.active_muscles);
    let raw = settings.emg != EmgSignal::Normalized;
    let recorder = settings.emg_recorder.as_ref();
    let mut column = |name: &str, meaning: &str| {
        let index = header.iter().position(|c| c == name);
        if index.is_none() {
            problems.push(Problem::error(file, 1, missing_column(name, meaning, header)));
        }
        index
    };
    let time = column(&columns.time, "time in seconds");
    let angle = column(&columns.angle, "angle of the dynamometer's coordinate");
    let moment = column(&columns.moment, "measured moment in N·m");
    let further: Vec<usize> = columns
        .further_moments
        .iter()
        .filter_map(|f| column(&f.column, &format!("measured moment about {} in N·m", f.coordinate)))
        .collect();
    let has_velocity = columns.velocity_required || header.contains(&columns.velocity);
    let velocity = if has_velocity { column(&columns.velocity, "angular velocity") } else { None };
    let shared = recorder.and_then(EmgRecorder::shared_with);
    let shared = shared.and_then(|name| column(name, "the quantity that both recorders have"));
    let mut emg = Vec::with_capacity(muscles.len());
    for (i, (name, muscle)) in columns.emg.iter().zip(muscles).enumerate().filter(|_| recorder.is_none()) {
        let said_before = columns.emg[..i].contains(name) && !header.contains(name);
        if !said_before {
            emg.extend(column(name, &format!("EMG of {muscle}{}", if raw { "" } else { ", 0 to 1" })));
        }
    }
    report_unknown_columns(header, settings, file, problems);
    (problems.len() == before).then_some(())?;
    Some(Layout { time: time?, angle: angle?, velocity, moment: moment?, further, emg, shared })
}

fn report_unknown_columns(header: &[String], settings: &Settings, file: &Path, problems: &mut Vec<Problem>) {
    let columns = &settings.columns;
    let mut known: Vec<&str> = vec![&columns.time, &columns.angle, &columns.velocity, &columns.moment];
    known.extend(columns.further_moments.iter().map(|f| f.column.as_str()));
    known.extend(settings.emg_recorder.as_ref().and_then(EmgRecorder::shared_with));
    for name in columns.emg.iter().filter(|_| settings.emg_recorder.is_none()) {
        if !known.contains(&name.as_str()) {
            known.push(name); // one column may drive several muscles
        }
    }
    for column in header.iter().filter(|c| !known.contains(&c.as_str()) && !columns.ignore.contains(c)) {
        let absent = known.iter().copied().filter(|k| !header.iter().any(|c| c == k));
        let fault = Fault::UnknownColumn {
            column: column.clone(),
            known: known.iter().map(|k| (*k).to_owned()).collect(),
            nearest: nearest(column, absent),
            in_trial: true,
        };
        problems.push(Problem::error(file, 1, fault));
    }
}

/// First bad cell of a column, and how many more there are.
#[derive(Default)]
struct BadCells {
    first: Option<(usize, String)>,
    more: usize,
}

impl BadCells {
    fn note(&mut self, line: usize, text: &str) {
        match self.first {
            None => self.first = Some((line, text.to_owned())),
            Some(_) => self.more += 1,
        }
    }
}

/// Streams the rows; `None` after reporting at least one error.
fn read_samples(
    info: &TrialInfo,
    settings: &Settings,
    trials_file: &Path,
    problems: &mut Vec<Problem>,
) -> Option<Trial> {
    let file = &info.file;
    let named_at = format!("{}:{}", trials_file.display(), info.line);
    let columns = [&settings.columns.time, &settings.columns.angle, &settings.columns.moment].map(String::as_str);
    let source = Source {
        path: file,
        table: table_of(info, settings),
        columns: &columns,
        what: "trial file",
        named_at: Some(&named_at),
        key: "table",
    };
    let mut recording = Recording::open(&source, problems)?;
    let header = recording.names.clone();
    let layout = layout(&header, settings, file, problems)?;

    let unit = settings.columns.angle_unit;
    let conversions = &settings.columns.conversions;
    let mut shared = Vec::new();
    let muscles = settings.active_muscles.len();
    let mut trial = Trial::from_samples(info.clone(), Vec::new(), Vec::new(), Vec::new(), vec![Vec::new(); muscles]);
    trial.further_moments = vec![Vec::new(); layout.further.len()];
    let mut velocity = layout.velocity.map(|_| Vec::new());
    let mut bad: Vec<BadCells> = header.iter().map(|_| BadCells::default()).collect();
    let mut ragged: Option<(usize, usize, usize)> = None;
    while recording.next(file, problems)? {
        let line = recording.place();
        if recording.cells() != header.len() {
            let first = ragged.get_or_insert((line, recording.cells(), 0));
            first.2 += 1;
            continue;
        }
        if trial.len() == MAX_SAMPLES {
            problems.push(Problem::error(file, line, Fault::TooManySamples { limit: MAX_SAMPLES }));
            return None;
        }
        let mut number = |column: usize| {
            let value = recording.number(column).filter(|v| is_of_a_study(*v));
            if value.is_none() {
                bad[column].note(line, &recording.text_of(column));
            }
            value.unwrap_or(0.0) // never used: a noted cell fails the whole trial below
        };
        trial.time.push(conversions.time.of(number(layout.time)));
        trial.angle.push(unit.to_radians(conversions.angle.of(number(layout.angle))));
        trial.moment.push(conversions.moment.of(number(layout.moment)));
        shared.extend(layout.shared.map(&mut number));
        for (samples, column) in trial.further_moments.iter_mut().zip(&layout.further) {
            samples.push(number(*column));
        }
        if let (Some(column), Some(samples)) = (layout.velocity, velocity.as_mut()) {
            samples.push(unit.to_radians(conversions.velocity.of(number(column))));
        }
        for (i, (channel, column)) in trial.excitation.iter_mut().zip(&layout.emg).enumerate() {
            // A column that serves several muscles is counted as bad once.
            let again = layout.emg[..i].contains(column);
            let value = if again { recording.number(*column).unwrap_or(0.0) } else { number(*column) };
            channel.push(conversions.emg(i).of(value));
        }
        trial.lines.push(u32::try_from(line).unwrap_or(u32::MAX));
    }
    trial.velocity = velocity;
    let before = problems.len();
    report_bad_cells(file, &header, bad, ragged, problems);
    if problems.len() == before && trial.len() < MIN_SAMPLES {
        problems.push(Problem::error(file, None, Fault::TooFewSamples { found: trial.len(), expected: MIN_SAMPLES }));
    }
    if problems.len() == before
        && let Some(recorder) = &settings.emg_recorder
    {
        add_emg(&mut trial, recorder, &shared, settings, &named_at, problems);
    }
    (problems[before..].iter().all(|problem| problem.severity == Severity::Warning)).then_some(trial)
}

/// Adds the EMG of a recorder of its own: normalized at the trial's times, raw at its own. The trial is cut to the time
/// that both recorded.
///
/// - `shared`: samples of the quantity that sets the clock, as in the trial's file
fn add_emg(
    trial: &mut Trial,
    recorder: &EmgRecorder,
    shared: &[f64],
    settings: &Settings,
    named_at: &str,
    problems: &mut Vec<Problem>,
) {
    let file = trial.info.file.clone();
    let found = match recorder.read(&trial.info, &settings.columns, named_at, (&trial.time, shared)) {
        Ok(found) => found,
        Err(EmgRecorderError::Study(errors)) => {
            problems.extend(errors.errors.into_iter().chain(errors.warnings));
            return;
        }
        Err(EmgRecorderError::Alignment { file: of_emg, error }) => {
            let fault = Fault::EmgClock { with: file.display().to_string(), error };
            problems.push(Problem::error(Path::new(&of_emg), None, fault));
            return;
        }
    };
    if let Some(a) = found.alignment.filter(Alignment::is_doubtful) {
        let fault = Fault::EmgClockDoubtful { shift_s: a.shift, correlation: a.correlation, runner_up: a.runner_up };
        problems.push(Problem::warning(&found.file, None, fault));
    }
    let emg_time = found.recorded.time;
    let (first, last) = (emg_time[0], emg_time[emg_time.len() - 1]);
    let begin = trial.time.partition_point(|t| *t < first);
    let end = trial.time.partition_point(|t| *t <= last).max(begin);
    let trial_s = trial.duration();
    if 2 * (end - begin) < trial.len() {
        let common_s = (last.min(trial.time[trial.len() - 1]) - first.max(trial.time[0])).max(0.0);
        problems.push(Problem::error(&found.file, None, Fault::LittleInCommon { common_s, trial_s }));
        return;
    }
    trial.keep(begin..end);
    let conversions = &settings.columns.conversions;
    let column = |name: &str| found.recorded.columns.iter().find(|(known, _)| known == name).map(|(_, x)| x.as_slice());
    let channels = settings.columns.emg.iter().enumerate().map(|(i, name)| {
        column(name).unwrap_or_default().iter().map(|x| conversions.emg(i).of(*x)).collect::<Vec<f64>>()
    });
    trial.excitation = channels.collect();
    trial.emg_time = Some(emg_time);
    if settings.emg == EmgSignal::Normalized {
        raw_emg::to_trial_times(trial, problems);
    }
}

fn report_bad_cells(
    file: &Path,
    header: &[String],
    bad: Vec<BadCells>,
    ragged: Option<(usize, usize, usize)>,
    problems: &mut Vec<Problem>,
) {
    if let Some((line, found, count)) = ragged {
        let fault = Fault::FieldCount { expected: header.len(), found, more: count - 1 };
        problems.push(Problem::error(file, line, fault));
    }
    for (column, cells) in header.iter().zip(bad) {
        if let Some((line, found)) = cells.first {
            let is_too_large = found.parse().is_ok_and(f64::is_finite);
            let expected = if is_too_large { "a number of at most 1e12 in size" } else { "a finite number" };
            let fault = Fault::BadNumber { column: column.clone(), expected, found, more: cells.more };
            problems.push(Problem::error(file, line, fault));
        }
    }
}
