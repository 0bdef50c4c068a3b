//! Curves joined from C-shaped quintic Bézier corners, as OpenSim's muscle curves are.
//!
//! A corner is a pair of polynomials x(u), y(u), 0 ≤ u ≤ 1; y(x) needs the inverse u(x). A table of local cubic
//! expansions of u(x) gives u to within [`GUESS_TOLERANCE`]; one Newton step, done as a Taylor expansion so that every
//! polynomial is evaluated once, then reaches machine precision.

use std::sync::OnceLock;

use super::scalar::Scalar;
use thiserror::Error;

/// Largest error in u of the tabulated guess; its square is below the precision of an `f64`.
const GUESS_TOLERANCE: f64 = 1e-7;
/// Cells per corner to start with and at most.
const CELLS: std::ops::RangeInclusive<usize> = 32..=512;

/// Corners of the longest curve, the active force–length curve.
const MOST_CORNERS: usize = 5;

/// Control points of one corner, in OpenSim's order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuinticCorner {
    /// Abscissae of the six control points.
    pub x: [f64; 6],
    /// Ordinates of the six control points.
    pub y: [f64; 6],
}

/// Why a corner cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum CornerError {
    /// The tangents at the ends meet too far away: the section would be S-shaped, not C-shaped.
    #[error("the tangents at ({x0}, {y0}) and ({x1}, {y1}) do not form a C-shaped corner")]
    NotCShaped {
        /// Start.
        x0: f64,
        /// Start.
        y0: f64,
        /// End.
        x1: f64,
        /// End.
        y1: f64,
    },
}

impl QuinticCorner {
    /// The corner from `(x0, y0)` with slope `dydx0` to `(x1, y1)` with slope `dydx1`.
    ///
    /// - `curviness`: 0 (straight) to 1 (sharp corner)
    ///
    /// # Errors
    /// [`CornerError::NotCShaped`] if the tangents meet farther from an end than the ends are apart.
    ///
    /// # References
    /// OpenSim `SegmentedQuinticBezierToolkit::calcQuinticBezierCornerControlPoints`.
    pub fn new(
        [x0, y0, dydx0]: [f64; 3],
        [x1, y1, dydx1]: [f64; 3],
        curviness: f64,
    ) -> Result<QuinticCorner, CornerError> {
        let x_c = if (dydx0 - dydx1).abs() > f64::EPSILON.sqrt() {
            (y1 - y0 - x1 * dydx1 + x0 * dydx0) / (dydx0 - dydx1)
        } else {
            (x1 + x0) / 2.0
        };
        let y_c = (x_c - x1) * dydx1 + y1;
        let squared_distance = |dx: f64, dy: f64| dx * dx + dy * dy;
        let to_start = squared_distance(x_c - x0, y_c - y0);
        let to_end = squared_distance(x_c - x1, y_c - y1);
        let apart = squared_distance(x1 - x0, y1 - y0);
        if !(apart > to_start && apart > to_end) {
            return Err(CornerError::NotCShaped { x0, y0, x1, y1 });
        }
        let points = |start: f64, corner: f64, end: f64| {
            let near_start = start + curviness * (corner - start);
            let near_end = end + curviness * (corner - end);
            [start, near_start, near_start, near_end, near_end, end]
        };
        Ok(QuinticCorner { x: points(x0, x_c, x1), y: points(y0, y_c, y1) })
    }
}

/// Value and first derivative of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueAndDerivative {
    /// y(x).
    pub value: f64,
    /// dy/dx.
    pub derivative: f64,
}

/// Polynomial of degree five with its derivatives, lowest powers first.
#[derive(Clone, Copy, Debug)]
struct Quintic {
    value: [f64; 6],
    first: [f64; 5],
    /// Half the second derivative.
    half_second: [f64; 4],
}

impl Quintic {
    fn new(c: [f64; 6]) -> Quintic {
        Quintic {
            value: c,
            first: [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 5.0 * c[5]],
            half_second: [c[2], 3.0 * c[3], 6.0 * c[4], 10.0 * c[5]],
        }
    }

    /// Power form of a Bézier polynomial.
    fn from_bezier(p: &[f64; 6]) -> Quintic {
        Quintic::new([
            p[0],
            5.0 * (p[1] - p[0]),
            10.0 * (p[2] - 2.0 * p[1] + p[0]),
            10.0 * (p[3] - 3.0 * p[2] + 3.0 * p[1] - p[0]),
            5.0 * (p[4] - 4.0 * p[3] + 6.0 * p[2] - 4.0 * p[1] + p[0]),
            p[5] - 5.0 * p[4] + 10.0 * p[3] - 10.0 * p[2] + 5.0 * p[1] - p[0],
        ])
    }

    /// Value, first derivative and half the second derivative; short dependency chains rather than Horner's rule.
    #[inline]
    fn expand(&self, u: f64) -> [f64; 3] {
        let (c, d, e) = (&self.value, &self.first, &self.half_second);
        let u2 = u * u;
        let u4 = u2 * u2;
        [
            (c[0] + c[1] * u) + (c[2] + c[3] * u) * u2 + (c[4] + c[5] * u) * u4,
            (d[0] + d[1] * u) + (d[2] + d[3] * u) * u2 + d[4] * u4,
            (e[0] + e[1] * u) + (e[2] + e[3] * u) * u2,
        ]
    }

    /// Sixth part of the third derivative.
    fn third(&self, u: f64) -> f64 {
        let c = &self.value;
        c[3] + 4.0 * c[4] * u + 10.0 * c[5] * u * u
    }
}

/// One corner, ready for evaluation.
#[derive(Clone, Debug)]
struct Segment {
    x_start: f64,
    x_end: f64,
    /// x(u) − `x_start`.
    x: Quintic,
    /// y(u).
    y: Quintic,
    /// Guesses of u(x), made when the first is asked for: many curves are only ever read through tables of their own.
    guesses: OnceLock<Guesses>,
}

/// Local cubic expansions of u(x) on cells of equal width.
#[derive(Clone, Debug)]
struct Guesses {
    /// Reciprocal of the width of a cell.
    cells_per_x: f64,
    /// Half the width of a cell.
    half_cell: f64,
    /// Per cell: u and its derivatives (Taylor coefficients) at the cell's middle.
    cells: Vec<[f64; 4]>,
}

impl Segment {
    fn new(corner: &QuinticCorner) -> Segment {
        let x_start = corner.x[0];
        Segment {
            x_start,
            x_end: corner.x[5],
            x: Quintic::from_bezier(&corner.x.map(|x| x - x_start)),
            y: Quintic::from_bezier(&corner.y),
            guesses: OnceLock::new(),
        }
    }

    #[cold]
    fn tabulate(&self) -> Guesses {
        let mut count = *CELLS.start();
        loop {
            let last = count >= *CELLS.end();
            if let Some(guesses) = self.tabulated(count, if last { f64::INFINITY } else { GUESS_TOLERANCE }) {
                return guesses;
            }
            count *= 2;
        }
    }

    /// Guesses in `count` cells; `None` if one is farther off than `tolerance` at an edge of its cell.
    fn tabulated(&self, count: usize, tolerance: f64) -> Option<Guesses> {
        let width = self.x_end - self.x_start;
        let cell = width / count as f64;
        let mut cells = Vec::with_capacity(count);
        let mut left = self.solve_slowly(0.0);
        for i in 0..count {
            let middle = (i as f64 + 0.5) * cell;
            let u = self.solve_slowly(middle);
            let [_, x1, half_x2] = self.x.expand(u);
            let third_x3 = self.x.third(u);
            // Series reversion of dx = x1 du + half_x2 du² + third_x3 du³.
            let t1 = 1.0 / x1;
            let t2 = -half_x2 * t1 * t1 * t1;
            let t3 = (2.0 * half_x2 * half_x2 - x1 * third_x3) * t1.powi(5);
            cells.push([u, t1, t2, t3]);
            let edge = (i as f64 + 1.0) * cell;
            let right = self.solve_slowly(edge);
            for (edge, exact) in [(i as f64 * cell, left), (edge, right)] {
                let d = edge - middle;
                let guess = (u + d * (t1 + d * (t2 + d * t3))).clamp(0.0, 1.0);
                if (guess - exact).abs() > tolerance {
                    return None;
                }
            }
            left = right;
        }
        Some(Guesses { cells_per_x: count as f64 / width, half_cell: 0.5 * cell, cells })
    }

    /// u where x(u) = `x_start` + `dx`, by bisection and Newton's method.
    fn solve_slowly(&self, dx: f64) -> f64 {
        self.refine(dx, dx / (self.x_end - self.x_start))
    }

    /// Improves the guess `u` of the solution of x(u) = `x_start` + `dx` until nothing changes.
    #[cold]
    fn refine(&self, dx: f64, u: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        let mut u = if (0.0..=1.0).contains(&u) { u } else { 0.5 };
        for _ in 0..80 {
            let [x, slope, _] = self.x.expand(u);
            let residual = x - dx;
            if residual == 0.0 {
                break;
            }
            if residual < 0.0 {
                low = u;
            } else {
                high = u;
            }
            let newton = u - residual / slope;
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            if (next - u).abs() <= 0.5 * f64::EPSILON {
                u = next;
                break;
            }
            u = next;
        }
        u
    }

    /// u within [`GUESS_TOLERANCE`] of the solution of x(u) = x, and the Newton step that remains.
    #[inline]
    fn locate(&self, x: f64) -> Located {
        let guesses = self.guesses.get_or_init(|| self.tabulate());
        let dx = x - self.x_start;
        let index = ((dx * guesses.cells_per_x) as i32 as usize).min(guesses.cells.len() - 1);
        let d = dx - (2.0 * index as f64 + 1.0) * guesses.half_cell;
        let [t0, t1, t2, t3] = guesses.cells[index];
        let u = t0 + (d * t1 + (d * d) * (t2 + d * t3));
        let [at, x1, half_x2] = self.x.expand(u);
        let du_dx = 1.0 / x1;
        let step = (dx - at) * du_dx;
        if step.abs() > 4.0 * GUESS_TOLERANCE {
            let u = self.refine(dx, u);
            let [_, x1, half_x2] = self.x.expand(u);
            return Located { u, step: 0.0, du_dx: 1.0 / x1, half_x2 };
        }
        Located { u, step, du_dx, half_x2 }
    }
}

/// Where on a corner an abscissa lies.
struct Located {
    /// Guess of the curve parameter.
    u: f64,
    /// What is missing to the curve parameter.
    step: f64,
    /// 1/x′ at the guess.
    du_dx: f64,
    /// Half of x″ at the guess.
    half_x2: f64,
}

/// A smooth curve y(x): quintic Bézier corners, continued linearly beyond both ends.
///
/// Values and first and second derivatives agree with OpenSim's `SmoothSegmentedFunction` to rounding.
#[derive(Clone, Debug)]
pub struct SmoothSegmentedFunction {
    segments: Vec<Segment>,
    /// Ends of all segments but the last, filled up with infinity: comparing with all of them needs no branch.
    breaks: [f64; MOST_CORNERS - 1],
    start: [f64; 3],
    end: [f64; 3],
}

impl SmoothSegmentedFunction {
    /// The curve through `corners`, in order of x, each starting where the one before ends.
    ///
    /// - `slope_start`, `slope_end`: slopes of the linear continuations
    ///
    /// # Panics
    /// If there are no corners or more than five.
    pub fn new(corners: &[QuinticCorner], slope_start: f64, slope_end: f64) -> SmoothSegmentedFunction {
        assert!((1..=MOST_CORNERS).contains(&corners.len()), "{} corners", corners.len());
        let (first, last) = (&corners[0], &corners[corners.len() - 1]);
        let mut breaks = [f64::INFINITY; MOST_CORNERS - 1];
        for (end, corner) in breaks.iter_mut().zip(&corners[..corners.len() - 1]) {
            *end = corner.x[5];
        }
        SmoothSegmentedFunction {
            breaks,
            segments: corners.iter().map(Segment::new).collect(),
            start: [first.x[0], first.y[0], slope_start],
            end: [last.x[5], last.y[5], slope_end],
        }
    }

    /// First and last x of the curved part.
    pub fn domain(&self) -> [f64; 2] {
        [self.start[0], self.end[0]]
    }

    #[inline]
    fn segment(&self, x: f64) -> &Segment {
        let index: usize = self.breaks.iter().map(|&end| usize::from(x >= end)).sum();
        &self.segments[index]
    }

    /// The straight line beyond an end, if `x` lies there.
    #[inline]
    fn beyond(&self, x: f64) -> Option<ValueAndDerivative> {
        let [x0, y0, slope] = if x < self.start[0] {
            self.start
        } else if x > self.end[0] {
            self.end
        } else {
            return None;
        };
        Some(ValueAndDerivative { value: y0 + slope * (x - x0), derivative: slope })
    }

    /// y(x) and dy/dx; NaN for NaN.
    #[inline]
    pub fn value_and_derivative(&self, x: f64) -> ValueAndDerivative {
        if let Some(line) = self.beyond(x) {
            return line;
        }
        let segment = self.segment(x);
        let Located { u, step, du_dx, half_x2 } = segment.locate(x);
        let [y, y1, half_y2] = segment.y.expand(u);
        // Second-order Taylor terms of u(x) = u + step − (x″/2x′) step² and of 1/x′ leave errors of third order.
        let bend = step * half_x2 * du_dx;
        let step = step * (1.0 - bend);
        ValueAndDerivative {
            value: y + step * (y1 + step * half_y2),
            derivative: (y1 + 2.0 * step * half_y2) * du_dx * (1.0 - 2.0 * bend * (1.0 - 2.0 * bend)),
        }
    }

    /// y(x).
    #[inline]
    pub fn value(&self, x: f64) -> f64 {
        self.value_and_derivative(x).value
    }

    /// dy/dx.
    #[inline]
    pub fn derivative(&self, x: f64) -> f64 {
        self.value_and_derivative(x).derivative
    }

    /// d²y/dx²; zero beyond the ends.
    pub fn second_derivative(&self, x: f64) -> f64 {
        if self.beyond(x).is_some() {
            return 0.0;
        }
        let segment = self.segment(x);
        let located = segment.locate(x);
        let u = (located.u + located.step).clamp(0.0, 1.0);
        let [_, x1, half_x2] = segment.x.expand(u);
        let [_, y1, half_y2] = segment.y.expand(u);
        2.0 * (half_y2 - y1 / x1 * half_x2) / (x1 * x1)
    }

    /// y(x) with the derivatives that x carries.
    #[inline]
    pub fn evaluate<S: Scalar>(&self, x: S) -> S {
        let at = self.value_and_derivative(x.value());
        x.chain(at.value, at.derivative)
    }

    /// dy/dx with the derivatives that x carries.
    pub fn evaluate_derivative<S: Scalar>(&self, x: S) -> S {
        x.chain(self.derivative(x.value()), self.second_derivative(x.value()))
    }

    /// The x where `a`·y(x) + `b`·x = `target`, with y and dy/dx there; for a curve that never falls.
    ///
    /// On a corner the equation is a polynomial in u, so that no inverse is needed.
    /// - `a` ≥ 0, `b` > 0: weights; the left side then rises strictly and has one solution
    pub fn solve_weighted_sum(&self, a: f64, b: f64, target: f64) -> (f64, ValueAndDerivative) {
        let line = |[x0, y0, slope]: [f64; 3]| {
            let x = (target - a * (y0 - slope * x0)) / (a * slope + b);
            (x, ValueAndDerivative { value: y0 + slope * (x - x0), derivative: slope })
        };
        let side = |[x0, y0, _]: [f64; 3]| a * y0 + b * x0;
        let (mut f_low, last) = (side(self.start), side(self.end));
        if target <= f_low {
            return line(self.start);
        }
        if target >= last {
            return line(self.end);
        }
        let mut found = None;
        for segment in &self.segments {
            let f_high = a * segment.y.value.iter().sum::<f64>() + b * segment.x_end;
            if target <= f_high {
                found = Some((segment, f_high));
                break;
            }
            f_low = f_high;
        }
        // NaN reaches this point without a segment.
        let Some((segment, f_high)) = found else {
            return (f64::NAN, ValueAndDerivative { value: f64::NAN, derivative: f64::NAN });
        };
        let mut sum = [0.0; 6];
        for i in 0..6 {
            sum[i] = a * segment.y.value[i] + b * segment.x.value[i];
        }
        sum[0] += b * segment.x_start - target;
        let u = root_of_rising(&Quintic::new(sum), (target - f_low) / (f_high - f_low));
        let [x, x1, _] = segment.x.expand(u);
        let [y, y1, _] = segment.y.expand(u);
        (segment.x_start + x, ValueAndDerivative { value: y, derivative: y1 / x1 })
    }
}

/// Root in [0, 1] of a polynomial that rises from below zero to above zero, from the guess `u`.
fn root_of_rising(polynomial: &Quintic, guess: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    let mut u = guess;
    for _ in 0..100 {
        let [f, f1, half_f2] = polynomial.expand(u);
        if f < 0.0 {
            low = u;
        } else {
            high = u;
        }
        // Halley's step: the corner's curvature is strong.
        let step = -f * f1 / (f1 * f1 - f * half_f2);
        let trial = u + step;
        if !(trial >= low && trial <= high) {
            u = 0.5 * (low + high);
            continue;
        }
        u = trial;
        // The error after a Halley step is of third order in the step.
        if step.abs() < 1e-6 {
            break;
        }
    }
    u
}
