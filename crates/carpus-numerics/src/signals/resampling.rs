//! Other instants for the same signal.

use super::butterworth::{Band, Butterworth};
use super::error::{SignalError, finite, positive_rate};

/// Order of the filter that removes what the lower rate could not carry.
const ANTI_ALIAS_ORDER: usize = 8;
/// Its cutoff as a fraction of half the lower rate.
const ANTI_ALIAS_CUTOFF: f64 = 0.8;
/// Largest ratio of a new rate to the recorded one. Between samples nothing is known; recorders of motion at 50 Hz and
/// of EMG at 5 kHz are
/// the farthest apart.
const MOST_NEW_SAMPLES: f64 = 100.0;

/// Sample rate of a recording: the inverse of its median step \[Hz\].
///
/// # Errors
/// - [`SignalError::TooShort`]: fewer than two instants
/// - [`SignalError::Times`]: they do not increase
pub fn sample_rate(time: &[f64]) -> Result<f64, SignalError> {
    if time.len() < 2 {
        return Err(SignalError::TooShort { found: time.len(), expected: 2 });
    }
    increasing(time)?;
    let mut steps: Vec<f64> = time.windows(2).map(|t| t[1] - t[0]).collect();
    steps.sort_by(f64::total_cmp);
    let n = steps.len();
    Ok(2.0 / (steps[(n - 1) / 2] + steps[n / 2]))
}

/// Linear interpolation of `(time, x)` at other instants; before the first and after the last sample the nearest one
/// holds (`numpy.interp`). Exact at the samples; between them off by at most h²/8 times the second derivative.
///
/// # Errors
/// [`SignalError::Times`]: times do not increase, or their number is not that of the values, or there are none.
pub fn interpolate_linear(time: &[f64], x: &[f64], at: &[f64]) -> Result<Vec<f64>, SignalError> {
    if time.len() != x.len() || time.is_empty() {
        return Err(SignalError::Times { expected: "as many times as values, and at least one" });
    }
    increasing(time)?;
    Ok(at
        .iter()
        .map(|&t| match time.partition_point(|&known| known <= t) {
            0 => x[0],
            after if after == time.len() => x[after - 1],
            after => {
                let before = after - 1;
                let slope = (x[after] - x[before]) / (time[after] - time[before]);
                x[before] + slope * (t - time[before])
            }
        })
        .collect())
}

/// The signal at another rate, beginning with the same instant and ending no later. Downwards it first passes a
/// zero-phase Butterworth low-pass (order 8, cutoff 0.8 of half the new rate); then it is interpolated linearly, so
/// upwards this suits envelopes, angles and moments, which are smooth between samples, and not raw EMG.
///
/// # Errors
/// [`SignalError::SampleRate`], [`SignalError::NewRate`], [`SignalError::TooShort`], [`SignalError::NotFinite`].
pub fn resample(x: &[f64], from_hz: f64, to_hz: f64) -> Result<Vec<f64>, SignalError> {
    positive_rate(from_hz)?;
    positive_rate(to_hz)?;
    finite(x)?;
    if x.is_empty() {
        return Err(SignalError::TooShort { found: 0, expected: 1 });
    }
    let filtered;
    let smooth = if to_hz < from_hz {
        let band = Band::LowPass { cutoff_hz: ANTI_ALIAS_CUTOFF * to_hz / 2.0 };
        filtered = Butterworth { order: ANTI_ALIAS_ORDER, band }.design(from_hz)?.filter_zero_phase(x)?;
        &filtered[..]
    } else {
        x
    };
    if to_hz > MOST_NEW_SAMPLES * from_hz {
        return Err(SignalError::NewRate { from_hz, to_hz, most: MOST_NEW_SAMPLES });
    }
    let last = x.len() - 1;
    // A sample that rounding puts a hair after the last one still counts.
    let n = (last as f64 * to_hz / from_hz + 1e-9).floor() as usize + 1;
    Ok((0..n)
        .map(|i| {
            let position = (i as f64 * from_hz / to_hz).min(last as f64);
            let before = (position.floor() as usize).min(last.saturating_sub(1));
            let next = smooth[(before + 1).min(last)];
            smooth[before] + (next - smooth[before]) * (position - before as f64)
        })
        .collect())
}

fn increasing(time: &[f64]) -> Result<(), SignalError> {
    let increasing = time.windows(2).all(|t| t[1] > t[0]);
    if increasing { Ok(()) } else { Err(SignalError::Times { expected: "strictly increasing times" }) }
}
