//! Equations of motion of the whole model, constraints included.
//!
//! ```text
//! M(q) u̇ + c(q, u) + Gᵀ λ = f,     G u̇ = b(q, u, t),     q̇ = N(q) u
//! ```
//! In: a compiled [`Model`](crate::multibody::Model), its [`Constraints`], coordinates q, OpenSim's generalized speeds
//! u, and applied forces. Out: accelerations, multipliers, consistent coordinates and speeds. No file is read here.

mod assembly;
mod constraints;
mod error;
mod mass;
mod path_jump;
mod plant;
mod reduction;
mod simulate;
mod solve;

pub use constraints::{ConstraintForce, Constraints};
pub use error::{ConstraintError, DynamicsError, PathJump, PlantError};
pub use plant::states::PlantState;
pub use plant::{DrivenPlant, LaggedActuator, Load, Plant, PlantMuscle, Work};
pub use reduction::{Reduction, Relation};
pub use simulate::{ForwardOptions, Trajectory, simulate_forward};
pub use solve::{Accelerations, Dynamics};
