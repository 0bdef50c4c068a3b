//! What trials say about parameters.

use nalgebra::DMatrix;

use super::directions::Combination;
use super::next_trial::RankedTrial;
use super::parameters::FreeParameter;
use carpus_diagnosis::noise::NoiseLevels;

/// A bound that a value stands at.
pub use carpus_personalization::personalization::BoundHit;

/// What is known of one parameter. Values are in the unit of the property.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// The parameter.
    pub parameter: FreeParameter,
    /// Value that the data make most likely within the bounds, without prior knowledge.
    pub most_likely: f64,
    /// The bound that it stands at.
    pub at_bound: Option<BoundHit>,
    /// Confidence interval from the data and the bounds alone.
    pub interval: [f64; 2],
    /// Whether the data set each end; `false`: the interval runs to the bound.
    pub end_from_data: [bool; 2],
    /// Whether the interval rests on another parameter's bound, too.
    pub leans_on_bounds: bool,
    /// Of the noise, as far as this parameter's interval rests on it: few where few trials tell of it.
    pub degrees_of_freedom: f64,
    /// Median of the posterior.
    pub posterior_median: f64,
    /// Credible interval of the same level: data, bounds and prior knowledge.
    pub credible: [f64; 2],
    /// Standard deviation of the logarithm in the posterior.
    pub posterior_log_sd: f64,
    /// Share of the prior variance of the logarithm that the data removed: 0, they say nothing; 1, all.
    pub share_from_data: f64,
}

impl Knowledge {
    /// Whether the data bound the parameter from both sides.
    pub fn is_determined(&self) -> bool {
        self.end_from_data == [true, true]
    }

    /// Half the interval's width over the most likely value.
    pub fn relative_half_width(&self) -> f64 {
        0.5 * (self.interval[1] - self.interval[0]) / self.most_likely
    }
}

/// How far the numbers can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Soundness {
    /// Largest difference of −2 log likelihood from what the level asks for, by simulation at the ends of the intervals
    /// that the data set; 2.7 and more is what a 90 % interval is made of.
    pub largest_deviance_error: f64,
    /// How much more trials scatter about the fit than the noise explains (variance ratio, at least 1); intervals are
    /// widened by its root. Far above 1, something is missing in the model.
    pub dispersion: f64,
    /// Largest split R̂: above 1.05 the chains disagree.
    pub largest_r_hat: f64,
    /// Least number of independent draws of any parameter.
    pub fewest_effective_draws: f64,
    /// Paths of the sampler that went astray.
    pub divergent: usize,
    /// Share of draws at the edge of the region that the polynomials cover.
    pub share_outside: f64,
}

/// What the trials say.
#[derive(Clone, Debug)]
pub struct Identifiability {
    /// Per parameter, in the order of the request.
    pub parameters: Vec<Knowledge>,
    /// From the best known combination of parameters to the least known.
    pub combinations: Vec<Combination>,
    /// Correlations of the logarithms in the posterior.
    pub correlations: DMatrix<f64>,
    /// Variances of the noise that the fit found.
    pub noise: NoiseLevels,
    /// Draws of the logarithms of factors, one row each.
    pub draws: DMatrix<f64>,
    /// How far to trust this; of [`identify`](crate::identify).
    pub soundness: Option<Soundness>,
    /// How far personalization goes from the model as given (0) to these values (1); of [`identify_session`](crate::identify_session).
    pub part_of_the_way: Option<f64>,
    /// Candidates for the next trial, the most informative first.
    pub next_trials: Vec<RankedTrial>,
}
