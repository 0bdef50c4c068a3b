//! Points along a path for drawing: between the points that a wrap gives they follow its surface.
//!
//! Lengths and moment arms do not depend on these points.

use super::geometry::{CurrentPoint, PathGeometry, PointOrigin};
use super::path::{Path, PathWrap};
use carpus_osim::osim::spec::WrapShape;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Largest angle between two drawn points of a curve, seen from its centre [rad].
const STEP: f64 = 0.15;
/// Most points that are drawn of a curve.
const MOST_POINTS: usize = 64;

impl Path {
    /// Appends the points that a drawing of the path joins by straight lines, in ground [m]: the points of
    /// [`PathGeometry::points`], and others on the surfaces between them.
    ///
    /// A curve over an ellipsoid or a sphere lies in the plane of its ends and the point before it; over a cylinder it
    /// is a spiral; over a torus a spiral over the cylinder that OpenSim puts in its place. Of the two ways round a
    /// surface it is the one whose length is nearer to that of the wrap.
    ///
    /// - `geometry`: after [`Path::update`]
    pub fn drawn_points(&self, geometry: &PathGeometry, out: &mut Vec<Vector3<f64>>) {
        for (i, point) in geometry.points.iter().enumerate() {
            out.push(point.p_GS);
            let (PointOrigin::WrapStart(w), Some(end)) = (point.origin, geometry.points.get(i + 1)) else { continue };
            if end.origin == PointOrigin::WrapEnd(w) {
                let before = i.checked_sub(1).map_or(point, |before| &geometry.points[before]);
                self.curve(geometry, w, [before, point, end], out);
            }
        }
    }

    /// Points between the ends of a curve.
    #[allow(non_snake_case)]
    fn curve(&self, geometry: &PathGeometry, w: usize, points: [&CurrentPoint; 3], out: &mut Vec<Vector3<f64>>) {
        let (wrap, X_GW): (&PathWrap, _) = (&self.wraps[w], &geometry.X_GW[w]);
        let [p, r1, r2] = points.map(|point| X_GW.inverse_transform_point(&point.p_GS));
        let length = points[2].wrap_length.abs();
        let curve = match wrap.surface.shape {
            WrapShape::Sphere { radius } => on_ellipsoid(&Vector3::repeat(radius), &p, &r1, &r2, length),
            WrapShape::Ellipsoid { dimensions } => on_ellipsoid(&Vector3::from(dimensions), &p, &r1, &r2, length),
            WrapShape::Cylinder { .. } => spiral(&r1, &r2, length),
            WrapShape::Torus { outer_radius, .. } => on_torus(outer_radius, &r1, &r2, length),
        };
        out.extend(curve.iter().filter(|r| r.iter().all(|x| x.is_finite())).map(|r| X_GW * r));
    }
}

/// Of an angle and the rest of the turn, both signed, the one for which the curve's length is nearer to `length`.
fn way_round(angle: f64, length: f64, of: impl Fn(f64) -> f64) -> f64 {
    let other = if angle >= 0.0 { angle - TAU } else { angle + TAU };
    let misses = |angle: f64| (of(angle) - length).abs();
    if misses(other) < misses(angle) { other } else { angle }
}

/// How many pieces a curve of an angle is drawn with.
fn pieces(angle: f64) -> usize {
    ((angle.abs() / STEP).ceil() as usize).clamp(1, MOST_POINTS)
}

/// A spiral about z between two points, whose radius changes evenly from that of the one to that of the other.
fn spiral(r1: &Vector3<f64>, r2: &Vector3<f64>, length: f64) -> Vec<Vector3<f64>> {
    let (radius1, radius2) = (r1.xy().norm(), r2.xy().norm());
    let start = r1.y.atan2(r1.x);
    let short = (r1.x * r2.y - r1.y * r2.x).atan2(r1.x * r2.x + r1.y * r2.y);
    let turn = way_round(short, length, |angle| (0.5 * (radius1 + radius2) * angle).hypot(r2.z - r1.z));
    let n = pieces(turn);
    (1..n)
        .map(|i| {
            let part = i as f64 / n as f64;
            let (angle, radius) = (start + part * turn, radius1 + part * (radius2 - radius1));
            Vector3::new(radius * angle.cos(), radius * angle.sin(), r1.z + part * (r2.z - r1.z))
        })
        .collect()
}

/// A spiral over the cylinder that touches a torus' tube where the curve is.
fn on_torus(radius: f64, r1: &Vector3<f64>, r2: &Vector3<f64>, length: f64) -> Vec<Vector3<f64>> {
    let middle = 0.5 * (r1 + r2);
    let Some(outward) = Vector3::new(middle.x, middle.y, 0.0).try_normalize(0.0) else { return Vec::new() };
    let (centre, along) = (outward * radius, outward.cross(&Vector3::z()));
    // The cylinder's axis runs along the circle.
    let into = |p: &Vector3<f64>| {
        let d = p - centre;
        Vector3::new(d.dot(&outward), d.z, d.dot(&along))
    };
    let out_of = |p: Vector3<f64>| centre + outward * p.x + Vector3::z() * p.y + along * p.z;
    spiral(&into(r1), &into(r2), length).into_iter().map(out_of).collect()
}

/// The curve in which the plane through `p`, `r1` and `r2` cuts the ellipsoid with semi-axes `a`, from `r1` to `r2`.
fn on_ellipsoid(
    a: &Vector3<f64>,
    p: &Vector3<f64>,
    r1: &Vector3<f64>,
    r2: &Vector3<f64>,
    length: f64,
) -> Vec<Vector3<f64>> {
    // Where the surface is a unit sphere, planes stay planes.
    let [p, s1, s2] = [p, r1, r2].map(|v| v.component_div(a));
    let Some(normal) = (s1 - p).cross(&(s2 - p)).try_normalize(1e-12) else { return Vec::new() };
    let centre = normal * normal.dot(&s1);
    let (x, to_s2) = (s1 - centre, s2 - centre);
    let y = normal.cross(&x);
    let short = to_s2.dot(&y).atan2(to_s2.dot(&x));
    let at = |angle: f64| (centre + x * angle.cos() + y * angle.sin()).component_mul(a);
    let measured = |angle: f64| -> f64 {
        let n = 2 * MOST_POINTS;
        let point = |i: usize| at(angle * i as f64 / n as f64);
        (0..n).map(|i| (point(i + 1) - point(i)).norm()).sum()
    };
    let turn = way_round(short, length, measured);
    let n = pieces(turn);
    (1..n).map(|i| at(turn * i as f64 / n as f64)).collect()
}
