//! What is asked of a study.

use std::path::PathBuf;

use crate::identify::Identify;
use crate::provenance::DEFAULT_SEED;
use crate::screening::DEFAULT_STARTS;

/// Rows N of the Sobol' analysis where none are asked for: N (m + 2) runs per condition of m parameters.
pub const DEFAULT_SOBOL: usize = 64;

/// Evaluations of each Bayesian optimization where none are asked for.
pub const DEFAULT_BAYESIAN_EVALUATIONS: usize = 150;

/// Iterations of each sequential quadratic programming where none are asked for.
pub const DEFAULT_SQP_ITERATIONS: u64 = 100;

/// How hard to work on a study. The default is what the command does without options.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeStudy {
    /// Steps, by name; none: all.
    pub steps: Vec<String>,
    /// Starts r of the Morris screening.
    pub starts: usize,
    /// Rows N of the Sobol' analysis; 0 for none.
    pub sobol: usize,
    /// Evaluations of each Bayesian optimization.
    pub bayesian_evaluations: usize,
    /// Iterations of each sequential quadratic programming.
    pub sqp_iterations: u64,
    /// What is asked about the parameters' intervals.
    pub identify: Identify,
    /// A table of prior knowledge, read when the step comes to it.
    pub priors: Option<PathBuf>,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for WholeStudy {
    fn default() -> Self {
        WholeStudy {
            steps: Vec::new(),
            starts: DEFAULT_STARTS,
            sobol: DEFAULT_SOBOL,
            bayesian_evaluations: DEFAULT_BAYESIAN_EVALUATIONS,
            sqp_iterations: DEFAULT_SQP_ITERATIONS,
            identify: Identify::default(),
            priors: None,
            seed: DEFAULT_SEED,
        }
    }
}
