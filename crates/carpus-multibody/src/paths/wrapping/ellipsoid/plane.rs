//! The point `c1` of the surface that, with both ends, spans the plane of the curve.

use super::super::rounding::{normalize_or_zero, sign};
use super::super::wrap::ConstrainedHalf;
use super::closest_point;
use super::segment::Segment;
use carpus_osim::osim::spec::WrapMethod;
use nalgebra::Vector3;

/// `hybrid`: a segment less parallel to its main axis than this uses the fan alone.
const MU_BLEND_MIN: f64 = 0.7073;
/// `hybrid`: a segment more parallel to its main axis than this uses the axial technique alone.
const MU_BLEND_MAX: f64 = 0.9;
/// `hybrid`: fraction of the chord at either end where the axial technique fades out.
const SV_BOUNDARY_BLEND: f64 = 0.3;
/// Number of points on the chord whose closest points make up the fan.
const FAN_SAMPLES: usize = 300;

/// Where the search for tangent points starts.
pub(super) struct Start {
    /// Point of the surface that spans the plane.
    pub c1: Vector3<f64>,
    /// First guess of the tangent point of `p1`.
    pub r1: Vector3<f64>,
    /// First guess of the tangent point of `p2`.
    pub r2: Vector3<f64>,
    /// Weight of the fan in `c1`; −∞ if the fan was not used.
    fan_weight: f64,
}

/// Chooses the plane for a segment that enters the ellipsoid at `r1` and leaves it at `r2`.
pub(super) fn choose(segment: &Segment, method: WrapMethod, r1: Vector3<f64>, r2: Vector3<f64>) -> Start {
    // Fresh OpenSim models start from NaN here; it survives only if no closest point is found.
    let mut c1 = Vector3::repeat(f64::NAN);
    let mut fan_weight = f64::NEG_INFINITY;
    let mut use_c1_as_guess = true;
    match method {
        WrapMethod::Midpoint => {
            let middle = r1 + (r2 - r1) * 0.5;
            closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &middle, &mut c1);
        }
        WrapMethod::Axial => {
            let axial = Axial::of_chord(segment, &r1, &r2);
            c1 = axial.c1;
            use_c1_as_guess = axial.t > 0.0 && axial.t < 1.0;
        }
        WrapMethod::Hybrid => {
            let axial = Axial::of_chord(segment, &r1, &r2);
            let mu = axial.faded_parallelism();
            if mu > MU_BLEND_MIN {
                c1 = axial.c1;
            }
            if mu < MU_BLEND_MAX {
                let fan = fan_point(segment, &r1, &r2);
                if mu <= MU_BLEND_MIN {
                    closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &fan, &mut c1);
                    fan_weight = 1.0;
                } else {
                    let axial_weight = (mu - MU_BLEND_MIN) / (MU_BLEND_MAX - MU_BLEND_MIN);
                    fan_weight = 1.0 - axial_weight;
                    let mut fan_c1 = axial.other_c1;
                    closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &fan, &mut fan_c1);
                    let blend = c1 * axial_weight + fan_c1 * fan_weight;
                    closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &blend, &mut c1);
                }
            }
        }
    }
    let (r1, r2) = if use_c1_as_guess { (c1, c1) } else { (r1, r2) };
    Start { c1, r1, r2, fan_weight }
}

impl Start {
    /// Mirrors `c1` to the allowed half; where the fan had a part in it, moves it towards the dividing plane.
    ///
    /// OpenSim means to compute the fan's weight anew if the fan was not used, but compares infinities for
    /// equality by their difference, so that this never happens.
    pub(super) fn flip_to(&mut self, half: ConstrainedHalf, segment: &Segment) {
        let axis = half.axis;
        if sign(self.c1[axis]) == half.sign {
            return;
        }
        let original = self.c1[axis];
        self.c1[axis] = -original;
        self.r1 = self.c1;
        self.r2 = self.c1;
        let weight = self.fan_weight.min(1.0);
        if weight > 0.0 {
            let bisection = (original + self.c1[axis]) / 2.0;
            self.c1[axis] += weight * (bisection - self.c1[axis]);
            let target = self.c1;
            closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &target, &mut self.c1);
        }
    }
}

/// Axial technique: the chord is cut by the coordinate plane that it is most perpendicular to, and the closest point is
/// sought in that plane.
struct Axial {
    /// Cosine between the segment and the axis most parallel to it.
    mu: f64,
    /// Where on the chord the plane cuts it, 0 at `r1`, 1 at `r2`.
    t: f64,
    c1: Vector3<f64>,
    /// The closest point in the plane of y, which OpenSim's workspace holds when the fan is blended in.
    other_c1: Vector3<f64>,
}

impl Axial {
    fn of_chord(segment: &Segment, r1: &Vector3<f64>, r2: &Vector3<f64>) -> Axial {
        let mu = normalize_or_zero(&(segment.p1 - segment.p2)).abs();
        let mut axis = 0;
        for i in 1..3 {
            if mu[i] > mu[axis] {
                axis = i;
            }
        }
        let chord = r2 - r1;
        let cut = |i: usize| {
            let t = -r1[i] / chord[i];
            let mut c1 = Vector3::zeros();
            closest_point::in_coordinate_plane(&segment.a, &(r1 + chord * t), i, &mut c1);
            (t, c1)
        };
        let (t, c1) = cut(axis);
        let other_c1 = if axis == 1 { c1 } else { cut(1).1 };
        Axial { mu: mu[axis], t, c1, other_c1 }
    }

    /// Parallelism, lowered where the cut is near an end of the chord or beyond it.
    fn faded_parallelism(&self) -> f64 {
        if self.mu <= MU_BLEND_MIN {
            return self.mu;
        }
        let fade = if self.t < 0.0 || self.t > 1.0 {
            0.0
        } else if self.t < SV_BOUNDARY_BLEND {
            self.t / SV_BOUNDARY_BLEND
        } else if self.t > 1.0 - SV_BOUNDARY_BLEND {
            (1.0 - self.t) / SV_BOUNDARY_BLEND
        } else {
            1.0
        };
        if fade < 1.0 { MU_BLEND_MIN + fade * (self.mu - MU_BLEND_MIN) } else { self.mu }
    }
}

/// Fan technique: the middle of the chord, moved by the unit mean of the directions from points of the chord to
/// their closest points on the surface.
fn fan_point(segment: &Segment, r1: &Vector3<f64>, r2: &Vector3<f64>) -> Vector3<f64> {
    let chord = r2 - r1;
    let mut sum = Vector3::zeros();
    let mut closest = Vector3::zeros();
    for i in 1..FAN_SAMPLES - 1 {
        let point = r1 + chord * (i as f64 / FAN_SAMPLES as f64);
        closest_point::on_ellipsoid(&segment.a, &segment.dimensions, &point, &mut closest);
        sum += normalize_or_zero(&(closest - point));
    }
    r1 + chord * 0.5 + normalize_or_zero(&sum)
}
