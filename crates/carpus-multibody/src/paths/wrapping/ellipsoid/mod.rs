//! Wrapping over an ellipsoid with semi-axes along x, y, z, centred at the origin (OpenSim's
//! `WrapEllipsoid::wrapLine`).
//!
//! The curve lies in the plane through both ends of the segment and one point of the surface; choosing that point is
//! what the methods `hybrid`, `axial` and `midpoint` differ in (`plane`). All lengths are first scaled so that the
//! mean semi-axis is 1, because OpenSim's absolute tolerances apply to scaled lengths.

mod closest_point;
mod curve;
mod plane;
mod segment;
mod tangent;

use self::segment::{Segment, WrappingPlane};
use super::rounding::normalize_or_zero;
use super::wrap::{ConstrainedHalf, Wrap, WrapAction, WrapPath};
use carpus_osim::osim::spec::WrapMethod;
use nalgebra::Vector3;

/// Slack of the inside test, on the value of the ellipsoid's equation.
const INSIDE_TOLERANCE: f64 = 1e-4;
/// Ends seen from the centre within this (1 − cosine) of each other are not wrapped.
const COLLINEAR_TOLERANCE: f64 = 1e-4;

/// Wraps the segment from `p1` to `p2` over an ellipsoid with the semi-axes `dimensions` [m].
///
/// The tangent points are found by an iteration that stops at a scaled residual of 1e-4, and the curve is the sum
/// of straight pieces of about 1 mm; both are OpenSim's, and limit the accuracy of the length to about 1e-5 m.
pub fn wrap(
    dimensions: &[f64; 3],
    half: Option<ConstrainedHalf>,
    method: WrapMethod,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Wrap {
    let factor = 3.0 / (dimensions[0] + dimensions[1] + dimensions[2]);
    let segment = Segment {
        a: Vector3::from(*dimensions) * factor,
        p1: p1 * factor,
        p2: p2 * factor,
        dimensions: Vector3::from(*dimensions),
        factor,
    };
    let level1 = segment.level(&segment.p1);
    let level2 = segment.level(&segment.p2);
    if level1 < -INSIDE_TOLERANCE || level2 < -INSIDE_TOLERANCE {
        return Wrap::INSIDE_RADIUS;
    }
    let cosine = normalize_or_zero(&segment.p1).dot(&normalize_or_zero(&segment.p2));
    if (cosine - 1.0).abs() < COLLINEAR_TOLERANCE {
        return Wrap::NO_WRAP;
    }
    let Some((r1, r2)) = segment.intersections() else {
        return Wrap::NO_WRAP;
    };
    let mut start = plane::choose(&segment, method, r1, r2);
    if let Some(half) = half {
        start.flip_to(half, &segment);
    }
    let normal = normalize_or_zero(&(segment.p1 - segment.p2).cross(&(segment.p1 - start.c1)));
    let offset = -normal.dot(&start.c1);
    let wrapping_plane = WrappingPlane { normal, offset };
    let r1 = tangent::find(&segment.a, &wrapping_plane, level1, &segment.p1, start.r1);
    let r2 = tangent::find(&segment.a, &wrapping_plane, level2, &segment.p2, start.r2);

    let mut arc = curve::measure(&segment, &wrapping_plane, &r1, &r2, false);
    if half.is_some() && arc.leaves_backwards(&segment, &r1, &r2) {
        arc = curve::measure(&segment, &wrapping_plane, &r1, &r2, true);
    }
    let path = arc.is_defined.then(|| WrapPath { r1: r1 / factor, r2: r2 / factor, length: arc.length / factor });
    Wrap { action: WrapAction::MandatoryWrap, path }
}
