//! Rotations, rigid transforms, spatial velocities and spatial forces.
//!
//! Monogram notation: `X_GB` is the pose of frame B in frame G (so that `p_GS = X_GB * p_BS`), `R_GB` its rotation,
//! `p_BS` the position of point S from the origin of B expressed in B. Spatial velocities and forces are taken at a
//! body's origin and expressed in ground unless a name says otherwise. Metres, radians, seconds, newtons.

mod rotation;
mod transform;
mod vectors;

pub use rotation::{angular_rate_matrix_body_xyz, body_xyz_angles, rotation_about_axis, rotation_body_xyz};
pub use transform::Transform;
pub use vectors::{SpatialAcceleration, SpatialForce, SpatialVelocity};
