//! Muscle models: curves, pennation, activation dynamics, Millard 2012 equilibrium.
//!
//! In: [`MuscleSpec`](carpus_osim::osim::spec::MuscleSpec) and, per evaluation, state (activation, fibre length) and
//! path (length, lengthening speed). Out: state derivatives, forces, and their derivatives. Nothing here knows of
//! paths, bones or time.

mod activation;
pub mod curves;
mod degroote_fregly2016;
mod deprecated;
mod dynamics;
mod equilibrium;
mod error;
mod kinematics;
mod law;
mod model;
mod parameters;
mod pennation;
mod rigid_tendon;
mod thelen2003;
mod velocity;

pub use activation::FirstOrderActivation;
pub use degroote_fregly2016::DeGrooteFregly2016;
pub use deprecated::DeprecatedMuscle;
pub use dynamics::MuscleDynamics;
pub use equilibrium::{EQUILIBRIUM_TOLERANCE, Equilibrium, EquilibriumError, EquilibriumStatus};
pub use error::MuscleError;
pub use law::{
    Balance, Contraction, MuscleLaw, RigidTendonRule, Start, ValueAndSlope, balance_of_forces, balance_of_velocities,
    force_of_fiber,
};
pub use model::{MuscleModel, MuscleRates, MuscleState};
pub use parameters::{MIN_NONZERO_DAMPING_COEFFICIENT, Millard2012, Millard2012Parameters};
pub use pennation::{FixedWidthPennation, Pennation};
pub use rigid_tendon::RigidTendon;
pub use thelen2003::Thelen2003;
pub use velocity::{FiberVelocity, Linearization, StateGradient};

#[cfg(test)]
mod conformance;
