//! Why nothing can be said of parameters.

use carpus_simulation::simulation::SimulationError;

/// Why nothing can be said.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifiabilityError {
    /// There is nothing to learn from.
    #[error("no training trials; expected at least one trial with use = train")]
    NoTrials,
    /// There is nothing to learn.
    #[error("no parameters: every one named is 0 or absent in the model")]
    NoParameters,
    /// A parameter's bounds exclude every value.
    #[error("{name}: bounds {lower} to {upper} times the model's value, expected 0 < lower < upper")]
    Bounds {
        /// The parameter.
        name: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// A session estimates lengths and forces alone.
    #[error("a property that is not among those that every fit estimates")]
    NotFitted,
    /// It was not to go on.
    #[error("stopped")]
    Stopped,
    /// A trial cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
}
