//! What is fitted, and how hard.

use carpus_simulation::simulation::{MuscleParameters, PreparedTrial};
use carpus_study::study::ParameterBounds;

/// A trial to fit.
#[derive(Clone, Copy, Debug)]
pub struct TrainingTrial<'a> {
    /// The trial, prepared for simulation.
    pub prepared: &'a PreparedTrial,
    /// Measured moment at the trial's samples [N·m].
    pub measured: &'a [f64],
}

/// What is to be fitted in two stages.
#[derive(Clone, Debug)]
pub struct FitProblem<'a> {
    /// Training trials.
    pub trials: Vec<TrainingTrial<'a>>,
    /// Names of the active muscles.
    pub muscles: Vec<String>,
    /// The muscles' parameters before the fit, in the same order.
    pub nominal: Vec<MuscleParameters>,
    /// Bounds relative to them.
    pub bounds: ParameterBounds,
}

/// How hard to search in two stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Seed of the global searches.
    pub seed: u64,
    /// Parameter sets of the global search over lengths (a Latin hypercube).
    pub global_points: usize,
    /// Simulated parameter sets that the local search over lengths may take.
    pub local_evaluations: usize,
}

impl Default for FitOptions {
    /// 64 points and 250 local evaluations: about 150 iterations of the dissertation's Bayesian search, and its SQP.
    fn default() -> Self {
        FitOptions { seed: 0, global_points: 64, local_evaluations: 250 }
    }
}
