//! Closest point on an ellipsoid or ellipse (Hart, "Distance to an ellipsoid", Graphics Gems IV, 1994), as in
//! OpenSim's `WrapEllipsoid::findClosestPoint` and `closestPointToEllipse`.

use super::super::rounding::is_zero_within_roundoff;
use nalgebra::Vector3;

const MAX_ITERATIONS: usize = 64;
/// Newton's iteration ends when the polynomial's absolute value is below this.
const TOLERANCE: f64 = 1e-9;

/// Moves `closest` to the point of the ellipsoid with semi-axes `a` that is closest to `p`. Points on a coordinate
/// plane are handled in that plane. If the iteration does not converge, `closest` keeps its value, as in OpenSim.
///
/// - `dimensions`: unscaled semi-axes, which decide among several coordinate planes
pub(super) fn on_ellipsoid(a: &Vector3<f64>, dimensions: &Vector3<f64>, p: &Vector3<f64>, closest: &mut Vector3<f64>) {
    let mut plane = None;
    let mut smallest = f64::INFINITY;
    for axis in 0..3 {
        if is_zero_within_roundoff(p[axis]) {
            let sum = match axis {
                0 => dimensions[1] + dimensions[2],
                1 => dimensions[0] + dimensions[2],
                _ => dimensions[0] + dimensions[1],
            };
            if smallest > sum {
                plane = Some(axis);
                smallest = sum;
            }
        }
    }
    match plane {
        Some(axis) => in_coordinate_plane(a, p, axis, closest),
        None => {
            if let Some(point) = general(a, p) {
                *closest = point;
            }
        }
    }
}

/// Moves `closest` to the closest point of the ellipse that the plane of constant `axis` through the centre cuts out;
/// the component along `axis` stays that of `p`.
pub(super) fn in_coordinate_plane(a: &Vector3<f64>, p: &Vector3<f64>, axis: usize, closest: &mut Vector3<f64>) {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let (x, y) = on_ellipse(a[i], a[j], p[i], p[j]);
    closest[axis] = p[axis];
    closest[i] = x;
    closest[j] = y;
}

/// Newton's iteration for a point off the coordinate planes.
fn general(a: &Vector3<f64>, p: &Vector3<f64>) -> Option<Vector3<f64>> {
    let [a2, b2, c2] = [a.x * a.x, a.y * a.y, a.z * a.z];
    let (a2u2, b2v2, c2w2) = (a2 * (p.x * p.x), b2 * (p.y * p.y), c2 * (p.z * p.z));
    let inside = (p.x / a.x).powi(2) + (p.y / a.y).powi(2) + (p.z / a.z).powi(2) < 1.0;
    let mut t = if inside { 0.0 } else { a.max() * p.norm() };
    for _ in 0..MAX_ITERATIONS {
        let (pp, qq, rr) = (t + a2, t + b2, t + c2);
        let (p2, q2, r2) = (pp * pp, qq * qq, rr * rr);
        let f = p2 * q2 * r2 - a2u2 * q2 * r2 - b2v2 * p2 * r2 - c2w2 * p2 * q2;
        if f.abs() < TOLERANCE {
            return Some(Vector3::new(a2 * p.x / pp, b2 * p.y / qq, c2 * p.z / rr));
        }
        let (pq, pr, qr) = (pp * qq, pp * rr, qq * rr);
        let slope = 2.0
            * (pp * qq * rr * (qr + pr + pq) - a2u2 * qr * (qq + rr) - b2v2 * pr * (pp + rr) - c2w2 * pq * (pp + qq));
        t -= f / slope;
    }
    None
}

/// Closest point on the ellipse with semi-axes `a`, `b` to (`u`, `v`).
fn on_ellipse(a: f64, b: f64, u: f64, v: f64) -> (f64, f64) {
    let (a2, b2) = (a * a, b * b);
    match (is_zero_within_roundoff(u), is_zero_within_roundoff(v)) {
        (true, true) if a < b => return (if u < 0.0 { -a } else { a }, v),
        (true, true) => return (u, if v < 0.0 { -b } else { b }),
        (true, false) if a >= b || v.abs() >= b - a2 / b => return (u, if v >= 0.0 { b } else { -b }),
        (true, false) => {
            let y = b2 * v / (b2 - a2);
            return (a * (1.0 - (y / b).powi(2)).abs().sqrt(), y);
        }
        (false, true) if b >= a || u.abs() >= a - b2 / a => return (if u >= 0.0 { a } else { -a }, v),
        (false, true) => {
            let x = a2 * u / (a2 - b2);
            return (x, b * (1.0 - (x / a).powi(2)).abs().sqrt());
        }
        (false, false) => {}
    }
    let (a2u2, b2v2) = (a2 * (u * u), b2 * (v * v));
    let inside = (u / a).powi(2) + (v / b).powi(2) < 1.0;
    let mut t = if inside { 0.0 } else { a.max(b) * (u * u + v * v).sqrt() };
    let (mut p, mut q) = (t + a2, t + b2);
    for _ in 0..MAX_ITERATIONS {
        (p, q) = (t + a2, t + b2);
        let (p2, q2) = (p * p, q * q);
        let f = p2 * q2 - a2u2 * q2 - b2v2 * p2;
        if f.abs() < TOLERANCE {
            break;
        }
        t -= f / (2.0 * (p * q * (p + q) - a2u2 * q - b2v2 * p));
    }
    (a2 * u / p, b2 * v / q)
}
