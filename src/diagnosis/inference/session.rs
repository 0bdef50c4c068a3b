//! The joint mode of a session: point, noise, discrepancy and the sets of effects that the data call for.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::discrepancy::{self, Ranges};
use super::excitation::{self, Expected};
use super::linear_model::{LinearModel, Posterior, Prior, SizePriors, Sizes};
use super::search::{Budget, Sets, search};
use crate::diagnosis::diagnose::ParameterEstimate;
use crate::diagnosis::effect::{Effect, Role, interpolate};
use crate::diagnosis::fit::{
    Analysis, Linear, Point, block_means, block_starts, corrected, knot_count, trial_times, whiten,
};
use crate::diagnosis::forward_model::{FITTED_PER_MUSCLE, ForwardModel, Setting};
use crate::diagnosis::kernel::Kernel;
use crate::diagnosis::noise::{self, KNOT_SPACING, NoiseLevels, TrialNoise};
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::ParameterBounds;

/// Prior scale of κ: what a laboratory has of every effect, as a share of what is plausible.
const EVERYTHING: f64 = 0.15;
/// Prior scale of the relative error of a muscle's moment.
const OF_MUSCLES: f64 = 0.08;
/// Prior scale of the moment that is left beside the muscles, in tenths of a newton metre at a wrist.
const OF_MOMENT: f64 = 0.5;
/// Prior odds that an effect is not missing.
const ODDS: f64 = 20.0;
/// Points that are followed from the model as given.
const STARTS: usize = 4;
/// Sets whose neighbours are looked at around the model as given.
const FIRST_EXPANSIONS: usize = 6;
/// Effects that are tried alone from there, those first that the linear model calls for most.
const SCREENED: usize = 12;
/// Gauss–Newton steps of these.
const FIRST_STEPS: usize = 3;
/// Rounds of search, simulation of other sets, noise and relinearization, at most.
const ROUNDS: usize = 4;
/// Gauss–Newton steps with a set of effects.
const STEPS: usize = 5;
/// Most probable sets beside the best that are tried by simulation.
const OTHERS: usize = 4;
/// Largest expected error of the logarithm of the EMG.
const LARGEST_NOISE: f64 = 0.7;
/// An effect may stand in another's place where the set with it has more than this share of the probability.
const STANDS_IN: f64 = 0.1;
/// Beyond this part of the way the joint mode itself is handed over.
const ALL_OF_IT: f64 = 0.9;
/// Of the sets that were tried in a round, those first whose noise is estimated anew.
const ASSESSED: usize = 3;
/// The estimate has settled when a round lowers −2 log posterior by less than this.
const SETTLED: f64 = 1.0;

/// An effect's columns in the linear model.
struct EffectColumns {
    amplitudes: Vec<usize>,
}

/// How noise enters all trials.
pub(crate) struct Passage {
    /// The EMG's by its response alone.
    bare: Vec<TrialNoise>,
    /// Per trial and muscle: what is expected of the EMG's error.
    expected: Vec<Vec<Expected>>,
    /// As the expected excitations leave it.
    noise: Vec<TrialNoise>,
}

/// What descents with several sets of effects start from.
struct Around<'s> {
    point: &'s Point,
    model: &'s LinearModel,
    sizes: &'s Sizes,
    noise: &'s Passage,
    factors: &'s [Cholesky<f64, Dyn>],
    directions: &'s [DMatrix<f64>],
}

/// Directions of a trial with the noise whitened, and their products.
struct WhitenedDirections {
    columns: DMatrix<f64>,
    products: DMatrix<f64>,
}

/// Where a descent with a set of effects has come to.
struct Reached {
    set: Vec<usize>,
    point: Point,
    sizes: Sizes,
    /// −2 log posterior, the noise held, up to a constant.
    deviance: f64,
}

/// A session being estimated.
pub struct Session<'a> {
    /// Trials, linearization.
    pub analysis: Analysis<'a>,
    ranges: Ranges,
    budget: Budget,
}

/// What is handed over to the user.
#[derive(Clone, Debug)]
pub struct HandedOver {
    /// Muscles.
    pub parameters: Vec<MuscleParameters>,
    /// Effects.
    pub effects: Vec<Setting>,
    /// How far it is from the model as given (0) to the joint mode (1).
    pub part: f64,
    /// Error of trials that were left out one at a time, at the joint mode, over that of the model as given.
    pub left_out_ratio: f64,
}

/// Where a round begins.
struct Start {
    point: Point,
    levels: NoiseLevels,
    set: Vec<usize>,
    sizes: Sizes,
}

/// Where the estimate stands.
pub struct State {
    /// −2 log posterior of the most probable set, up to a constant.
    pub deviance: f64,
    /// Muscles, effects, EMG.
    pub point: Point,
    /// Variances of the noise.
    pub levels: NoiseLevels,
    /// How noise enters every trial.
    pub(crate) noise: Passage,
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
}

impl<'a> Session<'a> {
    /// A session of training trials.
    pub fn new(
        forward: &'a ForwardModel,
        train: Vec<usize>,
        candidates: Vec<&'static dyn Effect>,
        bounds: &ParameterBounds,
        budget: Budget,
    ) -> Session<'a> {
        let ranges = Ranges::of(train.iter().map(|g| {
            let kinematics = forward.base(*g).kinematics();
            (&kinematics.angle[..], &kinematics.speed[..])
        }));
        let analysis = Analysis::without_data(forward, train, candidates, bounds, 0);
        Session { analysis, ranges, budget }
    }

    fn forward(&self) -> &'a ForwardModel {
        self.analysis.forward
    }

    /// Places of the effects that the data can speak of.
    fn testable(&self) -> Vec<usize> {
        let testable = |i: &usize| self.analysis.candidates[*i].description().unidentifiable.is_none();
        (0..self.analysis.candidates.len()).filter(testable).collect()
    }

    /// Standard deviation of what is plausible of an amplitude, in units of its scale, and the sign that it must have.
    fn plausible(&self, effect: &'static dyn Effect, parameter: usize) -> (f64, Option<f64>) {
        let forward = self.forward();
        let p = &effect.description().parameters[parameter];
        let scale = forward.joint.scale(p);
        let [low, high] = forward.joint.plausible(p);
        let ends = if effect.has_log_ratios() {
            let absent = forward.joint.absent(effect).values;
            let usual = effect.reported(&absent, &forward.muscles)[parameter].max(f64::MIN_POSITIVE);
            [low.max(f64::MIN_POSITIVE) / usual, high / usual].map(f64::ln)
        } else {
            [low, high]
        };
        let largest = ends[0].abs().max(ends[1].abs());
        let sign = match ends {
            [low, _] if low >= 0.0 => Some(1.0),
            [_, high] if high <= 0.0 => Some(-1.0),
            _ => None,
        };
        (0.5 * largest / scale, sign)
    }

    /// Columns of the discrepancy of the muscles in a trial, averaged over blocks.
    fn of_muscles(&self, position: usize, linear: &Linear) -> DMatrix<f64> {
        let record = &self.forward().trials[self.analysis.train[position]];
        let starts = block_starts(&record.time);
        let kinematics = linear.core.prepared.kinematics();
        let columns: Vec<DVector<f64>> = (0..self.analysis.n_muscles())
            .flat_map(|m| {
                let moment = &linear.core.by_parameters[m * FITTED_PER_MUSCLE];
                discrepancy::columns(&self.ranges, kinematics, m, moment)
            })
            .map(|c| block_means(&c, &starts))
            .collect();
        DMatrix::from_columns(&columns)
    }

    /// Priors of the columns [nuisance | effects that are on | directions | muscles' discrepancy] and the point's distance from their means.
    fn priors(&self, point: &Point) -> (Vec<Prior>, DVector<f64>) {
        let mut priors = Vec::new();
        let mut offset = Vec::new();
        let forward = self.forward();
        for (p, nominal) in point.parameters.iter().zip(forward.nominal_parameters()) {
            priors.extend(self.analysis.prior_sd.map(Prior::Known));
            offset.push((p.max_isometric_force / nominal.max_isometric_force).ln());
            offset.push((p.optimal_fiber_length / nominal.optimal_fiber_length).ln());
            offset.push((p.tendon_slack_length / nominal.tendon_slack_length).ln());
        }
        priors.extend(point.baseline.iter().map(|_| Prior::Known(1.0)));
        offset.extend(&point.baseline);
        let place = |e: &'static dyn Effect| {
            self.analysis.candidates.iter().position(|c| c.description().id == e.description().id).unwrap_or(usize::MAX)
        };
        for setting in &point.effects {
            let effect = place(setting.effect);
            for (i, (p, value)) in setting.effect.description().parameters.iter().zip(&setting.values).enumerate() {
                priors.push(match p.role {
                    Role::Shape => Prior::Shape { effect, sd: 1.0 },
                    Role::Amplitude => {
                        let (plausible, sign) = self.plausible(setting.effect, i);
                        Prior::Amplitude { effect, plausible, sign }
                    }
                });
                offset.push((value - forward.joint.start(p)) / forward.joint.scale(p));
            }
        }
        let is_on = |id: &str| point.effects.iter().any(|s| s.effect.description().id == id);
        for (effect, candidate) in self.analysis.candidates.iter().enumerate() {
            for i in candidate.description().amplitudes() {
                let (plausible, sign) = self.plausible(*candidate, i);
                let absent = is_on(candidate.description().id) || candidate.description().unidentifiable.is_some();
                priors.push(if absent { Prior::Known(0.0) } else { Prior::Amplitude { effect, plausible, sign } });
            }
        }
        let moment = self.analysis.n_muscles();
        let of_axes =
            self.analysis.blocks.iter().filter(|b| b.name.starts_with("axis:")).map(|b| b.columns.len()).sum();
        priors.extend(std::iter::repeat_n(Prior::Discrepancy { size: moment, weight: 1.0 }, of_axes));
        for m in 0..self.analysis.n_muscles() {
            priors.extend(
                (0..discrepancy::PER_MUSCLE).map(|j| Prior::Discrepancy { size: m, weight: discrepancy::weight(j) }),
            );
        }
        offset.resize(priors.len(), 0.0);
        (priors, DVector::from_vec(offset))
    }

    fn size_priors(&self) -> SizePriors {
        let mut discrepancy = vec![OF_MUSCLES; self.analysis.n_muscles()];
        discrepancy.push(OF_MOMENT);
        SizePriors { everything: EVERYTHING, discrepancy }
    }

    /// All columns of a trial, and the residual.
    fn columns(&self, position: usize, linear: &Linear, directions: &DMatrix<f64>) -> DMatrix<f64> {
        let of_muscles = self.of_muscles(position, linear);
        let parts = [&linear.nuisance, &linear.effects, directions, &of_muscles];
        let total: usize = parts.iter().map(|p| p.ncols()).sum();
        let mut all = DMatrix::zeros(linear.residual.len(), total + 1);
        let mut next = 0;
        for part in parts {
            all.columns_mut(next, part.ncols()).copy_from(part);
            next += part.ncols();
        }
        all.set_column(total, &linear.residual);
        all
    }

    fn all_columns(&self, linear: &[Linear], directions: &[DMatrix<f64>]) -> Vec<DMatrix<f64>> {
        let of = |(i, (l, d)): (usize, (&Linear, &DMatrix<f64>))| self.columns(i, l, d);
        linear.par_iter().zip(directions).enumerate().map(of).collect()
    }

    fn model(&self, point: &Point, columns: &[DMatrix<f64>], factors: &[Cholesky<f64, Dyn>]) -> LinearModel {
        let (priors, offset) = self.priors(point);
        let products = |(columns, factor): (&DMatrix<f64>, &Cholesky<f64, Dyn>)| {
            let w = whiten(factor, columns);
            w.tr_mul(&w)
        };
        let by_trial: Vec<_> = columns.par_iter().zip(factors).map(products).collect();
        LinearModel::new(priors, offset, by_trial, self.size_priors())
    }

    /// As [`Session::model`], directions being whitened already.
    fn model_beside(
        &self,
        point: &Point,
        linear: &[Linear],
        whitened: &[WhitenedDirections],
        factors: &[Cholesky<f64, Dyn>],
    ) -> LinearModel {
        let (priors, offset) = self.priors(point);
        let of_trial =
            |(position, ((l, d), factor)): (usize, ((&Linear, &WhitenedDirections), &Cholesky<f64, Dyn>))| {
                let of_muscles = self.of_muscles(position, l);
                let (own, directions) = (l.nuisance.ncols() + l.effects.ncols(), d.columns.ncols());
                let rest = of_muscles.ncols() + 1;
                let mut moving = DMatrix::zeros(l.residual.len(), own + rest);
                moving.columns_mut(0, l.nuisance.ncols()).copy_from(&l.nuisance);
                moving.columns_mut(l.nuisance.ncols(), l.effects.ncols()).copy_from(&l.effects);
                moving.columns_mut(own, rest - 1).copy_from(&of_muscles);
                moving.set_column(own + rest - 1, &l.residual);
                let moving = whiten(factor, &moving);
                let squares = moving.tr_mul(&moving);
                let cross = moving.tr_mul(&d.columns);
                let n = own + directions + rest;
                let mut out = DMatrix::zeros(n, n);
                let at = own + directions;
                out.view_mut((0, 0), (own, own)).copy_from(&squares.view((0, 0), (own, own)));
                out.view_mut((0, at), (own, rest)).copy_from(&squares.view((0, own), (own, rest)));
                out.view_mut((at, 0), (rest, own)).copy_from(&squares.view((own, 0), (rest, own)));
                out.view_mut((at, at), (rest, rest)).copy_from(&squares.view((own, own), (rest, rest)));
                out.view_mut((own, own), (directions, directions)).copy_from(&d.products);
                out.view_mut((0, own), (own, directions)).copy_from(&cross.rows(0, own));
                out.view_mut((own, 0), (directions, own)).copy_from(&cross.rows(0, own).transpose());
                out.view_mut((at, own), (rest, directions)).copy_from(&cross.rows(own, rest));
                out.view_mut((own, at), (directions, rest)).copy_from(&cross.rows(own, rest).transpose());
                out
            };
        let by_trial: Vec<_> = linear.par_iter().zip(whitened).zip(factors).enumerate().map(of_trial).collect();
        LinearModel::new(priors, offset, by_trial, self.size_priors())
    }

    /// What the variances of the noise are estimated beside: columns in units of their prior standard deviations, and the residual at the
    /// priors' means.
    fn regressors(
        model: &LinearModel,
        columns: &[DMatrix<f64>],
        sd: &DVector<f64>,
    ) -> Vec<(DMatrix<f64>, DVector<f64>)> {
        let p = model.len();
        let used: Vec<usize> = (0..p).filter(|j| sd[*j] > 0.0).collect();
        columns
            .iter()
            .map(|c| {
                let residual = c.column(p) + c.columns(0, p) * &model.offset;
                let mut x = c.select_columns(&used);
                for (mut column, j) in x.column_iter_mut().zip(&used) {
                    column *= sd[*j];
                }
                (x, residual)
            })
            .collect()
    }

    fn levels(
        &self,
        noise: &[TrialNoise],
        regressors: &[(DMatrix<f64>, DVector<f64>)],
        start: NoiseLevels,
    ) -> NoiseLevels {
        let trials: Vec<_> = noise.iter().zip(regressors).map(|(n, (x, r))| (n, x, r)).collect();
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        noise::estimate(&trials, &DVector::from_element(count, 1.0), self.analysis.least_white(), start)
    }

    /// Estimates the session: many starts, of which the most probable are followed to their end.
    ///
    /// - `always`: identifiers of effects that are missing for certain; `only`: no others are
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn estimate(&mut self, always: &[&str], only: bool, report: &dyn Fn(&str)) -> Result<State, SimulationError> {
        let place = |id: &&str| self.analysis.candidates.iter().position(|c| c.description().id == *id);
        let always: Vec<usize> = always.iter().filter_map(place).collect();
        let candidates = if only { Vec::new() } else { self.testable() };
        let clock = std::time::Instant::now();
        let starts = self.starts(&candidates, &always)?;
        report(&format!("{} starts, {:.1?}", starts.len(), clock.elapsed()));
        let mut followed: Vec<State> = Vec::new();
        let mut kernels_are_known = false;
        for start in starts {
            let Ok(mut state) = self.assessed(start, &candidates, &always) else { continue };
            if !kernels_are_known {
                self.choose_kernels(&mut state);
                kernels_are_known = true;
                report(&format!("kernels {:?} {:.1?}", self.analysis.kernels, clock.elapsed()));
            }
            let next = self.advanced(&state, None)?.into_iter().next();
            if let Some(Ok(next)) = next.map(|start| self.assessed(start, &candidates, &always)) {
                state = next;
            }
            report(&format!("start {} {:.1?}", self.in_words(&state), clock.elapsed()));
            followed.push(state);
        }
        let mut best = followed.into_iter().min_by(|a, b| a.deviance.total_cmp(&b.deviance));
        for _ in 0..ROUNDS {
            let Some(state) = &best else { break };
            let next = self
                .advanced(state, Some((&candidates, &always)))?
                .into_iter()
                .filter_map(|start| self.assessed(start, &candidates, &always).ok())
                .min_by(|a, b| a.deviance.total_cmp(&b.deviance));
            let Some(next) = next else { break };
            report(&format!("round {} {:.1?}", self.in_words(&next), clock.elapsed()));
            let fall = state.deviance - next.deviance;
            if fall > 0.0 {
                best = Some(next);
            }
            if fall < SETTLED {
                break;
            }
        }
        best.ok_or(SimulationError::ParameterCount { found: 0, expected: 1 })
    }

    /// What is handed over: muscles and effects, as far from the model as given as trials left out one at a time are predicted best.
    ///
    /// The step to what the other trials say of a trial is linear; the residuals at both ends are simulated.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn handed_over(&self, state: &State) -> Result<HandedOver, SimulationError> {
        let forward = self.forward();
        let given = forward.nominal_parameters();
        let residuals =
            |parameters: &[MuscleParameters], effects: &[Setting]| -> Result<Vec<DVector<f64>>, SimulationError> {
                let variant = forward.variant(effects)?;
                let of = |g: &usize| {
                    let record = &forward.trials[*g];
                    let core = forward.core(&variant, *g, &forward.recorded_input(*g), parameters, effects, false)?;
                    let moment = forward.recorded_moment(*g, &core, effects);
                    let left: Vec<f64> = record.moment.iter().zip(&moment).map(|(y, m)| y - m).collect();
                    Ok(block_means(&left, &block_starts(&record.time)))
                };
                self.analysis.train.par_iter().map(of).collect::<Vec<_>>().into_iter().collect()
            };
        let of_given = residuals(&given, &[])?;
        let of_fit = residuals(&state.point.parameters, &state.point.effects)?;
        let set = self.places(&state.point.effects);
        let sizes = &state.sets.best().sizes;
        let muscles = self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let at_all = state.model.posterior(&set, sizes).mean;
        let left_out = |(i, of_fit): (usize, &DVector<f64>)| {
            let without = &state.model.products - &state.model.by_trial[i];
            let change = state.model.posterior_of(&without, &set, sizes).mean - &at_all;
            let linear = &state.linear[i];
            let of_effects = change.rows(self.analysis.n_nuisance(), linear.effects.ncols());
            of_fit - linear.nuisance.columns(0, muscles) * change.rows(0, muscles) - &linear.effects * of_effects
        };
        let left_out: Vec<DVector<f64>> = of_fit.par_iter().enumerate().map(left_out).collect();
        // Mean square at a part of the way: a parabola, least at `vertex`.
        let mut sums = [0.0; 3];
        for (a, b) in of_given.iter().zip(&left_out) {
            sums[0] += a.norm_squared();
            sums[1] += a.dot(&(b - a));
            sums[2] += (b - a).norm_squared();
        }
        let part = if sums[2] > 0.0 { (-sums[1] / sums[2]).clamp(0.0, 1.0) } else { 0.0 };
        let part = if part > ALL_OF_IT { 1.0 } else { part };
        let (parameters, effects) = self.part_of_the_way(&state.point, part);
        let left_out_ratio = ((sums[0] + 2.0 * sums[1] + sums[2]) / sums[0].max(f64::MIN_POSITIVE)).max(0.0).sqrt();
        Ok(HandedOver { parameters, effects, part, left_out_ratio })
    }

    /// Muscles and effects at a part of the way from the model as given to a point.
    fn part_of_the_way(&self, point: &Point, part: f64) -> (Vec<MuscleParameters>, Vec<Setting>) {
        let forward = self.forward();
        let between = |from: f64, to: f64| from * (to / from).powf(part);
        let given = forward.nominal_parameters();
        let parameters = given.iter().zip(&point.parameters).map(|(from, to)| MuscleParameters {
            max_isometric_force: between(from.max_isometric_force, to.max_isometric_force),
            optimal_fiber_length: between(from.optimal_fiber_length, to.optimal_fiber_length),
            tendon_slack_length: between(from.tendon_slack_length, to.tendon_slack_length),
            ..*to
        });
        let shortened = |setting: &Setting| {
            let mut setting = setting.clone();
            for i in setting.effect.description().amplitudes() {
                let start = forward.joint.start(&setting.effect.description().parameters[i]);
                setting.values[i] = start + part * (setting.values[i] - start);
            }
            setting
        };
        (parameters.collect(), point.effects.iter().map(shortened).collect())
    }

    /// What would be handed over without one of the effects: muscles and the others take, to first order, what it leaves.
    ///
    /// - `effect`: its place
    pub fn without(&self, state: &State, effect: usize, part: f64) -> (Vec<MuscleParameters>, Vec<Setting>) {
        let set: Vec<usize> = self.places(&state.point.effects).into_iter().filter(|e| *e != effect).collect();
        let posterior = state.model.posterior(&set, &state.sets.best().sizes);
        let own = self.analysis.n_nuisance() + state.point.effects.iter().map(|s| s.values.len()).sum::<usize>();
        let step = (&posterior.mean - &state.model.offset).rows(0, own).into_owned();
        let mut point = self.analysis.moved(&state.point, &step);
        let id = self.analysis.candidates[effect].description().id;
        point.effects.retain(|s| s.effect.description().id != id);
        self.part_of_the_way(&point, part)
    }

    /// Estimates of the effects at the joint mode, by `effect.parameter`, with 95 % intervals.
    pub fn estimates(&self, state: &State) -> BTreeMap<String, ParameterEstimate> {
        let forward = self.forward();
        let posterior = state.model.posterior(&self.places(&state.point.effects), &state.sets.best().sizes);
        let mut column = self.analysis.n_nuisance();
        let mut out = BTreeMap::new();
        for setting in &state.point.effects {
            let description = setting.effect.description();
            let reported = |values: &[f64]| setting.effect.reported(values, &forward.muscles);
            let value = reported(&setting.values);
            for (i, p) in description.parameters.iter().enumerate() {
                let half = 1.96 * posterior.sd_of(column) * forward.joint.scale(p);
                let side = |sign: f64| {
                    let mut values = setting.values.clone();
                    values[i] += sign * half;
                    reported(&values)[i]
                };
                let (a, b) = (side(-1.0), side(1.0));
                let estimate = ParameterEstimate {
                    value: value[i],
                    unit: p.unit,
                    ci95: [a.min(b), a.max(b)],
                    plausible: forward.joint.plausible(p),
                };
                out.insert(format!("{}.{}", description.id, p.name), estimate);
                column += 1;
            }
        }
        out
    }

    /// Standard deviation of the noise of a sample of the training trials [N·m].
    pub fn noise_floor(&self, state: &State) -> f64 {
        let total: f64 = state.noise.bare.iter().map(|n| n.variance_of_samples(&state.levels)).sum();
        let blocks: usize = state.linear.iter().map(|l| l.bare.len()).sum();
        (total / blocks.max(1) as f64).sqrt()
    }

    /// Effects that may stand in an effect's place: its probability and that of all of them together.
    ///
    /// - `effect`: place of one of the point's effects
    pub fn group(&self, state: &State, effect: usize) -> (Vec<usize>, f64) {
        let set = self.places(&state.point.effects);
        let probability = |candidate: &[usize]| {
            let found = state.sets.found.iter().zip(&state.sets.probability).find(|(s, _)| s.effects == candidate);
            found.map_or(0.0, |(_, p)| *p)
        };
        let own = probability(&set);
        let exchanged = |other: usize| {
            let mut set: Vec<usize> = set.iter().copied().filter(|e| *e != effect).chain([other]).collect();
            set.sort_unstable();
            set
        };
        let stands_in = |other: &usize| !set.contains(other) && probability(&exchanged(*other)) > own * STANDS_IN;
        let mut group = vec![effect];
        group.extend(self.testable().into_iter().filter(stands_in));
        let together = state.sets.of_any(&group);
        (group, together)
    }

    fn ids(&self, set: &[usize]) -> Vec<&'static str> {
        set.iter().map(|e| self.analysis.candidates[*e].description().id).collect()
    }

    fn in_words(&self, state: &State) -> String {
        let best = state.sets.best();
        format!(
            "{:?} deviance {:.1} of set {:.1} κ {:.3} σ {:.3?} levels {:.3?}",
            self.ids(&best.effects),
            state.deviance,
            best.deviance,
            best.sizes.everything,
            best.sizes.discrepancy,
            state.levels.0.map(f64::sqrt)
        )
    }

    /// Where to begin: from the model as given every effect alone, none, and what the linear model at that point calls for, each fitted with
    /// the same usual noise; the most probable first.
    fn starts(&mut self, candidates: &[usize], always: &[usize]) -> Result<Vec<Start>, SimulationError> {
        let levels = NoiseLevels::usual(self.forward().joint.strength);
        let mut point = self.analysis.nominal_point();
        self.start_at_expected(&mut point, &levels)?;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let passage = self.structure(&mut linear, &point, &levels);
        let directions;
        (directions, self.analysis.blocks) = self.analysis.calc_directions(&linear, &point)?;
        let factors = factors(&passage.noise, &levels);
        let model = self.model(&point, &self.all_columns(&linear, &directions), &factors);
        let sizes = model.usual_sizes();
        let found =
            search(&model, candidates, always, 2.0 * ODDS.ln(), &[], &sizes, Budget { expansions: FIRST_EXPANSIONS });
        let mut sets: Vec<Vec<usize>> = vec![always.to_vec(), found.best().effects.clone()];
        let with = |e: &usize| [always, &[*e]].concat();
        let mut alone: Vec<(f64, Vec<usize>)> = candidates
            .par_iter()
            .filter(|e| !always.contains(e))
            .map(|e| (model.posterior(&with(e), &sizes).deviance, with(e)))
            .collect();
        alone.sort_by(|a, b| a.0.total_cmp(&b.0));
        sets.extend(alone.into_iter().take(SCREENED).map(|(_, set)| set));
        sets.iter_mut().for_each(|s| s.sort_unstable());
        sets.dedup();
        let from = Around {
            point: &point,
            model: &model,
            sizes: &sizes,
            noise: &passage,
            factors: &factors,
            directions: &directions,
        };
        let mut reached: Vec<Reached> =
            sets.par_iter().with_max_len(1).filter_map(|set| self.reach(&from, set, FIRST_STEPS).ok()).collect();
        reached.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        reached.truncate(STARTS);
        Ok(reached.into_iter().map(|r| Start { point: r.point, levels, set: r.set, sizes: r.sizes }).collect())
    }

    /// Noise, linear model and sets at a point.
    fn assessed(&self, start: Start, candidates: &[usize], always: &[usize]) -> Result<State, SimulationError> {
        let Start { point, levels, set, sizes } = start;
        let mut linear = self.analysis.linearize(&point, &[])?;
        let passage = self.structure(&mut linear, &point, &levels);
        let directions = self.analysis.calc_directions(&linear, &point)?.0;
        let columns = self.all_columns(&linear, &directions);
        let mut state = State {
            deviance: f64::INFINITY,
            model: self.model(&point, &columns, &factors(&passage.noise, &levels)),
            factors: Vec::new(),
            sets: Sets::none(),
            point,
            levels,
            noise: passage,
            linear,
            directions,
        };
        let regressors = Self::regressors(&state.model, &columns, &state.model.sds(&set, &sizes));
        state.levels = self.levels(&state.noise.noise, &regressors, levels);
        self.weigh(&mut state, &columns, &set, &sizes, candidates, always);
        Ok(state)
    }

    /// The linear model with the noise as it is, its sets and deviance.
    fn weigh(
        &self,
        state: &mut State,
        columns: &[DMatrix<f64>],
        set: &[usize],
        sizes: &Sizes,
        candidates: &[usize],
        always: &[usize],
    ) {
        state.factors = factors(&state.noise.noise, &state.levels);
        state.model = self.model(&state.point, columns, &state.factors);
        state.sets = search(&state.model, candidates, always, 2.0 * ODDS.ln(), &[set.to_vec()], sizes, self.budget);
        let determinant: f64 = state
            .factors
            .iter()
            .flat_map(|f| f.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).collect::<Vec<_>>())
            .sum();
        state.deviance = determinant + state.sets.best().deviance + noise::prior_deviance(&state.levels);
    }

    /// Steps on: the best set reached by descent; with `among`, others tried by simulation, too: the most probable, the noise held.
    fn advanced(&self, state: &State, among: Option<(&[usize], &[usize])>) -> Result<Vec<Start>, SimulationError> {
        let best = state.sets.best();
        let from = Around {
            point: &state.point,
            model: &state.model,
            sizes: &best.sizes,
            noise: &state.noise,
            factors: &state.factors,
            directions: &state.directions,
        };
        let mut sets = vec![best.effects.clone()];
        if let Some((candidates, always)) = among {
            sets.extend(self.alternatives(&best.effects, &state.sets, candidates, always));
        }
        let found: Vec<_> = sets.par_iter().with_max_len(1).map(|set| self.reach(&from, set, STEPS)).collect();
        let mut reached: Vec<Reached> = found.into_iter().flatten().collect();
        reached.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        reached.truncate(ASSESSED);
        let start = |r: Reached| Start { point: r.point, levels: state.levels, set: r.set, sizes: r.sizes };
        Ok(reached.into_iter().map(start).collect())
    }

    /// Takes the excitations that are expected before the moment is looked at.
    fn start_at_expected(&self, point: &mut Point, levels: &NoiseLevels) -> Result<(), SimulationError> {
        let expected = excitation::expected(&self.envelopes(), levels, &self.analysis.kernels.emg);
        for (position, g) in self.analysis.train.iter().enumerate() {
            let record = &self.forward().trials[*g];
            let clamp = |e: &Expected| e.mean.map(|w| w.clamp(-LARGEST_NOISE, LARGEST_NOISE));
            point.correction[position] = expected[position].iter().map(clamp).collect();
            let excitation = corrected(&record.time, &record.excitation, &point.correction[position]);
            point.inputs[position] = Arc::new(self.forward().input(*g, excitation)?);
        }
        Ok(())
    }

    /// Recorded envelopes on knots, per trial and muscle.
    fn envelopes(&self) -> Vec<Vec<DVector<f64>>> {
        let of = |g: &usize| {
            let record = &self.forward().trials[*g];
            let knots = knot_count(&record.time);
            let at = |e: &Vec<f64>, j: usize| interpolate(&record.time, e, record.time[0] + KNOT_SPACING * j as f64);
            record.excitation.iter().map(|e| DVector::from_fn(knots, |j, _| at(e, j))).collect()
        };
        self.analysis.train.iter().map(of).collect()
    }

    /// How noise enters every trial; the linearization is made to match.
    fn structure(&self, linear: &mut [Linear], point: &Point, levels: &NoiseLevels) -> Passage {
        let bare = self.analysis.noise_structure(linear, point);
        let expected = excitation::expected(&self.envelopes(), levels, &self.analysis.kernels.emg);
        let kernel = &self.analysis.kernels.emg;
        let noise = bare
            .par_iter()
            .zip(&expected)
            .map(|(n, e)| n.with_expected(e.iter().map(|e| (&e.shaping, &e.known)), kernel))
            .collect();
        let passage = Passage { bare, expected, noise };
        self.attach(linear, point, &passage);
        passage
    }

    /// Residuals with what is expected of the EMG, and baselines' columns.
    fn attach(&self, linear: &mut [Linear], point: &Point, passage: &Passage) {
        linear.par_iter_mut().enumerate().for_each(|(i, l)| {
            self.analysis.attach(l, i, point, &passage.bare[i]);
            let means: Vec<DVector<f64>> = passage.expected[i].iter().map(|e| e.mean.clone()).collect();
            l.residual -= passage.bare[i].respond(&means);
        });
    }

    /// Linearized at a point, noise passing as it does.
    fn linearized(&self, point: &Point, passage: &Passage) -> Result<Vec<Linear>, SimulationError> {
        let mut linear = self.analysis.linearize(point, &[])?;
        self.attach(&mut linear, point, passage);
        Ok(linear)
    }

    /// Directions with 0 for effects that are on at a point.
    fn directions_without(&self, directions: &[DMatrix<f64>], point: &Point) -> Vec<DMatrix<f64>> {
        let mut out = directions.to_vec();
        for (block, effect) in self.analysis.blocks.iter().zip(&self.analysis.candidates) {
            if point.effects.iter().any(|s| s.effect.description().id == effect.description().id) {
                for d in &mut out {
                    block.columns.iter().for_each(|c| d.column_mut(*c).fill(0.0));
                }
            }
        }
        out
    }

    /// The point with the effects of a set on and all others off; those that are new at what the posterior expects.
    fn switched(&self, point: &Point, model: &LinearModel, posterior: &Posterior, set: &[usize]) -> Point {
        let forward = self.forward();
        let columns = self.amplitude_columns(model);
        let of = |effect: &usize| {
            let candidate = self.analysis.candidates[*effect];
            let known = point.effects.iter().find(|s| s.effect.description().id == candidate.description().id);
            known.cloned().unwrap_or_else(|| {
                let mut setting = forward.joint.absent(candidate);
                let amplitudes: Vec<usize> = candidate.description().amplitudes().collect();
                for (i, column) in amplitudes.into_iter().zip(&columns[*effect].amplitudes) {
                    let p = &candidate.description().parameters[i];
                    let (plausible, sign) = self.plausible(candidate, i);
                    let size = posterior.mean[*column].clamp(-2.0 * plausible, 2.0 * plausible);
                    // On its side, and there at all, so that its shape matters.
                    let least = 0.02 * plausible;
                    let size = match sign {
                        Some(sign) => sign * (sign * size).max(least),
                        None if size.abs() < least => least.copysign(size),
                        None => size,
                    };
                    setting.values[i] += size * forward.joint.scale(p);
                }
                setting
            })
        };
        Point { effects: set.iter().map(of).collect(), ..point.clone() }
    }

    fn amplitude_columns(&self, model: &LinearModel) -> Vec<EffectColumns> {
        let of = |effect: usize| {
            let own = |(_, p): &(usize, &Prior)| matches!(p, Prior::Amplitude { effect: e, .. } if *e == effect);
            EffectColumns { amplitudes: model.priors.iter().enumerate().filter(own).map(|(j, _)| j).collect() }
        };
        (0..self.analysis.candidates.len()).map(of).collect()
    }

    /// Sets that are tried by simulation beside the best: the most probable others, and those in which an effect gives way to a rival.
    fn alternatives(&self, set: &[usize], sets: &Sets, candidates: &[usize], always: &[usize]) -> Vec<Vec<usize>> {
        let mut out: Vec<Vec<usize>> =
            sets.found.iter().map(|s| s.effects.clone()).filter(|s| s != set).take(OTHERS).collect();
        for effect in set.iter().filter(|e| !always.contains(e)) {
            let rivals = self.analysis.candidates[*effect].description().rivals;
            let is_rival = |e: &&usize| rivals.contains(&self.analysis.candidates[**e].description().id);
            for rival in candidates.iter().filter(|e| !set.contains(e)).filter(is_rival) {
                let mut other: Vec<usize> = set.iter().copied().filter(|e| e != effect).chain([*rival]).collect();
                other.sort_unstable();
                if !out.contains(&other) {
                    out.push(other);
                }
            }
        }
        out
    }

    /// Where the descent comes to with a set of effects, the noise held.
    fn reach(&self, from: &Around, set: &[usize], steps: usize) -> Result<Reached, SimulationError> {
        let posterior = from.model.posterior(set, from.sizes);
        let point = self.switched(from.point, from.model, &posterior, set);
        self.reach_from(from, point, set, steps)
    }

    /// Places of effects among the candidates, ascending.
    pub(crate) fn places(&self, effects: &[Setting]) -> Vec<usize> {
        let place =
            |s: &Setting| self.analysis.candidates.iter().position(|c| c.description().id == s.effect.description().id);
        let mut out: Vec<usize> = effects.iter().filter_map(place).collect();
        out.sort_unstable();
        out
    }

    /// As [`Session::reach`], from a point with the effects of the set.
    fn reach_from(
        &self,
        from: &Around,
        mut point: Point,
        set: &[usize],
        steps: usize,
    ) -> Result<Reached, SimulationError> {
        let mut linear = self.linearized(&point, from.noise)?;
        let mut directions = self.directions_without(from.directions, &point);
        let is_on = |id: &str| set.iter().any(|e| self.analysis.candidates[*e].description().id == id);
        let was_on = |id: &str| from.point.effects.iter().any(|s| s.effect.description().id == id);
        if from.point.effects.iter().any(|s| !is_on(s.effect.description().id)) {
            let (of_removed, blocks) =
                self.analysis.calc_directions_of(&linear, &point, &|id| was_on(id) && !is_on(id))?;
            for (block, effect) in blocks.iter().zip(&self.analysis.candidates) {
                let id = effect.description().id;
                for column in block.columns.iter().filter(|_| was_on(id) && !is_on(id)) {
                    for (to, from) in directions.iter_mut().zip(&of_removed) {
                        to.set_column(*column, &from.column(*column));
                    }
                }
            }
        }
        let model =
            self.descend(&mut point, &mut linear, from.noise, from.factors, &directions, set, from.sizes, steps)?;
        let (sizes, deviance) = model.sizes_for(set, from.sizes, 2);
        let deviance = deviance + 2.0 * ODDS.ln() * set.len() as f64;
        Ok(Reached { set: set.to_vec(), point, sizes, deviance })
    }

    /// Gauss–Newton steps of muscles, baselines and effects; directions and discrepancy are profiled out.
    fn descend(
        &self,
        point: &mut Point,
        linear: &mut Vec<Linear>,
        noise: &Passage,
        factors: &[Cholesky<f64, Dyn>],
        directions: &[DMatrix<f64>],
        set: &[usize],
        sizes: &Sizes,
        steps: usize,
    ) -> Result<LinearModel, SimulationError> {
        let whitened: Vec<WhitenedDirections> = directions
            .par_iter()
            .zip(factors)
            .map(|(d, factor)| {
                let columns = whiten(factor, d);
                WhitenedDirections { products: columns.tr_mul(&columns), columns }
            })
            .collect();
        let mut model = self.model_beside(point, linear, &whitened, factors);
        let mut radius = 1.0_f64;
        for _ in 0..steps {
            let own = self.analysis.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>();
            let posterior = model.posterior(set, sizes);
            let here = profiled(&model, own, set, sizes);
            let promised = here - posterior.squares;
            if promised < 0.3 {
                break;
            }
            let step = (&posterior.mean - &model.offset).rows(0, own) * radius;
            let moved = self.analysis.moved(point, &step.into_owned());
            let next = self.linearized(&moved, noise).ok().map(|linear| {
                let model = self.model_beside(&moved, &linear, &whitened, factors);
                (profiled(&model, own, set, sizes), linear, model)
            });
            match next {
                Some((there, l, m)) if there < here - 0.05 * promised * radius => {
                    (*point, *linear, model) = (moved, l, m);
                    radius = (2.0 * radius).min(1.0);
                }
                _ => radius *= 0.3,
            }
        }
        Ok(model)
    }

    /// Chooses how noise is autocorrelated by restricted likelihood: of the EMG's, then of the moment's.
    fn choose_kernels(&mut self, state: &mut State) {
        let columns = self.all_columns(&state.linear, &state.directions);
        let best = state.sets.best().clone();
        let regressors = Self::regressors(&state.model, &columns, &state.model.sds(&best.effects, &best.sizes));
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        let precision = DVector::from_element(count, 1.0);
        let least = self.analysis.least_white();
        for of_emg in [true, false] {
            let known = if of_emg { self.analysis.kernels.emg } else { self.analysis.kernels.moment };
            let noise = &state.noise.noise;
            let levels = state.levels;
            let with = |kernel: &Kernel| -> Vec<TrialNoise> {
                let of = |(n, g): (&TrialNoise, &usize)| match of_emg {
                    true => n.clone().with_emg_kernel(kernel),
                    false => n.clone().with_times(trial_times(&self.forward().trials[*g], kernel)),
                };
                noise.par_iter().zip(&self.analysis.train).map(of).collect()
            };
            let best = noise::best_kernel(&known, |kernel| {
                let noise = with(kernel);
                let trials: Vec<_> = noise.iter().zip(&regressors).map(|(n, (x, r))| (n, x, r)).collect();
                let levels = noise::estimate_within(2, &trials, &precision, least, levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            let found = with(&best);
            state.levels = self.levels(&found, &regressors, state.levels);
            state.noise.noise = found;
            if of_emg { self.analysis.kernels.emg = best } else { self.analysis.kernels.moment = best }
        }
        let time = |g: &usize| trial_times(&self.forward().trials[*g], &self.analysis.kernels.moment);
        self.analysis.times = self.analysis.train.iter().map(time).collect();
        state.factors = factors(&state.noise.noise, &state.levels);
        state.model = self.model(&state.point, &columns, &state.factors);
    }
}

/// Penalized sum of squares at the point, directions and discrepancy profiled out.
///
/// - `own`: columns that the point itself has
fn profiled(model: &LinearModel, own: usize, set: &[usize], sizes: &Sizes) -> f64 {
    let sd = model.sds(set, sizes);
    let p = model.len();
    let rest = p - own;
    let mut m = model.products.view((own, own), (rest, rest)).into_owned();
    let mut c = model.products.view((own, p), (rest, 1)).column(0).into_owned();
    for j in 0..rest {
        for i in 0..rest {
            m[(i, j)] *= sd[own + i] * sd[own + j];
        }
        m[(j, j)] += 1.0;
        c[j] *= sd[own + j];
    }
    let of_prior: f64 = (0..own).filter(|j| sd[*j] > 0.0).map(|j| (model.offset[j] / sd[j]).powi(2)).sum();
    let explained = m.cholesky().map_or(0.0, |f| c.dot(&f.solve(&c)));
    model.products[(p, p)] - explained + of_prior
}

fn factors(noise: &[TrialNoise], levels: &NoiseLevels) -> Vec<Cholesky<f64, Dyn>> {
    noise.par_iter().filter_map(|n| noise::factor(n, levels)).collect()
}
