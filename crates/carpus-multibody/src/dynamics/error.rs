//! Why constraints cannot be built, equations of motion not be solved, or a model not be simulated forward.

use crate::forces::ForceError;
use crate::muscles::{EquilibriumError, MuscleError};
use crate::paths::PathError;
use carpus_osim::osim::spec::Location;

/// Why constraints cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConstraintError {
    /// A class that is not enforced.
    #[error("{}: {class} is not supported", .at.path)]
    Unsupported {
        /// The constraint.
        at: Location,
        /// OpenSim class name.
        class: String,
    },
    /// A line without direction.
    #[error("{}: expected a line_direction_vec of nonzero length", .at.path)]
    NoDirection {
        /// The constraint.
        at: Location,
    },
}

impl ConstraintError {
    /// The constraint that it is about.
    pub fn at(&self) -> &Location {
        match self {
            ConstraintError::Unsupported { at, .. } | ConstraintError::NoDirection { at } => at,
        }
    }
}

/// Why the equations have no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DynamicsError {
    /// Something without mass can move: coordinates on which it depends are named.
    #[error(
        "accelerations are not determined: {} can move so that nothing with mass does (parts without mass, or axes of \
         a joint that coincide in this pose)",
        .coordinates.join(", ")
    )]
    Massless {
        /// Coordinates with the largest part in the massless motion.
        coordinates: Vec<String>,
    },
    /// Equations without a unique solution in a model whose bodies do not all have inertias of bodies.
    #[error("the mass matrix is singular: {} has a negative principal moment of inertia", .bodies.join(", "))]
    Singular {
        /// The bodies that have such an inertia.
        bodies: Vec<String>,
    },
    /// Constraints cannot be satisfied together.
    #[error("constraints cannot be satisfied: a violation of {violation:.2e} rad or m is left")]
    NotAssembled {
        /// Largest violation.
        violation: f64,
    },
    /// Forces or positions are not finite.
    #[error("the state or the forces on it are not finite")]
    NotFinite,
}

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
    #[error("integration ended at t = {time} s: \
             {reason}{}", .jump.as_ref().map_or_else(String::new, PathJump::to_string))]
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

/// A muscle whose length jumps.
#[derive(Clone, Debug, PartialEq)]
pub struct PathJump {
    /// The muscle's name.
    pub muscle: String,
    /// Length on this side of the jump, and beyond it [m].
    pub lengths: [f64; 2],
}

impl std::fmt::Display for PathJump {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [from, to] = self.lengths;
        let size = (to - from).abs();
        write!(
            f,
            "; there the length of muscle `{}` jumps by {size:.3} m, from {from:.4} to {to:.4} m: its path in the \
             model takes another way around a wrapping object or through a conditional point",
            self.muscle
        )
    }
}
