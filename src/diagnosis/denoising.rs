//! White noise of the recorded angle, as of an encoder's steps, taken out: differentiated once it drowns what depends on speed, twice
//! what depends on acceleration.
//!
//! The angle is smoothed by local cubic regression with Gaussian weights, all trials over the same time: the one of least
//! expected error (Mallows' Cp at the noise's known variance). What noise is left is then smooth, and judged as such (see
//! [`super::angle_noise`]). An angle without noticeable white noise stays as it is, to the last bit.
//!
//! # References
//! Mallows (1973), Some comments on Cp, doi:10.1080/00401706.1973.10489103.
//! Fan & Gijbels (1996), Local Polynomial Modelling and Its Applications, chapter 3.
//! Gasser, Sroka & Jennen-Steinmetz (1986), Residual variance and residual pattern in nonlinear regression (the variance from
//! differences), doi:10.1093/biomet/73.3.625.

use std::borrow::Cow;

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use super::angle_noise::{HELD_RANGE, range};
use crate::study::{Trial, TrialUse};

/// White noise that is not worth smoothing [rad]: 0.004°, somewhat more than recordings rounded to 0.01° have.
const NOTICEABLE: f64 = 7e-5;
/// Of the differences the smallest are looked at, this share: the larger ones are onsets of movements.
const SHARE: f64 = 0.8;
/// Mean square of this share of the smallest of normal numbers, over that of all.
const OF_SHARE: f64 = 0.437;
/// Fifth differences of white noise have 252 times its variance.
const DIFFERENCES: [f64; 6] = [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0];
/// Weights are cut off at so many widths.
const REACH: f64 = 3.0;
/// Widths that are tried, in sample intervals.
const WIDTHS: [f64; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];

/// Trials whose angles are without white noise.
///
/// What there is of it is learnt from trials that are not held out.
pub fn denoised(trials: &[Trial]) -> Cow<'_, [Trial]> {
    let seen = || trials.iter().filter(|t| t.info.usage != TrialUse::Test);
    let moving: Vec<&Trial> = seen().filter(|t| range(&t.angle) >= HELD_RANGE).collect();
    let Some(noise) = white_noise(&moving).filter(|noise| *noise > NOTICEABLE) else {
        return Cow::Borrowed(trials);
    };
    let width = best_width(&moving, noise);
    let smooth = |trial: &Trial| {
        let mut trial = trial.clone();
        trial.angle = smoothed(&trial.time, &trial.angle, width).0;
        trial
    };
    Cow::Owned(trials.par_iter().map(smooth).collect())
}

/// Standard deviation of the white noise of angles [rad]; `None` without enough samples.
fn white_noise(trials: &[&Trial]) -> Option<f64> {
    let difference = |w: &[f64]| w.iter().zip(DIFFERENCES).map(|(q, c)| q * c).sum::<f64>().powi(2);
    // Where an encoder shows the same for a while it says nothing of its steps.
    let changes = |w: &&[f64]| w.iter().any(|q| *q != w[0]);
    let windows = trials.iter().flat_map(|t| t.angle.windows(DIFFERENCES.len()).filter(changes));
    let mut squares: Vec<f64> = windows.map(difference).collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate((SHARE * squares.len() as f64) as usize);
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    let of_white: f64 = DIFFERENCES.iter().map(|c| c * c).sum();
    (!squares.is_empty()).then(|| (mean / (OF_SHARE * of_white)).sqrt())
}

/// Width of the weights [s] with which the expected error of the angles is least.
fn best_width(trials: &[&Trial], noise: f64) -> f64 {
    let mut steps: Vec<f64> = trials.iter().map(|t| t.duration() / (t.len() - 1) as f64).collect();
    steps.sort_by(f64::total_cmp);
    let step = steps[steps.len() / 2];
    let risk = |width: f64| -> f64 {
        let of_trial = |t: &&Trial| {
            let (smooth, trace) = smoothed(&t.time, &t.angle, width);
            let left: f64 = t.angle.iter().zip(&smooth).map(|(q, s)| (q - s).powi(2)).sum();
            left + 2.0 * noise * noise * trace
        };
        trials.par_iter().map(of_trial).collect::<Vec<_>>().iter().sum()
    };
    let risks: Vec<f64> = WIDTHS.iter().map(|w| risk(w * step)).collect();
    let least = (0..WIDTHS.len()).min_by(|i, j| risks[*i].total_cmp(&risks[*j])).unwrap_or(0);
    WIDTHS[least] * step
}

/// A series smoothed by local cubic regression, and the trace of the matrix that does so.
fn smoothed(time: &[f64], series: &[f64], width: f64) -> (Vec<f64>, f64) {
    let (mut first, mut end, mut trace) = (0, 0, 0.0);
    let mut out = Vec::with_capacity(series.len());
    for (k, now) in time.iter().enumerate() {
        while time[first] < now - REACH * width {
            first += 1;
        }
        while end < time.len() && time[end] <= now + REACH * width {
            end += 1;
        }
        let (mut products, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for j in first..end {
            let u = (time[j] - now) / width;
            let powers = Vector4::new(1.0, u, u * u, u * u * u);
            let weight = (-0.5 * u * u).exp();
            products += weight * powers * powers.transpose();
            right += weight * series[j] * powers;
        }
        // With fewer than four samples within reach it stays as it is.
        match (end - first >= 4).then(|| products.cholesky()).flatten() {
            Some(solver) => {
                out.push(solver.solve(&right)[0]);
                trace += solver.solve(&Vector4::x())[0];
            }
            None => {
                out.push(series[k]);
                trace += 1.0;
            }
        }
    }
    (out, trace)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::diagnosis::score_test::normal;
    use crate::study::{Contraction, Direction, TrialInfo};

    fn info() -> TrialInfo {
        TrialInfo::example(Contraction::Passive, Direction::None, TrialUse::Train)
    }

    /// A fast sweep there and back, and its speed.
    fn sweep(t: f64) -> (f64, f64) {
        let part = |t: f64| {
            let x = (t / 0.8).clamp(0.0, 1.0);
            (x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x).powi(2) / 0.8)
        };
        let (there, back) = (part(t - 0.2), part(t - 1.2));
        (2.4 * (there.0 - back.0) - 1.2, 2.4 * (there.1 - back.1))
    }

    fn trials(noise: impl Fn(&mut ChaCha8Rng, f64) -> f64, rate: f64) -> Vec<Trial> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let time: Vec<f64> = (0..(4.0 * rate) as usize).map(|k| k as f64 / rate).collect();
        let one = |rng: &mut ChaCha8Rng| {
            let angle = time.iter().map(|t| noise(rng, sweep(*t).0)).collect();
            let zero = vec![0.0; time.len()];
            Trial::from_samples(info(), time.clone(), angle, zero, Vec::new())
        };
        (0..4).map(|_| one(&mut rng)).collect()
    }

    fn speed_error(trials: &[Trial]) -> f64 {
        let of_trial = |t: &Trial| {
            let pairs = t.angle.windows(3).zip(t.time.windows(3));
            pairs.map(|(q, t)| ((q[2] - q[0]) / (t[2] - t[0]) - sweep(t[1]).1).powi(2)).sum::<f64>()
        };
        let count: usize = trials.iter().map(|t| t.len() - 2).sum();
        (trials.iter().map(of_trial).sum::<f64>() / count as f64).sqrt()
    }

    #[test]
    fn verif_white_noise_is_found_and_the_speed_comes_back() {
        for sd in [0.002, 0.005] {
            let noisy = trials(|rng, q| q + sd * normal(rng), 100.0);
            let found = white_noise(&noisy.iter().collect::<Vec<_>>()).unwrap();
            assert!((found / sd - 1.0).abs() < 0.1, "{found} {sd}");
            let (before, after) = (speed_error(&noisy), speed_error(&denoised(&noisy)));
            assert!(after < 0.35 * before, "{after} {before}");
        }
    }

    #[test]
    fn verif_an_encoders_steps_are_smoothed() {
        let step = 0.1_f64.to_radians();
        let noisy = trials(|_, q| (q / step).round() * step, 100.0);
        let (before, after) = (speed_error(&noisy), speed_error(&denoised(&noisy)));
        assert!(after < 0.5 * before, "{after} {before}");
    }

    #[test]
    fn verif_angles_without_white_noise_stay_as_they_are() {
        let step = 0.01_f64.to_radians();
        for clean in [trials(|_, q| q, 100.0), trials(|_, q| q, 50.0), trials(|_, q| (q / step).round() * step, 50.0)] {
            assert!(matches!(denoised(&clean), Cow::Borrowed(_)));
        }
    }
}
