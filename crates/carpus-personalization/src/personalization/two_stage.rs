//! The two stages of the dissertation: lengths, then forces, each globally and then locally.

use rayon::prelude::*;

use super::error::PersonalizationError;
use super::minimizers::{Found, minimize_in_unit_box};
use super::moments::{TrainingSet, UnitMoments};
use super::parameters::ParameterSpace;
use super::problem::{FitOptions, FitProblem};
use super::result::{Personalization, Progress, Stage};
use super::search::{UNUSABLE, latin_hypercube};

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
    let space = ParameterSpace::of(problem)?;
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
    space: &'a ParameterSpace,
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

const LENGTHS_GLOBALLY: &str = "lengths, global search";
const LENGTHS_LOCALLY: &str = "lengths, local search";
const FORCES_GLOBALLY: &str = "forces, global search";
const FORCES_LOCALLY: &str = "forces, local search";

/// Moments are linear in the forces, so that a set of forces costs next to nothing.
const FORCE_POINTS: usize = 256;
const FORCE_EVALUATIONS: usize = 1500;
/// First trust region of local searches, of the box's width.
const LOCAL_RADIUS: f64 = 0.1;

impl Run<'_> {
    /// Factors of all parameters after both stages.
    pub(super) fn two_stages(&mut self) -> Result<Vec<f64>, PersonalizationError> {
        let mut factors = self.space.unchanged();
        let start = self.set.objective(&self.space.parameters(&factors))?;
        self.go_on()?;
        let after_lengths = self.fit_lengths(&mut factors, start)?;
        self.go_on()?;
        self.fit_forces(&mut factors, after_lengths)?;
        Ok(factors)
    }

    fn fit_lengths(&mut self, factors: &mut [f64], start: f64) -> Result<f64, PersonalizationError> {
        let n = 2 * self.space.n_muscles();
        let (space, set) = (self.space, self.set);
        let base = factors.to_vec();
        let objective_at = |point: &[f64]| {
            let parameters = space.parameters(&space.placed(&base, 0, point));
            set.objective(&parameters).unwrap_or(UNUSABLE)
        };
        let points = latin_hypercube(self.options.global_points, n, self.options.seed, 1);
        let costs: Vec<f64> = points.par_iter().map(|point| objective_at(point)).collect();
        let (best, cost) = best_of(&points, &costs, space.unit_point(&base, 0, n), start);
        self.go_on()?;
        let local = minimize_in_unit_box(&objective_at, &best, LOCAL_RADIUS, self.options.local_evaluations)
            .map_err(|reason| PersonalizationError::Search { stage: LENGTHS_LOCALLY, reason })?;
        self.finish_stage(Stage {
            name: LENGTHS_GLOBALLY,
            evaluations: points.len(),
            objective_before: start,
            objective_after: cost,
        });
        Ok(self.accept(factors, 0, LENGTHS_LOCALLY, (best, cost), local))
    }

    fn fit_forces(&mut self, factors: &mut [f64], start: f64) -> Result<(), PersonalizationError> {
        let n = self.space.n_muscles();
        let first = 2 * n;
        let (space, set) = (self.space, self.set);
        let base = factors.to_vec();
        let unit: UnitMoments = set.unit_moments(&space.parameters(&base))?;
        let objective_at = |point: &[f64]| {
            let parameters = space.parameters(&space.placed(&base, first, point));
            let forces: Vec<f64> = parameters.iter().map(|p| p.max_isometric_force).collect();
            set.objective_of(&unit, &forces)
        };
        let points = latin_hypercube(FORCE_POINTS, n, self.options.seed, 2);
        let costs: Vec<f64> = points.par_iter().map(|point| objective_at(point)).collect();
        let (best, cost) = best_of(&points, &costs, space.unit_point(&base, first, n), start);
        let local = minimize_in_unit_box(&objective_at, &best, LOCAL_RADIUS, FORCE_EVALUATIONS)
            .map_err(|reason| PersonalizationError::Search { stage: FORCES_LOCALLY, reason })?;
        self.finish_stage(Stage {
            name: FORCES_GLOBALLY,
            evaluations: points.len(),
            objective_before: start,
            objective_after: cost,
        });
        self.accept(factors, first, FORCES_LOCALLY, (best, cost), local);
        Ok(())
    }

    /// Takes the local search's point, or its start if it found nothing better.
    fn accept(
        &mut self,
        factors: &mut [f64],
        first: usize,
        name: &'static str,
        (start, start_cost): (Vec<f64>, f64),
        local: Found,
    ) -> f64 {
        let evaluations = local.evaluations;
        let (point, cost) = if local.cost < start_cost { (local.point, local.cost) } else { (start, start_cost) };
        factors.copy_from_slice(&self.space.placed(factors, first, &point));
        self.finish_stage(Stage { name, evaluations, objective_before: start_cost, objective_after: cost });
        cost
    }
}

/// The best of some points and of the point that the search came from; the earliest of equals.
fn best_of(points: &[Vec<f64>], costs: &[f64], start: Vec<f64>, start_cost: f64) -> (Vec<f64>, f64) {
    let mut best = (start, start_cost);
    for (point, &cost) in points.iter().zip(costs) {
        if cost < best.1 {
            best = (point.clone(), cost);
        }
    }
    best
}
