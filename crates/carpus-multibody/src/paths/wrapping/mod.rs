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
mod rounding;
pub mod sphere;
pub mod torus;
mod wrap;

pub use wrap::{Attempt, ConstrainedHalf, Effort, Wrap, WrapAction, WrapPath};

use carpus_osim::osim::spec::{WrapMethod, WrapShape};
use nalgebra::Vector3;

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
