//! The true excitation of a muscle, given its recorded EMG: what of the recorded envelope is noise.
//!
//! The logarithm z of the recorded envelope is that of the true one, x, plus noise of covariance N. A person's excitation changes smoothly, slowly while an
//! effort is held and fast at its onset and end: the rate of x is a Gaussian process whose standard deviation follows how fast the recorded
//! envelope changes over some tenths of a second (`docs/src/theory/many-small-errors.md`, equations (8) and (9)). With C the covariance of
//! x that follows, and z̄ the mean of z over a trial,
//!
//! ```text
//! x | z ~ N( z − A (z − z̄),  N − A N ),   A = N (N + C)⁻¹                                     (10)
//! ```
//! Were every true excitation as likely as any (C infinite), a model that lets less of the EMG's noise pass, by a longer delay or a softer tendon,
//! would predict moments better than the true one does: it smooths what nobody has smoothed.
//!
//! Everything is on the knots of the EMG's noise, as errors w of the logarithm.
//!
//! # References
//! Carroll et al. (2006), Measurement Error in Nonlinear Models, chapters 4 and 8, doi:10.1201/9781420010138.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::diagnosis::kernel::{Family, Kernel};
use crate::diagnosis::noise::{KNOT_SPACING, NoiseLevels};

/// EMG below this counts as this when noise is expressed relative to it.
const SMALLEST: f64 = 0.005;
/// Standard deviations of the rate of a held effort's logarithm that are compared [1/s].
const RATES_WHEN_HELD: [f64; 4] = [0.1, 0.2, 0.4, 0.8];
/// Correlation lengths of the rate that are compared [s].
const RATE_LENGTHS: [f64; 3] = [0.1, 0.2, 0.4];
/// Halves of the times over which the recorded envelope's own rate is taken [s]: of onsets, and of what is slower than the noise.
const HALF_WINDOWS: [f64; 2] = [0.12, 0.3];
/// Variance of the level of a trial's logarithm: wide.
const LEVEL: f64 = 4.0;

/// Of one channel in one trial: what is expected of w before the moment is looked at, equation (11).
#[derive(Clone, Debug)]
pub struct Expected {
    /// On the knots: w of the mean excitation, which is by half of the variance above the mean of w. Moments go with excitations, not with
    /// their logarithms.
    pub mean: DVector<f64>,
    /// I − A, A = N (N + C)⁻¹: what of the noise is left in the expected envelope.
    pub shaping: DMatrix<f64>,
    /// A C Aᵀ: what of the true envelope is smoothed away. The covariance is (I − A) N (I − A)ᵀ + A C Aᵀ.
    pub known: DMatrix<f64>,
}

/// What is expected of every channel in every trial.
///
/// - `envelopes`: per trial and channel, recorded, on knots; `kernel`: of the noise's autocorrelation; `signals`: of every channel
pub fn expected(
    envelopes: &[Vec<DVector<f64>>],
    levels: &NoiseLevels,
    kernel: &Kernel,
    signals: &[Signal],
) -> Vec<Vec<Expected>> {
    let of =
        |trial: &Vec<DVector<f64>>| trial.iter().zip(signals).map(|(e, s)| of_channel(e, s, levels, kernel)).collect();
    envelopes.par_iter().map(of).collect()
}

/// The signals of maximum likelihood, of every channel.
///
/// - `envelopes`, `kernel`: as for [`expected`]
pub fn signals(envelopes: &[Vec<DVector<f64>>], levels: &NoiseLevels, kernel: &Kernel) -> Vec<Signal> {
    let channels = envelopes.first().map_or(0, Vec::len);
    let channel = |m: usize| -> Vec<&DVector<f64>> { envelopes.iter().map(|trial| &trial[m]).collect() };
    (0..channels).into_par_iter().map(|m| most_likely(&channel(m), levels, kernel)).collect()
}

/// How a channel's true envelopes change.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    /// Standard deviation of the logarithm's rate while an effort is held [1/s].
    rate: f64,
    /// How the rate is autocorrelated.
    kernel: Kernel,
}

/// The signal of maximum likelihood over all trials of a channel.
fn most_likely(trials: &[&DVector<f64>], levels: &NoiseLevels, kernel: &Kernel) -> Signal {
    let prepared: Vec<(DVector<f64>, DMatrix<f64>)> = trials
        .iter()
        .map(|e| {
            let e = e.map(|e| e.max(SMALLEST));
            (e.map(f64::ln), noise(&e, levels, kernel))
        })
        .collect();
    let deviance = |signal: &Signal| -> f64 {
        let of = |(z, n): &(DVector<f64>, DMatrix<f64>)| {
            let mut v = covariance(z, &n.diagonal(), signal) + n;
            (0..z.len()).for_each(|j| v[(j, j)] *= 1.0 + 1e-9);
            let Some(factor) = v.cholesky() else { return f64::INFINITY };
            let about = z.add_scalar(-z.mean());
            let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            log_determinant + about.dot(&factor.solve(&about))
        };
        prepared.iter().map(of).sum()
    };
    let families = [Family::Matern32, Family::Gaussian].into_iter();
    let kernels = families.flat_map(|family| RATE_LENGTHS.map(|length| Kernel { family, length }));
    let signals = kernels.flat_map(|kernel| RATES_WHEN_HELD.map(|rate| Signal { rate, kernel }));
    let found = signals.map(|signal| (deviance(&signal), signal)).min_by(|a, b| a.0.total_cmp(&b.0));
    found.map_or(Signal { rate: 0.3, kernel: Kernel { family: Family::Matern32, length: 0.2 } }, |(_, signal)| signal)
}

fn stationary(kernel: &Kernel, n: usize) -> DMatrix<f64> {
    let by_step: Vec<f64> = (0..n).map(|i| kernel.at(KNOT_SPACING * i as f64)).collect();
    DMatrix::from_fn(n, n, |i, j| by_step[i.abs_diff(j)])
}

/// N: covariance of the noise of the logarithm, equation (8).
fn noise(e: &DVector<f64>, levels: &NoiseLevels, kernel: &Kernel) -> DMatrix<f64> {
    let [envelope, _, floor] = levels.of_emg();
    let mut n = stationary(kernel, e.len());
    for j in 0..e.len() {
        for i in 0..e.len() {
            n[(i, j)] *= envelope + floor / (e[i] * e[j]);
        }
    }
    n
}

/// C: covariance of the true envelope's logarithm, equation (9).
///
/// - `noise`: variance of every knot's logarithm
fn covariance(z: &DVector<f64>, noise: &DVector<f64>, signal: &Signal) -> DMatrix<f64> {
    let n = z.len();
    // What of a change the noise does not explain, over the time that it took.
    let over = |j: usize, half: f64| {
        let reach = (half / KNOT_SPACING).round() as usize;
        let (before, after) = (j.saturating_sub(reach), (j + reach).min(n - 1));
        let change = (z[after] - z[before]).powi(2) - noise[before] - noise[after];
        change.max(0.0).sqrt() / (KNOT_SPACING * (after - before).max(1) as f64)
    };
    let rate = |j: usize| HALF_WINDOWS.iter().fold(signal.rate, |most, half| most.max(over(j, *half)));
    let rates: Vec<f64> = (0..n).map(rate).collect();
    let mut c = stationary(&signal.kernel, n);
    for j in 0..n {
        for i in 0..n {
            c[(i, j)] *= rates[i] * rates[j] * KNOT_SPACING * KNOT_SPACING;
        }
    }
    // Summed over time, from the start.
    for j in 0..n {
        for i in 1..n {
            c[(i, j)] += c[(i - 1, j)];
        }
    }
    for j in 1..n {
        for i in 0..n {
            c[(i, j)] += c[(i, j - 1)];
        }
    }
    c.add_scalar_mut(LEVEL);
    c
}

fn of_channel(e: &DVector<f64>, signal: &Signal, levels: &NoiseLevels, kernel: &Kernel) -> Expected {
    let e = e.map(|e| e.max(SMALLEST));
    let z = e.map(f64::ln);
    let knots = e.len();
    let n = noise(&e, levels, kernel);
    let c = covariance(&z, &n.diagonal(), signal);
    let mut v = &c + &n;
    (0..knots).for_each(|j| v[(j, j)] *= 1.0 + 1e-9);
    let Some(of_v) = v.cholesky() else {
        let none = DMatrix::zeros(knots, knots);
        return Expected { mean: DVector::zeros(knots), shaping: DMatrix::identity(knots, knots), known: none };
    };
    let about = z.add_scalar(-z.mean());
    // A = N V⁻¹, both symmetric.
    let a = of_v.solve(&n).transpose();
    let variance = (&n - &a * &n).diagonal();
    let mean = 0.5 * variance - &a * about;
    let known = &a * c * a.transpose();
    Expected { mean, shaping: DMatrix::identity(knots, knots) - a, known }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn normal(rng: &mut rand_chacha::ChaCha8Rng, n: usize) -> DVector<f64> {
        DVector::from_fn(n, |_, _| crate::diagnosis::score_test::normal(rng))
    }

    /// Of drawn envelopes with drawn noise the expected ones are nearer to the truth than the recorded, and as near as is said.
    #[test]
    fn verif_expected_envelopes_are_nearer_to_the_true_ones() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let kernel = Kernel { family: Family::Gaussian, length: 0.08 };
        let mut levels = NoiseLevels::default();
        levels.0[4] = 0.01;
        levels.0[6] = 1e-6;
        let n = 90;
        let smooth = stationary(&Kernel { family: Family::Gaussian, length: 0.5 }, n);
        let of_signal = crate::diagnosis::kernel::root(&smooth);
        let of_noise = crate::diagnosis::kernel::root(&stationary(&kernel, n));
        let draws: Vec<(DVector<f64>, DVector<f64>)> = (0..30)
            .map(|_| {
                let truth = (&of_signal * normal(&mut rng, n)).map(|x| 0.3 * (0.12 * x).exp());
                let noise = (&of_noise * normal(&mut rng, n)) * 0.1;
                let recorded = truth.component_mul(&noise.map(f64::exp));
                (truth, recorded)
            })
            .collect();
        let envelopes: Vec<Vec<DVector<f64>>> = draws.iter().map(|(_, e)| vec![e.clone()]).collect();
        let found = expected(&envelopes, &levels, &kernel, &signals(&envelopes, &levels, &kernel));
        let (mut before, mut after, mut said) = (0.0, 0.0, 0.0);
        for ((truth, e), found) in draws.iter().zip(&found) {
            let w = DVector::from_fn(n, |i, _| (truth[i] / e[i]).ln());
            before += w.norm_squared();
            after += (&w - &found[0].mean).norm_squared();
            let k = stationary(&kernel, n) * levels.0[4];
            said += (&found[0].shaping * k * found[0].shaping.transpose()).trace() + found[0].known.trace();
        }
        assert!(after < 0.6 * before, "{after} of {before}");
        // What is drawn wanders by another law than what is expected: within a factor.
        assert!((after / said).ln().abs() < 0.5, "{after}, expected {said}");
    }
}
