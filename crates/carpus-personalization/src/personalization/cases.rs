//! The training cases of the dissertation (chapter 3, table 3.1), and two optimizers that fit them.

use std::ops::Range;

use super::bayesian::minimize_by_expected_improvement;
use super::error::PersonalizationError;
use super::exact::SmoothObjective;
use super::minimizers::Found;
use super::minimizers::minimize_by_differences;
use super::moments::TrainingSet;
use super::parameters::{FittedParameter, ParameterSpace};
use super::problem::{FitProblem, TrainingTrial};
use super::result::Stage;
use super::search::UNUSABLE;
use carpus_simulation::simulation::MuscleParameters;
use carpus_study::study::{Contraction, ParameterBounds, TrialInfo, TrialUse};

/// Most rounds of lengths and forces in turn, where they are fitted to different trials.
const ROUNDS: usize = 2;

/// Which trials inform the lengths and which the forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CaseKind {
    /// Isometric trials inform all parameters.
    Isometric,
    /// Isotonic trials inform all parameters.
    Isotonic,
    /// Isotonic trials inform the lengths, isometric trials the forces.
    Cross,
    /// Isometric and isotonic trials inform all parameters.
    Combined,
}

impl CaseKind {
    /// All, in the order of table 3.1.
    pub const ALL: [CaseKind; 4] = [CaseKind::Isometric, CaseKind::Isotonic, CaseKind::Cross, CaseKind::Combined];

    /// The word for it.
    pub fn word(self) -> &'static str {
        match self {
            CaseKind::Isometric => "isometric",
            CaseKind::Isotonic => "isotonic",
            CaseKind::Cross => "cross",
            CaseKind::Combined => "combined",
        }
    }

    fn lengths_from(self) -> &'static [Contraction] {
        match self {
            CaseKind::Isometric => &[Contraction::Isometric],
            CaseKind::Isotonic | CaseKind::Cross => &[Contraction::Isotonic],
            CaseKind::Combined => &[Contraction::Isometric, Contraction::Isotonic],
        }
    }

    fn forces_from(self) -> &'static [Contraction] {
        match self {
            CaseKind::Cross => &[Contraction::Isometric],
            other => other.lengths_from(),
        }
    }
}

/// A training case: kinds of contraction at one effort.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingCase {
    /// Which trials.
    pub kind: CaseKind,
    /// At this effort [% of the maximum voluntary effort].
    pub effort_percent: f64,
}

impl TrainingCase {
    /// The cases of a study: every kind at every effort at which there are isometric or isotonic trials to train with.
    pub fn of_trials<'t>(trials: impl Iterator<Item = &'t TrialInfo>) -> Vec<TrainingCase> {
        let mut efforts: Vec<f64> = trials
            .filter(|t| t.usage == TrialUse::Train)
            .filter(|t| matches!(t.contraction, Contraction::Isometric | Contraction::Isotonic))
            .filter_map(|t| t.effort_percent)
            .collect();
        efforts.sort_by(f64::total_cmp);
        efforts.dedup();
        let of_kind = |kind| efforts.iter().map(move |&effort_percent| TrainingCase { kind, effort_percent });
        CaseKind::ALL.into_iter().flat_map(of_kind).collect()
    }

    /// A name that is also a file name: `isotonic_25`.
    pub fn id(&self) -> String {
        format!("{}_{}", self.kind.word(), self.effort_percent)
    }

    /// A name for people: `isotonic 25 %`.
    pub fn label(&self) -> String {
        format!("{} {} %", self.kind.word(), self.effort_percent)
    }

    /// Whether a trial informs the lengths.
    pub fn informs_lengths(&self, trial: &TrialInfo) -> bool {
        self.has(trial, self.kind.lengths_from())
    }

    /// Whether a trial informs the forces.
    pub fn informs_forces(&self, trial: &TrialInfo) -> bool {
        self.has(trial, self.kind.forces_from())
    }

    fn has(&self, trial: &TrialInfo, contractions: &[Contraction]) -> bool {
        trial.usage == TrialUse::Train
            && trial.effort_percent == Some(self.effort_percent)
            && contractions.contains(&trial.contraction)
    }
}

/// What is to be fitted, and to what.
#[derive(Clone, Debug)]
pub struct CaseProblem<'a> {
    /// Trials that inform the lengths.
    pub lengths: Vec<TrainingTrial<'a>>,
    /// Trials that inform the forces; the same as those of the lengths in all cases but [`CaseKind::Cross`].
    pub forces: Vec<TrainingTrial<'a>>,
    /// Names of the active muscles.
    pub muscles: Vec<String>,
    /// The muscles' parameters before the fit, in the same order.
    pub nominal: Vec<MuscleParameters>,
    /// Bounds relative to them.
    pub bounds: ParameterBounds,
}

/// How a case is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Optimizer {
    /// As in the dissertation: lengths, then forces, each by Bayesian optimization (150 evaluations) and sequential
    /// quadratic programming with differences of the objective.
    BayesianSqp,
    /// All parameters together with exact gradients, from several starts; where the case takes its forces from other
    /// trials than its lengths, both in turn, each given the other.
    ExactGradients,
}

impl Optimizer {
    /// All.
    pub const ALL: [Optimizer; 2] = [Optimizer::BayesianSqp, Optimizer::ExactGradients];

    /// A name that is also a file name.
    pub fn id(self) -> &'static str {
        match self {
            Optimizer::BayesianSqp => "bayesian_sqp",
            Optimizer::ExactGradients => "exact_gradients",
        }
    }
}

/// How hard the optimizers search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CaseOptions {
    /// Seed of everything random.
    pub seed: u64,
    /// Evaluations of each Bayesian optimization.
    pub bayesian_evaluations: usize,
    /// Iterations of each sequential quadratic programming.
    pub sqp_iterations: u64,
    /// Points of the hypercube from which the exact method takes its starts.
    pub screened_points: usize,
    /// Starts of the exact method, besides the model itself.
    pub starts: usize,
}

impl Default for CaseOptions {
    /// 150 evaluations, as in the dissertation.
    fn default() -> Self {
        CaseOptions { seed: 0, bayesian_evaluations: 150, sqp_iterations: 100, screened_points: 32, starts: 2 }
    }
}

/// Result of a fit of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseFit {
    /// The muscles' parameters after the fit, in the order of the problem.
    pub parameters: Vec<MuscleParameters>,
    /// Every fitted parameter with its bounds.
    pub fitted: Vec<FittedParameter>,
    /// The stages in order; each with J over the trials that it was fitted to.
    pub stages: Vec<Stage>,
    /// Parameter sets tried in all stages.
    pub evaluations: usize,
    /// Mean J over all trials of the case with the model itself.
    pub objective_before: f64,
    /// Mean J over all trials of the case with the fitted parameters.
    pub objective: f64,
}

/// Fits a training case: J = NRMSE + MaxErr + XCorr (equation 3.4), averaged over its trials, within the bounds.
///
/// # Errors
/// No trials for lengths or forces; otherwise as [`personalize`](super::personalize).
pub fn fit_case(
    problem: &CaseProblem,
    optimizer: Optimizer,
    options: &CaseOptions,
) -> Result<CaseFit, PersonalizationError> {
    let lengths = FitProblemParts::new(problem, problem.lengths.clone())?;
    let forces = FitProblemParts::new(problem, problem.forces.clone())?;
    let mut fit =
        Fit { space: &lengths.space, lengths: &lengths.set, forces: &forces.set, options, stages: Vec::new() };
    let unchanged = lengths.space.unchanged();
    let factors = match optimizer {
        Optimizer::BayesianSqp => fit.bayesian_sqp(unchanged.clone())?,
        Optimizer::ExactGradients => fit.exact_gradients(unchanged.clone(), same_trials(problem))?,
    };
    // Where both sets are the same trials, the mean over both is the mean over one.
    let (objective_before, objective) = (fit.objective_of_all(&unchanged)?, fit.objective_of_all(&factors)?);
    Ok(CaseFit {
        parameters: lengths.space.parameters(&factors),
        fitted: lengths.space.fitted(&factors, None),
        evaluations: fit.stages.iter().map(|s| s.evaluations).sum(),
        stages: fit.stages,
        objective_before,
        objective,
    })
}

fn same_trials(problem: &CaseProblem) -> bool {
    let same = |(a, b): (&TrainingTrial, &TrainingTrial)| std::ptr::eq(a.prepared, b.prepared);
    problem.lengths.len() == problem.forces.len() && problem.lengths.iter().zip(&problem.forces).all(same)
}

/// A checked set of trials with the space of the parameters.
struct FitProblemParts<'a> {
    space: ParameterSpace,
    set: TrainingSet<'a>,
}

impl<'a> FitProblemParts<'a> {
    fn new(problem: &CaseProblem<'a>, trials: Vec<TrainingTrial<'a>>) -> Result<Self, PersonalizationError> {
        let (muscles, nominal) = (problem.muscles.clone(), problem.nominal.clone());
        let problem = FitProblem { trials, muscles, nominal, bounds: problem.bounds };
        Ok(FitProblemParts { space: ParameterSpace::of(&problem)?, set: TrainingSet::new(&problem)? })
    }
}

struct Fit<'a> {
    space: &'a ParameterSpace,
    lengths: &'a TrainingSet<'a>,
    forces: &'a TrainingSet<'a>,
    options: &'a CaseOptions,
    stages: Vec<Stage>,
}

impl Fit<'_> {
    fn bayesian_sqp(&mut self, mut factors: Vec<f64>) -> Result<Vec<f64>, PersonalizationError> {
        let m = self.space.n_muscles();
        let (space, lengths) = (self.space, self.lengths);
        let base = factors.clone();
        let of_lengths =
            |point: &[f64]| lengths.objective(&space.parameters(&space.placed(&base, 0, point))).unwrap_or(UNUSABLE);
        let names = ["lengths, Bayesian optimization", "lengths, SQP"];
        let point = self.globally_then_locally(&of_lengths, &space.unit_point(&base, 0, 2 * m), names, 1)?;
        factors = space.placed(&factors, 0, &point);

        let unit = self.forces.unit_moments(&space.parameters(&factors))?;
        let (base, forces) = (factors.clone(), self.forces);
        let of_forces = |point: &[f64]| {
            let parameters = space.parameters(&space.placed(&base, 2 * m, point));
            let values: Vec<f64> = parameters.iter().map(|p| p.max_isometric_force).collect();
            forces.objective_of(&unit, &values)
        };
        let names = ["forces, Bayesian optimization", "forces, SQP"];
        let point = self.globally_then_locally(&of_forces, &space.unit_point(&base, 2 * m, m), names, 2)?;
        Ok(space.placed(&factors, 2 * m, &point))
    }

    /// Bayesian optimization, then SQP from the best point so far, the model's own among them.
    fn globally_then_locally(
        &mut self,
        cost: &dyn Fn(&[f64]) -> f64,
        own: &[f64],
        [globally, locally]: [&'static str; 2],
        stream: u64,
    ) -> Result<Vec<f64>, PersonalizationError> {
        let failed = |stage: &'static str| move |reason: String| PersonalizationError::Search { stage, reason };
        let start = cost(own);
        let evaluations = self.options.bayesian_evaluations;
        let seed = self.options.seed.wrapping_mul(2).wrapping_add(stream);
        let mut best = minimize_by_expected_improvement(cost, own.len(), evaluations, seed);
        if best.cost > start {
            (best.point, best.cost) = (own.to_vec(), start);
        }
        self.stages.push(Stage {
            name: globally,
            evaluations: evaluations + 1,
            objective_before: start,
            objective_after: best.cost,
        });
        let local = minimize_by_differences(cost, &best.point, self.options.sqp_iterations).map_err(failed(locally))?;
        let evaluations = local.evaluations;
        let (point, after) = if local.cost < best.cost { (local.point, local.cost) } else { (best.point, best.cost) };
        self.stages.push(Stage { name: locally, evaluations, objective_before: best.cost, objective_after: after });
        Ok(point)
    }

    fn exact_gradients(&mut self, unchanged: Vec<f64>, same_trials: bool) -> Result<Vec<f64>, PersonalizationError> {
        let all = 0..self.space.len();
        if same_trials {
            return Ok(self.smoothly("all parameters, exact gradients", self.lengths, unchanged, all, Some(0))?.0);
        }
        // Lengths from some trials and forces from others. Few trials leave several lengths about equally good: those
        // that were found with the forces free and with the model's forces, from every start; the forces are fitted to
        // each, and the best by all trials counts.
        let lengths = 0..2 * self.space.n_muscles();
        let forces = lengths.end..self.space.len();
        let mut best: Option<(Vec<f64>, f64)> = None;
        for (name, free) in [("all parameters, exact gradients", all), ("lengths, exact gradients", lengths.clone())] {
            let (found, ends) = self.smoothly(name, self.lengths, unchanged.clone(), free, Some(0))?;
            for candidate in std::iter::once(found).chain(ends) {
                let name = "forces, exact gradients";
                let (factors, _) = self.smoothly(name, self.forces, candidate, forces.clone(), Some(1))?;
                self.keep_the_better(&mut best, factors)?;
            }
        }
        for _ in 0..ROUNDS {
            let Some((factors, _)) = best.clone() else { break };
            let name = "lengths again, exact gradients";
            let (factors, _) = self.smoothly(name, self.lengths, factors, lengths.clone(), None)?;
            let name = "forces again, exact gradients";
            let (factors, _) = self.smoothly(name, self.forces, factors, forces.clone(), None)?;
            if !self.keep_the_better(&mut best, factors)? {
                break;
            }
        }
        Ok(best.map_or(unchanged, |(factors, _)| factors))
    }

    /// Whether factors are better by all trials than the best so far, which they then are.
    fn keep_the_better(
        &self,
        best: &mut Option<(Vec<f64>, f64)>,
        factors: Vec<f64>,
    ) -> Result<bool, PersonalizationError> {
        let cost = self.objective_of_all(&factors)?;
        let better = best.as_ref().is_none_or(|(_, least)| cost < *least);
        if better {
            *best = Some((factors, cost));
        }
        Ok(better)
    }

    /// Mean J over the trials of lengths and of forces.
    fn objective_of_all(&self, factors: &[f64]) -> Result<f64, PersonalizationError> {
        let parameters = self.space.parameters(factors);
        let (a, b) = (self.lengths.trials.len() as f64, self.forces.trials.len() as f64);
        Ok((a * self.lengths.objective(&parameters)? + b * self.forces.objective(&parameters)?) / (a + b))
    }

    /// Minimizes J of some trials over some factors: the best, and where all starts led.
    ///
    /// - `widely`: from starts all over the box, of that stream of random numbers; else from `base` alone
    fn smoothly(
        &mut self,
        name: &'static str,
        set: &TrainingSet,
        base: Vec<f64>,
        free: Range<usize>,
        widely: Option<u64>,
    ) -> Result<(Vec<f64>, Vec<Vec<f64>>), PersonalizationError> {
        let before = set.objective(&self.space.parameters(&base))?;
        let problem = SmoothObjective::new(self.space, set, base.clone(), free);
        let found: Found = match widely {
            Some(stream) => {
                let seed = self.options.seed.wrapping_add(stream);
                problem
                    .minimize(self.options.screened_points, self.options.starts, seed)
                    .map_err(|reason| PersonalizationError::Search { stage: name, reason })?
            }
            None => problem.minimize_nearby(),
        };
        let better = found.cost < before;
        let factors = if better { problem.factors_of(&found) } else { base };
        self.stages.push(Stage {
            name,
            evaluations: found.evaluations + 1,
            objective_before: before,
            objective_after: found.cost.min(before),
        });
        Ok((factors, problem.factors_of_ends()))
    }
}
