//! Muscles alone: the estimate of muscle parameters, with no effect added, that every command reports
//! (`docs/src/theory/many-small-errors.md`, equations (16), (25), (26), (31) and (32)).
//!
//! In: training trials, bounds, fibre lengths of images. Out: the muscles that are handed over, and of every
//! parameter the value at the joint mode, its standard deviation and its interval.

use nalgebra::DMatrix;

use super::muscle_columns::{FORCE, place};
pub use super::muscle_prior::MusclePrior;
use super::resting_fiber::RestingFiber;
use super::search::Budget;
use super::session::{Determinable, HandedOver, Session, State};
use carpus_effects::catalogue::with_own;
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, ForwardModel};
use carpus_numerics::statistics::normal_quantile;
use carpus_simulation::simulation::{Property, SimulationError};
use carpus_study::study::{ParameterBounds, TrialUse};

/// What the session's training trials say of a muscle's parameter. Values are in the unit of the property.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleEstimate {
    /// Position of the muscle among the active ones.
    pub muscle: usize,
    /// The property.
    pub property: Property,
    /// Value of the model as given.
    pub given: f64,
    /// Value at the joint mode.
    pub joint_mode: f64,
    /// Value that is handed over, a part of the way from the one to the other.
    pub value: f64,
    /// Standard deviation of the logarithm, given the trials.
    pub log_sd: f64,
    /// The same before the trials.
    pub prior_log_sd: f64,
    /// Bounds.
    pub bounds: [f64; 2],
}

/// A parameter is determined by the trials where they removed at least this share of its prior variance:
/// where they say more of it than the bounds do.
pub const DETERMINED: f64 = 0.5;

impl MuscleEstimate {
    /// The interval of a level, equation (31): about the joint mode, wide enough to hold what is handed over,
    /// and within the bounds.
    ///
    /// - `level`: probability, for example 0.9
    pub fn interval(&self, level: f64) -> [f64; 2] {
        let half = normal_quantile(0.5 + 0.5 * level) * self.log_sd;
        let [low, high] = self.bounds;
        let ends = [(self.joint_mode * (-half).exp()).min(self.value), (self.joint_mode * half.exp()).max(self.value)];
        ends.map(|end| end.clamp(low, high))
    }

    /// Share of the variance of the logarithm before the trials that these removed: 0, they say nothing; 1, all.
    pub fn share_from_data(&self) -> f64 {
        (1.0 - (self.log_sd / self.prior_log_sd).powi(2)).clamp(0.0, 1.0)
    }

    /// Whether the trials set each end of the interval; `false`: the bounds do, as limits or as prior.
    pub fn end_from_data(&self, level: f64) -> [bool; 2] {
        let [low, high] = self.interval(level);
        [low > self.bounds[0], high < self.bounds[1]].map(|inside| inside && self.share_from_data() >= DETERMINED)
    }
}

/// What is asked: the muscles of a session.
#[derive(Clone)]
pub struct MuscleProblem<'a> {
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// Bounds of the parameters: priors, equation (2).
    pub bounds: ParameterBounds,
    /// Fascicle lengths of images that are data.
    pub images: Vec<RestingFiber>,
    /// Prior knowledge beside the bounds, and ties; a muscle and property in one of them at most.
    pub priors: Vec<MusclePrior>,
    /// Seed of random draws.
    pub seed: u64,
}

/// The muscles of a session.
pub struct Muscles<'a> {
    /// The session.
    pub session: Session<'a>,
    /// What is handed over.
    pub handed_over: HandedOver,
    /// Every parameter, muscle by muscle.
    pub parameters: Vec<MuscleEstimate>,
    /// Where the estimate ended.
    pub state: State,
}

impl<'a> MuscleProblem<'a> {
    /// The training trials, to be estimated: every effect is there with its small size.
    fn session(&self) -> Session<'a> {
        let train = self.forward.trials_for(TrialUse::Train);
        let session = Session::new(self.forward, train, with_own(), &self.bounds, Budget::none(), self.seed);
        let session = session.with_images(self.images.clone());
        if self.priors.is_empty() { session } else { session.with_muscle_priors(&self.priors) }
    }

    /// What the training trials can determine at all.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn determinable(&self) -> Result<Determinable, SimulationError> {
        self.session().determinable()
    }

    /// Estimates the muscles; `None` where it is not to go on.
    ///
    /// - `report`: told what has been done
    /// - `goes_on`: asked between the searches
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn estimate(
        &self,
        report: &dyn Fn(&str),
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Option<Muscles<'a>>, SimulationError> {
        Muscles::of(self.session(), report, goes_on)
    }
}

/// About how many things an estimate reports: starts, their noise, its autocorrelation, rounds.
pub const USUAL_REPORTS: usize = 8;

impl<'a> Muscles<'a> {
    /// Covariance of the logarithms of all muscle parameters given the trials, in the order of columns:
    /// equation (16), what the gains of the recordings leave open of forces, and the distance of other
    /// minima, equation (34).
    pub fn log_covariance(&self) -> DMatrix<f64> {
        let mut out = self.log_covariance_at_mode();
        let of_gains = self.session.gain_log_sd().powi(2);
        (FORCE..out.nrows()).step_by(FITTED_PER_MUSCLE).for_each(|j| out[(j, j)] += of_gains);
        let total: f64 = 1.0 + self.state.others.iter().map(|other| other.odds).sum::<f64>();
        for other in &self.state.others {
            let away = other.away.rows(0, out.nrows());
            out.ger(other.odds / total, &away, &away, 1.0);
        }
        out
    }

    /// The same about the joint mode alone, the gains of the recordings being known: equation (16).
    pub fn log_covariance_at_mode(&self) -> DMatrix<f64> {
        let State { model, point, .. } = &self.state;
        let count = self.parameters.len();
        let all = model.posterior(&self.session.places(&point.effects), self.session.sizes(&self.state)).covariance();
        all.view((0, 0), (count, count)).into_owned()
    }

    /// As [`MuscleProblem::estimate`], of a session in which nothing was estimated yet.
    pub(crate) fn of(
        mut session: Session<'a>,
        report: &dyn Fn(&str),
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Option<Muscles<'a>>, SimulationError> {
        if !goes_on() {
            return Ok(None);
        }
        let begun = session.begin(&[], true, report)?;
        if !goes_on() {
            return Ok(None);
        }
        let state = session.settle(begun, report)?;
        let handed_over = session.handed_over(&state)?;
        let parameters = session.muscle_estimates(&state, &handed_over);
        Ok(Some(Muscles { session, handed_over, parameters, state }))
    }
}

impl Session<'_> {
    /// The session, its search starting also from where the muscles alone of the same trials are.
    pub fn starting_from(&mut self, muscles: &Muscles) {
        self.further_start = Some(muscles.state.point.clone());
    }

    /// Standard deviation of the logarithm of a maximum force that no trial can tell from a gain of the
    /// recordings, equation (32): of every effect that is the same as another maximum force, what is
    /// plausible.
    pub(crate) fn gain_log_sd(&self) -> f64 {
        let gains = self.analysis.candidates.iter().filter(|e| e.description().unidentifiable.is_some());
        let of = |effect: &&'static dyn Effect| {
            let of_amplitude = |i: usize| {
                let scale = self.analysis.forward.joint.scale(&effect.description().parameters[i]);
                self.plausible(*effect, i).0 * scale
            };
            effect.description().amplitudes().map(of_amplitude).map(|sd| sd * sd).sum::<f64>()
        };
        gains.map(of).sum::<f64>().sqrt()
    }

    /// What a state says of every muscle parameter.
    pub fn muscle_estimates(&self, state: &State, handed_over: &HandedOver) -> Vec<MuscleEstimate> {
        let posterior = state.model.posterior(&self.places(&state.point.effects), self.sizes(state));
        let deviations = self.deviations(state);
        let given = self.analysis.forward.nominal_parameters();
        let of_gains = self.gain_log_sd();
        let of = |muscle: usize, property: Property| {
            let column = muscle * FITTED_PER_MUSCLE + place(property);
            let of_gains = if property == Property::MaxIsometricForce { of_gains } else { 0.0 };
            let of_given = property.of(&given[muscle]);
            MuscleEstimate {
                muscle,
                property,
                given: of_given,
                joint_mode: property.of(&state.point.parameters[muscle]),
                value: property.of(&handed_over.parameters[muscle]),
                log_sd: deviations[column].hypot(of_gains).min(posterior.sd[column]),
                prior_log_sd: posterior.sd[column],
                bounds: self.analysis.log_bounds[place(property)].map(|bound| bound.exp() * of_given),
            }
        };
        (0..given.len()).flat_map(|muscle| Property::ALL.map(|property| of(muscle, property))).collect()
    }
}
