//! Noise of the recorded angle, and what it does to forces that depend on speed or angle.
//!
//! Where the machine holds the joint the recorded angle shows its own noise: its size, and how it goes with itself in
//! time. A force on the joint is a function f of the true motion, of which the recorded one is all that is known:
//!
//! ```text
//! E[f | recorded] ≈ mean over draws of f(q + δq, q̇ + δq̇, q̈ + δq̈),   Cov[f | recorded] ≈ that of the draws, tapered
//! ```
//! (regression calibration). Without it, friction at slow speeds is underestimated and the onset of every movement
//! rejects it.
//!
//! # References
//! Carroll, Ruppert, Stefanski & Crainiceanu (2006), Measurement error in nonlinear models, chapter 4,
//! doi:10.1201/9781420010138. Gaspari & Cohn (1999), Construction of correlation functions in two and three dimensions
//! (tapering), doi:10.1002/qj.49712555417.

use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::random::normal;
use carpus_study::study::{Contraction, Trial, TrialUse};

/// A contraction in which the angle stays within this range is held as a whole [rad]: 3°.
pub(super) const HELD_RANGE: f64 = 0.052;
/// Samples are held if they are the same for at least this long [s]; for a shorter time an encoder of coarse steps may
/// be between two.
const HELD_TIME: f64 = 0.25;
/// Trials whose sample intervals differ by more than this share are not looked at together.
const SAME_RATE: f64 = 0.1;
/// Draws come in pairs of opposite sign.
pub(super) const PAIRS: usize = 8;
/// Covariances of draws are trusted up to so many correlation lengths.
const TAPER: f64 = 2.5;
/// Time in which noise comes back after a hold [s].
const RETURN: f64 = 0.04;

/// Noise of a recorded angle: a Gaussian process with correlation exp(-(Δt/length)²/2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngleNoise {
    /// Standard deviation [rad].
    pub sd: f64,
    /// Correlation length [s].
    pub length: f64,
}

/// A draw of the noise over a trial's samples.
#[derive(Clone, Debug)]
pub struct Disturbance {
    /// Of the angle [rad].
    pub angle: Vec<f64>,
    /// Of the speed [rad/s].
    pub speed: Vec<f64>,
    /// Of the acceleration [rad/s²].
    pub acceleration: Vec<f64>,
}

impl AngleNoise {
    /// From the contractions in which the joint hardly moves, without those that are held out; `None` without such
    /// trials.
    pub fn of(trials: &[Trial]) -> Option<AngleNoise> {
        let still = |t: &&Trial| range(&t.angle) < HELD_RANGE && t.angle.len() > 2 && t.info.usage != TrialUse::Test;
        // A relaxed joint may be swept over a degree or two.
        let is_contraction = |t: &&Trial| matches!(t.info.contraction, Contraction::Isometric | Contraction::Mvc);
        let held: Vec<&Trial> = trials.iter().filter(still).filter(is_contraction).collect();
        let (mut squares, mut count) = (0.0, 0usize);
        for trial in &held {
            let mean = trial.angle.iter().sum::<f64>() / trial.angle.len() as f64;
            squares += trial.angle.iter().map(|a| (a - mean).powi(2)).sum::<f64>();
            count += trial.angle.len();
        }
        let sd = (squares / count.max(1) as f64).sqrt();
        (count > 0 && sd > 0.0).then(|| AngleNoise { sd, length: correlation_length(&held, sd * sd) })
    }

    /// Draws of the noise of one trial: none where the angle is held.
    ///
    /// - `angle`: with holds that are held exactly
    pub fn draws(&self, time: &[f64], angle: &[f64], seed: u64) -> Vec<Disturbance> {
        let step = (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64;
        // Noise that stays the same throughout a trial has no speed, whatever its length.
        let width = (self.length / std::f64::consts::SQRT_2 / step).clamp(0.5, time.len().max(1) as f64);
        let reach = (4.0 * width).ceil() as usize;
        let at = |i: usize| (i as f64 - reach as f64) / width;
        let mut kernel: Vec<f64> = (0..=2 * reach).map(|i| (-0.5 * at(i).powi(2)).exp()).collect();
        let norm = self.sd / kernel.iter().map(|k| k * k).sum::<f64>().sqrt();
        kernel.iter_mut().for_each(|k| *k *= norm);
        let unit = width * step;
        let slope: Vec<f64> = (0..=2 * reach).map(|i| -at(i) * kernel[i] / unit).collect();
        let bend: Vec<f64> = (0..=2 * reach).map(|i| (at(i).powi(2) - 1.0) * kernel[i] / (unit * unit)).collect();
        let weight = moving(time, angle);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut out = Vec::with_capacity(2 * PAIRS);
        for _ in 0..PAIRS {
            let white: Vec<f64> = (0..time.len() + 2 * reach).map(|_| normal(&mut rng)).collect();
            // y(t) = Σ k(t - s) white(s): the kernel is even, its slope odd.
            let with = |kernel: &[f64], sign: f64| -> Vec<f64> {
                let value = |k: usize| kernel.iter().rev().zip(&white[k..]).map(|(a, b)| a * b).sum::<f64>();
                (0..time.len()).map(|k| sign * weight[k] * value(k)).collect()
            };
            for sign in [1.0, -1.0] {
                out.push(Disturbance {
                    angle: with(&kernel, sign),
                    speed: with(&slope, sign),
                    acceleration: with(&bend, sign),
                });
            }
        }
        out
    }

    /// Covariance of what draws cause, per block of samples.
    ///
    /// - `draws`: per draw, block means; `times`: of the blocks [s]
    pub fn covariance(&self, draws: &[Vec<f64>], times: &[f64]) -> DMatrix<f64> {
        let count = draws.len() as f64;
        let mean = |b: usize| draws.iter().map(|d| d[b]).sum::<f64>() / count;
        let means: Vec<f64> = (0..times.len()).map(mean).collect();
        let reach = TAPER * self.length;
        DMatrix::from_fn(times.len(), times.len(), |i, j| {
            let taper = (-0.5 * ((times[i] - times[j]) / reach).powi(2)).exp();
            let products = draws.iter().map(|d| (d[i] - means[i]) * (d[j] - means[j]));
            taper * products.sum::<f64>() / (count - 1.0)
        })
    }
}

/// Correlation length of a Gaussian correlation that has the autocorrelation of held angles at its half.
fn correlation_length(held: &[&Trial], variance: f64) -> f64 {
    let step_of = |t: &Trial| t.duration() / (t.len() - 1) as f64;
    let step = held.first().map_or(0.01, |t| step_of(t));
    let held: Vec<&Trial> = held.iter().copied().filter(|t| (step_of(t) / step - 1.0).abs() < SAME_RATE).collect();
    let longest = held.iter().map(|t| t.angle.len() / 2).min().unwrap_or(1).max(1);
    let correlation = |lag: usize| {
        let (mut sum, mut count) = (0.0, 0usize);
        for trial in &held {
            let mean = trial.angle.iter().sum::<f64>() / trial.angle.len() as f64;
            let pairs = trial.angle.iter().zip(&trial.angle[lag..]);
            sum += pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
            count += trial.angle.len() - lag;
        }
        sum / (count.max(1) as f64 * variance)
    };
    let mut before = 1.0;
    for lag in 1..=longest {
        let now = correlation(lag);
        if now < 0.5 {
            let part = (before - 0.5) / (before - now);
            return step * (lag as f64 - 1.0 + part) / (2.0 * 2.0_f64.ln()).sqrt();
        }
        before = now;
    }
    step * longest as f64
}

/// 0 where the angle is held, 1 where it moves, and between.
pub(super) fn moving(time: &[f64], angle: &[f64]) -> Vec<f64> {
    let n = angle.len();
    let mut held = vec![false; n];
    let mut first = 0;
    for k in 1..=n {
        if k == n || angle[k] != angle[first] {
            held[first..k].fill(time[k - 1] - time[first] >= HELD_TIME);
            first = k;
        }
    }
    let mut distance = vec![f64::INFINITY; n];
    let mut last = f64::NEG_INFINITY;
    for k in 0..n {
        if held[k] {
            last = time[k];
        }
        distance[k] = time[k] - last;
    }
    let mut next = f64::INFINITY;
    for k in (0..n).rev() {
        if held[k] {
            next = time[k];
        }
        distance[k] = distance[k].min(next - time[k]);
    }
    distance.iter().map(|d| 0.5 * (1.0 - (std::f64::consts::PI * (d / RETURN).min(1.0)).cos())).collect()
}

pub(super) fn range(angle: &[f64]) -> f64 {
    let high = angle.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    high - angle.iter().copied().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_draws_have_the_size_and_length_asked_for() {
        let time: Vec<f64> = (0..4000).map(|k| 0.01 * f64::from(k)).collect();
        let noise = AngleNoise { sd: 0.004, length: 0.2 };
        let angle: Vec<f64> = time.clone();
        let draws = noise.draws(&time, &angle, 3);
        let rms = |pick: fn(&Disturbance) -> &Vec<f64>| {
            let squares: f64 = draws.iter().flat_map(pick).map(|v| v * v).sum();
            (squares / (draws.len() * time.len()) as f64).sqrt()
        };
        let speed = noise.sd / noise.length;
        assert!((rms(|d| &d.angle) / noise.sd - 1.0).abs() < 0.03);
        assert!((rms(|d| &d.speed) / speed - 1.0).abs() < 0.03);
        // The speed is the angle's.
        let d = &draws[0];
        for k in 1..time.len() - 1 {
            let difference = (d.angle[k + 1] - d.angle[k - 1]) / 0.02;
            assert!((difference - d.speed[k]).abs() < 0.02 * speed, "{difference} {}", d.speed[k]);
            let difference = (d.speed[k + 1] - d.speed[k - 1]) / 0.02;
            assert!((difference - d.acceleration[k]).abs() < 0.03 * speed / noise.length);
        }
        let held = |lag: usize| {
            let products: f64 = d.angle.iter().zip(&d.angle[lag..]).map(|(a, b)| a * b).sum();
            products / (time.len() - lag) as f64
        };
        assert!((held(20) / held(0) - (-0.5_f64).exp()).abs() < 0.1);
    }

    #[test]
    fn verif_no_noise_where_the_angle_is_held() {
        let time: Vec<f64> = (0..300).map(|k| 0.01 * f64::from(k)).collect();
        let angle: Vec<f64> = time.iter().map(|t| (t - 1.0).max(0.0)).collect();
        let draws = AngleNoise { sd: 0.004, length: 0.2 }.draws(&time, &angle, 3);
        assert!(draws[0].speed[..90].iter().all(|v| *v == 0.0));
        assert!(draws[0].speed[150..].iter().any(|v| v.abs() > 0.01));
    }
}
