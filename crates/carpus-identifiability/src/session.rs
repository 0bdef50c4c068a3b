//! Lengths and forces of muscles by the one model of a session ([`carpus_diagnosis::inference`]): the estimate that
//! personalization hands over and a diagnosis reports, what it leaves open, and which trial would narrow it down.

use std::cell::Cell;

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::answer::{BoundHit, Identifiability, Knowledge};
use super::directions;
use super::error::IdentifiabilityError;
use super::next_trial::RankedTrial;
use super::parameters::{FreeParameter, check, fitted};
use carpus_diagnosis::inference::muscles::{MuscleEstimate, MusclePrior, MuscleProblem, Muscles, USUAL_REPORTS};
use carpus_diagnosis::inference::resting_fiber::RestingFiber;
use carpus_diagnosis::separation::{Laboratory, after_session};
use carpus_effects::forward_model::ForwardModel;
use carpus_numerics::statistics::normal_of_uniform;
use carpus_study::study::{ParameterBounds, Trial, TrialUse};

/// What is asked of a session.
#[derive(Clone)]
pub struct SessionRequest<'a> {
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// What further trials are simulated with.
    pub laboratory: Laboratory<'a>,
    /// Bounds of the parameters: priors.
    pub bounds: ParameterBounds,
    /// Fascicle lengths of images that are data.
    pub images: Vec<RestingFiber>,
    /// Parameters in question: those that every fit estimates. The others are estimated, too.
    pub parameters: Vec<FreeParameter>,
    /// Level of intervals, usually 0.9.
    pub level: f64,
    /// Seed of the draws.
    pub seed: u64,
    /// Draws.
    pub draws: usize,
    /// Trials that might be recorded next, with their names; their moments do not matter.
    pub candidates: Vec<Trial>,
}

/// What the training trials of a session say about muscle parameters.
///
/// - `progress`: told how many steps of about how many are done, from the calling thread
/// - `goes_on`: asked between the searches, from the calling thread
///
/// # Errors
/// [`IdentifiabilityError`].
pub fn identify_session(
    request: &SessionRequest,
    progress: &dyn Fn(usize, usize),
    goes_on: &dyn Fn() -> bool,
) -> Result<Identifiability, IdentifiabilityError> {
    check(&request.parameters)?;
    let forward = request.forward;
    if forward.trials_for(TrialUse::Train).is_empty() {
        return Err(IdentifiabilityError::NoTrials);
    }
    let problem = MuscleProblem {
        forward,
        bounds: request.bounds,
        images: request.images.clone(),
        priors: request.parameters.iter().filter_map(known).collect(),
        seed: request.seed,
    };
    let done = Cell::new(0);
    let report = |_: &str| {
        done.set(done.get() + 1);
        progress(done.get(), USUAL_REPORTS.max(done.get()));
    };
    let muscles = problem.estimate(&report, goes_on)?.ok_or(IdentifiabilityError::Stopped)?;
    let free = &request.parameters;
    let columns: Vec<usize> = free.iter().filter_map(column).collect();
    let covariance = muscles.log_covariance().select_rows(&columns).select_columns(&columns);
    let estimates: Vec<&MuscleEstimate> = free.iter().filter_map(|p| estimate(&muscles, p)).collect();
    if estimates.len() < free.len() {
        return Err(IdentifiabilityError::NotFitted);
    }
    let knowledge = free.iter().zip(&estimates).map(|(p, e)| knowledge(p, e, request.level)).collect();
    Ok(Identifiability {
        parameters: knowledge,
        combinations: directions::combinations(free, &information(free, &covariance)),
        correlations: correlations(&covariance),
        noise: muscles.state.levels,
        draws: draws(&estimates, &covariance, request.draws, request.seed),
        soundness: None,
        part_of_the_way: Some(muscles.handed_over.part),
        next_trials: ranked(request, &muscles, &columns)?,
    })
}

/// What is known of a parameter beside its bounds, or that several muscles have one factor.
fn known(p: &FreeParameter) -> Option<MusclePrior> {
    let property = fitted(p.property)?;
    (p.muscles.len() > 1 || p.prior.source.is_some()).then(|| MusclePrior {
        muscles: p.muscles.clone(),
        property,
        log_mean: p.prior.factor.ln(),
        log_sd: p.prior.log_sd,
    })
}

/// Column of a parameter; of tied muscles that of the first.
fn column(p: &FreeParameter) -> Option<usize> {
    let own = MusclePrior { muscles: p.muscles.clone(), property: fitted(p.property)?, log_mean: 0.0, log_sd: 0.0 };
    own.columns().next()
}

fn estimate<'m>(muscles: &'m Muscles, p: &FreeParameter) -> Option<&'m MuscleEstimate> {
    let (muscle, property) = (*p.muscles.first()?, fitted(p.property)?);
    muscles.parameters.iter().find(|e| e.muscle == muscle && e.property == property)
}

fn knowledge(p: &FreeParameter, e: &MuscleEstimate, level: f64) -> Knowledge {
    let [low, high] = e.bounds;
    let most_likely = e.joint_mode.clamp(low, high);
    let at_bound = match most_likely {
        value if value <= low => Some(BoundHit::Lower),
        value if value >= high => Some(BoundHit::Upper),
        _ => None,
    };
    let interval = e.interval(level);
    Knowledge {
        parameter: p.clone(),
        most_likely,
        at_bound,
        interval,
        end_from_data: e.end_from_data(level),
        leans_on_bounds: false,
        degrees_of_freedom: f64::INFINITY,
        posterior_median: most_likely,
        credible: interval,
        posterior_log_sd: e.log_sd,
        share_from_data: e.share_from_data(),
    }
}

/// What the trials say of parameters: the posterior's precision without the prior's.
fn information(free: &[FreeParameter], covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let prior = |i: usize| free[i].prior.log_sd.powi(-2);
    match covariance.clone().cholesky() {
        Some(factor) => factor.inverse() - DMatrix::from_diagonal(&DVector::from_fn(free.len(), |i, _| prior(i))),
        None => DMatrix::zeros(free.len(), free.len()),
    }
}

fn correlations(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let sd = covariance.diagonal().map(f64::sqrt);
    DMatrix::from_fn(sd.len(), sd.len(), |i, j| if i == j { 1.0 } else { covariance[(i, j)] / (sd[i] * sd[j]) })
}

/// Draws of the logarithms of factors, one row each.
fn draws(estimates: &[&MuscleEstimate], covariance: &DMatrix<f64>, count: usize, seed: u64) -> DMatrix<f64> {
    let n = estimates.len();
    let root = covariance.clone().cholesky().map_or_else(|| DMatrix::zeros(n, n), |factor| factor.l());
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || normal_of_uniform([1.0 - rng.random::<f64>(), rng.random()]);
    let mut out = DMatrix::zeros(count, n);
    for mut row in out.row_iter_mut() {
        let drawn = &root * DVector::from_fn(n, |_, _| normal());
        let at = |i: usize| (estimates[i].joint_mode / estimates[i].given).ln() + drawn[i];
        row.iter_mut().enumerate().for_each(|(i, value)| *value = at(i));
    }
    out
}

/// Candidates for the next trial, the most informative first.
fn ranked(
    request: &SessionRequest,
    muscles: &Muscles,
    columns: &[usize],
) -> Result<Vec<RankedTrial>, IdentifiabilityError> {
    if request.candidates.is_empty() {
        return Ok(Vec::new());
    }
    let Laboratory { spec, model } = request.laboratory;
    let then = after_session(request.forward, spec, model, &request.candidates)?;
    let deviations = muscles.session.deviations_after(&muscles.state, &then)?;
    let before = muscles.log_covariance_at_mode().diagonal().map(f64::sqrt);
    let of = |(trial, after): (&Trial, &DVector<f64>)| {
        let shrinkage: Vec<f64> = columns.iter().map(|j| 1.0 - after[*j] / before[*j]).collect();
        let mean_shrinkage = shrinkage.iter().sum::<f64>() / columns.len() as f64;
        RankedTrial { name: trial.info.name.clone(), mean_shrinkage, shrinkage }
    };
    let mut ranked: Vec<RankedTrial> = request.candidates.iter().zip(&deviations).map(of).collect();
    ranked.sort_by(|a, b| b.mean_shrinkage.total_cmp(&a.mean_shrinkage));
    Ok(ranked)
}
