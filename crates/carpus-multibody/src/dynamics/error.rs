//! Why a model cannot be simulated forward.

use super::constraints::ConstraintError;
use super::path_jump::PathJump;
use super::solve::DynamicsError;
use crate::forces::ForceError;
use crate::muscles::{EquilibriumError, MuscleError};
use crate::paths::PathError;

/// Why a model cannot be simulated forward.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// A force cannot be built.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// A path cannot be built.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A muscle cannot be built.
    #[error(transparent)]
    Muscle(#[from] MuscleError),
    /// A muscle cannot be balanced at the start.
    #[error(transparent)]
    Equilibrium(#[from] EquilibriumError),
    /// A constraint cannot be built.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// The equations of motion have no solution.
    #[error(transparent)]
    Dynamics(#[from] DynamicsError),
    /// Forces that this program does not compute.
    #[error("forces that are not computed: {}", list(.forces))]
    UnsupportedForces {
        /// Names and classes.
        forces: Vec<(String, String)>,
    },
    /// A coordinate that both follows others and is held.
    #[error("{constraint}: the coordinate follows from others and is held besides")]
    NotExplicit {
        /// Name of the coordinate.
        constraint: String,
    },
    /// The end was not reached in as many steps as are allowed.
    #[error("{most_steps} integrator steps lead to t = {time} s only, of {end} s")]
    StepLimit {
        /// Steps allowed.
        most_steps: usize,
        /// Time reached [s].
        time: f64,
        /// Time wanted [s].
        end: f64,
    },
    /// The integration ended early.
    #[error("integration ended at t = {time} s: {reason}{}", .jump.as_ref().map_or_else(String::new, PathJump::to_string))]
    Stopped {
        /// Time [s].
        time: f64,
        /// Why.
        reason: String,
        /// A muscle whose length jumps there.
        jump: Option<PathJump>,
    },
}

fn list(forces: &[(String, String)]) -> String {
    forces.iter().map(|(name, class)| format!("{name} ({class})")).collect::<Vec<_>>().join(", ")
}
