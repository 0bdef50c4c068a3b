//! Rectification, moving averages and Savitzky–Golay smoothing.

use nalgebra::{DMatrix, DVector};

use super::error::{SignalError, finite};

/// Longest window \[s\]: windows of envelopes take a tenth of a second, those of maximal contractions one or two. Each
/// sample is
/// summed over its window, so that the work grows with it.
const LONGEST_WINDOW: f64 = 60.0;

/// Sums side by side, which a processor adds together: one after the other, each would wait for the one before.
const LANES: usize = 8;

/// Sum of `n` terms, in an order that depends on `n` alone.
fn sum_of(n: usize, term: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let whole = n - n % LANES;
    for first in (0..whole).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += term(first + lane);
        }
    }
    sums.iter().sum::<f64>() + (whole..n).map(term).sum::<f64>()
}

/// Full-wave rectification: the absolute value of every sample.
pub fn rectify(x: &[f64]) -> Vec<f64> {
    x.iter().map(|v| v.abs()).collect()
}

/// The odd number of samples nearest to a duration, so that a window has a sample at its centre.
///
/// # Errors
/// [`SignalError::WindowDuration`] if the duration is not a positive number.
pub fn odd_window(duration_s: f64, sample_rate_hz: f64) -> Result<usize, SignalError> {
    let samples = duration_s * sample_rate_hz;
    if !(samples > 0.0 && duration_s <= LONGEST_WINDOW && sample_rate_hz.is_finite()) {
        return Err(SignalError::WindowDuration { most_s: LONGEST_WINDOW, found_s: duration_s });
    }
    Ok(2 * ((samples - 1.0) / 2.0).round().max(0.0) as usize + 1)
}

/// Mean over a centred window of `window` samples (odd). At the ends the window is cut to the samples there are
/// (MATLAB `movmean`; pandas `rolling(center=True, min_periods=1)`).
///
/// # Errors
/// [`SignalError::Window`] if the window is even.
pub fn moving_mean(x: &[f64], window: usize) -> Result<Vec<f64>, SignalError> {
    if window.is_multiple_of(2) {
        return Err(SignalError::Window { found: window, expected: "an odd number of samples".to_owned() });
    }
    let half = window / 2;
    // Each window is summed anew: a running sum would carry the rounding of a burst into the silence after it.
    Ok((0..x.len())
        .map(|i| {
            let inside = &x[i.saturating_sub(half)..(i + half + 1).min(x.len())];
            sum_of(inside.len(), |k| inside[k]) / inside.len() as f64
        })
        .collect())
}

/// Root mean square over a centred window of `window` samples (odd); ends as in [`moving_mean`].
///
/// # Errors
/// [`SignalError::Window`] if the window is even.
pub fn moving_rms(x: &[f64], window: usize) -> Result<Vec<f64>, SignalError> {
    let squares: Vec<f64> = x.iter().map(|v| v * v).collect();
    Ok(moving_mean(&squares, window)?.into_iter().map(f64::sqrt).collect())
}

/// Savitzky–Golay smoothing: each sample is replaced by the value there of the polynomial of order `order` that fits
/// the `window` samples around it best. The first and last half window take the polynomial of the first and last full
/// window (`scipy.signal.savgol_filter` with `mode="interp"`).
///
/// # Errors
/// - [`SignalError::Window`]: even, or not longer than the order
/// - [`SignalError::TooShort`]: fewer samples than the window
/// - [`SignalError::NotFinite`]
///
/// # References
/// Savitzky & Golay (1964), doi:10.1021/ac60214a047
pub fn savitzky_golay(x: &[f64], order: usize, window: usize) -> Result<Vec<f64>, SignalError> {
    if window.is_multiple_of(2) || window <= order {
        let expected = format!("an odd number of samples, more than the polynomial's order {order}");
        return Err(SignalError::Window { found: window, expected });
    }
    if x.len() < window {
        return Err(SignalError::TooShort { found: x.len(), expected: window });
    }
    finite(x)?;
    let half = window / 2;
    let basis = orthonormal_polynomials(order, window);
    let weights: DVector<f64> = &basis * basis.row(half).transpose();
    let mut y: Vec<f64> = x.to_vec();
    for (centre, samples) in x.windows(window).enumerate() {
        let weights = weights.as_slice();
        y[centre + half] = sum_of(window, |k| samples[k] * weights[k]);
    }
    let fitted = |samples: &[f64]| &basis * (basis.transpose() * DVector::from_column_slice(samples));
    let (first, last) = (fitted(&x[..window]), fitted(&x[x.len() - window..]));
    let end = x.len();
    for i in 0..half {
        y[i] = first[i];
        y[end - 1 - i] = last[window - 1 - i];
    }
    Ok(y)
}

/// Values of polynomials of degree 0 to `order` that are orthonormal over `window` equally spaced points, one a column.
fn orthonormal_polynomials(order: usize, window: usize) -> DMatrix<f64> {
    let half = (window / 2).max(1) as f64;
    let at = |i: usize| (i as f64 - (window / 2) as f64) / half;
    DMatrix::from_fn(window, order + 1, |i, degree| at(i).powi(degree as i32)).qr().q()
}
