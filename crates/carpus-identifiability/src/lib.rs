//! What recorded trials say about muscle parameters, and what they leave open.
//!
//! [`identify_session`] asks the one model of a session, which every command shares, about lengths and forces.
//! [`identify`] asks about further properties of muscles, and with moments about further coordinates, by a likelihood
//! of its own.
//!
//! In: a participant's model, training trials, and the parameters in question with bounds and priors. Out: for every
//! parameter a confidence interval that rests on the data alone (profile likelihood), a posterior that uses prior
//! knowledge too (no-U-turn sampler), the share of what is known that comes from the data; which combinations of
//! parameters the data fix and which they leave free; and which further trial would narrow the intervals most.
//!
//! | file | what is in it |
//! |---|---|
//! | `session.rs` | lengths and forces by the model of a session |
//! | `parameters.rs` | properties of muscles, ties, bounds, priors |
//! | `problem.rs` | what is given, and the moments that the model has for it |
//! | `likelihood.rs` | noise of moment and EMG, the most probable parameters |
//! | `surrogate.rs` | the likelihood near them as polynomials: microseconds instead of simulations |
//! | `profile.rs`, `posterior.rs` | intervals, draws |
//! | `directions.rs` | combinations, in words |
//! | `answer.rs`, `error.rs` | what is said, and why nothing can be said |
//! | `candidates.rs`, `next_trial.rs` | trials that could be recorded next, and the information expected of them |
//!
//! Not here: reading files, choosing which muscles act, finding missing effects (that is [`carpus_diagnosis`], whose
//! model of the noise this module shares). Intervals hold if the model's structure is right; a missing effect makes
//! them wrong.

mod answer;
mod candidates;
mod certainty;
mod descent;
mod directions;
mod ends;
mod error;
mod held;
mod likelihood;
mod next_trial;
mod parameters;
mod posterior;
mod problem;
mod profile;
mod recorded;
mod session;
mod surrogate;

use nalgebra::{DMatrix, DVector};

use carpus_numerics::statistics::normal_quantile;
use carpus_osim::osim::spec::MuscleSpec;
use carpus_simulation::simulation::{MusculoskeletalModel, Options};

pub use answer::{BoundHit, Identifiability, Knowledge, Soundness};
pub use candidates::{usual_candidates, usual_recordings};
pub use directions::{Combination, Component};
pub use error::IdentifiabilityError;
pub use next_trial::{Candidate, RankedTrial};
pub use parameters::{FreeParameter, MuscleProperty, Prior, fitted, usual_bounds};
pub use recorded::{Channel, RecordedTrial};
pub use session::{SessionRequest, identify_session};

use likelihood::Fit;
use parameters::{Layout, check};
use posterior::{Amount, Draws, LogDensity};
use problem::Problem;
use surrogate::Surrogate;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Request {
    /// The participant's model, compiled for the study.
    pub model: MusculoskeletalModel,
    /// Specifications of the active muscles, in order.
    pub muscles: Vec<MuscleSpec>,
    /// Training trials.
    pub trials: Vec<RecordedTrial>,
    /// Parameters in question.
    pub parameters: Vec<FreeParameter>,
    /// Level of intervals, usually 0.9.
    pub level: f64,
    /// Seed of the draws.
    pub seed: u64,
    /// Draws kept, all chains together.
    pub draws: usize,
    /// Trials that might be recorded next.
    pub candidates: Vec<Candidate>,
}

/// A parameter's confidence interval. Values are in the unit of the property.
#[derive(Clone, Debug)]
struct ConfidenceInterval {
    /// The parameter.
    pub parameter: FreeParameter,
    /// Value that the data make most likely within the bounds, without prior knowledge.
    pub most_likely: f64,
    /// The bound that it stands at.
    pub at_bound: Option<BoundHit>,
    /// From the data and the bounds alone.
    pub interval: [f64; 2],
    /// Whether the data set each end; `false`: the interval runs to the bound.
    pub end_from_data: [bool; 2],
    /// Whether the interval rests on another parameter's bound, too.
    pub leans_on_bounds: bool,
    /// Of the noise, as far as this interval rests on it: few where few trials tell of it.
    pub degrees_of_freedom: f64,
}

/// What the training trials say about parameters.
///
/// # Errors
/// [`IdentifiabilityError`].
pub fn identify(request: &Request) -> Result<Identifiability, IdentifiabilityError> {
    let problem = checked(request)?;
    let fit = problem.fit()?;
    let Profiled { surrogate, freedom, drops, profiles, largest_deviance_error } = profiled(&problem, &fit, request)?;
    let free = &problem.layout.free;
    // The posterior is one density for all parameters: it is widened by the mean of what their intervals are.
    let normal = normal_quantile(0.5 + 0.5 * request.level).powi(2);
    let widened = drops.iter().map(|d| d / normal).sum::<f64>() / drops.len() as f64;
    let covariance = posterior_covariance(&problem, &fit, widened);
    let draws = draws(&surrogate, &problem, &fit, &covariance, widened, request);
    let own = |i: usize| interval(i, free, &profiles, freedom[i]);
    let parameters = (0..free.len()).map(|i| knowledge(i, own(i), &draws, request.level)).collect();
    let all: Vec<&DVector<f64>> = draws.chains.iter().flatten().collect();
    let matrix = DMatrix::from_fn(all.len(), free.len(), |r, c| all[r][c]);
    let outside = all.iter().filter(|x| !surrogate.covers(x.as_slice())).count();
    let per_parameter: Vec<Vec<Vec<f64>>> = (0..free.len()).map(|i| draws.of(|x| x[i])).collect();
    let soundness = Soundness {
        largest_deviance_error,
        dispersion: fit.dispersion,
        largest_r_hat: per_parameter.iter().map(|c| posterior::split_r_hat(c)).fold(0.0, f64::max),
        fewest_effective_draws: per_parameter
            .iter()
            .map(|c| posterior::effective_draws(c))
            .fold(f64::INFINITY, f64::min),
        divergent: draws.divergent,
        share_outside: outside as f64 / all.len().max(1) as f64,
    };
    let next_trials = next_trial::rank(&problem, &fit, &request.candidates)?;
    Ok(Identifiability {
        parameters,
        combinations: directions::combinations(free, &(marginal(&fit.information, free.len()) / fit.dispersion)),
        correlations: correlations(&matrix),
        noise: fit.held.levels,
        draws: matrix,
        soundness: Some(soundness),
        part_of_the_way: None,
        next_trials,
    })
}

/// Profiles and what they were made with.
struct Profiled {
    surrogate: Surrogate,
    freedom: Vec<f64>,
    drops: Vec<f64>,
    profiles: profile::Profiles,
    largest_deviance_error: f64,
}

fn profiled(problem: &Problem, fit: &Fit, request: &Request) -> Result<Profiled, IdentifiabilityError> {
    let surrogate = Surrogate::new(problem, fit)?;
    let free = &problem.layout.free;
    let spread: Vec<f64> = free.iter().map(|p| p.log_bounds()).map(|[a, b]| (b - a).powi(2) / 12.0).collect();
    let freedom = certainty::degrees_of_freedom(problem, fit, &spread)?;
    let inflation = certainty::inflation(problem, fit, &spread)?;
    let drops: Vec<f64> = freedom
        .iter()
        .zip(&inflation)
        .map(|(df, factor)| certainty::drop_of(request.level, *df) * fit.dispersion * factor)
        .collect();
    let mut profiles = profile::profiles(&surrogate, free, &fit.at, &drops);
    let largest_deviance_error = ends::simulate_ends(problem, fit, &surrogate, free, &mut profiles, &drops)?;
    Ok(Profiled { surrogate, freedom, drops, profiles, largest_deviance_error })
}

fn checked(request: &Request) -> Result<Problem, IdentifiabilityError> {
    if request.trials.is_empty() {
        return Err(IdentifiabilityError::NoTrials);
    }
    check(&request.parameters)?;
    let nominal = request.model.nominal_parameters();
    Ok(Problem {
        layout: Layout::new(request.parameters.clone(), nominal.len()),
        model: request.model.clone(),
        specs: request.muscles.clone(),
        nominal,
        trials: request.trials.clone(),
        options: Options { allow_angle_outside_range: true, ..Options::default() },
    })
}

/// Information about parameters, baselines integrated out.
fn marginal(information: &DMatrix<f64>, n: usize) -> DMatrix<f64> {
    let m = information.nrows() - n;
    let own = information.view((0, 0), (n, n)).into_owned();
    let cross = information.view((n, 0), (m, n)).into_owned();
    match information.view((n, n), (m, m)).into_owned().cholesky() {
        Some(factor) => own - cross.tr_mul(&factor.solve(&cross)),
        None => own,
    }
}

fn posterior_covariance(problem: &Problem, fit: &Fit, widened: f64) -> DMatrix<f64> {
    let n = problem.layout.len();
    let mut information = marginal(&fit.information, n) / widened;
    for (i, p) in problem.layout.free.iter().enumerate() {
        information[(i, i)] += p.prior.log_sd.powi(-2);
    }
    information.try_inverse().unwrap_or_else(|| {
        DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| problem.layout.free[i].prior.log_sd.powi(2)))
    })
}

/// The posterior of logits of the place between the bounds.
struct Posterior<'a> {
    surrogate: &'a Surrogate,
    /// −2 log likelihood is divided by this.
    widened: f64,
    free: &'a [FreeParameter],
}

impl Posterior<'_> {
    fn theta(&self, x: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(x.len(), |i, _| {
            let [lower, upper] = self.free[i].log_bounds();
            lower + (upper - lower) / (1.0 + (-x[i]).exp())
        })
    }

    fn logit(&self, theta: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(self.free.len(), |i, _| {
            let [lower, upper] = self.free[i].log_bounds();
            let place = ((theta[i] - lower) / (upper - lower)).clamp(0.02, 0.98);
            (place / (1.0 - place)).ln()
        })
    }

    /// dθ/dx.
    fn slope(&self, i: usize, x: f64) -> f64 {
        let [lower, upper] = self.free[i].log_bounds();
        let s = 1.0 / (1.0 + (-x).exp());
        (upper - lower) * s * (1.0 - s)
    }
}

impl LogDensity for Posterior<'_> {
    fn calc(&self, x: &DVector<f64>) -> (f64, DVector<f64>) {
        let theta = self.theta(x);
        let data = self.surrogate.evaluate(theta.as_slice(), false);
        let mut value = -0.5 * data.value / self.widened;
        let gradient = DVector::from_fn(x.len(), |i, _| {
            let prior = &self.free[i].prior;
            let off = (theta[i] - prior.factor.ln()) / prior.log_sd;
            let s = 1.0 / (1.0 + (-x[i]).exp());
            let slope = self.slope(i, x[i]);
            value -= 0.5 * off * off;
            // The map's own density: ln |dθ/dx|.
            value += slope.max(1e-300).ln();
            slope * (-data.gradient[i] / self.widened - off / prior.log_sd) + (1.0 - 2.0 * s)
        });
        (value, gradient)
    }
}

const CHAINS: usize = 4;
const WARM_UP: usize = 400;

fn draws(
    surrogate: &Surrogate,
    problem: &Problem,
    fit: &Fit,
    covariance: &DMatrix<f64>,
    widened: f64,
    request: &Request,
) -> Draws {
    let free = &problem.layout.free;
    let n = free.len();
    let posterior = Posterior { surrogate, widened, free };
    let start = posterior.logit(&fit.at);
    let slope = DVector::from_fn(n, |i, _| posterior.slope(i, start[i]));
    let scaled = DMatrix::from_fn(n, n, |i, j| covariance[(i, j)] / (slope[i] * slope[j]));
    let amount = Amount { chains: CHAINS, warm_up: WARM_UP, draws: request.draws.div_ceil(CHAINS).max(10) };
    let mut draws = posterior::draw(&posterior, &start, &scaled, amount, request.seed).unwrap_or_else(|| {
        let alone = DMatrix::from_diagonal(&scaled.diagonal().map(|v| v.max(1e-12)));
        posterior::draw(&posterior, &start, &alone, amount, request.seed).expect("a positive diagonal has a factor")
    });
    for x in draws.chains.iter_mut().flatten() {
        *x = posterior.theta(x);
    }
    draws
}

fn interval(
    i: usize,
    free: &[FreeParameter],
    profiles: &profile::Profiles,
    degrees_of_freedom: f64,
) -> ConfidenceInterval {
    let p = &free[i];
    let profile = &profiles.each[i];
    let value = |log: f64| p.nominal * log.exp();
    let [lower, upper] = p.log_bounds();
    let near = 1e-4 * (upper - lower);
    let at_bound = if profiles.best[i] <= lower + near {
        Some(BoundHit::Lower)
    } else if profiles.best[i] >= upper - near {
        Some(BoundHit::Upper)
    } else {
        None
    };
    ConfidenceInterval {
        parameter: p.clone(),
        most_likely: value(profiles.best[i]),
        at_bound,
        interval: profile.ends.map(|e| value(e.at)),
        end_from_data: profile.ends.map(|e| e.by_data),
        leans_on_bounds: profile.leans_on_bounds,
        degrees_of_freedom,
    }
}

fn knowledge(i: usize, own: ConfidenceInterval, draws: &Draws, level: f64) -> Knowledge {
    let value = |log: f64| own.parameter.nominal * log.exp();
    let mut of: Vec<f64> = draws.of(|x| x[i]).concat();
    let log_variance = posterior::variance(&of);
    of.sort_by(f64::total_cmp);
    let quantile = |q: f64| value(of[((of.len() - 1) as f64 * q).round() as usize]);
    let log_sd = own.parameter.prior.log_sd;
    Knowledge {
        posterior_median: quantile(0.5),
        credible: [quantile(0.5 - 0.5 * level), quantile(0.5 + 0.5 * level)],
        posterior_log_sd: log_variance.sqrt(),
        share_from_data: (1.0 - log_variance / log_sd.powi(2)).clamp(0.0, 1.0),
        parameter: own.parameter,
        most_likely: own.most_likely,
        at_bound: own.at_bound,
        interval: own.interval,
        end_from_data: own.end_from_data,
        leans_on_bounds: own.leans_on_bounds,
        degrees_of_freedom: own.degrees_of_freedom,
    }
}

fn correlations(draws: &DMatrix<f64>) -> DMatrix<f64> {
    let (rows, n) = draws.shape();
    let means: Vec<f64> = (0..n).map(|i| draws.column(i).sum() / rows as f64).collect();
    let cross = |i: usize, j: usize| -> f64 {
        (0..rows).map(|r| (draws[(r, i)] - means[i]) * (draws[(r, j)] - means[j])).sum()
    };
    DMatrix::from_fn(n, n, |i, j| {
        let scale = (cross(i, i) * cross(j, j)).sqrt();
        if i == j || scale == 0.0 { f64::from(u8::from(i == j)) } else { cross(i, j) / scale }
    })
}
