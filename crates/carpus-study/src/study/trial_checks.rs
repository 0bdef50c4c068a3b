//! Checks of the samples of a trial.

use super::columns::AngleUnit;
use super::fault::Fault;
use super::limits::{EMG_NOISE_ABOVE, EMG_NOISE_BELOW, GAP_IN_MEDIAN_STEPS, MAX_SAMPLES, MIN_SAMPLES};
use super::problem::Problem;
use super::raw_emg::{EmgSignal, emg_rate_hz};
use super::settings::Settings;
use super::table::is_of_a_study;
use super::times::{implausible_time, median};
use super::trial::Trial;
use carpus_numerics::signals::{Resampled, own_samples};

/// What is wrong with arrays that no row of a file can have wrong.
///
/// - `muscles`: how many are active
pub(super) fn check_arrays(trial: &Trial, muscles: usize, problems: &mut Vec<Problem>) {
    let (file, n) = (&trial.info.file, trial.time.len());
    let mut error = |fault: Fault| problems.push(Problem::error(file, None, fault));
    if trial.excitation.len() != muscles {
        let (key, found) = ("excitation".to_owned(), trial.excitation.len().to_string());
        error(Fault::BadValue { key, expected: format!("{muscles} arrays, one for each active muscle"), found });
    }
    let further = trial.further_moments.iter().map(|x| ("further moment", x));
    let excitation = trial.excitation.iter().map(|x| ("excitation", x));
    let own = [("time", &trial.time), ("angle", &trial.angle), ("moment", &trial.moment)];
    let velocity = trial.velocity.iter().map(|x| ("velocity", x));
    for (name, x) in own.into_iter().chain(velocity).chain(further).chain(excitation) {
        if x.len() != n {
            let (key, found) = (name.to_owned(), x.len().to_string());
            error(Fault::BadValue { key, expected: format!("{n} values, one for each time"), found });
        }
        if let Some(first) = x.iter().find(|v| !is_of_a_study(**v)) {
            let more = x.iter().filter(|v| !is_of_a_study(**v)).count() - 1;
            let expected = "a finite number of at most 1e12 in size";
            error(Fault::BadNumber { column: name.to_owned(), expected, found: first.to_string(), more });
        }
    }
    if n < MIN_SAMPLES {
        error(Fault::TooFewSamples { found: n, expected: MIN_SAMPLES });
    }
    if n > MAX_SAMPLES {
        error(Fault::TooManySamples { limit: MAX_SAMPLES });
    }
}

/// Reports angles and EMG that were held or interpolated to the grid of the file.
pub(super) fn note_resampled(trial: &Trial, settings: &Settings, problems: &mut Vec<Problem>) {
    let (Some(last), true) = (trial.len().checked_sub(1), trial.duration() > 0.0) else { return };
    let rate_hz = last as f64 / trial.duration();
    let columns = &settings.columns;
    let mut note = |quantity: &'static str, column: &str, samples: &[f64], rate_hz: f64| {
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
    note("angle", &columns.angle, &trial.angle.iter().map(written).collect::<Vec<f64>>(), rate_hz);
    let quantity = if matches!(settings.emg, EmgSignal::Raw(_)) { "raw EMG" } else { "EMG" };
    for (i, (column, samples)) in columns.emg.iter().zip(&trial.excitation).enumerate() {
        if !columns.emg[..i].contains(column) {
            note(quantity, column, samples, emg_rate_hz(trial));
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
pub(super) fn check_time(trial: &Trial, max_gap: Option<f64>, problems: &mut Vec<Problem>) {
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

/// Reports excitations outside 0..1, once per column, and clamps those that are noise.
pub(super) fn check_excitation(trial: &mut Trial, settings: &Settings, problems: &mut Vec<Problem>) {
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
