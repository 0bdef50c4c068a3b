//! Effects added to a model: each step of the way fitted jointly with the muscle parameters.

use std::collections::BTreeMap;

use super::diagnose::{ParameterEstimate, Request, estimates, tested_null};
use super::effect::Effect;
use super::fit::{Analysis, Fit};
use super::forward_model::Setting;
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::TrialUse;

/// One-step estimates farther than this many scales away are no starting values.
const LARGEST_START: f64 = 5.0;

/// A model after a step: what was fitted, and what that leaves.
#[derive(Clone, Debug)]
pub struct FittedStep {
    /// Muscle parameters.
    pub parameters: Vec<MuscleParameters>,
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
    let forward = request.forward;
    let train = forward.trials_for(TrialUse::Train);
    let (analysis, refit) = Analysis::new(forward, train, request.candidates.clone(), &request.bounds, request.seed)?;
    let refit = tested_null(&analysis, refit, &unidentifiable(&analysis))?.fit;
    progress(1);
    let mut fits = vec![refit];
    for count in 1..=effects.len() {
        let before = &fits[count - 1];
        let start = start(&analysis, &fits[0], before, &effects[..count]);
        let fit = analysis.refit(start, fits[0].levels, None, None)?;
        // Beside it a size may be one at which a muscle cannot be simulated.
        let deeper = analysis.deeper(&fit, None).ok().flatten();
        fits.push(deeper.unwrap_or(fit));
        progress(1 + count);
    }
    Ok(fits.into_iter().map(|fit| step(&analysis, request, fit)).collect())
}

/// Where a fit with effects starts: those fitted already as they are, the last one at its one-step estimate.
fn start(analysis: &Analysis, refit: &Fit, before: &Fit, effects: &[&'static dyn Effect]) -> super::fit::Point {
    // The refit without effects may have bent the muscles to make up for what is missing: start from the model.
    let mut point = if effects.len() == 1 { analysis.nominal_point() } else { before.point.clone() };
    let Some(last) = effects.last() else { return point };
    let mut setting = Setting::absent(*last);
    let description = last.description();
    let from = if effects.len() == 1 { refit } else { before };
    let left = analysis.anything_left(from, &[]);
    if let Some(score) = left.iter().flat_map(|l| &l.blocks).find(|b| b.name == description.id) {
        for (i, p) in description.amplitudes().enumerate() {
            setting.values[p] = score.one_step[i].clamp(-LARGEST_START, LARGEST_START)
                * analysis.forward.strength.scale(&description.parameters[p]);
        }
    }
    point.effects.push(setting);
    point
}

/// Effects that no data tell from the muscles' parameters.
pub(super) fn unidentifiable(analysis: &Analysis) -> Vec<&'static str> {
    let all = analysis.candidates.iter().map(|e| e.description());
    all.filter(|d| d.unidentifiable.is_some()).map(|d| d.id).collect()
}

fn step(analysis: &Analysis, request: &Request, fit: Fit) -> FittedStep {
    FittedStep {
        estimates: estimates(&fit, request.forward),
        p_value: analysis.anything_left(&fit, &unidentifiable(analysis)).map(|left| left.p_value),
        noise_floor: analysis.noise_floor(&fit),
        parameters: fit.point.parameters,
        effects: fit.point.effects,
    }
}
