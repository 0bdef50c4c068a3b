//! The delay between two recorders that recorded the same quantity.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use carpus_numerics::signals::{SignalError, interpolate_linear};

/// Most steps of the finer recorder, on average, to a sample of either: recorders of motion at 50 Hz and of EMG at 5
/// kHz are the farthest apart.
const MOST_STEPS: f64 = 100.0;
/// Common samples below which a correlation means nothing.
const MIN_OVERLAP: usize = 32;
/// Another peak of the correlation this near to the highest makes a delay ambiguous.
const AMBIGUOUS: f64 = 0.95;
/// A correlation below this says that two channels hardly show the same quantity.
const WEAK: f64 = 0.8;
/// A variance below this share of the squares is none.
const FLAT: f64 = 1e-12;
/// Accuracy of the delay, in steps of the finer recorder.
const ACCURACY: f64 = 1e-6;

/// The delay between two recorders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Time that has to be added to the second recorder's clock \[s\].
    pub shift: f64,
    /// Pearson's correlation of the two signals after the shift.
    pub correlation: f64,
    /// The highest correlation at any other peak: near `correlation` the delay is ambiguous.
    pub runner_up: f64,
}

impl Alignment {
    /// Whether the two channels hardly show the same quantity, or another delay is nearly as likely.
    pub fn is_doubtful(&self) -> bool {
        self.correlation < WEAK || self.runner_up > AMBIGUOUS * self.correlation
    }
}

/// Why recorders cannot be aligned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignmentError {
    /// A signal that cannot be used.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The recordings hardly overlap within the lags allowed.
    #[error("the two recordings have fewer than {MIN_OVERLAP} samples in common within ±{max_lag_s} s")]
    NoOverlap {
        /// Largest lag \[s\].
        max_lag_s: f64,
    },
    /// One recorder's steps are much smaller than the other's.
    #[error("the steps of one recording, {step_s} s, are more than {MOST_STEPS} times smaller than the other's")]
    Steps {
        /// The smaller median step \[s\].
        step_s: f64,
    },
    /// A signal that does not vary.
    #[error("one of the two signals does not vary")]
    Flat,
    /// The best lag is the largest allowed.
    #[error("the correlation is highest at the largest lag allowed, ±{max_lag_s} s")]
    AtLimit {
        /// Largest lag \[s\].
        max_lag_s: f64,
    },
}

/// The shift of the second recorder's clock that makes two recordings of one quantity agree best.
///
/// Both are brought to the finer recorder's steps by linear interpolation; every whole-step lag is tried, with the mean
/// and scale of the common samples removed (sums of products by a fast Fourier transform), and the best is refined
/// between steps by golden-section search of the correlation itself, the second signal by cubics between its samples.
///
/// - `first`, `second`: time \[s\] and values; units may differ, signs may not
/// - `max_lag`: largest shift looked at \[s\]
///
/// # Errors
/// [`AlignmentError`].
pub fn align(first: (&[f64], &[f64]), second: (&[f64], &[f64]), max_lag: f64) -> Result<Alignment, AlignmentError> {
    let step = step(first.0)?.min(step(second.0)?);
    let most = MOST_STEPS * (first.0.len() + second.0.len()) as f64;
    let span = |time: &[f64]| (time[time.len() - 1] - time[0]) / step;
    if !(span(first.0).max(span(second.0)) <= most) {
        return Err(AlignmentError::Steps { step_s: step });
    }
    let (x, y) = (Regular::new(first, step)?, Regular::new(second, step)?);
    // Recordings that are farther apart than both are long have nothing in common.
    let apart = (x.start - y.start).abs() / step + (x.values.len() + y.values.len()) as f64;
    let lags = (max_lag / step).floor().clamp(1.0, apart) as i64;
    let correlations = x.correlations(&y, lags);
    let best = (0..correlations.len())
        .filter(|i| correlations[*i].is_some())
        .max_by(|a, b| correlations[*a].unwrap_or(-2.0).total_cmp(&correlations[*b].unwrap_or(-2.0)));
    let Some(best) = best else {
        let flat = [&x, &y].iter().any(|r| r.values.iter().all(|v| *v == r.values[0]));
        return Err(if flat { AlignmentError::Flat } else { AlignmentError::NoOverlap { max_lag_s: max_lag } });
    };
    let value = |i: usize| correlations.get(i).copied().flatten();
    if best == 0 || value(best - 1).is_none() || value(best + 1).is_none() {
        return Err(AlignmentError::AtLimit { max_lag_s: max_lag });
    }
    let peak = |i: usize| match (value(i - 1), value(i), value(i + 1)) {
        (Some(a), Some(b), Some(c)) if b >= a && b >= c => Some(b),
        _ => None,
    };
    let others = (1..correlations.len() - 1).filter(|i| i.abs_diff(best) > 1).filter_map(peak);
    let runner_up = others.fold(-1.0, f64::max);
    let coarse = (best as i64 - lags) as f64 * step;
    let shift = refine(|shift| x.correlation(&y, x.start, shift).unwrap_or(-2.0), coarse, step);
    let correlation = x.correlation(&y, x.start, shift).unwrap_or(f64::NAN);
    Ok(Alignment { shift, correlation, runner_up })
}

/// Golden-section search for the maximum within one step of `coarse`.
fn refine(objective: impl Fn(f64) -> f64, coarse: f64, step: f64) -> f64 {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let [mut low, mut high] = [coarse - step, coarse + step];
    let mut inner = [high - ratio * (high - low), low + ratio * (high - low)];
    let mut values = inner.map(&objective);
    while high - low > ACCURACY * step {
        if values[0] > values[1] {
            high = inner[1];
            inner = [high - ratio * (high - low), inner[0]];
            values = [objective(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + ratio * (high - low)];
            values = [values[1], objective(inner[1])];
        }
    }
    0.5 * (low + high)
}

fn step(time: &[f64]) -> Result<f64, SignalError> {
    carpus_numerics::signals::sample_rate(time).map(|rate| 1.0 / rate)
}

/// A signal about its mean, and its sums.
struct Sums {
    values: Vec<f64>,
    /// Of the values and of their squares, before each sample and after the last.
    before: Vec<[f64; 2]>,
}

impl Sums {
    fn new(signal: &[f64]) -> Sums {
        let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
        let values: Vec<f64> = signal.iter().map(|v| v - mean).collect();
        let mut before = vec![[0.0; 2]];
        let mut sum = [0.0; 2];
        for v in &values {
            sum = [sum[0] + v, sum[1] + v * v];
            before.push(sum);
        }
        Sums { values, before }
    }

    /// Sums of the values and of their squares from one sample to before another.
    fn between(&self, first: i64, end: i64) -> [f64; 2] {
        let (from, to) = (self.before[first as usize], self.before[end as usize]);
        [to[0] - from[0], to[1] - from[1]]
    }

    fn square(&self) -> f64 {
        self.before[self.values.len()][1]
    }
}

/// Σ x_i y_{i + d} at place d, negative d from the end.
fn sums_of_products(x: &[f64], y: &[f64]) -> Vec<f64> {
    let length = (x.len() + y.len()).next_power_of_two();
    let mut planner = FftPlanner::new();
    let (forward, back) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let transformed = |signal: &[f64]| {
        let mut out: Vec<Complex<f64>> = signal.iter().map(|v| Complex::new(*v, 0.0)).collect();
        out.resize(length, Complex::new(0.0, 0.0));
        forward.process(&mut out);
        out
    };
    let mut both: Vec<Complex<f64>> =
        transformed(x).into_iter().zip(transformed(y)).map(|(x, y)| x.conj() * y).collect();
    back.process(&mut both);
    both.into_iter().map(|v| v.re / length as f64).collect()
}

/// A recording with equal steps.
struct Regular {
    start: f64,
    step: f64,
    values: Vec<f64>,
}

impl Regular {
    fn new((time, values): (&[f64], &[f64]), step: f64) -> Result<Regular, SignalError> {
        let n = ((time[time.len() - 1] - time[0]) / step + 1e-9).floor() as usize + 1;
        let at: Vec<f64> = (0..n).map(|i| time[0] + i as f64 * step).collect();
        Ok(Regular { start: time[0], step, values: interpolate_linear(time, values, &at)? })
    }

    /// The value between samples by a cubic through four (Catmull–Rom), which does not favour whole steps as a straight
    /// line does.
    fn at(&self, position: f64) -> f64 {
        let last = self.values.len() - 1;
        let i = (position.floor().max(0.0) as usize).min(last.saturating_sub(1));
        let u = position - i as f64;
        let v = |k: isize| self.values[(i as isize + k).clamp(0, last as isize) as usize];
        let (a, b, c, d) = (v(-1), v(0), v(1), v(2));
        b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))
    }

    /// Correlations with another recording whose clock is shifted by whole steps, from −`lags` to `lags`; `None` where
    /// there are not enough common samples, or no variation.
    fn correlations(&self, other: &Regular, lags: i64) -> Vec<Option<f64>> {
        let offset = (self.start - other.start) / self.step;
        let (whole, between) = (offset.floor() as i64, offset - offset.floor());
        let common = ((other.values.len() - 1) as f64 - between).floor().max(-1.0) as usize + 1;
        let theirs: Vec<f64> = (0..common).map(|j| other.at(j as f64 + between)).collect();
        let (x, y) = (Sums::new(&self.values), Sums::new(&theirs));
        let products = sums_of_products(&x.values, &y.values);
        let of = |lag: i64| {
            // Sample i of this recording is at sample i + ahead of the other.
            let ahead = whole - lag;
            let first = (-ahead).max(0);
            let end = (x.values.len() as i64).min(y.values.len() as i64 - ahead);
            if end < first + MIN_OVERLAP as i64 {
                return None;
            }
            let n = (end - first) as f64;
            let ([sx, sxx], [sy, syy]) = (x.between(first, end), y.between(first + ahead, end + ahead));
            let sxy = products[ahead.rem_euclid(products.len() as i64) as usize];
            let (vx, vy) = (sxx - sx * sx / n, syy - sy * sy / n);
            let is_flat = vx <= FLAT * x.square() || vy <= FLAT * y.square();
            (!is_flat).then(|| (sxy - sx * sy / n) / (vx * vy).sqrt())
        };
        (-lags..=lags).map(of).collect()
    }

    /// Correlation with another recording whose clock is shifted; `None` without enough common samples or variation.
    fn correlation(&self, other: &Regular, origin: f64, shift: f64) -> Option<f64> {
        let position = |i: usize| (origin + i as f64 * self.step - other.start - shift) / self.step;
        let offset = position(0);
        let first = (-offset).ceil().max(0.0) as usize;
        let end = ((other.values.len() - 1) as f64 - offset).floor() + 1.0;
        let end = (end.max(0.0) as usize).min(self.values.len());
        if end < first + MIN_OVERLAP {
            return None;
        }
        let n = (end - first) as f64;
        let [mut sx, mut sy, mut sxx, mut syy, mut sxy] = [0.0; 5];
        for i in first..end {
            let (x, y) = (self.values[i], other.at(position(i)));
            sx += x;
            sy += y;
            sxx += x * x;
            syy += y * y;
            sxy += x * y;
        }
        let (vx, vy) = (sxx - sx * sx / n, syy - sy * sy / n);
        let is_flat = vx <= FLAT * sxx.max(1e-300) || vy <= FLAT * syy.max(1e-300);
        (!is_flat).then(|| (sxy - sx * sy / n) / (vx * vy).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_correlations_of_all_lags_are_those_of_the_sums_themselves() {
        let time = |start: f64, n: usize| -> Vec<f64> { (0..n).map(|i| start + 0.01 * i as f64).collect() };
        // Apart by other than whole steps, with a mean, and at rest for a while.
        let signal = |t: &[f64]| -> Vec<f64> { t.iter().map(|t| 5.0 + (1.3 * t * t).sin().max(0.0)).collect() };
        let (first, second) = (time(0.0, 300), time(0.5037, 220));
        let x = Regular::new((&first, &signal(&first)), 0.01).unwrap();
        let y = Regular::new((&second, &signal(&second)), 0.01).unwrap();
        let lags = 260;
        let mut compared = 0;
        for (lag, found) in (-lags..=lags).zip(x.correlations(&y, lags)) {
            let expected = x.correlation(&y, x.start, lag as f64 * 0.01);
            assert_eq!(found.is_some(), expected.is_some(), "lag {lag}");
            let (Some(found), Some(expected)) = (found, expected) else { continue };
            compared += 1;
            assert!((found - expected).abs() < 1e-9, "lag {lag}: {found} and {expected}");
        }
        assert!(compared > 400, "{compared}");
    }
}
