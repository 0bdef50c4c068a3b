//! Wrapping one straight path segment over one surface, in the surface's own frame.
//!
//! In: the two ends of a segment `p1`, `p2` [m], the shape, the constrained half, the ellipsoid method. Out: what to do
//! ([`WrapAction`], the return code of OpenSim's `WrapObject::wrapLine`) and, where there is one, the curve over the
//! surface ([`WrapPath`]). Which segment of a path is wrapped over which object, and in which order, is decided in
//! [`crate::paths`].
//!
//! The functions follow OpenSim 4.6 (`WrapSphere`, `WrapCylinder`, `WrapEllipsoid`, `WrapTorus`) including its
//! tolerances and its peculiarities, because lengths and moment arms are compared with OpenSim's. They are pure:
//! OpenSim 4.6 hands every surface the result of the previous wrap, but multiplies it by a factor that is always NaN
//! (`WrapResult` resets `factor` whenever it is copied), so that nothing of it can survive. The single exception is the
//! ellipsoid's intermediate point `c1`, used only if the search for a closest point on the ellipsoid fails: there
//! we start, as a fresh OpenSim model does, from NaN.
//!
//! Deliberately not here: points along the curve for drawing (see [`Path::drawn_points`](super::Path::drawn_points)).

pub mod cylinder;
pub mod ellipsoid;
pub mod sphere;
pub mod torus;

use carpus_osim::osim::spec::{Quadrant, WrapMethod, WrapShape};
use nalgebra::Vector3;

/// What a surface says about a segment; OpenSim's `WrapObject::WrapAction`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WrapAction {
    /// The segment does not touch the surface.
    NoWrap,
    /// An end of the segment is inside the surface; the segment is left as it is.
    InsideRadius,
    /// The segment may wrap; the caller takes the segment whose length changes least.
    Wrapped,
    /// The segment must wrap; no further segment is looked at.
    MandatoryWrap,
}

/// The part of a path that lies on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrapPath {
    /// Tangent point nearest to `p1`, in the surface's frame [m].
    pub r1: Vector3<f64>,
    /// Tangent point nearest to `p2`, in the surface's frame [m].
    pub r2: Vector3<f64>,
    /// Length of the curve from `r1` to `r2` [m]. Negative where OpenSim's sphere wraps over the far side.
    pub length: f64,
}

/// Result of wrapping a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrap {
    /// What to do.
    pub action: WrapAction,
    /// The curve; `None` if there is none or if OpenSim's own is not a number (such a wrap is never used).
    pub path: Option<WrapPath>,
}

impl Wrap {
    /// The segment does not touch the surface.
    pub const NO_WRAP: Wrap = Wrap { action: WrapAction::NoWrap, path: None };
    /// An end of the segment is inside the surface.
    pub const INSIDE_RADIUS: Wrap = Wrap { action: WrapAction::InsideRadius, path: None };
}

/// The half of a surface that a path may use, in the form that the algorithms need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConstrainedHalf {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// +1 or −1.
    pub sign: i8,
}

impl ConstrainedHalf {
    /// `None` if the surface is unconstrained.
    pub fn from_quadrant(quadrant: Quadrant) -> Option<ConstrainedHalf> {
        match quadrant {
            Quadrant::All => None,
            Quadrant::Half { axis, sign } => Some(ConstrainedHalf { axis, sign }),
        }
    }

    /// Whether `point` is on the allowed half; a point on the dividing plane counts as positive.
    #[inline]
    fn holds(self, point: &Vector3<f64>) -> bool {
        sign(point[self.axis]) == self.sign
    }
}

/// A surface with everything that stays constant between evaluations.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Which surface and its dimensions.
    pub shape: WrapShape,
    /// The half that may be used; `None`: all of it.
    pub half: Option<ConstrainedHalf>,
    /// How an ellipsoid is wrapped.
    pub method: WrapMethod,
    /// The path has this wrap only. OpenSim then leaves out the search for true tangency on cylinders.
    pub is_only_wrap_of_path: bool,
}

impl Surface {
    /// Wraps the segment from `p1` to `p2`, both in the surface's frame [m].
    pub fn wrap(&self, p1: &Vector3<f64>, p2: &Vector3<f64>) -> Wrap {
        match self.wrap_unless_longer(p1, p2, f64::INFINITY) {
            Attempt::Done(wrap) => wrap,
            Attempt::TooLong { .. } => Wrap::NO_WRAP, // unreachable: nothing exceeds infinity
        }
    }

    /// Wraps the segment, but leaves a wrap that the caller need not take ([`WrapAction::Wrapped`]) unfinished if it
    /// certainly lengthens the segment by more than `max_change` [m]. The unfinished part is what costs most: the
    /// search for tangency on a cylinder, which for hopeless segments does not converge.
    pub fn wrap_unless_longer(&self, p1: &Vector3<f64>, p2: &Vector3<f64>, max_change: f64) -> Attempt {
        let effort = Effort { find_tangency: !self.is_only_wrap_of_path, max_change, mandatory_is_optional: false };
        match self.shape {
            WrapShape::Sphere { radius } => Attempt::Done(sphere::wrap(radius, self.half, p1, p2)),
            WrapShape::Cylinder { radius, length } => cylinder::wrap(radius, length, self.half, &effort, p1, p2),
            WrapShape::Ellipsoid { dimensions } => {
                Attempt::Done(ellipsoid::wrap(&dimensions, self.half, self.method, p1, p2))
            }
            WrapShape::Torus { inner_radius, outer_radius } => {
                torus::wrap(inner_radius, outer_radius, self.half, &effort, p1, p2)
            }
        }
    }
}

/// Result of [`Surface::wrap_unless_longer`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attempt {
    /// The wrap, as [`Surface::wrap`] gives it.
    Done(Wrap),
    /// The segment may wrap, at the cost of at least `least_change` [m], which is more than was asked for.
    TooLong {
        /// Lower bound of the change in length [m].
        least_change: f64,
    },
}

/// How much work a cylinder is worth.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Whether the tangent points are slid until straight and curved parts meet without a corner. OpenSim does so
    /// unless the path has a single wrap.
    pub find_tangency: bool,
    /// An optional wrap is left unfinished if it certainly lengthens the segment by more than this [m].
    pub max_change: f64,
    /// The caller takes mandatory wraps for optional ones (the torus).
    pub mandatory_is_optional: bool,
}

/// OpenSim's `DSIGN`: +1 for zero and above, else −1 (also for NaN).
#[inline]
fn sign(x: f64) -> i8 {
    if x >= 0.0 { 1 } else { -1 }
}

/// OpenSim's `ROUNDOFF_ERROR`, the tolerance of `EQUAL_WITHIN_ERROR`.
const ROUNDOFF_ERROR: f64 = 2e-13;

/// OpenSim's `EQUAL_WITHIN_ERROR(0, x)`.
#[inline]
fn is_zero_within_roundoff(x: f64) -> bool {
    x.abs() <= ROUNDOFF_ERROR
}

/// `v` divided by its norm, or zero if the norm is below machine epsilon (`WrapMath::NormalizeOrZero`).
#[inline]
fn normalize_or_zero(v: &Vector3<f64>) -> Vector3<f64> {
    let norm = v.norm();
    if norm >= f64::EPSILON { v * (1.0 / norm) } else { Vector3::zeros() }
}
