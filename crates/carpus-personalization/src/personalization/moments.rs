//! The training trials, and their simulated moments for a vector of factors.

use rayon::prelude::*;

use super::error::PersonalizationError;
use super::objective::objective;
use super::problem::{FitProblem, TrainingTrial};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};

/// Training trials, ready for many evaluations.
#[derive(Debug)]
pub(super) struct TrainingSet<'a> {
    pub(super) trials: Vec<TrainingTrial<'a>>,
    /// Per trial: the part of the moment that no fitted parameter changes [N·m].
    pub(super) fixed: Vec<Vec<f64>>,
}

/// Moment of every muscle per unit of maximum isometric force, per trial and muscle [m].
pub(super) type UnitMoments = Vec<Vec<Vec<f64>>>;

impl<'a> TrainingSet<'a> {
    pub(super) fn new(problem: &FitProblem<'a>) -> Result<TrainingSet<'a>, PersonalizationError> {
        if problem.trials.is_empty() {
            return Err(PersonalizationError::NoTrials);
        }
        for trial in &problem.trials {
            let name = || trial.prepared.name().to_owned();
            let (found, expected) = (trial.prepared.n_muscles(), problem.nominal.len());
            if found != expected {
                return Err(PersonalizationError::Count { what: "muscles of a prepared trial", found, expected });
            }
            let (found, expected) = (trial.measured.len(), trial.prepared.len());
            if found != expected {
                return Err(PersonalizationError::MomentLength { trial: name(), found, expected });
            }
            if trial.measured.iter().any(|m| !m.is_finite()) {
                return Err(PersonalizationError::UnusableMoment { trial: name(), problem: "not a finite number" });
            }
            if trial.measured.iter().all(|m| *m == 0.0) {
                return Err(PersonalizationError::UnusableMoment { trial: name(), problem: "zero throughout" });
            }
        }
        let fixed = problem.trials.iter().map(|t| t.prepared.moment_without_muscles()).collect();
        Ok(TrainingSet { trials: problem.trials.clone(), fixed })
    }

    /// Unit moments of all muscles in all trials; parallel over both.
    pub(super) fn unit_moments(&self, parameters: &[MuscleParameters]) -> Result<UnitMoments, SimulationError> {
        let n = parameters.len();
        let flat: Vec<Result<Vec<f64>, SimulationError>> = (0..self.trials.len() * n)
            .into_par_iter()
            .map(|i| {
                let (trial, muscle) = (self.trials[i / n].prepared, i % n);
                let mut moment = vec![0.0; trial.len()];
                trial.add_unit_moment(muscle, &parameters[muscle], &mut moment)?;
                Ok(moment)
            })
            .collect();
        let mut flat = flat.into_iter();
        self.trials.iter().map(|_| flat.by_ref().take(n).collect()).collect()
    }

    /// Mean objective J of given unit moments and forces.
    pub(super) fn objective_of(&self, unit: &UnitMoments, forces: &[f64]) -> f64 {
        let per_trial: Vec<f64> = (0..self.trials.len())
            .map(|t| {
                let mut moment = self.fixed[t].clone();
                for (unit, force) in unit[t].iter().zip(forces) {
                    for (total, u) in moment.iter_mut().zip(unit) {
                        *total += force * u;
                    }
                }
                objective(self.trials[t].measured, &moment)
            })
            .collect();
        per_trial.iter().sum::<f64>() / per_trial.len() as f64
    }

    /// Mean objective J of parameters.
    pub(super) fn objective(&self, parameters: &[MuscleParameters]) -> Result<f64, SimulationError> {
        let forces: Vec<f64> = parameters.iter().map(|p| p.max_isometric_force).collect();
        Ok(self.objective_of(&self.unit_moments(parameters)?, &forces))
    }
}
