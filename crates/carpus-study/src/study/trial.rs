//! One recorded trial: its samples, and whether they can be used.

use std::path::Path;

use super::in_memory::check_arrays;
use super::problem::{Fault, Problem, StudyErrors, nearest};
use super::raw_emg::{self, EmgSignal};
use super::settings::{AngleUnit, Columns, Settings};
use super::table::{csv_problem, is_of_a_study, missing_column, open};
use super::trial_list::TrialInfo;
use carpus_numerics::signals::{OwnSamples, Resampled, independent_samples, own_samples};

/// Fewest samples a trial may have: enough for a cubic spline with something to smooth.
pub const MIN_SAMPLES: usize = 10;
/// Most samples a trial may have (eight minutes at 2 kHz, an hour and more at 250 Hz). Simulated with five muscles a
/// sample takes up to
/// 2.6 kB, so that a trial stays below 3 GB.
pub const MAX_SAMPLES: usize = 1_000_000;
/// Longest median step, and longest mean step, of a trial: ten times the usual time constant of deactivation, 40 ms.
/// From one such sample to the next a
/// contraction comes and goes, so that time is in another unit \[s\].
pub const LONGEST_STEP: f64 = 0.4;
/// Shortest median step of a trial: a megahertz, a hundred times the rate of recorders of EMG \[s\].
pub const SHORTEST_STEP: f64 = 1e-6;
/// Longest trial: no contraction or passive movement on a dynamometer lasts an hour \[s\].
pub const LONGEST_TRIAL: f64 = 3600.0;
/// A step of more than this many median steps is a gap, unless `[checks] max_gap_s` says otherwise.
pub const GAP_IN_MEDIAN_STEPS: f64 = 5.0;
/// EMG up to this is noise about a full contraction: clamped to 1 with a warning. Above it, an error.
pub const EMG_NOISE_ABOVE: f64 = 1.05;
/// EMG down to this is filter ripple about rest: clamped to 0 with a warning. Below it, an error.
pub const EMG_NOISE_BELOW: f64 = -0.02;
/// How far a measured angle may leave the coordinate's range: an encoder's noise, 0.1° \[rad\].
pub const ANGLE_RANGE_TOLERANCE: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// How far a measured angle may leave the coordinate's range with a warning: 12° \[rad\]. Beyond, zero, sign or unit are wrong.
pub const ANGLE_RANGE_WARNING: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// The same of a coordinate that is a translation \[m\].
pub const POSITION_RANGE_WARNING: f64 = 0.02;

/// The samples of one trial, in internal units.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// What `trials.csv` says of it.
    pub info: TrialInfo,
    /// Time \[s\], strictly increasing.
    pub time: Vec<f64>,
    /// Angle of the dynamometer's coordinate \[rad\].
    pub angle: Vec<f64>,
    /// Angular velocity [rad/s], if it was recorded; else the derivative of the angle is meant.
    pub velocity: Option<Vec<f64>>,
    /// Moment the person exerts about the coordinate [N·m], positive in the coordinate's positive direction.
    pub moment: Vec<f64>,
    /// Moments about the further coordinates of `[dynamometer] further_moments` [N·m], in their order.
    pub further_moments: Vec<Vec<f64>>,
    /// Excitation of each active muscle, 0 to 1, in the order of the study's active muscles.
    pub excitation: Vec<Vec<f64>>,
    /// The moment's own samples, where it was held, interpolated or smoothed on the grid of the file; `None`: one a row.
    pub moment_samples: Option<OwnSamples>,
    /// What a person should look at.
    pub warnings: Vec<Problem>,
    /// Line of each sample in the file; empty if the trial was not read from a file.
    lines: Vec<u32>,
}

impl Trial {
    /// A trial that does not come from a file. Nothing is checked.
    pub fn from_samples(
        info: TrialInfo,
        time: Vec<f64>,
        angle: Vec<f64>,
        moment: Vec<f64>,
        excitation: Vec<Vec<f64>>,
    ) -> Self {
        let (velocity, further_moments, warnings, lines) = (None, Vec::new(), Vec::new(), Vec::new());
        let moment_samples = None;
        Self { info, time, angle, velocity, moment, further_moments, excitation, moment_samples, warnings, lines }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never so for a trial read from a file.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample \[s\].
    pub fn duration(&self) -> f64 {
        self.time.last().zip(self.time.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// Largest absolute moment [N·m].
    pub fn max_abs_moment(&self) -> f64 {
        self.moment.iter().fold(0.0, |max, m| f64::max(max, m.abs()))
    }

    /// Rows of the file from one sample of the moment to the next: 1 where every row is one.
    pub fn rows_per_moment(&self) -> f64 {
        self.moment_samples.as_ref().map_or(1.0, |own| own.step)
    }

    /// The moment [N·m] at its own samples: all that tells of its noise.
    pub fn own_moment(&self) -> Vec<f64> {
        match &self.moment_samples {
            Some(own) => own.at.iter().map(|k| self.moment[*k]).collect(),
            None => self.moment.clone(),
        }
    }

    /// With so many samples averaged to one; what is over at the end is left out.
    pub fn averaged(&self, count: usize) -> Trial {
        let mean = |x: &Vec<f64>| -> Vec<f64> {
            x.chunks_exact(count.max(1)).map(|part| part.iter().sum::<f64>() / part.len() as f64).collect()
        };
        let coarser = |own: &OwnSamples| {
            let mut at: Vec<usize> = own.at.iter().map(|k| k / count.max(1)).collect();
            at.dedup();
            at.retain(|k| *k < self.len() / count.max(1));
            let step = own.step / count.max(1) as f64;
            (step > 1.0).then_some(OwnSamples { at, step, ..*own })
        };
        Trial {
            info: self.info.clone(),
            moment_samples: self.moment_samples.as_ref().and_then(coarser),
            time: mean(&self.time),
            angle: mean(&self.angle),
            velocity: self.velocity.as_ref().map(mean),
            moment: mean(&self.moment),
            further_moments: self.further_moments.iter().map(mean).collect(),
            excitation: self.excitation.iter().map(mean).collect(),
            warnings: self.warnings.clone(),
            lines: self.lines.chunks_exact(count.max(1)).map(|part| part[0]).collect(),
        }
    }

    /// Line of a sample in the trial's file; `None` if it does not come from a file.
    pub fn line_of_sample(&self, sample: usize) -> Option<usize> {
        self.lines.get(sample).map(|line| *line as usize)
    }

    /// Checks the angle against the range of the coordinate it is prescribed to.
    ///
    /// - `is_translation`: whether the coordinate is one
    /// - `lower`, `upper`: the coordinate's range in the model [rad or m]
    ///
    /// A sample outside by more than [`ANGLE_RANGE_TOLERANCE`] makes it a warning, at the line of the first such sample; one
    /// outside by more than [`ANGLE_RANGE_WARNING`] ([`POSITION_RANGE_WARNING`] of a translation) an error.
    pub fn check_against_range(
        &self,
        coordinate: &str,
        is_translation: bool,
        [lower, upper]: [f64; 2],
    ) -> Option<Problem> {
        let excess = |angle: f64| f64::max(lower - angle, angle - upper);
        let is_outside = |angle: &f64| excess(*angle) > ANGLE_RANGE_TOLERANCE;
        let first = self.angle.iter().position(is_outside)?;
        let extreme =
            self.angle.iter().copied().fold(self.angle[first], |a, b| if excess(b) > excess(a) { b } else { a });
        let fault = Fault::AngleOutOfRange {
            coordinate: coordinate.to_owned(),
            is_translation,
            lower,
            upper,
            extreme,
            count: self.angle.iter().filter(|a| is_outside(a)).count(),
            samples: self.len(),
        };
        let allowed = if is_translation { POSITION_RANGE_WARNING } else { ANGLE_RANGE_WARNING };
        let problem = if excess(extreme) > allowed { Problem::error } else { Problem::warning };
        Some(problem(&self.info.file, self.line_of_sample(first), fault))
    }

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
        Self::settled(trial, settings, mvc_levels, problems)
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
                    let equal_steps = problems.len() == before && raw_emg::check_steps(&trial, &mut problems);
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

/// Where each quantity stands in the header.
struct Layout {
    time: usize,
    angle: usize,
    velocity: Option<usize>,
    moment: usize,
    further: Vec<usize>,
    emg: Vec<usize>,
}

fn layout(
    header: &[String],
    columns: &Columns,
    muscles: &[String],
    raw: bool,
    file: &Path,
    problems: &mut Vec<Problem>,
) -> Option<Layout> {
    let before = problems.len();
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
    let mut emg = Vec::with_capacity(muscles.len());
    for (i, (name, muscle)) in columns.emg.iter().zip(muscles).enumerate() {
        let said_before = columns.emg[..i].contains(name) && !header.contains(name);
        if !said_before {
            emg.extend(column(name, &format!("EMG of {muscle}{}", if raw { "" } else { ", 0 to 1" })));
        }
    }
    report_unknown_columns(header, columns, file, problems);
    (problems.len() == before).then_some(())?;
    Some(Layout { time: time?, angle: angle?, velocity, moment: moment?, further, emg })
}

fn report_unknown_columns(header: &[String], columns: &Columns, file: &Path, problems: &mut Vec<Problem>) {
    let mut known: Vec<&str> = vec![&columns.time, &columns.angle, &columns.velocity, &columns.moment];
    known.extend(columns.further_moments.iter().map(|f| f.column.as_str()));
    for name in &columns.emg {
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
    let raw = settings.emg != EmgSignal::Normalized;
    let named_at = format!("{}:{}", trials_file.display(), info.line);
    let (mut reader, header) = open(file, "trial file", Some(&named_at), problems)?;
    let layout = layout(&header, &settings.columns, &settings.active_muscles, raw, file, problems)?;

    let unit = settings.columns.angle_unit;
    let muscles = settings.active_muscles.len();
    let mut trial = Trial::from_samples(info.clone(), Vec::new(), Vec::new(), Vec::new(), vec![Vec::new(); muscles]);
    trial.further_moments = vec![Vec::new(); layout.further.len()];
    let mut velocity = layout.velocity.map(|_| Vec::new());
    let mut bad: Vec<BadCells> = header.iter().map(|_| BadCells::default()).collect();
    let mut ragged: Option<(usize, usize, usize)> = None;
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Ok(true) => {}
            Err(error) => {
                problems.push(csv_problem(file, &error));
                return None;
            }
        }
        if record.iter().all(str::is_empty) {
            continue; // a row of separators, as spreadsheets leave at the end
        }
        let line = record.position().map_or(0, |p| p.line() as usize);
        if record.len() != header.len() {
            let first = ragged.get_or_insert((line, record.len(), 0));
            first.2 += 1;
            continue;
        }
        if trial.len() == MAX_SAMPLES {
            problems.push(Problem::error(file, line, Fault::TooManySamples { limit: MAX_SAMPLES }));
            return None;
        }
        let mut number = |column: usize| {
            let text = &record[column];
            let value = text.parse().ok().filter(|v| is_of_a_study(*v));
            if value.is_none() {
                bad[column].note(line, text);
            }
            value.unwrap_or(0.0) // never used: a noted cell fails the whole trial below
        };
        trial.time.push(number(layout.time));
        trial.angle.push(unit.to_radians(number(layout.angle)));
        trial.moment.push(number(layout.moment));
        for (samples, column) in trial.further_moments.iter_mut().zip(&layout.further) {
            samples.push(number(*column));
        }
        if let (Some(column), Some(samples)) = (layout.velocity, velocity.as_mut()) {
            samples.push(unit.to_radians(number(column)));
        }
        for (i, (channel, column)) in trial.excitation.iter_mut().zip(&layout.emg).enumerate() {
            // A column that serves several muscles is counted as bad once.
            let again = layout.emg[..i].contains(column);
            channel.push(if again { record[*column].parse().unwrap_or(0.0) } else { number(*column) });
        }
        trial.lines.push(u32::try_from(line).unwrap_or(u32::MAX));
    }
    trial.velocity = velocity;
    let before = problems.len();
    report_bad_cells(file, &header, bad, ragged, problems);
    if problems.len() == before && trial.len() < MIN_SAMPLES {
        problems.push(Problem::error(file, None, Fault::TooFewSamples { found: trial.len(), expected: MIN_SAMPLES }));
    }
    (problems.len() == before).then_some(trial)
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

/// Reports angles and EMG that were held or interpolated to the grid of the file.
fn note_resampled(trial: &Trial, settings: &Settings, problems: &mut Vec<Problem>) {
    let (Some(last), true) = (trial.len().checked_sub(1), trial.duration() > 0.0) else { return };
    let rate_hz = last as f64 / trial.duration();
    let columns = &settings.columns;
    let mut note = |quantity: &'static str, column: &str, samples: &[f64]| {
        // An encoder of few steps jumps in a rhythm, too, where the motion is even.
        let own = own_samples(samples).filter(|own| own.how == Resampled::Interpolated || !is_stepped(samples));
        if let Some(own) = own {
            let column = column.to_owned();
            let fault =
                Fault::ColumnResampled { quantity, column, how: own.how, own_rate_hz: rate_hz / own.step, rate_hz };
            problems.push(Problem::warning(&trial.info.file, None, fault));
        }
    };
    // As the file has it: digits tell what rounding is.
    let written = |angle: &f64| match columns.angle_unit {
        AngleUnit::Degrees => angle.to_degrees(),
        AngleUnit::Radians => *angle,
    };
    note("angle", &columns.angle, &trial.angle.iter().map(written).collect::<Vec<f64>>());
    let quantity = if matches!(settings.emg, EmgSignal::Raw(_)) { "raw EMG" } else { "EMG" };
    for (i, (column, samples)) in columns.emg.iter().zip(&trial.excitation).enumerate() {
        if !columns.emg[..i].contains(column) {
            note(quantity, column, samples);
        }
    }
}

/// Whether all changes of a signal are few multiples of one step.
fn is_stepped(x: &[f64]) -> bool {
    const MOST: f64 = 3.5;
    let changes = || x.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|change| *change > 0.0);
    // Rounding of sums leaves changes that are none.
    let largest = changes().fold(0.0, f64::max);
    let least = changes().filter(|change| *change > 1e-9 * largest).fold(f64::INFINITY, f64::min);
    let is_multiple = |change: f64| {
        let times = change / least;
        times < MOST && (times - times.round()).abs() < 1e-6
    };
    changes().filter(|change| *change > 1e-9 * largest).all(is_multiple)
}

/// Reports the first of each kind of flaw in the time column.
fn check_time(trial: &Trial, max_gap: Option<f64>, problems: &mut Vec<Problem>) {
    let file = &trial.info.file;
    let steps: Vec<f64> = trial.time.windows(2).map(|w| w[1] - w[0]).collect();
    let at = |step: usize| trial.line_of_sample(step + 1);
    let flaws = |is_flaw: &dyn Fn(f64) -> bool| {
        let mut found = steps.iter().enumerate().filter(|(_, step)| is_flaw(**step)).map(|(i, _)| i);
        found.next().map(|first| (first, found.count()))
    };
    if let Some((first, more)) = flaws(&|step| step < 0.0) {
        let fault = Fault::TimeNotIncreasing { time_s: trial.time[first + 1], before_s: trial.time[first], more };
        problems.push(Problem::error(file, at(first), fault));
    }
    if let Some((first, more)) = flaws(&|step| step == 0.0) {
        let fault = Fault::TimeRepeated { time_s: trial.time[first + 1], more };
        problems.push(Problem::error(file, at(first), fault));
    }
    let median = median(&steps);
    let fault = implausible_time(&trial.time, median);
    if fault.is_some() {
        problems.extend(fault.map(|fault| Problem::error(file, None, fault)));
        return;
    }
    let allowed = max_gap.unwrap_or(GAP_IN_MEDIAN_STEPS * median);
    if median <= 0.0 {
        return; // already reported: time does not increase
    }
    if let Some((first, more)) = flaws(&|step| step > allowed) {
        let fault = Fault::Gap { gap_s: steps[first], allowed_s: allowed, median_step_s: median, more };
        problems.push(Problem::error(file, at(first), fault));
    }
}

/// What is wrong with times of which the unit cannot be seconds. The work that a trial makes grows with its duration;
/// after this check it grows
/// with the number of its samples.
///
/// - `median_step_s`: median step \[s\]
pub(crate) fn implausible_time(time: &[f64], median_step_s: f64) -> Option<Fault> {
    let (first, last) = (*time.first()?, *time.last()?);
    let duration_s = last - first;
    let mean_step_s = duration_s / (time.len().max(2) - 1) as f64;
    let plausible = (SHORTEST_STEP..=LONGEST_STEP).contains(&median_step_s)
        && mean_step_s <= LONGEST_STEP
        && duration_s <= LONGEST_TRIAL;
    (!plausible).then_some(Fault::ImplausibleTime { median_step_s, duration_s })
}

/// Median; the upper one of two middle values.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Reports excitations outside 0..1, once per column, and clamps those that are noise.
fn check_excitation(trial: &mut Trial, settings: &Settings, problems: &mut Vec<Problem>) {
    let lines = &trial.lines;
    for (i, samples) in trial.excitation.iter_mut().enumerate() {
        let column = &settings.columns.emg[i];
        if !settings.columns.emg[..i].contains(column) {
            for above in [true, false] {
                if let Some((first, fault)) = outside(samples, column, above) {
                    let line = lines.get(first).map(|line| *line as usize);
                    let clamped = matches!(fault, Fault::EmgOutOfRange { clamped: true, .. });
                    let problem = if clamped { Problem::warning } else { Problem::error };
                    problems.push(problem(&trial.info.file, line, fault));
                }
            }
        }
        samples.iter_mut().for_each(|e| *e = e.clamp(0.0, 1.0));
    }
}

fn outside(samples: &[f64], column: &str, above: bool) -> Option<(usize, Fault)> {
    let is_outside = |e: &f64| if above { *e > 1.0 } else { *e < 0.0 };
    let first = samples.iter().position(is_outside)?;
    let pick = if above { f64::max } else { f64::min };
    let extreme = samples.iter().copied().fold(samples[first], pick);
    let fault = Fault::EmgOutOfRange {
        column: column.to_owned(),
        above,
        count: samples.iter().filter(|e| is_outside(e)).count(),
        samples: samples.len(),
        extreme,
        clamped: if above { extreme <= EMG_NOISE_ABOVE } else { extreme >= EMG_NOISE_BELOW },
    };
    Some((first, fault))
}
