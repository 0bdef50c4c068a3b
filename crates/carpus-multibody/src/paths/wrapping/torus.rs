//! Wrapping over a torus around the z axis, centred at the origin (OpenSim's `WrapTorus::wrapLine`).
//!
//! The torus is replaced by the cylinder that is tangent to its tube where the tube's centre circle comes nearest to
//! the segment. The nearest point is found by minimizing with a Levenberg–Marquardt iteration whose loose
//! tolerances (1e-4) and finite-difference step (1e-5 m) show in OpenSim's path lengths; therefore the same iteration
//! is done here.

use super::cylinder;
use super::rounding::normalize_or_zero;
use super::wrap::{Attempt, ConstrainedHalf, Effort, Wrap, WrapAction, WrapPath};
use nalgebra::Vector3;

/// Length of the replacing cylinder [m].
const CYLINDER_LENGTH: f64 = 10_000.0;

/// Wraps the segment from `p1` to `p2` over a torus: `inner_radius` is the radius of the tube and `outer_radius` that
/// of its centre circle [m] (OpenSim's names).
///
/// Once a nearest point exists OpenSim reports `Wrapped`, even if the cylinder then is not wrapped or must be.
pub fn wrap(
    inner_radius: f64,
    outer_radius: f64,
    half: Option<ConstrainedHalf>,
    effort: &Effort,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Attempt {
    let Some(nearest) = nearest_on_circle(outer_radius, half, p1, p2) else {
        return Attempt::Done(Wrap::NO_WRAP);
    };
    // Cylinder frame: x towards the torus' centre, y against its axis; origin on the circle.
    let x = normalize_or_zero(&-nearest);
    let z = x.cross(&Vector3::new(0.0, 0.0, -1.0));
    let into = |p: &Vector3<f64>| {
        let d = p - nearest;
        Vector3::new(x.dot(&d), -d.z, z.dot(&d))
    };
    let out_of = |p: &Vector3<f64>| nearest + x * p.x + Vector3::new(0.0, 0.0, -p.y) + z * p.z;
    let inside = Some(ConstrainedHalf { axis: 0, sign: 1 });
    let effort = Effort { mandatory_is_optional: true, ..*effort };
    match cylinder::wrap(inner_radius, CYLINDER_LENGTH, inside, &effort, &into(p1), &into(p2)) {
        Attempt::Done(Wrap { path, .. }) => {
            let path = path.map(|path| WrapPath { r1: out_of(&path.r1), r2: out_of(&path.r2), length: path.length });
            Attempt::Done(Wrap { action: WrapAction::Wrapped, path })
        }
        Attempt::TooLong { least_change } => Attempt::TooLong { least_change },
    }
}

/// The point on the circle of `radius` in the xy plane nearest to the line of the segment; `None` if it is not on the
/// allowed half. The iteration runs from both ends, and the better result counts.
fn nearest_on_circle(
    radius: f64,
    half: Option<ConstrainedHalf>,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let (a1, a2) = nearest_on_line(radius, p1, p2);
    let first_is_nearer = || squared_distance_to_circle(&a1, radius) < squared_distance_to_circle(&a2, radius);
    let use_first = match half {
        None => first_is_nearer(),
        Some(half) => match (half.holds(&a1), half.holds(&a2)) {
            (true, true) => first_is_nearer(),
            (true, false) => true,
            (false, true) => false,
            (false, false) => return None,
        },
    };
    let a = if use_first { a1 } else { a2 };
    let scale = radius / a.xy().norm();
    Some(Vector3::new(a.x * scale, a.y * scale, 0.0))
}

/// Squared distance of `p` from the circle [m²].
fn squared_distance_to_circle(p: &Vector3<f64>, radius: f64) -> f64 {
    p.norm_squared() + radius * radius - 2.0 * radius * p.xy().norm()
}

/// The function whose root OpenSim looks for along a line, with the coefficients of `WrapTorus::calcCircleResids`.
///
/// It is meant as the derivative of the squared distance to the circle, but its circle term is twice too large; the
/// points found therefore are not the nearest ones, here as in OpenSim.
struct LineToCircle {
    c2: f64,
    c3: f64,
    c4: f64,
    c5: f64,
    radius: f64,
}

impl LineToCircle {
    fn new(start: &Vector3<f64>, direction: &Vector3<f64>, radius: f64) -> LineToCircle {
        let c3 = start.x * direction.x + start.y * direction.y;
        LineToCircle {
            c2: 2.0 * start.dot(direction),
            c3,
            c4: direction.x * direction.x + direction.y * direction.y,
            c5: start.x * start.x + start.y * start.y,
            radius,
        }
    }

    fn residual(&self, u: f64) -> f64 {
        let distance_from_axis = (u * u * self.c4 + 2.0 * self.c3 * u + self.c5).sqrt();
        self.c2 + 2.0 * u - 2.0 * self.radius * (2.0 * self.c4 * u + 2.0 * self.c3) / distance_from_axis
    }
}

/// The points of the line where the iteration ends, started from `p1` and from `p2`.
fn nearest_on_line(radius: f64, p1: &Vector3<f64>, p2: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let forward = (p2 - p1) / (p2 - p1).norm();
    let backward = -forward;
    let mut from1 = Minimization::new(LineToCircle::new(p1, &forward, radius));
    let mut from2 = Minimization::new(LineToCircle::new(p2, &backward, radius));
    // The two are independent; taking turns lets the processor work on both at once.
    while !(from1.is_done && from2.is_done) {
        from1.step();
        from2.step();
    }
    (p1 + forward * from1.x, p2 + backward * from2.x)
}

/// MINPACK's `lmdif` (Moré, Garbow, Hillstrom 1980) for one unknown and one residual as OpenSim calls it: from 0, with
/// relative tolerances 1e-4, a first step of at most 0.2 (scaled by the slope) and a fixed finite difference.
struct Minimization {
    function: LineToCircle,
    /// Position along the line [m].
    x: f64,
    /// Residual there.
    f: f64,
    /// Slope there; recomputed after a successful step.
    slope: f64,
    evaluations: usize,
    lambda: f64,
    scale: f64,
    step_bound: f64,
    x_norm: f64,
    is_first: bool,
    is_done: bool,
}

impl Minimization {
    const TOLERANCE: f64 = 1e-4;
    const STEP_FACTOR: f64 = 0.2;
    const MAX_EVALUATIONS: usize = 500;
    const DIFFERENCE: f64 = 1e-5;

    fn new(function: LineToCircle) -> Minimization {
        let mut start = Minimization {
            x: 0.0,
            f: function.residual(0.0),
            slope: 0.0,
            evaluations: 1,
            lambda: 0.0,
            scale: 0.0,
            step_bound: Self::STEP_FACTOR,
            x_norm: 0.0,
            is_first: true,
            is_done: false,
            function,
        };
        start.differentiate();
        start
    }

    /// Slope at the present point; the end is reached where residual or slope vanish.
    #[inline]
    fn differentiate(&mut self) {
        self.slope = (self.function.residual(self.x + Self::DIFFERENCE) - self.f) / Self::DIFFERENCE;
        self.is_done = self.f == 0.0 || self.slope == 0.0;
        self.scale = self.slope.abs().max(self.scale);
    }

    /// One trial step; nothing if the end is reached.
    #[inline]
    fn step(&mut self) {
        if self.is_done {
            return;
        }
        let step = -trust_region_step(self.slope, self.f, self.scale, self.step_bound, &mut self.lambda);
        let step_norm = (self.scale * step).abs();
        if self.is_first {
            self.step_bound = self.step_bound.min(step_norm);
        }
        let f_new = self.function.residual(self.x + step);
        self.evaluations += 1;
        let relative = (f_new / self.f).abs();
        let actual = if 0.1 * relative < 1.0 { 1.0 - relative * relative } else { -1.0 };
        let gauss_newton_part = (self.slope * step / self.f).powi(2);
        let damping_part = self.lambda * (step_norm / self.f).powi(2);
        let predicted = gauss_newton_part + damping_part / 0.5;
        let ratio = if predicted != 0.0 { actual / predicted } else { 0.0 };
        if ratio <= 0.25 {
            let directional = -(gauss_newton_part + damping_part);
            let mut shrink = if actual >= 0.0 { 0.5 } else { 0.5 * directional / (directional + 0.5 * actual) };
            if 0.1 * relative >= 1.0 || shrink < 0.1 {
                shrink = 0.1;
            }
            self.step_bound = shrink * self.step_bound.min(step_norm / 0.1);
            self.lambda /= shrink;
        } else if self.lambda == 0.0 || ratio >= 0.75 {
            self.step_bound = step_norm / 0.5;
            self.lambda *= 0.5;
        }
        let is_accepted = ratio >= 1e-4;
        if is_accepted {
            self.x += step;
            self.f = f_new;
            self.x_norm = (self.scale * self.x).abs();
            self.is_first = false;
        }
        let agrees = |tolerance: f64| actual.abs() <= tolerance && predicted <= tolerance && 0.5 * ratio <= 1.0;
        if agrees(Self::TOLERANCE)
            || self.step_bound <= Self::TOLERANCE * self.x_norm
            || self.evaluations >= Self::MAX_EVALUATIONS
        {
            self.is_done = true;
        } else if is_accepted {
            self.differentiate();
        }
        // A step that is not a number neither is accepted nor refused: lmdif then starts over from the same point,
        // until the evaluations are used up.
    }
}

/// MINPACK's `lmpar` for one unknown: the step s with |scale·s| ≤ 1.1·step_bound that solves
/// (slope² + λ·scale²)·s = slope·f, and λ, which starts from the previous one.
fn trust_region_step(slope: f64, f: f64, scale: f64, step_bound: f64, lambda: &mut f64) -> f64 {
    const SMALLEST: f64 = 1e-38;
    let mut step = f / slope;
    let mut norm = (scale * step).abs();
    let mut excess = norm - step_bound;
    if excess <= 0.1 * step_bound {
        *lambda = 0.0;
        return step;
    }
    // Newton iteration on the norm of the scaled step as a function of λ, between bounds.
    let newton_slope = (scale / slope).powi(2);
    let mut lower = excess / step_bound / newton_slope;
    let gradient = (slope * f / scale).abs();
    let mut upper = gradient / step_bound;
    if upper == 0.0 {
        upper = SMALLEST / step_bound.min(0.1);
    }
    *lambda = lambda.max(lower).min(upper);
    if *lambda == 0.0 {
        *lambda = gradient / norm;
    }
    for iteration in 1.. {
        if *lambda == 0.0 {
            *lambda = SMALLEST.max(0.001 * upper);
        }
        let pivot = slope * slope + *lambda * scale * scale;
        step = slope * f / pivot;
        norm = (scale * step).abs();
        let previous_excess = excess;
        excess = norm - step_bound;
        if excess.abs() <= 0.1 * step_bound
            || (lower == 0.0 && excess <= previous_excess && previous_excess < 0.0)
            || iteration == 10
        {
            break;
        }
        let correction = excess / step_bound / (scale * scale / pivot);
        if excess > 0.0 {
            lower = lower.max(*lambda);
        }
        if excess < 0.0 {
            upper = upper.min(*lambda);
        }
        *lambda = lower.max(*lambda + correction);
    }
    step
}
