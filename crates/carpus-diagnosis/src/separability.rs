//! What data could tell: how far an effect of a given size is from what the model does without it, or with another
//! effect.
//!
//! The effect is held at its size while muscles and noise are fitted to the data. To the moments that this predicts,
//! without noise, the model is fitted without the effect, and with every other effect in its place: muscles, amplitudes
//! and shapes all free, so that nothing is linear but the noise. Muscles start from where they are with the effect and
//! from where they are without, as there are several valleys. What remains is the distance in standard deviations:
//!
//! ```text
//! D = min over θ, φ of  Σ_g ‖τ_g(truth) − τ_g(θ, φ)‖²_V + ‖θ − θ₀‖²_Λ + ‖φ‖²_Λ  −  ‖θ(truth) − θ₀‖²_Λ,   z = √D
//! ```
//! −2 log likelihood of the rival is D larger on average, the noise being known, with a standard deviation of 2 √D.
//! [`super::fit::Analysis::pairwise_z`] is √D to first order around the model without effects, of which shapes are not
//! free.

use rayon::prelude::*;

use super::diagnose::Request;
use super::fit::Point;
use super::inference::search::Budget;
use super::inference::session::{Session, State};
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::Setting;
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::TrialUse;

/// How far an effect is from a rival.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Distance {
    /// Identifier of the rival; none: the model without effects.
    pub rival: Option<&'static str>,
    /// Standard deviations.
    pub z: f64,
}

/// Distances of an effect from the model without it and from every other effect; the nearest first. Rivals that cannot
/// be simulated near it are left out.
///
/// - `truth`: the effect, at a size
///
/// # Errors
/// A trial that cannot be simulated.
pub fn separability(request: &Request, truth: &Setting) -> Result<Vec<Distance>, SimulationError> {
    let forward = request.forward;
    let train = forward.trials_for(TrialUse::Train);
    let id = truth.effect.description().id;
    let rivals: Vec<&'static dyn Effect> = request
        .candidates
        .iter()
        .copied()
        .filter(|e| e.description().id != id && e.description().unidentifiable.is_none())
        .collect();
    let given = forward.given().iter().chain([truth]).cloned().collect();
    let with = forward.clone().with_given(given);
    let mut session = Session::new(&with, train.clone(), Vec::new(), &request.bounds, Budget::none(), request.seed);
    let state = session.estimate(&[], true, &request.report())?;
    let targets = moments_of(&session, &state)?;
    let mut without = Session::new(forward, train, Vec::new(), &request.bounds, Budget::none(), request.seed);
    let null = without.estimate(&[], true, &request.report())?;
    let near = |effects: &[Setting]| {
        let on: Vec<&'static dyn Effect> = effects.iter().map(|s| s.effect).collect();
        let from = |muscles: &State| {
            let start = Point {
                parameters: muscles.point.parameters.clone(),
                effects: effects.to_vec(),
                baseline: vec![0.0; muscles.point.baseline.len()],
                correction: session.analysis.no_correction(),
                ..state.point.clone()
            };
            session.beside(forward, on.clone(), targets.clone()).distance(start, &state)
        };
        match (from(&state), from(&null)) {
            (Ok(a), Ok(b)) => Ok(a.min(b)),
            (a, b) => a.or(b),
        }
    };
    let none = Distance { rival: None, z: near(&[])? };
    let of_rival = |rival: &&'static dyn Effect| {
        let starts = forward.joint.starts(*rival);
        let least = starts.into_iter().filter_map(|start| near(&[start]).ok()).fold(f64::INFINITY, f64::min);
        // With the rival's size 0 the model does what it does without it.
        least.is_finite().then(|| Distance { rival: Some(rival.description().id), z: least.min(none.z) })
    };
    let mut found: Vec<Distance> = rivals.par_iter().filter_map(of_rival).collect();
    found.push(none.clone());
    found.sort_by(|a, b| a.z.total_cmp(&b.z));
    Ok(found)
}

/// Moments of the training trials that a state predicts, its excitations taken for the truth [N·m].
fn moments_of(session: &Session, state: &State) -> Result<Vec<Vec<f64>>, SimulationError> {
    let Point { parameters, effects, inputs, .. } = &state.point;
    let analysis = &session.analysis;
    let variant = analysis.forward.variant(effects)?;
    let of_trial = |(g, input): (&usize, &std::sync::Arc<carpus_effects::forward_model::TrialInput>)| {
        let core = analysis.forward.core(&variant, *g, input, parameters, effects, false)?;
        Ok(analysis.forward.recorded_moment(*g, &core, effects))
    };
    analysis.train.par_iter().zip(inputs).map(of_trial).collect::<Vec<_>>().into_iter().collect()
}
