//! Muscle paths: points, wrapping, lengths, lengthening speeds, moment arms.
//!
//! In: a [`PathSpec`](carpus_osim::osim::spec::PathSpec), the compiled skeleton and the poses of its bodies. Out: the
//! path's length [m], the points that it runs through, its lengthening speed [m/s] and its effective moment arm about a
//! coordinate [m, or dimensionless about a translation]. Forces are not here.
//!
//! ```text
//! let path = Path::compile(&muscle.path, &spec, &model)?;       // once
//! let mut geometry = path.new_geometry();                       // once per thread
//! model.update_positions(&q, &mut cache);
//! path.update(&q, &cache, &mut geometry);                       // geometry.length()
//! model.update_unit_motion(&q, flexion, &mut cache);
//! let arm = path.moment_arm(&q, &cache, &geometry);
//! ```
//!
//! Everything is computed as OpenSim 4.6 computes it (`GeometryPath`, `Wrap*`, `MomentArmSolver`): which segment wraps
//! over which object in which order, when the search for the order ends (0.5 mm), and the peculiarities of each
//! surface (see [`wrapping`]).
//!
//! **What OpenSim 4.6 does that geometry would not** and is reproduced, because OpenSim is the referee: on paths with
//! several wraps, straight pieces are measured from where a tangent point was put first (see
//! [`CurrentPoint::measured_p_GS`]), so that such a path can have a small moment arm about joints that it does not
//! cross; the search for tangency on a cylinder over-corrects, and for unlucky segments runs away by metres; the
//! finite tolerances of ellipsoid and torus show at 1e-5 m. Where OpenSim's own result is not a number (coincident
//! points, a curve over an ellipsoid that leaves its surface) a finite one is given.
//!
//! **Functions.** A `FunctionBasedPath` has no points: its length is a function of coordinates, its moment arms are
//! functions of their own or the derivatives of the length. Moment arms follow couplers, where OpenSim's
//! `computeMomentArm` gives the function's value; the forces on coordinates are the same.
//!
//! **History.** The result depends on the pose alone. OpenSim keeps the previous wrap of every path outside its state,
//! but version 4.6 cannot use it: the factor that it multiplies it with is NaN after every copy. So OpenSim's result
//! does not depend on the path's history either, with one exception that has not been seen in practice: an ellipsoid
//! on which the search for a closest point fails falls back to the point of the previous evaluation; here, as in a
//! fresh OpenSim model, it is then left unwrapped.

mod drawing;
mod error;
mod functions;
mod geometry;
mod motion;
mod path;
mod wrap_order;
pub mod wrapping;

pub use error::PathError;
pub use geometry::{CurrentPoint, PathGeometry, PointOrigin};
pub use path::Path;
