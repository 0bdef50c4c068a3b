//! White noise of the recorded angle, as of an encoder's steps, taken out: differentiated once it drowns what depends
//! on speed, twice what depends on acceleration.
//!
//! A movement in a machine is rest and constant speed most of the time, and for short whiles anything but. So the angle
//! is taken for a twice integrated acceleration whose increments are rare and large (Student's t), recorded with white
//! noise of a known variance: a Kalman smoother, the variance of every increment by expectation-maximization. What is
//! at rest comes out at rest; a smoother of one width leaves noise there that friction, of the wrong sign, is found to
//! cancel. The scale of the increments is the one by which every other sample is best foretold from the rest. How far
//! the angle may be off, near onsets above all, is drawn from what the smoother leaves open. An angle without
//! noticeable white noise stays as it is, to the last bit.
//!
//! # References
//! Rauch, Tung & Striebel (1965), Maximum likelihood estimates of linear dynamic systems (the smoother),
//! doi:10.2514/3.3166. Aravkin, Burke & Pillonetto (2014), Robust and trend-following Student's t Kalman smoothers,
//! SIAM Journal on Control and Optimization 52. Lange, Little & Taylor (1989), Robust statistical modeling using the t
//! distribution, doi:10.1080/01621459.1989.10478852. Gasser, Sroka & Jennen-Steinmetz (1986), Residual variance and
//! residual pattern in nonlinear regression (the variance from differences), doi:10.1093/biomet/73.3.625.

use std::borrow::Cow;

use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::angle_noise::{Disturbance, HELD_RANGE, PAIRS, range};
use super::random::normal;
use carpus_study::study::{Trial, TrialUse};

/// White noise that is not worth smoothing [rad]: 0.004°, somewhat more than recordings rounded to 0.01° have.
const NOTICEABLE: f64 = 7e-5;
/// Of the differences the smallest are looked at, this share: the larger ones are onsets of movements.
const SHARE: f64 = 0.8;
/// Mean square of this share of the smallest of normal numbers, over that of all.
const OF_SHARE: f64 = 0.437;
/// Fifth differences of white noise have 252 times its variance.
const DIFFERENCES: [f64; 6] = [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0];
/// Scales of the acceleration's increments that are tried [rad/s^2.5].
const SCALES: [f64; 5] = [0.2, 0.5, 1.5, 5.0, 15.0];
/// A scale that foretells worse than the best by less than this share is as good: the smallest leaves most at rest.
const AS_GOOD: f64 = 0.05;
/// What is foretold worse than by so many standard deviations of the noise counts no more than that.
const MOST: f64 = 5.0;
/// Samples at either end that are not foretold.
const ENDS: usize = 4;
/// Degrees of freedom of the distribution of the increments: so few that most are nothing beside a few.
const DEGREES_OF_FREEDOM: f64 = 0.3;
/// Increments at either end that are of the usual size.
const OUTERMOST: usize = 3;
/// Standard deviations of speed [rad/s] and acceleration [rad/s²] at the first sample.
const AT_FIRST: [f64; 2] = [2.0, 20.0];
/// Steps of expectation-maximization.
const STEPS: usize = 10;
/// Inverse of the covariance of what an acceleration's white increments do over one unit of time to angle, speed and
/// acceleration.
const PRECISION: [[f64; 3]; 3] = [[720.0, -360.0, 60.0], [-360.0, 192.0, -36.0], [60.0, -36.0, 9.0]];
/// That covariance.
const COVARIANCE: [[f64; 3]; 3] =
    [[1.0 / 20.0, 1.0 / 8.0, 1.0 / 6.0], [1.0 / 8.0, 1.0 / 3.0, 1.0 / 2.0], [1.0 / 6.0, 1.0 / 2.0, 1.0]];

/// Draws are so many times as far off as the smoother says: it takes the variances of the increments for known. By the
/// fast sweeps of the tests; at rest, where little is left, it is too much.
const WIDENED: f64 = 2.0;
/// Seed of the draws.
const SEED: u64 = 0x5eed;

/// Trials without white noise of their angles.
pub struct Denoised<'a> {
    /// The trials.
    pub trials: Cow<'a, [Trial]>,
    /// Per trial, draws of what their angles may be off by, in pairs of opposite sign; empty if there was no noise.
    pub left: Vec<Vec<Disturbance>>,
}

/// Trials whose angles are without white noise.
///
/// What there is of it is learnt from trials that are not held out.
pub fn denoised(trials: &[Trial]) -> Denoised<'_> {
    let seen = || trials.iter().filter(|t| t.info.usage != TrialUse::Test);
    let moving: Vec<&Trial> = seen().filter(|t| range(&t.angle) >= HELD_RANGE).collect();
    let Some(noise) = white_noise(&moving).filter(|noise| *noise > NOTICEABLE) else {
        return Denoised { trials: Cow::Borrowed(trials), left: Vec::new() };
    };
    let scale = best_scale(&moving, noise);
    let smooth = |(g, trial): (usize, &Trial)| {
        let mut trial = trial.clone();
        let smoother = Smoother { noise, scale };
        let left = match smoother.follow(&trial.time, &trial.angle, |_| true) {
            Some(followed) => {
                trial.angle = followed.angle;
                smoother.draws(&trial.time, &followed.known, g as u64)
            }
            None => Vec::new(),
        };
        (trial, left)
    };
    let (trials, left): (Vec<Trial>, Vec<_>) = trials.par_iter().enumerate().map(smooth).unzip();
    Denoised { trials: Cow::Owned(trials), left }
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

/// Scale of the acceleration's increments [rad/s^2.5] with which every other sample is foretold from the rest, the
/// smallest that does so as well as any.
fn best_scale(trials: &[&Trial], noise: f64) -> f64 {
    let missed = |scale: f64| -> f64 {
        let of_trial = |t: &&Trial| {
            let half = |parity: usize| -> f64 {
                let smoother = Smoother { noise, scale };
                let Some(foretold) = smoother.follow(&t.time, &t.angle, |k| k % 2 == parity) else { return 0.0 };
                let hidden = (ENDS..t.len().saturating_sub(ENDS)).filter(|k| k % 2 != parity);
                hidden.map(|k| (t.angle[k] - foretold.angle[k]).powi(2).min((MOST * noise).powi(2))).sum()
            };
            half(0) + half(1)
        };
        trials.par_iter().map(of_trial).collect::<Vec<f64>>().iter().sum()
    };
    let errors = SCALES.map(missed);
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let as_good = errors.iter().position(|e| *e <= (1.0 + AS_GOOD) * least).unwrap_or(0);
    SCALES[as_good]
}

/// What a Kalman filter knows at a sample: before the sample, and with it.
struct Known {
    before: (Vector3<f64>, Matrix3<f64>),
    with: (Vector3<f64>, Matrix3<f64>),
    /// From the sample before, in units of the usual interval.
    step: f64,
}

impl Known {
    /// How what turns out at the next sample acts back on this one; `None` where the filter knows too exactly to say.
    fn back_from(&self, next: &Known) -> Option<Matrix3<f64>> {
        Some(self.with.1 * motion(next.step).transpose() * next.before.1.try_inverse()?)
    }
}

/// Takes an angle's white noise out.
struct Smoother {
    /// Standard deviation of the noise [rad].
    noise: f64,
    /// Of the acceleration's increments [rad/s^2.5].
    scale: f64,
}

/// An angle without its noise.
struct Followed {
    /// Angle [rad].
    angle: Vec<f64>,
    /// What the filter knows at every sample.
    known: Vec<Known>,
}

impl Smoother {
    /// The angle without its noise; `None` where there are too few samples.
    ///
    /// - `time`: of the samples [s]; `angle`: recorded [rad]; `seen`: whether a sample, by its position, is looked at
    fn follow(&self, time: &[f64], angle: &[f64], seen: impl Fn(usize) -> bool) -> Option<Followed> {
        let n = angle.len();
        let unit = usual_interval(time);
        if n <= 2 * OUTERMOST || !(unit > 0.0) {
            return None;
        }
        // Speed and acceleration are per unit of time, noise is 1: all is of the same order.
        let usual = self.scale * self.scale * unit.powi(5) / (self.noise * self.noise);
        let start = angle[0];
        let series: Vec<f64> = angle.iter().map(|q| (q - start) / self.noise).collect();
        // Of the angle there the samples tell more than enough.
        let widest = 10.0 + 10.0 * series.iter().fold(0.0_f64, |most, q| most.max(q.abs()));
        let [speed, acceleration] = AT_FIRST;
        let first = Vector3::new(widest, speed * unit / self.noise, acceleration * unit * unit / self.noise);
        let mut increments = vec![usual; n];
        let mut known = filtered(time, &series, &seen, &increments, (unit, first));
        let mut followed = followed_back(&known);
        for _ in 1..STEPS {
            let freedom = DEGREES_OF_FREEDOM;
            // At either end a rare large increment would do for the noise of a sample.
            let inner = OUTERMOST..n - OUTERMOST;
            for (increment, square) in increments[inner.clone()].iter_mut().zip(&followed.1[inner]) {
                *increment = (freedom * usual + square) / (freedom + 3.0);
            }
            known = filtered(time, &series, &seen, &increments, (unit, first));
            followed = followed_back(&known);
        }
        let angle = followed.0.iter().map(|q| start + self.noise * q).collect();
        Some(Followed { angle, known })
    }

    /// Draws of what the angle may be off by, given all samples.
    fn draws(&self, time: &[f64], known: &[Known], seed: u64) -> Vec<Disturbance> {
        let unit = usual_interval(time);
        let n = known.len();
        let mut rng = ChaCha8Rng::seed_from_u64(SEED.wrapping_add(seed));
        let mut draw = || Vector3::from_fn(|_, _| normal(&mut rng));
        let mut off = vec![vec![Vector3::zeros(); n]; PAIRS];
        for k in (0..n).rev() {
            // Given the sample after.
            let own = &known[k].with.1;
            let (back, rest) = match known.get(k + 1).and_then(|next| Some((next, known[k].back_from(next)?))) {
                Some((next, back)) => (back, own - back * next.before.1 * back.transpose()),
                None => (Matrix3::zeros(), *own),
            };
            let eigen = (0.5 * (rest + rest.transpose())).symmetric_eigen();
            let root = eigen.eigenvectors * Matrix3::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
            for off in &mut off {
                let after = off.get(k + 1).copied().unwrap_or_default();
                off[k] = back * after + root * draw();
            }
        }
        let signed = |(off, sign): (&Vec<Vector3<f64>>, f64)| {
            let of = |i: usize, per: f64| off.iter().map(|d| WIDENED * sign * self.noise * d[i] / per).collect();
            Disturbance { angle: of(0, 1.0), speed: of(1, unit), acceleration: of(2, unit * unit) }
        };
        off.iter().flat_map(|off| [(off, 1.0), (off, -1.0)]).map(signed).collect()
    }
}

/// Mean interval of samples [s].
fn usual_interval(time: &[f64]) -> f64 {
    (time[time.len() - 1] - time[0]) / (time.len().max(2) - 1) as f64
}

/// Forward over the samples.
///
/// - `increments`: variances, by the sample after them; `unit`: of time [s]; `first`: standard deviations at the first
///   sample
fn filtered(
    time: &[f64],
    series: &[f64],
    seen: impl Fn(usize) -> bool,
    increments: &[f64],
    (unit, first): (f64, Vector3<f64>),
) -> Vec<Known> {
    let mut state = Vector3::zeros();
    let mut covariance = Matrix3::from_diagonal(&first.component_mul(&first));
    let mut known = Vec::with_capacity(series.len());
    for k in 0..series.len() {
        let step = if k == 0 { 1.0 } else { ((time[k] - time[k - 1]) / unit).max(1e-3) };
        if k > 0 {
            let (motion, spread) = (motion(step), spread(step) * increments[k]);
            state = motion * state;
            covariance = motion * covariance * motion.transpose() + spread;
        }
        let before = (state, covariance);
        if seen(k) {
            let gain = covariance.column(0) / (covariance[(0, 0)] + 1.0);
            state += gain * (series[k] - state[0]);
            covariance -= gain * covariance.row(0);
            covariance = 0.5 * (covariance + covariance.transpose());
        }
        known.push(Known { before, with: (state, covariance), step });
    }
    known
}

/// Backward over the samples: angles; and at every sample from the second the expected square of the increment before
/// it.
fn followed_back(known: &[Known]) -> (Vec<f64>, Vec<f64>) {
    let n = known.len();
    let (mut state, mut covariance) = known[n - 1].with;
    let mut angles = vec![state[0]; n];
    let mut squares = vec![0.0; n];
    for k in (0..n - 1).rev() {
        let (next, own) = (&known[k + 1], &known[k].with);
        let motion = motion(next.step);
        let Some(back) = known[k].back_from(next) else {
            (state, covariance) = *own;
            angles[k] = state[0];
            continue;
        };
        let earlier = own.0 + back * (state - next.before.0);
        let earlier_covariance = own.1 + back * (covariance - next.before.1) * back.transpose();
        let jump = state - motion * earlier;
        let cross = motion * back * covariance;
        let variance = covariance - cross - cross.transpose() + motion * earlier_covariance * motion.transpose();
        squares[k + 1] = (precision(next.step) * (variance + jump * jump.transpose())).trace().max(0.0);
        (state, covariance) = (earlier, earlier_covariance);
        angles[k] = state[0];
    }
    (angles, squares)
}

/// Angle, speed and acceleration after a step of constant acceleration.
fn motion(step: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, step, 0.5 * step * step, 0.0, 1.0, step, 0.0, 0.0, 1.0)
}

/// What increments of variance 1 per unit of time do to them over a step.
fn spread(step: f64) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| COVARIANCE[i][j] * step.powi(5 - (i + j) as i32))
}

/// Its inverse.
fn precision(step: f64) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| PRECISION[i][j] * step.powi((i + j) as i32 - 5))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::random::normal;
    use carpus_study::study::{Contraction, Direction, TrialInfo};

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
    fn verif_precision_is_the_inverse_of_the_covariance() {
        for step in [0.5, 1.0, 3.0] {
            let product = spread(step) * precision(step);
            assert!((product - Matrix3::identity()).amax() < 1e-9, "{product}");
        }
    }

    #[test]
    fn verif_a_joint_at_rest_comes_out_at_rest() {
        let noisy = trials(|rng, q| q + 0.005 * normal(rng), 100.0);
        for trial in denoised(&noisy).trials.iter() {
            let at_rest = |t: f64| t > 2.4;
            let pairs = trial.angle.windows(2).zip(&trial.time).filter(|(_, t)| at_rest(**t));
            let speeds: Vec<f64> = pairs.map(|(q, _)| ((q[1] - q[0]) / 0.01).abs()).collect();
            let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
            // Of 0.4 rad/s before.
            assert!(mean < 0.01, "{mean} rad/s");
        }
    }

    #[test]
    fn verif_white_noise_is_found_and_the_speed_comes_back() {
        for sd in [0.002, 0.005] {
            let noisy = trials(|rng, q| q + sd * normal(rng), 100.0);
            let found = white_noise(&noisy.iter().collect::<Vec<_>>()).unwrap();
            assert!((found / sd - 1.0).abs() < 0.1, "{found} {sd}");
            let (before, after) = (speed_error(&noisy), speed_error(&denoised(&noisy).trials));
            assert!(after < 0.35 * before, "{after} {before}");
        }
    }

    #[test]
    fn verif_an_encoders_steps_are_smoothed() {
        let step = 0.1_f64.to_radians();
        let noisy = trials(|_, q| (q / step).round() * step, 100.0);
        let (before, after) = (speed_error(&noisy), speed_error(&denoised(&noisy).trials));
        assert!(after < 0.5 * before, "{after} {before}");
    }

    #[test]
    fn verif_angles_without_white_noise_stay_as_they_are() {
        let step = 0.01_f64.to_radians();
        for clean in [trials(|_, q| q, 100.0), trials(|_, q| q, 50.0), trials(|_, q| (q / step).round() * step, 50.0)] {
            let denoised = denoised(&clean);
            assert!(matches!(denoised.trials, Cow::Borrowed(_)) && denoised.left.is_empty());
        }
    }

    #[test]
    fn verif_draws_are_as_far_off_as_the_speed_is() {
        let noisy = trials(|rng, q| q + 0.005 * normal(rng), 100.0);
        let found = denoised(&noisy);
        let rms = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v: f64| (sum + v * v, count + 1.0));
            (sum / count).sqrt()
        };
        // The joint accelerates for half of the first second and a half; later it rests.
        for (part, most) in [(20..150, 1.5), (250..380, 3.0)] {
            let drawn = rms(&mut found.left.iter().flatten().flat_map(|d| d.speed[part.clone()].iter().copied()));
            let off = rms(&mut found.trials.iter().flat_map(|t| {
                let speeds = t.angle.windows(3).map(|q| (q[2] - q[0]) / 0.02).zip(&t.time[1..]);
                speeds.map(|(v, t)| v - sweep(*t).1).skip(part.start).take(part.len()).collect::<Vec<_>>()
            }));
            println!("{part:?}: drawn {drawn:.4}, off {off:.4} rad/s");
            assert!((0.7..most).contains(&(drawn / off)), "{part:?}: {drawn} of {off} rad/s");
        }
        let draw = &found.left[0][0];
        let worst = (1..draw.angle.len() - 1)
            .map(|k| ((draw.angle[k + 1] - draw.angle[k - 1]) / 0.02 - draw.speed[k]).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.04, "{worst} rad/s");
    }
}
