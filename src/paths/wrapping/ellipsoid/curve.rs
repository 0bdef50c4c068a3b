//! The curve in which the wrapping plane cuts the ellipsoid, as a sum of straight pieces (OpenSim's
//! `WrapEllipsoid::CalcDistanceOnEllipsoid`).

use super::super::normalize_or_zero;
use super::{Segment, WrappingPlane};
use nalgebra::Vector3;

/// Length of a piece, measured on the chord [m].
const DESIRED_PIECE_LENGTH: f64 = 0.001;
const MAX_PIECES: usize = 499;

/// A curve from r1 to r2.
pub(super) struct Curve {
    /// Scaled length.
    pub length: f64,
    /// False if OpenSim would produce no curve (the tangent points are not numbers).
    pub is_defined: bool,
    /// First and last point between the ends, if there are any.
    interior: Option<(Vector3<f64>, Vector3<f64>)>,
}

impl Curve {
    /// Whether the curve leaves a tangent point towards the end of the segment, so that the far side is meant.
    pub(super) fn leaves_backwards(&self, segment: &Segment, r1: &Vector3<f64>, r2: &Vector3<f64>) -> bool {
        let Some((first, last)) = self.interior else { return false };
        let turns_back = |p: &Vector3<f64>, r: &Vector3<f64>, w: &Vector3<f64>| {
            normalize_or_zero(&(p - r)).dot(&normalize_or_zero(&(w - r))) > 0.0
        };
        turns_back(&segment.p1, r1, &first) || turns_back(&segment.p2, r2, &last)
    }
}

/// Measures the curve from `r1` to `r2`; over the far side if asked.
pub(super) fn measure(
    segment: &Segment,
    plane: &WrappingPlane,
    r1: &Vector3<f64>,
    r2: &Vector3<f64>,
    far_side: bool,
) -> Curve {
    let chord = (r1 - r2).norm();
    let chord_in_metres = chord / segment.factor;
    if chord_in_metres < DESIRED_PIECE_LENGTH {
        return Curve { length: chord, is_defined: true, interior: None };
    }
    let pieces = ((chord_in_metres / DESIRED_PIECE_LENGTH) as usize).min(MAX_PIECES);
    if pieces == 0 {
        return Curve { length: chord_in_metres, is_defined: false, interior: None };
    }

    // Rays from a0, where the plane meets the coordinate axis most perpendicular to it, sweep from r1 to r2.
    let axis = plane.normal.iamax();
    let mut a0 = Vector3::zeros();
    a0[axis] = -plane.offset / plane.normal[axis];
    let x = normalize_or_zero(&(r1 - a0));
    let to_r2 = normalize_or_zero(&(r2 - a0));
    let sweep = x.dot(&to_r2).clamp(-1.0, 1.0).acos();
    let step = if far_side { -(2.0 * std::f64::consts::PI - sweep) / pieces as f64 } else { sweep / pieces as f64 };
    let y = normalize_or_zero(&x.cross(&to_r2)).cross(&x);

    let center = a0.component_div(&segment.a);
    let cc = center.dot(&center) - 1.0;
    let on_surface = |i: usize| {
        let (sine, cosine) = (i as f64 * step).sin_cos();
        let ray = x * cosine + y * sine;
        let f = ray.component_div(&segment.a);
        let aa = f.dot(&f);
        let bb = 2.0 * f.dot(&center);
        // A ray that misses the surface, which makes OpenSim's length NaN, counts where it passes nearest.
        a0 + ray * ((-bb + (bb * bb - 4.0 * aa * cc).max(0.0).sqrt()) / (2.0 * aa))
    };
    let mut length = 0.0;
    let mut from = *r1;
    let mut interior = None;
    for i in 1..pieces {
        let to = on_surface(i);
        length += (to - from).norm();
        interior = Some((interior.map_or(to, |(first, _)| first), to));
        from = to;
    }
    length += (r2 - from).norm();
    Curve { length, is_defined: true, interior }
}
