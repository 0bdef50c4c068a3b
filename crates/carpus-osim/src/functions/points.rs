//! Checks of numbers and points, and where among them an argument lies.

use super::error::FunctionError;

/// Two abscissae closer than this are treated as equal (`ROUNDOFF_ERROR` of OpenSim's `SimmMacros.h`).
pub(super) const ROUNDOFF_ERROR: f64 = 2e-13;

/// Narrowest interval between two points (`TINY_NUMBER` of OpenSim's `SimmMacros.h`).
pub(super) const TINY_NUMBER: f64 = 1e-7;

/// `value` if it is finite.
pub(super) fn finite(class: &'static str, property: &'static str, value: f64) -> Result<f64, FunctionError> {
    if value.is_finite() { Ok(value) } else { Err(FunctionError::NotFinite { class, property, found: value }) }
}

/// Checks the points of a tabulated function; `strict` forbids equal neighbours.
pub(super) fn check_points(
    class: &'static str,
    x: &[f64],
    y: &[f64],
    fewest: usize,
    strict: bool,
) -> Result<(), FunctionError> {
    if x.len() != y.len() {
        return Err(FunctionError::LengthMismatch { class, x: x.len(), y: y.len() });
    }
    if x.len() < fewest {
        return Err(FunctionError::TooFewPoints { class, expected: fewest, found: x.len() });
    }
    for (&x, &y) in x.iter().zip(y) {
        finite(class, "x", x)?;
        finite(class, "y", y)?;
    }
    for (i, pair) in x.windows(2).enumerate() {
        if pair[1] < pair[0] || (strict && pair[1] == pair[0]) {
            return Err(FunctionError::NotIncreasing { class, index: i + 2, previous: pair[0], next: pair[1] });
        }
    }
    Ok(())
}

/// The interval k with `x(k) ≤ at ≤ x(k + 1)`, found by OpenSim's bisection so that a knot falls into the same one
/// of its two intervals as there. `at` must lie strictly inside the points.
pub(super) fn bisect(n: usize, x: impl Fn(usize) -> f64, at: f64) -> usize {
    let (mut low, mut high) = (0, n);
    loop {
        let k = (low + high) / 2;
        if at < x(k) {
            high = k;
        } else if k + 1 < n && at > x(k + 1) {
            low = k;
        } else {
            return k.min(n.saturating_sub(2));
        }
    }
}
