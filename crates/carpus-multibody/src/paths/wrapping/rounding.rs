//! Signs, zeros and directions as OpenSim takes them.

use nalgebra::Vector3;

/// OpenSim's `DSIGN`: +1 for zero and above, else −1 (also for NaN).
#[inline]
pub(super) fn sign(x: f64) -> i8 {
    if x >= 0.0 { 1 } else { -1 }
}

/// OpenSim's `ROUNDOFF_ERROR`, the tolerance of `EQUAL_WITHIN_ERROR`.
pub(super) const ROUNDOFF_ERROR: f64 = 2e-13;

/// OpenSim's `EQUAL_WITHIN_ERROR(0, x)`.
#[inline]
pub(super) fn is_zero_within_roundoff(x: f64) -> bool {
    x.abs() <= ROUNDOFF_ERROR
}

/// `v` divided by its norm, or zero if the norm is below machine epsilon (`WrapMath::NormalizeOrZero`).
#[inline]
pub(super) fn normalize_or_zero(v: &Vector3<f64>) -> Vector3<f64> {
    let norm = v.norm();
    if norm >= f64::EPSILON { v * (1.0 / norm) } else { Vector3::zeros() }
}
