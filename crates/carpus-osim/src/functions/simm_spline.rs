//! SIMM's natural cubic spline, OpenSim's `SimmSpline`.

use super::error::FunctionError;
use super::points::{ROUNDOFF_ERROR, TINY_NUMBER, bisect, check_points};

/// A point and the cubic to its right: `y + dx·(b + dx·(c + dx·d))`.
#[derive(Clone, Copy, Debug, Default)]
struct Knot {
    x: f64,
    y: f64,
    b: f64,
    c: f64,
    d: f64,
}

/// A cubic spline whose third derivative at both ends is that of the cubic through the four outermost points
/// (Forsythe, Malcolm & Moler 1977, *Computer Methods for Mathematical Computations*, routine SPLINE); extrapolated
/// linearly. Two points: a line. Mirrors OpenSim's `SimmSpline`, including the smallest interval of 1e-7.
#[derive(Clone, Debug)]
pub(super) struct SimmSpline {
    knots: Box<[Knot]>,
}

impl SimmSpline {
    pub(super) fn fit(x: &[f64], y: &[f64]) -> Result<Self, FunctionError> {
        check_points("SimmSpline", x, y, 2, false)?;
        let n = x.len();
        let mut knots: Vec<Knot> = x.iter().zip(y).map(|(&x, &y)| Knot { x, y, ..Knot::default() }).collect();
        let width = |i: usize, j: usize| TINY_NUMBER.max(x[j] - x[i]);
        if n == 2 {
            let slope = (y[1] - y[0]) / width(0, 1);
            knots.iter_mut().for_each(|knot| knot.b = slope);
            return Ok(Self { knots: knots.into() });
        }
        let h: Vec<f64> = (0..n - 1).map(|i| width(i, i + 1)).collect();
        let secant: Vec<f64> = (0..n - 1).map(|i| (y[i + 1] - y[i]) / h[i]).collect();
        let sigma = Self::solve_for_curvatures(n, &h, &secant, width);

        for i in 0..n - 1 {
            knots[i].b = secant[i] - h[i] * (sigma[i + 1] + 2.0 * sigma[i]);
            knots[i].c = 3.0 * sigma[i];
            knots[i].d = (sigma[i + 1] - sigma[i]) / h[i];
        }
        let last = n - 1;
        knots[last].b = secant[last - 1] + h[last - 1] * (sigma[last - 1] + 2.0 * sigma[last]);
        knots[last].c = 3.0 * sigma[last];
        knots[last].d = knots[last - 1].d;
        Ok(Self { knots: knots.into() })
    }

    /// One sixth of the second derivative at each point, from the symmetric tridiagonal system.
    fn solve_for_curvatures(n: usize, h: &[f64], secant: &[f64], width: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let last = n - 1;
        let mut diagonal = vec![0.0; n];
        let mut rhs = vec![0.0; n];
        diagonal[0] = -h[0];
        diagonal[last] = -h[last - 1];
        for i in 1..last {
            diagonal[i] = 2.0 * (h[i - 1] + h[i]);
            rhs[i] = secant[i] - secant[i - 1];
        }
        if n > 3 {
            let first = rhs[2] / width(1, 3) - rhs[1] / width(0, 2);
            let final_ = rhs[last - 1] / width(last - 2, last) - rhs[last - 2] / width(last - 3, last - 1);
            rhs[0] = first * h[0] * h[0] / width(0, 3);
            rhs[last] = -final_ * h[last - 1] * h[last - 1] / width(last - 3, last);
        }
        for i in 1..n {
            let factor = h[i - 1] / diagonal[i - 1];
            diagonal[i] -= factor * h[i - 1];
            rhs[i] -= factor * rhs[i - 1];
        }
        rhs[last] /= diagonal[last];
        for i in (0..last).rev() {
            rhs[i] = (rhs[i] - h[i] * rhs[i + 1]) / diagonal[i];
        }
        rhs
    }

    /// The knot whose cubic holds at `x`, and whether `x` is an end or beyond it.
    fn knot_for(&self, x: f64) -> (&Knot, Place) {
        let (first, last) = (&self.knots[0], &self.knots[self.knots.len() - 1]);
        if x < first.x {
            return (first, Place::Beyond);
        }
        if x > last.x {
            return (last, Place::Beyond);
        }
        if (x - first.x).abs() <= ROUNDOFF_ERROR {
            return (first, Place::AtEnd);
        }
        if (x - last.x).abs() <= ROUNDOFF_ERROR {
            return (last, Place::AtEnd);
        }
        let k = if self.knots.len() < 3 { 0 } else { bisect(self.knots.len(), |i| self.knots[i].x, x) };
        (&self.knots[k], Place::Inside)
    }

    pub(super) fn value(&self, x: f64) -> f64 {
        let (knot, place) = self.knot_for(x);
        let dx = x - knot.x;
        match place {
            Place::Beyond => knot.y + dx * knot.b,
            Place::AtEnd => knot.y,
            Place::Inside => knot.y + dx * (knot.b + dx * (knot.c + dx * knot.d)),
        }
    }

    pub(super) fn derivative(&self, x: f64) -> f64 {
        let (knot, place) = self.knot_for(x);
        let dx = x - knot.x;
        match place {
            Place::Beyond | Place::AtEnd => knot.b,
            Place::Inside => knot.b + dx * (2.0 * knot.c + 3.0 * dx * knot.d),
        }
    }

    pub(super) fn second_derivative(&self, x: f64) -> f64 {
        let (knot, place) = self.knot_for(x);
        match place {
            Place::Beyond => 0.0,
            Place::AtEnd => 2.0 * knot.c,
            Place::Inside => 2.0 * knot.c + 6.0 * (x - knot.x) * knot.d,
        }
    }
}

/// Where an argument lies with respect to the points.
#[derive(Clone, Copy)]
enum Place {
    Inside,
    AtEnd,
    Beyond,
}
