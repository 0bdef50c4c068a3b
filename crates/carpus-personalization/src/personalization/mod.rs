//! Fitting muscle parameters to recorded trials, and writing them back into the model file.
//!
//! In: training trials and bounds. Out: fitted parameters, what each stage did, and what the trials say of each
//! parameter. Held-out trials are not seen here.
//!
//! [`personalize`] estimates all parameters together, in the statistical model of a session that the diagnosis has, too
//! ([`carpus_diagnosis::inference`]): a parameter that the data say nothing about stays where anatomy put it, and what
//! is handed over predicts left-out trials no worse than the model as given. [`fit_in_two_stages`] is the procedure of
//! the dissertation (chapter 3): first optimal fibre lengths and tendon slack lengths, then maximum isometric forces,
//! each by a global and a local search of the mean objective J (equation 3.4).
//!
//! ```text
//! let fit = personalize(&problem, &|_| (), &|| true)?;
//! write_parameters(&mut file, &fit.fitted)?;        // only the fitted values' lines change
//! ```
//! [`fit_case`] fits the training cases of the dissertation's table 3.1 by its own optimizer and by exact gradients of
//! J.
//!
//! The result depends on the seed, never on the number of threads.

mod bayesian;
mod cases;
mod error;
mod exact;
mod gaussian_process;
mod joint;
mod minimizers;
mod moments;
mod objective;
mod parameters;
mod search;
mod two_stage;
mod write;

pub use carpus_diagnosis::inference::muscles::{MuscleEstimate, MuscleProblem};
pub use carpus_diagnosis::inference::resting_fiber::RestingFiber;
pub use carpus_simulation::simulation::Property;
use carpus_simulation::simulation::{MuscleParameters, PreparedTrial};
use carpus_study::study::ParameterBounds;
use moments::TrainingSet;

pub use cases::{CaseFit, CaseKind, CaseOptions, CaseProblem, Optimizer, TrainingCase, fit_case};
pub use error::PersonalizationError;
pub use joint::personalize;
pub use objective::mean_objective;
pub use parameters::{BoundHit, FittedParameter};
pub use write::{WriteBackError, write_parameters};

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

/// Fits lengths, then forces, as in chapter 3 of the dissertation, whatever that makes of trials that were not fitted.
///
/// - `progress`: called now and then, from the calling thread
/// - `goes_on`: asked between the searches, from the calling thread
///
/// # Errors
/// No trials; measured moments that are zero throughout or of another length; bounds that exclude the model's own
/// values; a simulation that fails with the model's own parameters; [`PersonalizationError::Stopped`].
pub fn fit_in_two_stages(
    problem: &FitProblem,
    options: &FitOptions,
    progress: &dyn Fn(Progress),
    goes_on: &dyn Fn() -> bool,
) -> Result<Personalization, PersonalizationError> {
    let space = parameters::ParameterSpace::of(problem)?;
    let set = TrainingSet::new(problem)?;
    let expected = options.global_points + options.local_evaluations;
    let (stages, evaluations) = (Vec::new(), 0);
    let mut run = Run { space: &space, set: &set, options, progress, goes_on, expected, stages, evaluations };
    let factors = run.two_stages()?;
    Ok(Personalization {
        parameters: space.parameters(&factors),
        fitted: space.fitted(&factors, None),
        stages: run.stages,
        evaluations: run.evaluations,
        part_of_the_way: 1.0,
    })
}

/// A fit under way.
struct Run<'a> {
    space: &'a parameters::ParameterSpace,
    set: &'a TrainingSet<'a>,
    options: &'a FitOptions,
    progress: &'a dyn Fn(Progress),
    goes_on: &'a dyn Fn() -> bool,
    expected: usize,
    stages: Vec<Stage>,
    evaluations: usize,
}

impl Run<'_> {
    /// Fails where the fit is not to go on.
    fn go_on(&self) -> Result<(), PersonalizationError> {
        if (self.goes_on)() { Ok(()) } else { Err(PersonalizationError::Stopped) }
    }

    fn finish_stage(&mut self, stage: Stage) {
        self.evaluations += stage.evaluations;
        (self.progress)(Progress { stage: stage.name, done: self.evaluations, expected: self.expected });
        self.stages.push(stage);
    }
}
