//! Repetitions within a long recording.

use std::ops::Range;

/// What rises in a repetition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RepetitionSignal {
    /// The moment: efforts at a held angle.
    Moment,
    /// The speed: movements between pauses or turning points; each direction is a repetition of its own.
    Movement,
}

/// How repetitions are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepetitionSettings {
    /// What rises.
    pub signal: RepetitionSignal,
    /// Share of the largest value above which a repetition runs.
    pub threshold: f64,
    /// Shortest repetition \[s\].
    pub min_duration: f64,
    /// Pauses shorter than this do not end a repetition \[s\].
    pub max_pause: f64,
    /// Recording kept before and after \[s\]; neighbours share what lies between them.
    pub margin: f64,
}

/// Ranges of samples, one per repetition, in order.
///
/// The signal (moment about its median, or velocity) has to exceed `threshold` times its largest value; stretches of
/// one direction with pauses up to `max_pause` are one repetition.
///
/// - `time`: \[s\], increasing
/// - `signal`: moment [N·m], or velocity [rad/s], as `settings.signal` says
pub fn find_repetitions(time: &[f64], signal: &[f64], settings: &RepetitionSettings) -> Vec<Range<usize>> {
    let n = time.len().min(signal.len());
    let rest = match settings.signal {
        RepetitionSignal::Moment => resting_level(&signal[..n]),
        RepetitionSignal::Movement => 0.0,
    };
    let largest = signal[..n].iter().fold(0.0f64, |m, v| m.max((v - rest).abs()));
    if !(largest > 0.0) {
        return Vec::new();
    }
    let direction = |v: f64| if (v - rest).abs() > settings.threshold * largest { (v - rest).signum() } else { 0.0 };
    let mut found: Vec<(Range<usize>, f64)> = Vec::new();
    let mut start = 0;
    for stretch in signal[..n].chunk_by(|a, b| direction(*a) == direction(*b)) {
        let (range, sign) = (start..start + stretch.len(), direction(stretch[0]));
        start = range.end;
        if sign == 0.0 {
            continue;
        }
        match found.last_mut() {
            Some((before, of)) if *of == sign && time[range.start] - time[before.end - 1] <= settings.max_pause => {
                before.end = range.end;
            }
            _ => found.push((range, sign)),
        }
    }
    found.retain(|(range, _)| time[range.end - 1] - time[range.start] >= settings.min_duration);
    let mut widened: Vec<Range<usize>> = Vec::with_capacity(found.len());
    for (i, (range, _)) in found.iter().enumerate() {
        // Half way to the neighbours at most, so that no sample belongs to two repetitions.
        let least = if i == 0 { 0 } else { (found[i - 1].0.end + range.start).div_ceil(2) };
        let most = found.get(i + 1).map_or(n, |(next, _)| (range.end + next.start).div_ceil(2));
        let first = time.partition_point(|t| *t < time[range.start] - settings.margin).max(least);
        let last = time.partition_point(|t| *t <= time[range.end - 1] + settings.margin).min(most);
        widened.push(first..last);
    }
    widened
}

/// The level that the signal rests at: the centre of the narrowest interval that holds a quarter of its samples.
fn resting_level(signal: &[f64]) -> f64 {
    let mut sorted = signal.to_vec();
    sorted.sort_by(f64::total_cmp);
    let quarter = sorted.len() / 4;
    let narrowest = (0..sorted.len() - quarter)
        .min_by(|a, b| (sorted[a + quarter] - sorted[*a]).total_cmp(&(sorted[b + quarter] - sorted[*b])));
    narrowest.map_or(0.0, |i| 0.5 * (sorted[i] + sorted[i + quarter]))
}
