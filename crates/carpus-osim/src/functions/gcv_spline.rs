//! Generalized cross-validatory natural splines of degree 1, 3, 5 and 7: OpenSim's `GCVSpline`.
//!
//! The fit follows H. J. Woltring (1986), "A FORTRAN package for generalized, cross-validatory spline smoothing and
//! differentiation", Advances in Engineering Software 8(2):104–113, doi:10.1016/0141-1195(86)90098-7, the algorithm
//! behind Simbody's `SplineFitter`. OpenSim evaluates the B-spline recursion at every call; here the spline is turned
//! into one polynomial per interval once.

mod evaluate;
mod smoothing;

use super::error::FunctionError;
use super::points::{check_points, finite};

/// A natural spline of degree 2m − 1, as polynomials about the left end of each interval.
#[derive(Clone, Debug)]
pub(super) struct GcvSpline {
    /// Abscissae of the data.
    x: Box<[f64]>,
    /// Number of polynomial coefficients per interval, 2m.
    order: usize,
    /// Coefficients by rising power of (x − origin): before the first point (about it), each interval (about its left
    /// point), beyond the last point (about it); `order` each.
    coefficients: Box<[f64]>,
}

impl GcvSpline {
    pub(super) fn fit(half_order: usize, error_variance: f64, x: &[f64], y: &[f64]) -> Result<Self, FunctionError> {
        if !(1..=4).contains(&half_order) {
            return Err(FunctionError::HalfOrder { found: half_order });
        }
        finite("GCVSpline", "error_variance", error_variance)?;
        check_points("GCVSpline", x, y, 2 * half_order, true)?;
        let variance = (error_variance >= 0.0).then_some(error_variance);
        let b_spline = smoothing::fit(half_order, x, y, variance);
        let order = 2 * half_order;
        let mut coefficients = Vec::with_capacity((x.len() + 1) * order);
        for interval in 0..=x.len() {
            let origin = x[interval.saturating_sub(1)];
            let mut factorial = 1.0;
            for power in 0..order {
                factorial *= power.max(1) as f64;
                let derivative = evaluate::derivative(power, half_order, origin, x, &b_spline, interval);
                coefficients.push(derivative / factorial);
            }
        }
        if !coefficients.iter().all(|c: &f64| c.is_finite()) {
            return Err(FunctionError::OutOfRange { class: "GCVSpline" });
        }
        Ok(Self { x: x.into(), order, coefficients: coefficients.into() })
    }

    /// Polynomial coefficients that hold at `x`, and the distance from their origin.
    fn piece(&self, x: f64) -> (&[f64], f64) {
        let interval = self.x.partition_point(|&knot| knot <= x);
        let piece = &self.coefficients[interval * self.order..(interval + 1) * self.order];
        (piece, x - self.x[interval.saturating_sub(1)])
    }

    pub(super) fn value(&self, x: f64) -> f64 {
        let (piece, dx) = self.piece(x);
        piece.iter().rev().fold(0.0, |sum, c| sum * dx + c)
    }

    /// Derivative of order 1 or 2.
    pub(super) fn derivative(&self, x: f64, order: usize) -> f64 {
        let (piece, dx) = self.piece(x);
        piece.iter().enumerate().skip(order).rev().fold(0.0, |sum, (power, c)| {
            let factor = (0..order).map(|k| (power - k) as f64).product::<f64>();
            sum * dx + factor * c
        })
    }
}
