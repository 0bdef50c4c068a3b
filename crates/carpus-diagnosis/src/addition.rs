//! Effects added to a model: each step of the way fitted jointly with the muscle parameters.

use std::collections::BTreeMap;

use super::diagnose::{ParameterEstimate, Request};
use super::fit::Analysis;
use super::inference::muscles::MuscleEstimate;
use super::inference::session::{HandedOver, Session, State};
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::Setting;
use carpus_simulation::simulation::{MuscleParameters, SimulationError};

/// A model after a step: what was fitted, and what that leaves.
#[derive(Clone, Debug)]
pub struct FittedStep {
    /// Muscle parameters.
    pub parameters: Vec<MuscleParameters>,
    /// What the trials say of them, with these effects.
    pub muscles: Vec<MuscleEstimate>,
    /// How far muscles and effects are from the model as given (0) to the joint mode (1).
    pub part_of_the_way: f64,
    /// Effects; empty where only the muscles were fitted.
    pub effects: Vec<Setting>,
    /// The effects' parameters by `effect.parameter`.
    pub estimates: BTreeMap<String, ParameterEstimate>,
    /// p-value of “nothing is left”.
    pub p_value: Option<f64>,
    /// Standard deviation of the noise of a sample as estimated with this step [N·m].
    pub noise_floor: f64,
}

/// Fits the muscles alone, then with the first effect, the first two, and so on.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn fit_steps(
    request: &Request,
    effects: &[&'static dyn Effect],
    progress: &dyn Fn(usize),
) -> Result<Vec<FittedStep>, SimulationError> {
    let ids: Vec<&str> = effects.iter().map(|e| e.description().id).collect();
    let mut session = request.session();
    let alone = request.muscles()?;
    let mut step = |count: usize| {
        let found = match count {
            0 => {
                let state = session.taken_up(&alone, &request.report())?;
                step(&session, &state, alone.handed_over.clone(), alone.parameters.clone(), &[])
            }
            _ => step_with(&mut session, &ids[..count], &request.report())?,
        };
        progress(1 + effects.len() - count);
        Ok::<_, SimulationError>(found)
    };
    // With all of them first: the noise is estimated beside everything that is missing.
    let mut steps = (0..=effects.len()).rev().map(&mut step).collect::<Result<Vec<_>, _>>()?;
    steps.reverse();
    Ok(steps)
}

/// Fits the muscles with these effects: the last of [`fit_steps`] alone.
///
/// - `effects`: one at least
/// - `report`: told what has been done
///
/// # Errors
/// A trial that cannot be simulated.
pub fn fit_with(
    request: &Request,
    effects: &[&'static dyn Effect],
    report: &dyn Fn(&str),
) -> Result<FittedStep, SimulationError> {
    let ids: Vec<&str> = effects.iter().map(|e| e.description().id).collect();
    step_with(&mut request.session(), &ids, report)
}

fn step_with(session: &mut Session, ids: &[&str], report: &dyn Fn(&str)) -> Result<FittedStep, SimulationError> {
    let state = session.estimate(ids, true, report)?;
    let handed_over = session.handed_over(&state)?;
    let muscles = session.muscle_estimates(&state, &handed_over);
    Ok(step(session, &state, handed_over, muscles, ids))
}

/// What is reported of a state.
///
/// - `ids`: of the effects, in the order in which they were asked for
fn step(
    session: &Session,
    state: &State,
    handed_over: HandedOver,
    muscles: Vec<MuscleEstimate>,
    ids: &[&str],
) -> FittedStep {
    // What is handed over may be short of the joint mode: an interval holds both.
    let forward = session.analysis.forward;
    let mut estimates = session.estimates(state);
    for setting in &handed_over.effects {
        let description = setting.effect.description();
        let reported = setting.effect.reported(&setting.values, &forward.muscles);
        for (p, value) in description.parameters.iter().zip(reported) {
            if let Some(e) = estimates.get_mut(&format!("{}.{}", description.id, p.name)) {
                e.value = value;
                e.ci95 = [e.ci95[0].min(value), e.ci95[1].max(value)];
            }
        }
    }
    let mut added = handed_over.effects;
    added.sort_by_key(|s| ids.iter().position(|id| *id == s.effect.description().id));
    let left = session.analysis.anything_left(&session.as_fit(state), &unidentifiable(&session.analysis));
    FittedStep {
        parameters: handed_over.parameters,
        muscles,
        part_of_the_way: handed_over.part,
        effects: added,
        estimates,
        p_value: left.map(|left| left.p_value),
        noise_floor: session.noise_floor(state),
    }
}

/// Effects that no data tell from the muscles' parameters.
pub(crate) fn unidentifiable(analysis: &Analysis) -> Vec<&'static str> {
    let all = analysis.candidates.iter().map(|e| e.description());
    all.filter(|d| d.unidentifiable.is_some()).map(|d| d.id).collect()
}
