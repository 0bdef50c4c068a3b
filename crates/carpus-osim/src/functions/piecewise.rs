//! Functions defined piecewise by points: linear and constant.

use super::error::FunctionError;
use super::points::{ROUNDOFF_ERROR, TINY_NUMBER, bisect, check_points};

/// A point and the slope to its right.
#[derive(Clone, Copy, Debug)]
struct Knot {
    x: f64,
    y: f64,
    slope: f64,
}

/// OpenSim's `PiecewiseLinearFunction`: linear between points, extrapolated with the slopes of the ends.
#[derive(Clone, Debug)]
pub(super) struct PiecewiseLinear {
    knots: Box<[Knot]>,
}

impl PiecewiseLinear {
    pub(super) fn new(x: &[f64], y: &[f64]) -> Result<Self, FunctionError> {
        check_points("PiecewiseLinearFunction", x, y, 1, false)?;
        let n = x.len();
        let slope = |i: usize| (y[i + 1] - y[i]) / TINY_NUMBER.max(x[i + 1] - x[i]);
        let knots =
            (0..n).map(|i| Knot { x: x[i], y: y[i], slope: if n == 1 { 0.0 } else { slope(i.min(n - 2)) } }).collect();
        Ok(Self { knots })
    }

    /// The knot from which the function extends linearly to `x`.
    fn knot_for(&self, x: f64) -> &Knot {
        let (first, last) = (&self.knots[0], &self.knots[self.knots.len() - 1]);
        if x < first.x || (x - first.x).abs() <= ROUNDOFF_ERROR {
            return first;
        }
        if x > last.x || (x - last.x).abs() <= ROUNDOFF_ERROR {
            return last;
        }
        &self.knots[bisect(self.knots.len(), |i| self.knots[i].x, x)]
    }

    pub(super) fn value(&self, x: f64) -> f64 {
        let knot = self.knot_for(x);
        knot.y + (x - knot.x) * knot.slope
    }

    pub(super) fn derivative(&self, x: f64) -> f64 {
        self.knot_for(x).slope
    }
}

/// OpenSim's `PiecewiseConstantFunction`: the ordinate of the point to the left.
#[derive(Clone, Debug)]
pub(super) struct PiecewiseConstant {
    points: Box<[(f64, f64)]>,
}

impl PiecewiseConstant {
    pub(super) fn new(x: &[f64], y: &[f64]) -> Result<Self, FunctionError> {
        check_points("PiecewiseConstantFunction", x, y, 1, false)?;
        Ok(Self { points: x.iter().copied().zip(y.iter().copied()).collect() })
    }

    pub(super) fn value(&self, x: f64) -> f64 {
        let (first, last) = (self.points[0], self.points[self.points.len() - 1]);
        if x < first.0 || (x - first.0).abs() <= ROUNDOFF_ERROR {
            return first.1;
        }
        if x > last.0 || (x - last.0).abs() <= ROUNDOFF_ERROR {
            return last.1;
        }
        self.points[bisect(self.points.len(), |i| self.points[i].0, x)].1
    }
}
