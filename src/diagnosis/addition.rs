//! Effects added to a model: each step of the way fitted jointly with the muscle parameters.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::ONE_BY_ONE;
use super::diagnose::{ParameterEstimate, Request, estimates, tested_null};
use super::effect::Effect;
use super::fit::{Analysis, Fit, Point};
use super::forward_model::Setting;
use super::joint_traits::JointTraits;
use super::several;
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
        let starts = starts(&analysis, &fits[0], before, &effects[..count]);
        fits.push(nearest_fit(&analysis, &fits[0], starts)?);
        progress(1 + count);
    }
    Ok(fits.into_iter().map(|fit| step(&analysis, request, fit)).collect())
}

/// The same where many things are a little wrong at once: every step by [`several::fitted_with`].
///
/// # Errors
/// A trial that cannot be simulated.
pub fn fit_steps_of_several(
    request: &Request,
    effects: &[&'static dyn Effect],
    progress: &dyn Fn(usize),
) -> Result<Vec<FittedStep>, SimulationError> {
    let ids: Vec<&str> = effects.iter().map(|e| e.description().id).collect();
    let step = |count: usize| {
        let fitted = several::fitted_with(request, &ids[..count])?;
        progress(1 + count);
        // What is handed over may be short of the joint mode: an interval holds both.
        let forward = request.forward;
        let mut estimates = fitted.estimates;
        for setting in &fitted.handed_over.effects {
            let description = setting.effect.description();
            let reported = setting.effect.reported(&setting.values, &forward.muscles);
            for (p, value) in description.parameters.iter().zip(reported) {
                if let Some(e) = estimates.get_mut(&format!("{}.{}", description.id, p.name)) {
                    e.value = value;
                    e.ci95 = [e.ci95[0].min(value), e.ci95[1].max(value)];
                }
            }
        }
        // In the order in which they were asked for.
        let mut added = fitted.handed_over.effects;
        added.sort_by_key(|s| ids.iter().position(|id| *id == s.effect.description().id));
        Ok(FittedStep {
            parameters: fitted.handed_over.parameters,
            effects: added,
            estimates,
            p_value: None,
            noise_floor: fitted.noise_floor,
        })
    };
    (0..=effects.len()).map(step).collect()
}

/// Of the fits from several starts the one that moments and EMG are nearest to, as between explanations by the same effects; the
/// first of equals.
///
/// # Errors
/// That of the first start, if none can be fitted.
fn nearest_fit(analysis: &Analysis, refit: &Fit, starts: Vec<Point>) -> Result<Fit, SimulationError> {
    let fitted = |start: Point| analysis.refit(start, refit.levels, None, None, f64::INFINITY);
    let mut fits = starts.into_par_iter().with_max_len(ONE_BY_ONE).map(fitted).collect::<Vec<_>>().into_iter();
    let first = fits.next().unwrap_or_else(|| fitted(refit.point.clone()));
    let fall = |fit: &Fit| analysis.farther_from(refit, fit).unwrap_or(f64::NEG_INFINITY);
    fits.flatten().fold(first, |known, fit| match known {
        Ok(known) if fall(&fit) <= fall(&known) => Ok(known),
        _ => Ok(fit),
    })
}

/// Where a fit with effects starts: those fitted already as they are, the last one of every size and shape that it is looked for from.
fn starts(analysis: &Analysis, refit: &Fit, before: &Fit, effects: &[&'static dyn Effect]) -> Vec<Point> {
    // The refit without effects may have bent the muscles to make up for what is missing: start from the model.
    let point = if effects.len() == 1 { analysis.nominal_point() } else { before.point.clone() };
    let Some(last) = effects.last() else { return vec![point] };
    let from = if effects.len() == 1 { refit } else { before };
    let left = analysis.anything_left(from, &[]);
    let score = left.iter().flat_map(|l| &l.blocks).find(|b| b.name == last.description().id);
    let one_step = score.map(|score| score.one_step.as_slice());
    let with = |setting| Point { effects: [&point.effects[..], &[setting]].concat(), ..point.clone() };
    first_settings(*last, one_step, &analysis.forward.joint).into_iter().map(with).collect()
}

/// Sizes and shapes of an effect that its fits start from: the usual shape at its one-step estimate, then the others of
/// [`Setting::starts`].
///
/// - `one_step`: of its amplitudes at the usual shape, in units of their scales
fn first_settings(effect: &'static dyn Effect, one_step: Option<&[f64]>, joint: &JointTraits) -> Vec<Setting> {
    let mut settings = Setting::starts(effect, joint);
    let description = effect.description();
    if let (Some(usual), Some(sizes)) = (settings.first_mut(), one_step) {
        for (p, size) in description.amplitudes().zip(sizes) {
            usual.values[p] = size.clamp(-LARGEST_START, LARGEST_START) * joint.scale(&description.parameters[p]);
        }
    }
    settings
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::catalogue::{CATALOGUE, effect};

    #[test]
    fn verif_an_effect_is_fitted_from_every_size_and_shape_that_it_is_looked_for_from() {
        let joint = JointTraits { strength: 2.0, neutral_angle: 0.3 };
        for effect in CATALOGUE.iter().copied() {
            let description = effect.description();
            let amplitudes: Vec<usize> = description.amplitudes().collect();
            let one_step: Vec<f64> = (0..amplitudes.len()).map(|i| if i == 0 { 0.5 } else { 40.0 }).collect();
            let settings = first_settings(effect, Some(&one_step), &joint);
            for (i, p) in amplitudes.iter().enumerate() {
                let scales = if i == 0 { 0.5 } else { LARGEST_START };
                let expected = scales * joint.scale(&description.parameters[*p]);
                assert_eq!(settings[0].values[*p], expected, "{}", description.id);
            }
            assert_eq!(settings[1..], Setting::starts(effect, &joint)[1..], "{}", description.id);
        }
        let of = |id: &str| first_settings(effect(id).unwrap(), None, &joint);
        // On either side alone; far from none.
        assert_eq!(of("ligament_stop").len(), 3);
        assert!(of("joint_compliance")[1].values[0] > 0.0);
        assert_eq!(of("joint_stiffness").len(), 1);
    }
}
