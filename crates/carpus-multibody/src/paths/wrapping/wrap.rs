//! What wrapping a segment takes and gives.

use super::rounding::sign;
use carpus_osim::osim::spec::Quadrant;
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
    pub(super) fn holds(self, point: &Vector3<f64>) -> bool {
        sign(point[self.axis]) == self.sign
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
