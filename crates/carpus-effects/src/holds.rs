//! Where the joint is held still: the recorded angle there is the sensor's noise, which as a speed would be taken for
//! movement by friction and everything else that depends on its direction.

use std::collections::VecDeque;
use std::ops::Range;

use super::angle_noise::AngleNoise;
use carpus_study::study::Trial;

/// A hold lasts at least this long [s].
const SHORTEST: f64 = 0.3;
/// Nearer to a movement than this a hold is left as recorded [s]: movements start slowly.
const MARGIN: f64 = 0.2;
/// Time in which the recorded angle takes over from a hold's [s]: faster, the difference would be a speed.
const TAPER: f64 = 0.5;
/// The angle is still while it stays within so many standard deviations of its noise to both sides.
const STILL: f64 = 3.5;

/// Trials whose angle is still where the joint is held.
pub fn steadied_trials(trials: &[Trial], noise: &AngleNoise) -> Vec<Trial> {
    let mut trials = trials.to_vec();
    trials.iter_mut().for_each(|t| t.angle = steadied(&t.time, &t.angle, noise.sd));
    trials
}

/// The angle with its holds held.
///
/// - `noise`: its standard deviation [rad]
pub fn steadied(time: &[f64], angle: &[f64], noise: f64) -> Vec<f64> {
    let mut out = angle.to_vec();
    let width = 2.0 * STILL * noise;
    let n = angle.len();
    // The longest hold first: found from one end, a hold would begin in the last of a movement and end too soon.
    let mut parts: Vec<Range<usize>> = std::iter::once(0..n).collect();
    while let Some(part) = parts.pop() {
        let found = longest_within(&angle[part.clone()], width);
        let (start, end) = (part.start + found.start, part.start + found.end);
        let first = if start == 0 { 0 } else { time.partition_point(|t| *t < time[start] + MARGIN) };
        let last = if end == n { n } else { time.partition_point(|t| *t < time[end - 1] - MARGIN) };
        if last > first + 2 && time[last - 1] - time[first] >= SHORTEST {
            hold(time, angle, first..last, &mut out);
            parts.extend([part.start..start, end..part.end].into_iter().filter(|p| p.len() > 2));
        }
    }
    out
}

/// The longest stretch in which a series stays within a width.
fn longest_within(series: &[f64], width: f64) -> Range<usize> {
    // Positions of falling highs and of rising lows from `start` on.
    let (mut highs, mut lows): (VecDeque<usize>, VecDeque<usize>) = Default::default();
    let (mut start, mut best) = (0, 0..0);
    for (k, value) in series.iter().enumerate() {
        while highs.back().is_some_and(|i| series[*i] <= *value) {
            highs.pop_back();
        }
        while lows.back().is_some_and(|i| series[*i] >= *value) {
            lows.pop_back();
        }
        highs.push_back(k);
        lows.push_back(k);
        while series[highs[0]] - series[lows[0]] > width {
            start += 1;
            highs.pop_front_if(|i| *i < start);
            lows.pop_front_if(|i| *i < start);
        }
        if k + 1 - start > best.len() {
            best = start..k + 1;
        }
    }
    best
}

fn hold(time: &[f64], angle: &[f64], range: Range<usize>, out: &mut [f64]) {
    let level = angle[range.clone()].iter().sum::<f64>() / range.len() as f64;
    out[range.clone()].fill(level);
    let (first, last) = (range.start, range.end - 1);
    let left = |distance: f64| 0.5 * (1.0 + (std::f64::consts::PI * (distance / TAPER).min(1.0)).cos());
    for k in (0..first).rev().take_while(|k| time[first] - time[*k] < TAPER) {
        out[k] -= (angle[first] - level) * left(time[first] - time[k]);
    }
    for k in (last + 1..time.len()).take_while(|k| time[*k] - time[last] < TAPER) {
        out[k] -= (angle[last] - level) * left(time[k] - time[last]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_longest_stretch_is_that_of_trying_all() {
        let series: Vec<f64> =
            (0..60).map(|k| (0.7 * f64::from(k)).sin() + (0.05 * f64::from(k)).cos() * 2.0).collect();
        for width in [0.1, 1.0, 2.3, 10.0] {
            let within = |a: usize, b: usize| {
                let part = &series[a..b];
                part.iter().copied().fold(f64::MIN, f64::max) - part.iter().copied().fold(f64::MAX, f64::min) <= width
            };
            let all = (0..60).flat_map(|a| (a + 1..=60).map(move |b| (a, b)));
            let longest = all.filter(|(a, b)| within(*a, *b)).map(|(a, b)| b - a).max().unwrap();
            let found = longest_within(&series, width);
            assert!(within(found.start, found.end));
            assert_eq!(found.len(), longest, "{width}");
        }
    }

    #[test]
    fn verif_holds_are_still_and_movements_stay() {
        let time: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k)).collect();
        let truth = |t: f64| {
            let x = ((t - 1.0) / 1.5).clamp(0.0, 1.0);
            x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        };
        let noise = |t: f64| 0.003 * ((9.0 * t).sin() + (23.0 * t).cos());
        let recorded: Vec<f64> = time.iter().map(|t| truth(*t) + noise(*t)).collect();
        let out = steadied(&time, &recorded, 0.003);
        for (t, q) in time.iter().zip(&out) {
            let near = (truth(*t) - q).abs();
            assert!(near < 0.012, "{t}: {near}");
            if !(0.7..=3.3).contains(t) {
                assert_eq!(*q, out[if *t < 1.0 { 0 } else { 399 }], "{t}");
            }
            if (1.5..=2.0).contains(t) {
                assert_eq!(*q, truth(*t) + noise(*t), "{t}");
            }
        }
    }
}
