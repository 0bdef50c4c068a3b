//! The curve in which the wrapping plane cuts the ellipsoid, as a sum of straight pieces (OpenSim's
//! `WrapEllipsoid::CalcDistanceOnEllipsoid`).

use super::super::rounding::normalize_or_zero;
use super::segment::{Segment, WrappingPlane};
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

    let sweep = Sweep { from: a0, x, y, step };
    // The near side is met by every ray, because the surface is convex.
    if far_side && !(1..pieces).all(|i| sweep.meets_surface(segment, i)) {
        let around = Sweep::the_other_way_around(segment, plane, r1, r2, &sweep, pieces);
        return sum_of_pieces(segment, &around, r1, r2, pieces);
    }
    sum_of_pieces(segment, &sweep, r1, r2, pieces)
}

/// Rays in the wrapping plane that sweep from one tangent point to the other in equal steps.
struct Sweep {
    from: Vector3<f64>,
    /// Towards the first tangent point, and perpendicular to it.
    x: Vector3<f64>,
    y: Vector3<f64>,
    /// Angle between two rays, signed from x to y [rad].
    step: f64,
}

impl Sweep {
    fn ray(&self, i: usize) -> Vector3<f64> {
        let (sine, cosine) = (i as f64 * self.step).sin_cos();
        self.x * cosine + self.y * sine
    }

    /// Coefficients of the quadratic equation for where a ray meets the surface.
    fn coefficients(&self, segment: &Segment, ray: &Vector3<f64>) -> [f64; 3] {
        let center = self.from.component_div(&segment.a);
        let f = ray.component_div(&segment.a);
        [f.dot(&f), 2.0 * f.dot(&center), center.dot(&center) - 1.0]
    }

    fn meets_surface(&self, segment: &Segment, i: usize) -> bool {
        let [aa, bb, cc] = self.coefficients(segment, &self.ray(i));
        bb * bb - 4.0 * aa * cc >= 0.0
    }

    fn on_surface(&self, segment: &Segment, i: usize) -> Vector3<f64> {
        let ray = self.ray(i);
        let [aa, bb, cc] = self.coefficients(segment, &ray);
        // Rounding may bring a ray that touches just past the surface.
        self.from + ray * ((-bb + (bb * bb - 4.0 * aa * cc).max(0.0).sqrt()) / (2.0 * aa))
    }

    /// Rays from the centre of the ellipse in which the plane cuts the surface.
    ///
    /// OpenSim's own rays start where the plane meets a coordinate axis. If that is outside of the surface, those that
    /// should go over the far side miss it, and OpenSim's length is not a number. The near side, which every ray from
    /// there meets, tells which of the two arcs is meant: the other one.
    fn the_other_way_around(
        segment: &Segment,
        plane: &WrappingPlane,
        r1: &Vector3<f64>,
        r2: &Vector3<f64>,
        missing: &Sweep,
        pieces: usize,
    ) -> Sweep {
        // The point of the plane nearest to the centre where the surface is a unit sphere.
        let normal = plane.normal.component_mul(&segment.a);
        let from = (normal * (-plane.offset / normal.norm_squared())).component_mul(&segment.a);
        let x = normalize_or_zero(&(r1 - from));
        let to_r2 = normalize_or_zero(&(r2 - from));
        let y = normalize_or_zero(&x.cross(&to_r2)).cross(&x);
        let angle = |p: &Vector3<f64>| {
            let p = p - from;
            p.dot(&y).atan2(p.dot(&x)).rem_euclid(2.0 * std::f64::consts::PI)
        };
        let sweep = angle(r2);
        let near_sweep = 2.0 * std::f64::consts::PI - missing.step.abs() * pieces as f64;
        let near = Sweep { step: near_sweep / 2.0, ..*missing };
        let is_near_between = angle(&near.on_surface(segment, 1)) < sweep;
        let whole = if is_near_between { sweep - 2.0 * std::f64::consts::PI } else { sweep };
        Sweep { from, x, y, step: whole / pieces as f64 }
    }
}

fn sum_of_pieces(segment: &Segment, sweep: &Sweep, r1: &Vector3<f64>, r2: &Vector3<f64>, pieces: usize) -> Curve {
    let mut length = 0.0;
    let mut from = *r1;
    let mut interior = None;
    for i in 1..pieces {
        let to = sweep.on_surface(segment, i);
        length += (to - from).norm();
        interior = Some((interior.map_or(to, |(first, _)| first), to));
        from = to;
    }
    length += (r2 - from).norm();
    Curve { length, is_defined: true, interior }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends, plane and semi-axes for which OpenSim's rays over the far side miss the surface.
    fn far_side(a: Vector3<f64>, normal: Vector3<f64>, distance: f64, angles: [f64; 2]) -> (f64, f64) {
        let normal = normal.normalize();
        let plane = WrappingPlane { normal, offset: -distance };
        let scaled = normal.component_mul(&a);
        // The section where the surface is a unit sphere: a circle.
        let center = scaled * (distance / scaled.norm_squared());
        let radius = (1.0 - center.norm_squared()).sqrt();
        let u = scaled.cross(&Vector3::z()).normalize();
        let v = scaled.normalize().cross(&u);
        let at = |t: f64| (center + (u * t.cos() + v * t.sin()) * radius).component_mul(&a);
        let (r1, r2) = (at(angles[0]), at(angles[1]));
        let dimensions = a * 0.3;
        let segment = Segment { a, p1: r1 * 3.0, p2: r2 * 3.0, dimensions, factor: 1.0 / 0.3 };
        let arc = measure(&segment, &plane, &r1, &r2, true).length;
        let true_arc = |from: f64, to: f64| -> f64 {
            let t = |i: i32| from + (to - from) * f64::from(i) / 20_000.0;
            (0..20_000).map(|i| (at(t(i + 1)) - at(t(i))).norm()).sum()
        };
        let turn = 2.0 * std::f64::consts::PI;
        let forth = (angles[1] - angles[0]).rem_euclid(turn);
        let arcs = [true_arc(angles[0], angles[0] + forth), true_arc(angles[0], angles[0] + forth - turn)];
        // The one that the near side does not run over: its middle ray meets the surface on the other.
        let axis = normal.iamax();
        let mut from = Vector3::zeros();
        from[axis] = distance / normal[axis];
        let middle = ((r1 - from).normalize() + (r2 - from).normalize()).normalize();
        let samples = (0..20_000).map(|i| turn * f64::from(i) / 20_000.0);
        let ahead = samples.filter(|&t| (at(t) - from).normalize().dot(&middle) > 1.0 - 1e-6);
        let met = ahead.max_by(|&s, &t| (at(s) - from).norm().total_cmp(&(at(t) - from).norm())).expect("a sample");
        let is_on_first = (met - angles[0]).rem_euclid(turn) < forth;
        let expected = if is_on_first { arcs[1] } else { arcs[0] };
        (arc, expected)
    }

    #[test]
    fn verif_the_far_side_is_the_rest_of_the_ellipse() {
        let sphere = Vector3::repeat(1.0);
        let long = Vector3::new(0.6, 0.8, 1.6);
        for (a, normal, distance, angles) in [
            // Rays start inside of the surface.
            (sphere, Vector3::new(1.0, 0.2, 0.1), 0.2, [0.4, 2.0]),
            (long, Vector3::new(1.0, 0.2, 0.1), 0.2, [0.4, 2.0]),
            // And outside.
            (sphere, Vector3::new(1.0, 0.9, 0.0), 0.9, [0.4, 2.0]),
            (sphere, Vector3::new(1.0, 0.9, 0.0), 0.9, [3.5, 5.5]),
            (sphere, Vector3::new(1.0, 0.9, 0.0), 0.9, [2.0, 0.4]),
            (long, Vector3::new(1.0, 0.9, 0.1), 0.6, [0.4, 2.0]),
            (long, Vector3::new(1.0, 0.9, 0.1), 0.6, [3.5, 5.5]),
            (long, Vector3::new(1.0, 0.9, 0.1), 0.6, [0.4, 5.9]),
        ] {
            let (arc, rest) = far_side(a, normal, distance, angles);
            // A sum of straight pieces of about a millimetre, on a surface of some decimetres.
            assert!((arc - rest).abs() < 1e-3 * rest, "{a:?} {normal:?} {angles:?}: {arc} instead of {rest}");
        }
    }
}
