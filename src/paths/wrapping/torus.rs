//! Wrapping over a torus around the z axis, centred at the origin (OpenSim's `WrapTorus::wrapLine`).
//!
//! The torus is replaced by the cylinder that is tangent to its tube where the tube's centre circle comes nearest to
//! the segment. The nearest point is found by minimizing with a Levenberg–Marquardt iteration whose loose
//! tolerances (1e-4) and finite-difference step (1e-5 m) show in OpenSim's path lengths; therefore the same iteration
//! is done here.

use super::{ConstrainedHalf, Wrap, WrapAction, WrapPath, cylinder, normalize_or_zero};
use nalgebra::Vector3;

/// Length of the replacing cylinder [m].
const CYLINDER_LENGTH: f64 = 10_000.0;

/// Wraps the segment from `p1` to `p2` over a torus: `inner_radius` is the radius of the tube and `outer_radius` that
/// of its centre circle [m] (OpenSim's names).
///
/// Once a nearest point exists OpenSim reports `Wrapped` even if the cylinder then is not wrapped.
pub fn wrap(
    inner_radius: f64,
    outer_radius: f64,
    half: Option<ConstrainedHalf>,
    find_tangency: bool,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Wrap {
    let Some(nearest) = nearest_on_circle(outer_radius, half, p1, p2) else {
        return Wrap::NO_WRAP;
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
    let wrap = cylinder::wrap(inner_radius, CYLINDER_LENGTH, inside, find_tangency, &into(p1), &into(p2));
    let path = wrap.path.map(|path| WrapPath { r1: out_of(&path.r1), r2: out_of(&path.r2), length: path.length });
    Wrap { action: WrapAction::Wrapped, path }
}

/// The point on the circle of `radius` in the xy plane nearest to the line of the segment; `None` if it is not on the
/// allowed half. The iteration runs from both ends, and the better result counts.
fn nearest_on_circle(
    radius: f64,
    half: Option<ConstrainedHalf>,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let from = |start: &Vector3<f64>, end: &Vector3<f64>| {
        let direction = (end - start) / (end - start).norm();
        start + direction * LineToCircle::new(start, &direction, radius).minimize()
    };
    let (a1, a2) = (from(p1, p2), from(p2, p1));
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

    /// Position along the line [m] where MINPACK's `lmdif`, as OpenSim calls it, ends from 0: one unknown, one
    /// residual, relative tolerances 1e-4 and a first step of at most 0.2 (scaled by the slope).
    fn minimize(&self) -> f64 {
        const TOLERANCE: f64 = 1e-4;
        const STEP_FACTOR: f64 = 0.2;
        const MAX_EVALUATIONS: usize = 500;
        const DIFFERENCE: f64 = 1e-5;
        const MACHINE_PRECISION: f64 = 1.2e-16;

        let mut x = 0.0;
        let mut f = self.residual(x);
        let mut evaluations = 1;
        let mut lambda = 0.0;
        let mut scale = 0.0;
        let mut step_bound = STEP_FACTOR;
        let mut x_norm = 0.0;
        let mut first = true;
        loop {
            let slope = (self.residual(x + DIFFERENCE) - f) / DIFFERENCE;
            if f == 0.0 || slope == 0.0 {
                return x;
            }
            if scale == 0.0 {
                scale = slope.abs();
            }
            scale = slope.abs().max(scale);
            loop {
                let step = -trust_region_step(slope, f, scale, step_bound, &mut lambda);
                let step_norm = (scale * step).abs();
                if first {
                    step_bound = step_bound.min(step_norm);
                }
                let f_new = self.residual(x + step);
                evaluations += 1;
                let f_norm = f.abs();
                let actual = if 0.1 * f_new.abs() < f_norm { 1.0 - (f_new.abs() / f_norm).powi(2) } else { -1.0 };
                let gauss_newton_part = (slope * step / f_norm).powi(2);
                let damping_part = lambda * (step_norm / f_norm).powi(2);
                let predicted = gauss_newton_part + damping_part / 0.5;
                let directional = -(gauss_newton_part + damping_part);
                let ratio = if predicted != 0.0 { actual / predicted } else { 0.0 };
                if ratio <= 0.25 {
                    let mut shrink = if actual >= 0.0 { 0.5 } else { 0.5 * directional / (directional + 0.5 * actual) };
                    if 0.1 * f_new.abs() >= f_norm || shrink < 0.1 {
                        shrink = 0.1;
                    }
                    step_bound = shrink * step_bound.min(step_norm / 0.1);
                    lambda /= shrink;
                } else if lambda == 0.0 || ratio >= 0.75 {
                    step_bound = step_norm / 0.5;
                    lambda *= 0.5;
                }
                if ratio >= 1e-4 {
                    x += step;
                    f = f_new;
                    x_norm = (scale * x).abs();
                    first = false;
                }
                let agrees = |tolerance: f64| actual.abs() <= tolerance && predicted <= tolerance && 0.5 * ratio <= 1.0;
                if agrees(TOLERANCE)
                    || step_bound <= TOLERANCE * x_norm
                    || evaluations >= MAX_EVALUATIONS
                    || agrees(MACHINE_PRECISION)
                    || step_bound <= MACHINE_PRECISION * x_norm
                {
                    return x;
                }
                if !(ratio < 1e-4) {
                    break;
                }
            }
        }
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
