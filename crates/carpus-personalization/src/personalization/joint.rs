//! All parameters together: the joint mode of the training trials ([`carpus_diagnosis::inference::muscles`]).

use std::cell::Cell;

use super::error::PersonalizationError;
use super::objective::objective;
use super::parameters::ParameterSpace;
use super::result::{Personalization, Progress, Stage};
use carpus_diagnosis::diagnose::simulate;
use carpus_diagnosis::inference::muscles::{MuscleProblem, USUAL_REPORTS};
use carpus_effects::forward_model::ForwardModel;
use carpus_simulation::simulation::{MuscleParameters, SimulationError};
use carpus_study::study::TrialUse;

const STAGE: &str = "all parameters, joint mode";

/// Fits the parameters of the active muscles to the training trials: the values that are handed over, and what the
/// trials say of each.
///
/// - `progress`: called now and then, from the calling thread
/// - `goes_on`: asked between the searches, from the calling thread
///
/// # Errors
/// No trials; no muscles; bounds that exclude the model's own values; a trial that cannot be simulated;
/// [`PersonalizationError::Stopped`].
pub fn personalize(
    problem: &MuscleProblem,
    progress: &dyn Fn(Progress),
    goes_on: &dyn Fn() -> bool,
) -> Result<Personalization, PersonalizationError> {
    let forward = problem.forward;
    if forward.trials_for(TrialUse::Train).is_empty() {
        return Err(PersonalizationError::NoTrials);
    }
    let names = forward.muscles.iter().map(|m| m.name.clone()).collect();
    let space = ParameterSpace::new(names, forward.nominal_parameters(), &problem.bounds)?;
    let steps = Cell::new(0);
    let report = |text: &str| {
        log::debug!("{text}");
        steps.set(steps.get() + 1);
        progress(Progress { stage: STAGE, done: steps.get(), expected: USUAL_REPORTS.max(steps.get()) });
    };
    let found = problem.estimate(&report, goes_on)?.ok_or(PersonalizationError::Stopped)?;
    let parameters = found.handed_over.parameters;
    let stage = Stage {
        name: STAGE,
        evaluations: found.session.analysis.linearizations(),
        objective_before: mean_objective(forward, &forward.nominal_parameters())?,
        objective_after: mean_objective(forward, &parameters)?,
    };
    Ok(Personalization {
        fitted: space.fitted(&space.factors(&parameters), Some(found.parameters)),
        parameters,
        evaluations: stage.evaluations,
        stages: vec![stage],
        part_of_the_way: found.handed_over.part,
    })
}

/// Mean objective J over the training trials in which a moment was measured.
fn mean_objective(forward: &ForwardModel, parameters: &[MuscleParameters]) -> Result<f64, SimulationError> {
    let simulated = simulate(forward, parameters, &[], TrialUse::Train)?;
    let measured = |g: &usize| &forward.trials[*g].moment;
    let trials = simulated.iter().filter(|(g, _)| measured(g).iter().any(|m| *m != 0.0));
    let objectives: Vec<f64> = trials.map(|(g, moment)| objective(measured(g), moment)).collect();
    Ok(objectives.iter().sum::<f64>() / objectives.len().max(1) as f64)
}
