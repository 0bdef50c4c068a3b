//! Wrapping over a sphere centred at the origin (OpenSim's `WrapSphere::wrapLine`).

use super::rounding::{normalize_or_zero, sign};
use super::wrap::{ConstrainedHalf, Wrap, WrapAction, WrapPath};
use nalgebra::Vector3;

/// A segment whose line passes the centre closer than this (sine of an angle) is not wrapped: the wrapping plane is
/// undefined.
const MIN_SINE_TO_CENTRE: f64 = 1e-5;

/// The two points where lines from one end touch the sphere, in the plane of the segment and the centre.
struct Tangents {
    a: Vector3<f64>,
    b: Vector3<f64>,
}

impl Tangents {
    /// Tangent points from `p`; `n` is the unit normal of the wrapping plane.
    fn from_point(p: &Vector3<f64>, radius: f64, n: &Vector3<f64>) -> Tangents {
        let distance = p.norm();
        let y = normalize_or_zero(&-p);
        let z = n.cross(&y);
        let sine = radius / distance;
        let cosine = (1.0 - sine * sine).max(0.0).sqrt();
        let reach = distance * cosine;
        Tangents { a: p + (y * cosine - z * sine) * reach, b: p + (y * cosine + z * sine) * reach }
    }
}

/// Wraps the segment from `p1` to `p2` over a sphere of the given `radius` [m].
///
/// The curve is an arc of a great circle. Where the constrained half forces the path around the far side, OpenSim
/// gives the arc a **negative** length, −(2π − angle)·radius; so do we. OpenSim's test whether the closest point of
/// the line is within the segment compares metres with 1; so do we.
pub fn wrap(radius: f64, half: Option<ConstrainedHalf>, p1: &Vector3<f64>, p2: &Vector3<f64>) -> Wrap {
    if p1.norm() < radius || p2.norm() < radius {
        return Wrap::INSIDE_RADIUS;
    }
    if !crosses_sphere(radius, p1, p2) {
        return Wrap::NO_WRAP;
    }
    let from_2_to_1 = normalize_or_zero(&(p1 - p2));
    let normal = from_2_to_1.cross(&normalize_or_zero(p2));
    if normal.norm() < MIN_SINE_TO_CENTRE {
        // OpenSim falls back to the previous tangent points, which are NaN: such a wrap is never chosen.
        return Wrap { action: WrapAction::Wrapped, path: None };
    }
    let n = normalize_or_zero(&normal);
    let t1 = Tangents::from_point(p1, radius, &n);
    let t2 = Tangents::from_point(p2, radius, &n);

    let Some(half) = half else {
        let (r1, r2) = nearest_pair(&t1, &t2);
        return Wrap { action: WrapAction::Wrapped, path: Some(arc(radius, r1, r2, false)) };
    };
    let mut action = WrapAction::Wrapped;
    if half.holds(p1) || half.holds(p2) {
        let along = p1.dot(&from_2_to_1);
        let nearest = p1 - from_2_to_1 * along;
        if nearest.norm_squared() < radius * radius && along > 0.0 && along < 1.0 {
            action = WrapAction::MandatoryWrap;
        } else if sign(p1[half.axis]) == sign(p2[half.axis]) || half.holds(&nearest) {
            return Wrap::NO_WRAP;
        }
    }
    let (r1, r2, far_side) = if half.holds(p1) && half.holds(p2) {
        let (r1, r2) = nearest_pair(&t1, &t2);
        (r1, r2, false)
    } else {
        constrained_pair(half, p1, p2, &t1, &t2)
    };
    Wrap { action, path: Some(arc(radius, r1, r2, far_side)) }
}

/// Whether the line through `p1` and `p2` meets the sphere twice between the two points.
fn crosses_sphere(radius: f64, p1: &Vector3<f64>, p2: &Vector3<f64>) -> bool {
    let ri = p1 - p2;
    let a = ri.dot(&ri);
    let b = 2.0 * p2.dot(&ri);
    let c = p2.dot(p2) - radius * radius;
    let disc = b * b - 4.0 * a * c;
    if disc < 0.0 {
        return false;
    }
    let root = disc.sqrt();
    let l1 = (-b + root) / (2.0 * a);
    let l2 = (-b - root) / (2.0 * a);
    0.0 < l1 && l1 < 1.0 && 0.0 < l2 && l2 < 1.0
}

/// The pair of tangent points with the smallest angle between them.
fn nearest_pair(t1: &Tangents, t2: &Tangents) -> (Vector3<f64>, Vector3<f64>) {
    let [r1a, r1b, r2a, r2b] = [&t1.a, &t1.b, &t2.a, &t2.b].map(normalize_or_zero);
    let (j1, j2, j3, j4) = (r1a.dot(&r2a), r1a.dot(&r2b), r1b.dot(&r2a), r1b.dot(&r2b));
    if j1 > j2 && j1 > j3 && j1 > j4 {
        (t1.a, t2.a)
    } else if j2 > j3 && j2 > j4 {
        (t1.a, t2.b)
    } else if j3 > j4 {
        (t1.b, t2.a)
    } else {
        (t1.b, t2.b)
    }
}

/// The pair on the allowed half, and whether the arc between them runs over the far side.
fn constrained_pair(
    half: ConstrainedHalf,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
    t1: &Tangents,
    t2: &Tangents,
) -> (Vector3<f64>, Vector3<f64>, bool) {
    let towards_centre = normalize_or_zero(&(-p1 - p2));
    let pick = |t: &Tangents| {
        if normalize_or_zero(&t.a).dot(&towards_centre) > normalize_or_zero(&t.b).dot(&towards_centre) {
            (t.a, t.b)
        } else {
            (t.b, t.a)
        }
    };
    let (mut r1, other1) = pick(t1);
    let (mut r2, other2) = pick(t2);
    let pull = normalize_or_zero(&((r1 - p1) + (r2 - p2)));
    if pull[half.axis] * f64::from(half.sign) < 0.0 {
        r1 = other1;
        r2 = other2;
    }
    let far_side = (r1 + r2).dot(&((r1 - p1) + (r2 - p2))) < 0.0;
    (r1, r2, far_side)
}

/// The arc from `r1` to `r2`. The cosine is limited to 1, where OpenSim's rounding may give NaN.
fn arc(radius: f64, r1: Vector3<f64>, r2: Vector3<f64>, far_side: bool) -> WrapPath {
    let mut angle = normalize_or_zero(&r1).dot(&normalize_or_zero(&r2)).clamp(-1.0, 1.0).acos();
    if far_side {
        angle = -(2.0 * std::f64::consts::PI - angle);
    }
    WrapPath { r1, r2, length: radius * angle }
}
