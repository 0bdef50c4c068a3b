//! Fitting muscle parameters to recorded trials, and writing them back into the model file.
//!
//! In: training trials that are prepared for simulation, with their measured moments, and bounds. Out: fitted
//! parameters, what each stage did, and how far the data determine each parameter. Held-out trials are not seen here.
//!
//! [`Method::TwoStage`] is the procedure of the dissertation (chapter 3): first optimal fibre lengths and tendon slack
//! lengths, then maximum isometric forces, each by a global and a local search of the mean objective J (equation 3.4).
//! [`Method::Joint`], the default, goes on from there: all parameters together, by nonlinear least squares with the
//! exact derivatives of the simulation, and with a weak pull towards the model's own values so that a parameter that the
//! data say nothing about stays where anatomy put it (see [`Determination`]).
//!
//! ```text
//! let fit = personalize(&problem, &FitOptions::default(), &|_| ())?;
//! write_parameters(&mut file, &fit.fitted)?;        // only the fitted values' lines change
//! ```
//! [`fit_case`] fits the training cases of the dissertation's table 3.1 by its own optimizer and by exact gradients of J.
//!
//! The result depends on the seed, never on the number of threads.

mod bayesian;
mod cases;
mod error;
mod exact;
mod fibers;
mod joint;
mod moments;
mod objective;
mod parameters;
mod search;
mod sqp;
mod two_stage;
mod write;

use carpus_simulation::simulation::{MuscleParameters, PreparedTrial};
use carpus_study::study::ParameterBounds;
use moments::TrainingSet;

pub use cases::{CaseFit, CaseKind, CaseOptions, CaseProblem, Optimizer, TrainingCase, fit_case};
pub use error::PersonalizationError;
pub use fibers::RestingFiber;
pub use objective::mean_objective;
pub use parameters::{BoundHit, Determination, FittedParameter, Property};
pub use write::{WriteBackError, write_parameters};

/// A trial to fit.
#[derive(Clone, Copy, Debug)]
pub struct TrainingTrial<'a> {
    /// The trial, prepared for simulation.
    pub prepared: &'a PreparedTrial,
    /// Measured moment at the trial's samples [N·m].
    pub measured: &'a [f64],
}

/// What is to be fitted.
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
    /// Fascicle lengths from images that inform the joint fit, too.
    pub fibers: Vec<RestingFiber>,
}

/// How to search.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Lengths, then forces, as in chapter 3 of the dissertation.
    TwoStage,
    /// The two stages, then all parameters together.
    #[default]
    Joint,
}

/// How to search, and how hard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Seed of the global searches.
    pub seed: u64,
    /// Which stages.
    pub method: Method,
    /// Parameter sets of the global search over lengths (a Latin hypercube).
    pub global_points: usize,
    /// Simulated parameter sets that the local search over lengths may take.
    pub local_evaluations: usize,
}

impl Default for FitOptions {
    /// 64 points and 250 local evaluations: about 150 iterations of the dissertation's Bayesian search, and its SQP.
    fn default() -> Self {
        FitOptions { seed: 0, method: Method::Joint, global_points: 64, local_evaluations: 250 }
    }
}

/// How far a fit has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: &'static str,
    /// Parameter sets tried in all stages so far.
    pub evaluations: usize,
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
}

/// Fits the parameters of the active muscles to the training trials.
///
/// - `progress`: called now and then, from the calling thread
///
/// # Errors
/// No trials; measured moments that are zero throughout or of another length; bounds that exclude the model's own
/// values; a simulation that fails with the model's own parameters.
pub fn personalize(
    problem: &FitProblem,
    options: &FitOptions,
    progress: &dyn Fn(Progress),
) -> Result<Personalization, PersonalizationError> {
    personalize_while(problem, options, progress, &|| true)
}

/// As [`personalize`], as long as it is to go on.
///
/// - `goes_on`: asked between the searches of a fit, from the calling thread
///
/// # Errors
/// As there; [`PersonalizationError::Stopped`].
pub fn personalize_while(
    problem: &FitProblem,
    options: &FitOptions,
    progress: &dyn Fn(Progress),
    goes_on: &dyn Fn() -> bool,
) -> Result<Personalization, PersonalizationError> {
    let space = parameters::ParameterSpace::new(problem)?;
    let set = TrainingSet::new(problem)?;
    let expected = options.global_points + options.local_evaluations + joint::EXPECTED_EVALUATIONS;
    let (stages, evaluations) = (Vec::new(), 0);
    let mut run = Run { space: &space, set: &set, options, progress, goes_on, expected, stages, evaluations };
    let mut factors = run.two_stages()?;
    let mut determination = None;
    if options.method == Method::Joint {
        let (joint, known) = run.joint(&factors)?;
        factors = joint;
        determination = Some(known);
    }
    Ok(Personalization {
        parameters: space.parameters(&factors),
        fitted: space.fitted(&factors, determination.as_deref()),
        stages: run.stages,
        evaluations: run.evaluations,
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
        (self.progress)(Progress { stage: stage.name, evaluations: self.evaluations, expected: self.expected });
        self.stages.push(stage);
    }
}
