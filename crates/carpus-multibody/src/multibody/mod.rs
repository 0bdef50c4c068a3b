//! The compiled, immutable multibody model: coordinates, joints, couplers, kinematics.
//!
//! In: a [`ModelSpec`](carpus_osim::osim::spec::ModelSpec). Out: a [`Model`] that is `Send + Sync` and never changes,
//! and [`Cache`] buffers that `update_*` functions fill with poses, velocities and accelerations. No file is read here
//! and nothing is printed. Muscles, paths and forces build on this module; it knows nothing of them.
//!
//! Conventions: G is ground, P the inboard and B the outboard body of a joint, F the joint's frame on its parent, M the
//! joint's frame on its child. All vectors are expressed in ground unless named otherwise.

mod beyond;
mod cache;
mod compile;
mod coordinate;
mod coupler;
mod coupling;
mod dynamics;
mod error;
mod index;
mod kinematics;
mod mobilizer;
mod model;
mod speeds;
mod subset;

pub use cache::Cache;
pub use coordinate::Coordinate;
pub use coupler::Coupler;
pub use dynamics::DynamicsBuffers;
pub use error::{CompileError, CouplerProblem};
pub use index::BaseIndex;
pub use model::{Body, Frame, LoopWeld, Model, WrapPlacement};
pub use subset::BodySubset;
