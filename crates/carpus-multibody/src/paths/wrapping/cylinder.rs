//! Wrapping over a cylinder along z, centred at the origin (OpenSim's `WrapCylinder::wrapLine`).

use super::rounding::{ROUNDOFF_ERROR, normalize_or_zero, sign};
use super::wrap::{Attempt, ConstrainedHalf, Effort, Wrap, WrapAction, WrapPath};
use nalgebra::{Vector2, Vector3};

/// Largest angle between the straight and the curved part at a tangent point that is accepted as tangency is
/// 0.1°; this is its tangent.
const TANGENCY_THRESHOLD_TANGENT: f64 = 1.745_331_024_188_800_4e-3;
/// Largest number of corrections of the tangent points.
const MAX_ITERATIONS: usize = 100;
/// Length of the pieces into which OpenSim divides the spiral [m]; the first and the last define its end tangents.
const SPIRAL_STEP: f64 = 0.002;
/// Half the height over which a tangent point is slid along its edge [m].
const SLIDE_REACH: f64 = 10.0;
/// Smallest |normal·edge| for which a plane and an edge intersect, and slack at the edge's ends.
const LINE_EPSILON: f64 = 1e-5;

/// Wraps the segment from `p1` to `p2` over a cylinder of the given `radius` and `length` [m].
///
/// The tangent points are found in the xy plane and then slid along z: first onto the plane through `p1`, `p2` and an
/// apex of the surface; then, if asked for, until the spiral between them meets both straight parts at the same
/// angle within 0.1°. OpenSim leaves out the second step for paths with a single wrap object, so that their tangent
/// points are those of the plane. A wrap is given up if both tangent points are beyond the cylinder's ends.
pub fn wrap(
    radius: f64,
    length: f64,
    half: Option<ConstrainedHalf>,
    effort: &Effort,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
) -> Attempt {
    let r_squared = radius * radius;
    let (xy1, xy2) = (p1.xy(), p2.xy());
    if xy1.norm_squared() < r_squared || xy2.norm_squared() < r_squared {
        return Attempt::Done(Wrap::INSIDE_RADIUS);
    }
    let nearest = NearestToAxis::of_segment(p1, p2, length);
    let crosses = nearest.distance_squared < r_squared && nearest.fraction > 0.0 && nearest.fraction < 1.0;
    let action = match half {
        None if crosses => WrapAction::MandatoryWrap,
        None => return Attempt::Done(Wrap::NO_WRAP),
        Some(half) if half.holds(p1) || half.holds(p2) => {
            if crosses {
                WrapAction::MandatoryWrap
            } else if sign(p1[half.axis]) != sign(p2[half.axis]) && !half.holds(&nearest.point) {
                WrapAction::Wrapped
            } else {
                return Attempt::Done(Wrap::NO_WRAP);
            }
        }
        Some(_) => WrapAction::Wrapped,
    };

    let t1 = Tangents::from_point(p1, radius);
    let t2 = Tangents::from_point(p2, radius);
    let choice = match half {
        Some(half) => choose_constrained(half, p1, p2, &t1, &t2),
        None => choose_nearest(&t1, &t2),
    };
    let mut ends = SpiralEnds { r1: choice.r1, r2: choice.r2, p1: *p1, p2: *p2 };
    ends.slide_onto_apex_plane(radius, t1.distance, t2.distance, choice.apex_on_far_side);

    let half_length = length / 2.0;
    let beyond = |r: &Vector3<f64>| r.z < -half_length || r.z > half_length;
    if beyond(&ends.r1) && beyond(&ends.r2) {
        return Attempt::Done(Wrap::NO_WRAP);
    }
    let spiral = Spiral::between(&ends, radius, choice.long_way);
    if effort.find_tangency {
        let is_optional = action == WrapAction::Wrapped || effort.mandatory_is_optional;
        if is_optional && effort.max_change < f64::INFINITY {
            let least_change = spiral.least_change(p1, p2);
            if least_change > effort.max_change {
                return Attempt::TooLong { least_change };
            }
        }
        spiral.slide_to_tangency(&mut ends);
    }
    let rise = ends.r2.z - ends.r1.z;
    let length = (spiral.around_squared + rise * rise).sqrt();
    Attempt::Done(Wrap { action, path: Some(WrapPath { r1: ends.r1, r2: ends.r2, length }) })
}

/// Where the line of a segment comes nearest to the cylinder's axis.
struct NearestToAxis {
    /// The point on the line (NaN if parallel to the axis, or if the cylinder has no length).
    point: Vector3<f64>,
    /// Its squared distance from the axis [m²].
    distance_squared: f64,
    /// Its position on the segment, 0 at `p1`, 1 at `p2`; NaN if undefined.
    fraction: f64,
}

impl NearestToAxis {
    fn of_segment(p1: &Vector3<f64>, p2: &Vector3<f64>, length: f64) -> NearestToAxis {
        let d = p2 - p1;
        let across = d.x * d.x + d.y * d.y;
        let undefined = length < f64::EPSILON || !(across > ROUNDOFF_ERROR * (across + d.z * d.z));
        if undefined {
            let point = Vector3::repeat(f64::NAN);
            return NearestToAxis { point, distance_squared: f64::NAN, fraction: f64::NAN };
        }
        let fraction = -(p1.x * d.x + p1.y * d.y) / across;
        let point = p1 + d * fraction;
        NearestToAxis { point, distance_squared: point.x * point.x + point.y * point.y, fraction }
    }
}

/// The two points where lines from one end, at the height of that end, touch the cylinder.
struct Tangents {
    a: Vector3<f64>,
    b: Vector3<f64>,
    /// Distance of the end from the axis [m].
    distance: f64,
}

impl Tangents {
    fn from_point(p: &Vector3<f64>, radius: f64) -> Tangents {
        let distance = p.xy().norm();
        let outward = if distance >= f64::EPSILON { p.xy() * (1.0 / distance) } else { Vector2::zeros() };
        let depth = radius * (radius / distance);
        let width = (radius * radius - depth * depth).max(0.0).sqrt();
        let middle = outward * depth;
        let side = Vector2::new(-outward.y, outward.x) * width;
        let at = |xy: Vector2<f64>| Vector3::new(xy.x, xy.y, p.z);
        Tangents { a: at(middle + side), b: at(middle - side), distance }
    }
}

/// Which tangent points are used, and on which side the curve runs.
struct Choice {
    r1: Vector3<f64>,
    r2: Vector3<f64>,
    /// The apex of the wrapping plane is the one away from the segment.
    apex_on_far_side: bool,
    /// The curve covers more than half of the circumference.
    long_way: bool,
}

/// Unconstrained: the pair with the smallest angle between them.
fn choose_nearest(t1: &Tangents, t2: &Tangents) -> Choice {
    let dot = |u: &Vector3<f64>, v: &Vector3<f64>| u.x * v.x + u.y * v.y;
    let (d1, d2) = (dot(&t1.a, &t2.a), dot(&t1.a, &t2.b));
    let (d3, d4) = (dot(&t1.b, &t2.a), dot(&t1.b, &t2.b));
    let (r1, r2) = if d1 > d2 && d1 > d3 && d1 > d4 {
        (t1.a, t2.a)
    } else if d2 > d3 && d2 > d4 {
        (t1.a, t2.b)
    } else if d3 > d4 {
        (t1.b, t2.a)
    } else {
        (t1.b, t2.b)
    };
    Choice { r1, r2, apex_on_far_side: false, long_way: false }
}

/// Constrained: the pair `a, b` or `b, a` that touches the allowed half.
fn choose_constrained(
    half: ConstrainedHalf,
    p1: &Vector3<f64>,
    p2: &Vector3<f64>,
    t1: &Tangents,
    t2: &Tangents,
) -> Choice {
    let dot = |u: &Vector3<f64>, v: &Vector3<f64>| u.x * v.x + u.y * v.y;
    // The pair with the larger angle between its points is the long way around (OpenSim's alpha > beta).
    let ab_is_wider = dot(&t1.a, &t2.b) < dot(&t1.b, &t2.a);
    let (r1a_held, r1b_held) = (half.holds(&t1.a), half.holds(&t1.b));
    // Some(true): a, b; Some(false): b, a; None: no tangent point is on the allowed half.
    let use_ab = match (r1a_held, r1b_held) {
        (true, false) => Some(true),
        (false, true) => Some(false),
        (true, true) => Some(!half.holds(&t2.a)),
        (false, false) if half.holds(&t2.a) => Some(false),
        (false, false) if half.holds(&t2.b) => Some(true),
        (false, false) => None,
    };
    let (ab, apex_on_far_side) = match use_ab {
        Some(true) => (true, ab_is_wider),
        Some(false) => (false, !ab_is_wider),
        None => (ab_is_wider, true),
    };
    let (r1, r2) = if ab { (t1.a, t2.b) } else { (t1.b, t2.a) };
    let pull = (r1 - p1) + (r2 - p2);
    let long_way = (r1.x + r2.x) * pull.x + (r1.y + r2.y) * pull.y < 0.0;
    Choice { r1, r2, apex_on_far_side, long_way }
}

/// The tangent points while they are slid along z; their x and y stay.
struct SpiralEnds {
    r1: Vector3<f64>,
    r2: Vector3<f64>,
    p1: Vector3<f64>,
    p2: Vector3<f64>,
}

impl SpiralEnds {
    /// Slides the tangent points onto the plane through both ends and the apex of the curve.
    fn slide_onto_apex_plane(&mut self, radius: f64, distance1: f64, distance2: f64, apex_on_far_side: bool) {
        let (p1, p2) = (self.p1, self.p2);
        let on_line = p1 + (p2 - p1) * (distance1 / (distance1 + distance2));
        let mut outward = normalize_or_zero(&Vector3::new(on_line.x, on_line.y, 0.0));
        if apex_on_far_side {
            outward = -outward;
        }
        let apex = outward * radius + Vector3::new(0.0, 0.0, on_line.z);
        let normal = normalize_or_zero(&(p1 - apex)).cross(&normalize_or_zero(&(p2 - apex)));
        let n = normal / normal.norm();

        let height_on_plane = |r: &Vector3<f64>| {
            let d = n.dot(&p1) - n.x * r.x - n.y * r.y;
            let z = d / n.z;
            let reached = ((z - r.z) / (2.0 * SLIDE_REACH)).abs() <= 0.5 + LINE_EPSILON;
            ((2.0 * SLIDE_REACH * n.z).abs() >= LINE_EPSILON && reached).then_some(z)
        };
        // A point is slid only if it comes nearer to the height of the other end. OpenSim measures this along the
        // line from the axis point of p1 in the direction of the axis point of p2, which has no direction if p2 is at
        // height 0: then r1 stays, and r2 always follows the plane.
        let p2_has_height = p2.z.abs() >= f64::EPSILON;
        let apart = (p1.z - p2.z).abs();
        if let Some(z) = height_on_plane(&self.r1)
            && p2_has_height
            && (z - p2.z).abs() < apart
        {
            self.r1.z = z;
        }
        if let Some(z) = height_on_plane(&self.r2) {
            let remaining = if p2_has_height { (z - p1.z).abs() } else { 0.0 };
            if remaining < apart {
                self.r2.z = z;
            }
        }
    }
}

/// What stays the same while the ends of a spiral are slid along z.
struct Spiral {
    /// Squared length seen along the axis [m²].
    around_squared: f64,
    /// Signed angle from r1 to r2 [rad].
    turn: f64,
    radius: f64,
    end1: SpiralEnd,
    end2: SpiralEnd,
}

/// One end of a spiral seen along the axis: the straight part from p to r is tangent to the circle there.
struct SpiralEnd {
    p_z: f64,
    /// Length of the straight part [m].
    straight: f64,
    /// Component of p → r along the tangent in which the spiral leaves r [m]: ± the length.
    forward: f64,
}

impl SpiralEnd {
    /// - `sense`: +1 if the spiral leaves `r` counter-clockwise
    fn new(p: &Vector3<f64>, r: &Vector3<f64>, sense: f64) -> SpiralEnd {
        let to_r = r.xy() - p.xy();
        let straight = to_r.norm();
        let forward = straight * (sense * (r.x * to_r.y - r.y * to_r.x)).signum();
        SpiralEnd { p_z: p.z, straight, forward }
    }
}

/// The corners at both ends of a spiral that OpenSim divides into `steps` pieces.
struct Corners {
    steps: usize,
    /// 1 / steps.
    t: f64,
    /// Squared lengths of the spiral for which its number of pieces stays [m²].
    lengths_squared: std::ops::Range<f64>,
    corner1: Corner,
    corner2: Corner,
}

impl Spiral {
    /// The spiral between the present tangent points.
    fn between(ends: &SpiralEnds, radius: f64, long_way: bool) -> Spiral {
        let (u, v) = (ends.r1.xy(), ends.r2.xy());
        let mut theta = (u.x * v.y - u.y * v.x).atan2(u.dot(&v));
        if long_way {
            theta = 2.0 * std::f64::consts::PI - theta;
        }
        let turn = if long_way { -theta } else { theta };
        Spiral {
            around_squared: (radius * theta) * (radius * theta),
            turn,
            radius,
            end1: SpiralEnd::new(&ends.p1, &ends.r1, turn.signum()),
            end2: SpiralEnd::new(&ends.p2, &ends.r2, -turn.signum()),
        }
    }

    /// Lower bound of the change in length of the segment that this wrap causes, wherever the tangent points are slid
    /// [m]: that of the shortest curve, which climbs evenly, less a little for rounding.
    fn least_change(&self, p1: &Vector3<f64>, p2: &Vector3<f64>) -> f64 {
        const ROUNDING: f64 = 1e-9;
        let level = self.end1.straight + self.around_squared.sqrt() + self.end2.straight;
        let climb = p2.z - p1.z;
        (level * level + climb * climb).sqrt() - (p2 - p1).norm() - ROUNDING
    }

    /// Slides the tangent points until the spiral meets the straight parts without a corner, or until OpenSim gives
    /// up; with its over-correction by half that is common where a straight part is long.
    fn slide_to_tangency(&self, ends: &mut SpiralEnds) {
        let (p1_z, p2_z) = (ends.p1.z, ends.p2.z);
        let (mut z1, mut z2) = (ends.r1.z, ends.r2.z);
        let mut corners = self.corners(z2 - z1);
        for _ in 0..MAX_ITERATIONS {
            let rise = z2 - z1;
            if !corners.lengths_squared.contains(&(self.around_squared + rise * rise)) {
                corners = self.corners(rise);
            }
            if corners.steps < 2 {
                break;
            }
            let Corners { t, corner1, corner2, .. } = &corners;
            let moved1 = corner1.own * z1 + (corner1.other * z2 + corner1.constant);
            let moves1 = corner1.differs(z1 - p1_z, t * rise);
            let z1_before = z1;
            if moves1 && corner1.is_defined(z1 + t * rise - p1_z) {
                z1 = moved1;
            }
            // As in OpenSim, the last point of the spiral is counted from the already corrected r1.
            let last = z1 + (1.0 - t) * rise;
            let moved2 = corner2.own * z2 + (corner2.other * z1_before + corner2.constant) + corner2.gain * z1;
            let moves2 = corner2.differs(z2 - p2_z, last - z2);
            if moves2 && corner2.is_defined(last - p2_z) {
                z2 = moved2;
            }
            if !moves1 && !moves2 {
                break;
            }
        }
        ends.r1.z = z1;
        ends.r2.z = z2;
    }

    /// The corners where the spiral rises by `rise`.
    fn corners(&self, rise: f64) -> Corners {
        let length = (self.around_squared + rise * rise).sqrt();
        let steps = (length / SPIRAL_STEP) as usize;
        let t = 1.0 / steps as f64;
        let squared = |steps: usize| {
            let length = steps as f64 * SPIRAL_STEP;
            length * length
        };
        // Half the angle of one piece.
        let (sine, cosine) = (0.5 * t * self.turn.abs()).sin_cos();
        let chord = 2.0 * self.radius * sine.abs();
        let forward = 2.0 * self.radius * sine * cosine;
        let mut corner1 = Corner::new(&self.end1, chord, forward);
        let mut corner2 = Corner::new(&self.end2, chord, forward);
        // r1 moves to −r1/2 + 3/2·(p1 + f1·(w1 − p1)) with w1 = r1 + t·(r2 − r1); r2 to the same expression of its own
        // quantities with w2 = r1′ + (1 − t)·(r2 − r1).
        corner1.own = -0.5 + corner1.gain * (1.0 - t);
        corner1.other = corner1.gain * t;
        corner2.own = -0.5 + corner2.gain * (1.0 - t);
        corner2.other = -corner2.gain * (1.0 - t);
        Corners { steps, t, lengths_squared: squared(steps)..squared(steps + 1), corner1, corner2 }
    }
}

/// Where a straight part from `p` meets the first chord of the spiral, at a tangent point `r`.
struct Corner {
    /// Horizontal length of the straight part [m].
    straight: f64,
    /// Horizontal length of the chord [m].
    chord: f64,
    /// Squared climb from `p` to the chord's end up to which the line between them is not vertical [m²].
    max_climb_squared: f64,
    /// 3/2 of the position of r on the horizontal line from `p` to the chord's end.
    gain: f64,
    /// Corrected height of r, as a linear function of its own height, the height of the other tangent point, and (for
    /// r2, through `gain`) the corrected height of r1.
    own: f64,
    other: f64,
    constant: f64,
}

impl Corner {
    /// - `chord`: horizontal length of the chord [m]
    /// - `forward`: its component along the tangent at r [m]
    fn new(end: &SpiralEnd, chord: f64, forward: f64) -> Corner {
        let straight_squared = end.straight * end.straight;
        let along = end.forward * forward;
        let across = straight_squared + 2.0 * along + chord * chord;
        let fraction = (straight_squared + along) / across;
        Corner {
            straight: end.straight,
            chord,
            max_climb_squared: across * (1.0 / ROUNDOFF_ERROR - 1.0),
            gain: 1.5 * fraction,
            own: 0.0,
            other: 0.0,
            constant: 1.5 * end.p_z * (1.0 - fraction),
        }
    }

    /// Whether straight part and chord, which climb by the given heights, differ in slope by more than the threshold.
    /// A part without length counts as horizontal, as in OpenSim.
    #[inline]
    fn differs(&self, straight_climb: f64, chord_climb: f64) -> bool {
        let direction = |across: f64, climb: f64| {
            if across < f64::EPSILON && climb.abs() < f64::EPSILON { (1.0, 0.0) } else { (across, climb) }
        };
        let (h1, z1) = direction(self.straight, straight_climb);
        let (h2, z2) = direction(self.chord, chord_climb);
        let sine = (h1 * z2 - h2 * z1).abs();
        let cosine = h1 * h2 + z1 * z2;
        !(cosine > 0.0 && sine <= TANGENCY_THRESHOLD_TANGENT * cosine)
    }

    /// Whether OpenSim finds the height at which the line from `p` to the chord's end, which climbs by `climb`, passes
    /// the vertical line through r.
    #[inline]
    fn is_defined(&self, climb: f64) -> bool {
        climb * climb < self.max_climb_squared && climb.abs() >= f64::EPSILON
    }
}
