//! What an estimate of a session is made of: the session, where the estimate begins, stands and goes.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::super::discrepancy::Ranges;
use super::super::linear_model::{LinearModel, Sizes};
use super::super::resting_fiber::RestingFiber;
use super::super::search::{Budget, Sets};
use crate::fit::linearization::Linear;
use crate::fit::{Analysis, Point};
use crate::noise::{NoiseLevels, TrialNoise};
use carpus_effects::forward_model::Setting;
use carpus_simulation::simulation::MuscleParameters;

/// Prior odds that an effect is not missing, equation (4).
pub(super) const ODDS: f64 = 20.0;

/// What descents with several sets of effects start from.
#[derive(Clone, Copy)]
pub(super) struct Around<'s> {
    pub(super) point: &'s Point,
    pub(super) model: &'s LinearModel,
    pub(super) sizes: &'s Sizes,
    pub(super) noise: &'s [TrialNoise],
    pub(super) factors: &'s [Cholesky<f64, Dyn>],
    pub(super) directions: &'s [DMatrix<f64>],
}

/// Where a descent with a set of effects has come to.
pub(super) struct Reached {
    pub(super) set: Vec<usize>,
    pub(super) point: Point,
    pub(super) sizes: Sizes,
    /// −2 log posterior, the noise held, up to a constant: equation (18).
    pub(super) deviance: f64,
    /// As of where the descent began.
    pub(super) directions: Vec<DMatrix<f64>>,
}

impl Reached {
    /// A round begins here.
    pub(super) fn start(self, levels: NoiseLevels) -> Start {
        let Reached { set, point, sizes, directions, .. } = self;
        Start { point, levels, set, sizes, directions }
    }
}

/// A session being estimated.
pub struct Session<'a> {
    /// Trials, linearization.
    pub analysis: Analysis<'a>,
    pub(super) ranges: Ranges,
    pub(super) budget: Budget,
    /// Variances of the noise that estimates start with: usual ones until they were estimated beside the
    /// effects that are missing, because the errors of a model that is far off would be taken for noise.
    pub(super) levels: NoiseLevels,
    /// Whether they were, and its autocorrelation chosen.
    pub(super) noise_is_final: bool,
    /// Places of the effects that may be named.
    pub(super) nameable: Vec<usize>,
    /// Fascicle lengths of images that are data.
    pub(super) images: Vec<RestingFiber>,
    /// Mean and standard deviation of the logarithm of every muscle parameter's factor before the data;
    /// empty: those of the bounds.
    pub(super) muscle_priors: Vec<[f64; 2]>,
    /// Where the search starts from beside the model as given: the muscles alone.
    pub(in crate::inference) further_start: Option<Point>,
}

/// What is handed over to the user.
#[derive(Clone, Debug)]
pub struct HandedOver {
    /// Muscles.
    pub parameters: Vec<MuscleParameters>,
    /// Effects.
    pub effects: Vec<Setting>,
    /// How far it is from the model as given (0) to the joint mode or the least error (1), equation (25).
    pub part: f64,
    /// Error of trials that were left out one at a time, over that of the model as given: R of equation (25).
    pub left_out_ratio: f64,
}

/// Where a round begins.
#[derive(Clone)]
pub(super) struct Start {
    pub(super) point: Point,
    pub(super) levels: NoiseLevels,
    pub(super) set: Vec<usize>,
    pub(super) sizes: Sizes,
    /// Directions near the point: what is left beside them is noise.
    pub(super) directions: Vec<DMatrix<f64>>,
}

/// An estimate that has begun: at the most probable of many starts.
pub struct Begun {
    /// Where it stands.
    pub state: State,
    pub(super) candidates: Vec<usize>,
    pub(super) always: Vec<usize>,
}

/// Where the estimate stands.
pub struct State {
    /// Muscles, effects, EMG.
    pub point: Point,
    /// Variances of the noise.
    pub levels: NoiseLevels,
    /// How noise enters every trial.
    pub(crate) noise: Vec<TrialNoise>,
    /// Factors of V.
    pub factors: Vec<Cholesky<f64, Dyn>>,
    /// Around the point.
    pub(crate) linear: Vec<Linear>,
    /// Directions of effects that are absent, and of the moment's discrepancy.
    pub directions: Vec<DMatrix<f64>>,
    /// The linear model.
    pub model: LinearModel,
    /// Sets of effects.
    pub sets: Sets,
    /// Of every trial: what is left where the linear model expects everything.
    pub(super) expected: Vec<ExpectedResidual>,
    /// Of effects: rivals that may stand in their place, everything else estimated anew.
    pub stand_ins: BTreeMap<usize, Vec<usize>>,
    /// Other local minima with the same effects, once looked for.
    pub others: Vec<OtherMinimum>,
}

impl State {
    /// Descents start from here.
    pub(super) fn around<'s>(&'s self, sizes: &'s Sizes) -> Around<'s> {
        let State { point, model, noise, factors, directions, .. } = self;
        Around { point, model, sizes, noise, factors, directions }
    }
}

/// What is left of a trial's moment with muscles, baselines, all effects and the discrepancy where the linear
/// model expects them, averaged over blocks [N·m].
pub(super) struct ExpectedResidual {
    pub(super) simulated: DVector<f64>,
    pub(super) linear: DVector<f64>,
}

/// Another local minimum, with the same effects or others.
#[derive(Clone, Debug)]
pub struct OtherMinimum {
    /// Muscles, baselines and parameters of the state's effects, in the units of their columns, less those of
    /// the state; NaN for an effect that it does not have.
    pub away: DVector<f64>,
    /// Its probability over the state's.
    pub odds: f64,
}
