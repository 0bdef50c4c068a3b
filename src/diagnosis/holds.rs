//! Where the joint is held still: the recorded angle there is the sensor's noise, which as a speed would be taken for
//! movement by friction and everything else that depends on its direction.

use super::angle_noise::AngleNoise;
use crate::study::Trial;

/// A hold lasts at least this long [s].
const SHORTEST: f64 = 0.3;
/// Nearer to a movement than this a hold is left as recorded [s]: movements start slowly.
const MARGIN: f64 = 0.15;
/// Time in which the recorded angle takes over from a hold's [s].
const TAPER: f64 = 0.2;
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
    let mut start = 0;
    while start < n {
        // The longest stretch from here on within the width.
        let (mut low, mut high, mut end) = (angle[start], angle[start], start + 1);
        while end < n {
            let (l, h) = (low.min(angle[end]), high.max(angle[end]));
            if h - l > width {
                break;
            }
            (low, high, end) = (l, h, end + 1);
        }
        let first = if start == 0 { 0 } else { time.partition_point(|t| *t < time[start] + MARGIN) };
        let last = if end == n { n } else { time.partition_point(|t| *t < time[end - 1] - MARGIN) };
        if last > first + 2 && time[last - 1] - time[first] >= SHORTEST {
            hold(time, angle, first..last, &mut out);
            start = end;
        } else {
            start += 1;
        }
    }
    out
}

fn hold(time: &[f64], angle: &[f64], range: std::ops::Range<usize>, out: &mut [f64]) {
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
            if (1.4..=2.1).contains(t) {
                assert_eq!(*q, truth(*t) + noise(*t), "{t}");
            }
        }
    }
}
