//! Why parameters cannot be fitted.

use carpus_simulation::simulation::SimulationError;

/// Why parameters cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PersonalizationError {
    /// There is nothing to fit to.
    #[error("no training trials; expected at least one trial with use = train")]
    NoTrials,
    /// There is nothing to fit.
    #[error("no active muscles to fit")]
    NoMuscles,
    /// Names, parameters and trials do not belong together.
    #[error("{what}: {found}, expected {expected}, one for each active muscle")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// The measured moment has another length than the trial.
    #[error("{trial}: measured moment has {found} samples, the trial has {expected}")]
    MomentLength {
        /// The trial.
        trial: String,
        /// Samples of the measured moment.
        found: usize,
        /// Samples of the trial.
        expected: usize,
    },
    /// The measured moment cannot be used.
    #[error("{trial}: the measured moment is {problem}")]
    UnusableMoment {
        /// The trial.
        trial: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// Bounds that do not surround the model's own value.
    #[error(
        "bounds of {property}: {lower} to {upper} times the model's value, expected 0 < lower ≤ 1 ≤ upper, lower < \
         upper"
    )]
    Bounds {
        /// OpenSim property name.
        property: &'static str,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// The model's own parameters cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The caller did not want it to go on .
    #[error("the fit was stopped on request")]
    Stopped,
    /// The search ended without a usable result.
    #[error("{stage}: the search stopped: {reason}")]
    Search {
        /// The stage.
        stage: &'static str,
        /// What the optimizer said.
        reason: String,
    },
}
