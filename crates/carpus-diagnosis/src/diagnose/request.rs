//! What a diagnosis is asked of.

use crate::inference::muscles::Muscles;
use crate::inference::resting_fiber::RestingFiber;
use crate::inference::search::Budget;
use crate::inference::session::Session;
use crate::separation::Laboratory;
use carpus_effects::catalogue::with_own;
use carpus_effects::effect::Effect;
use carpus_effects::forward_model::ForwardModel;
use carpus_simulation::simulation::SimulationError;
use carpus_study::study::{ParameterBounds, TrialUse};

/// Sets whose neighbours are looked at in a round.
const EXPANSIONS: usize = 12;

/// What to diagnose.
pub struct Request<'a> {
    /// Name of the participant.
    pub participant: String,
    /// Model and trials.
    pub forward: &'a ForwardModel,
    /// What further trials are simulated with, where these cannot tell explanations apart; without it none are.
    pub laboratory: Option<Laboratory<'a>>,
    /// Bounds of the muscle parameters: priors.
    pub bounds: ParameterBounds,
    /// Fascicle lengths of images that are data.
    pub images: Vec<RestingFiber>,
    /// Effects that may be named; empty: all. The others stay of the size that everything has in a laboratory.
    pub candidates: Vec<&'static dyn Effect>,
    /// Largest moment of the session [N·m].
    pub mvc: f64,
    /// Seed of random draws.
    pub seed: u64,
}

impl<'a> Request<'a> {
    /// The participant's training trials, to be estimated.
    pub(crate) fn session(&self) -> Session<'a> {
        let train = self.forward.trials_for(TrialUse::Train);
        let mut effects = with_own();
        let is_new =
            |effect: &&&'static dyn Effect| effects.iter().all(|e| e.description().id != effect.description().id);
        let new: Vec<&'static dyn Effect> = self.candidates.iter().filter(is_new).copied().collect();
        effects.extend(new);
        let session =
            Session::new(self.forward, train, effects, &self.bounds, Budget { expansions: EXPANSIONS }, self.seed)
                .with_images(self.images.clone());
        match self.candidates.as_slice() {
            [] => session,
            some => session.naming(some),
        }
    }

    /// The muscles alone, as every command reports them.
    pub(crate) fn muscles(&self) -> Result<Muscles<'a>, SimulationError> {
        let found = Muscles::of(self.session(), &self.report(), &|| true)?;
        found.ok_or(SimulationError::NoiseCovariance)
    }

    /// Tells the log how far an estimate is.
    pub(crate) fn report(&self) -> impl Fn(&str) + '_ {
        |text: &str| log::debug!("{}: {text}", self.participant)
    }
}
