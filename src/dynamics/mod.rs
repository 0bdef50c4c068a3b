//! Equations of motion of the whole model, constraints included.
//!
//! ```text
//! M(q) u̇ + c(q, u) + Gᵀ λ = f,     G u̇ = b(q, u, t),     q̇ = N(q) u
//! ```
//! In: a compiled [`Model`](crate::multibody::Model), its [`Constraints`], coordinates q, OpenSim's generalized speeds u,
//! and applied forces. Out: accelerations, multipliers, consistent coordinates and speeds. No file is read here.

mod applied;
mod constraints;
mod solve;

pub use applied::AppliedForces;
pub use constraints::{ConstraintError, Constraints};
pub use solve::{Accelerations, Dynamics, DynamicsError};
