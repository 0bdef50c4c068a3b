//! What comes of a fit, and how far it is.

use super::parameters::FittedParameter;
use carpus_simulation::simulation::MuscleParameters;

/// How far a fit has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: &'static str,
    /// Parameter sets tried, or steps taken, in all stages so far.
    pub done: usize,
    /// About how many there will be.
    pub expected: usize,
}

/// One stage of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What was fitted and how.
    pub name: &'static str,
    /// Parameter sets tried.
    pub evaluations: usize,
    /// Mean objective J over the training trials before the stage.
    pub objective_before: f64,
    /// And after it.
    pub objective_after: f64,
}

/// Result of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Personalization {
    /// The muscles' parameters after the fit, in the order of the problem.
    pub parameters: Vec<MuscleParameters>,
    /// Every fitted parameter with its bounds.
    pub fitted: Vec<FittedParameter>,
    /// The stages in order.
    pub stages: Vec<Stage>,
    /// Parameter sets tried in all stages.
    pub evaluations: usize,
    /// How far the parameters are from the model as given (0) to the fit itself (1), as trials left out one at a time
    /// are predicted best.
    pub part_of_the_way: f64,
}
