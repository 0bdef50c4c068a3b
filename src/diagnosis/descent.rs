//! The descent: damped Gauss–Newton steps of parameters and effects, and between them the EMG's expected noise and the noise's
//! variances.

mod relaxation;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

use super::ONE_BY_ONE;
use super::centring::{Drawn, MOST_PAIRS};
use super::effect::{Role, Stage};
use super::fit::{Account, Analysis, Fit, LARGEST_MEAN, Linear, Noise, Point, corrected};
use super::forward_model::{FITTED_PER_MUSCLE, Setting};
use super::noise::{self, COMPONENTS, NoiseLevels, scatter_of_all};
use super::score_test::tail;
use crate::simulation::SimulationError;
use relaxation::Relaxation;

/// Of many points that are fitted roughly, so many are looked at more closely for every one that is wanted.
const SCREENED: usize = 2;
/// So many times more get all rough steps, by what these foretell after the first few …
const FORETOLD: usize = 2;
/// … which are so many.
const FIRST_STEPS: usize = 3;
/// Steps while the noise is only guessed.
const ROUGH_STEPS: usize = 7;
/// Steps after each estimate of the noise.
const FINE_STEPS: usize = 6;
/// A rough fit has converged when a step promises less than this decrease of the deviance.
const ROUGHLY: f64 = 1.0;
/// The same of a fit.
const CONVERGED: f64 = 0.1;
/// Steps towards the moments of other effects.
const DISTANT_STEPS: usize = 30;
/// Rounds of estimating the noise, at most.
const MOST_ROUNDS: usize = 8;
/// Rounds before a fit may be given up.
const ROUNDS_AT_LEAST: usize = 2;
/// Such a fit leaves something of which the p-value, whatever its mean, is smaller than this.
pub(super) const BEYOND_DOUBT: f64 = 1e-3;
/// A rough fit, of noise that is only guessed, is given up if it leaves something of a smaller one still …
const BEYOND_HOPE: f64 = 1e-9;
/// … or if its misfit is this much larger still.
const STILL_FALLS: f64 = 40.0;
/// The noise has settled when a round changes the deviance by less than this …
const SETTLED: f64 = 2.0;
/// … so many times in a row: steps that were shortened because they swung change little, too.
const QUIET: usize = 2;
/// How far aside a deeper valley is looked for [standard errors].
const ASIDE: f64 = 1.5;
/// Steps from there.
const STEPS_BESIDE: usize = 6;
/// A valley counts as deeper from this fall of the misfit on.
const DEEPER: f64 = 2.0;
/// So many times, at most, a descent goes on in a deeper one.
const MOST_VALLEYS: usize = 2;
/// A fit whose deviance is this much above the least it had has run away: where little moves a muscle, its force and the noise of
/// its EMG take up more and more of what they do not cause.
const RUN_AWAY: f64 = 30.0;
/// Largest relative change of a force that is made without a simulation.
const LARGEST_CHANGE: f64 = 0.5;
/// Expected noise of the logarithm of the EMG stays below this.
const LARGEST_NOISE: f64 = 0.7;

/// Fits that are not followed to their end; of their scores no mean is taken out, or that of a few draws.
#[derive(Clone, Copy)]
pub struct Hopeless<'a> {
    /// Least misfit of a fit so far.
    pub best: f64,
    /// Those whose misfit stays farther above that …
    pub by: f64,
    /// … where these are the variances of the noise.
    pub levels: NoiseLevels,
    /// Those that leave what no noise explains, whatever its score's mean; these blocks are not asked (as for
    /// [`Analysis::anything_left`]).
    pub skip: &'a [&'static str],
}

/// A fit under way.
pub(super) struct Descent {
    pub(super) point: Point,
    pub(super) linear: Vec<Linear>,
    pub(super) noise: Noise,
    /// Last step of the noise's variances: see [`NoiseLevels::towards`].
    last_step: [[f64; 2]; COMPONENTS],
    /// Per training trial: last step of the EMG's expected noise.
    last_correction: Vec<Option<Relaxation>>,
    at: Account,
    /// Whether the noise's structure is that of the point, and not of one before.
    pub(super) noise_is_current: bool,
    /// Directions, once asked for.
    directions: Option<Arc<Vec<DMatrix<f64>>>>,
    /// Whether these are those of the point, and not of one before.
    directions_are_current: bool,
    /// Whether the noise's variances are estimates: with those that were guessed a deviance is not that of a fit.
    estimated: bool,
    /// Rounds in a row that changed little.
    quiet: usize,
    /// Where it was most probable at the end of a round.
    least: Option<Least>,
}

/// A state to go back to.
struct Least {
    deviance: f64,
    point: Point,
    levels: NoiseLevels,
}

impl Descent {
    /// That a full step promises.
    fn deviance(&self) -> f64 {
        self.noise.log_determinant() + self.misfit()
    }

    /// The same, of moments and EMG together.
    fn misfit(&self) -> f64 {
        self.at.objective - self.at.gain
    }
}

impl Analysis<'_> {
    /// Fits jointly from a point, the EMG as that point has it, with the variances of the noise near `levels`.
    ///
    /// - `near`: a fit without effects that is near enough for its scores to have nearly the same mean
    /// - `hopeless`: which fits are not followed to their end; `None`: all are
    /// - `deeper`: for one of less misfit than this that has a chance a deeper valley is looked for
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn refit(
        &self,
        start: Point,
        levels: NoiseLevels,
        near: Option<&Fit>,
        hopeless: Option<Hopeless>,
        deeper: f64,
    ) -> Result<Fit, SimulationError> {
        let mut descent = self.begin(start, levels)?;
        self.descend(&mut descent, ROUGH_STEPS, ROUGHLY);
        self.settle(&mut descent, false)?;
        if let Some(h) = hopeless {
            let (rough, _) = self.uncentred(&mut descent)?;
            if self.misfit(&rough, &h.levels) > h.best + h.by + STILL_FALLS
                || self.leaves_less_than(BEYOND_HOPE, &rough, h.skip)
            {
                return Ok(rough);
            }
        }
        let mut rounds = ROUNDS_AT_LEAST;
        loop {
            let settled = self.follow(&mut descent, rounds)?;
            let (fit, inverse) = self.uncentred(&mut descent)?;
            if hopeless.is_some_and(|h| {
                self.misfit(&fit, &h.levels) > h.best + h.by || self.leaves_less_than(BEYOND_DOUBT, &fit, h.skip)
            }) {
                return Ok(fit);
            }
            if settled || rounds > ROUNDS_AT_LEAST {
                let misfit = self.misfit(&fit, &hopeless.map_or(fit.levels, |h| h.levels));
                let may_be_deeper = misfit < deeper && !fit.is_within_noise();
                let drawn = self.drawn(fit, inverse)?;
                if may_be_deeper && hopeless.is_none_or(|h| self.has_a_chance(&drawn, &h)) {
                    // Beside it a size may be one at which a muscle cannot be simulated.
                    let deeper = self.deeper(descent).ok().flatten();
                    if let Some(Ok(fit)) = deeper.map(|deeper| self.centre_by_draws(deeper, near, hopeless)) {
                        return Ok(fit);
                    }
                }
                return self.centre_by_draws(drawn, near, hopeless);
            }
            rounds = MOST_ROUNDS - ROUNDS_AT_LEAST;
        }
    }

    /// Points with one more effect each, fitted roughly, with usual noise, from where a model has not yet gone astray to make up for
    /// what it lacks; the most promising first. Those that cannot be simulated are left out.
    ///
    /// - `start`: the model as given, with the effects that are on
    /// - `further`: effects, one at a time
    /// - `wanted`: how many points are asked for; there may be more or fewer
    pub(super) fn screened(&self, start: &Point, further: Vec<Setting>, wanted: usize) -> Vec<Point> {
        let Ok(start) = self.begin(start.clone(), NoiseLevels::usual(self.forward.joint.strength)) else {
            return Vec::new();
        };
        let first = |setting: Setting| {
            let mut descent = self.begin_beside(&start, setting)?;
            let radius = self.descend_on(&mut descent, f64::INFINITY, FIRST_STEPS, ROUGHLY);
            Ok::<_, SimulationError>((descent, radius))
        };
        let rest = |(mut descent, radius): (Descent, f64)| {
            self.descend_on(&mut descent, radius, ROUGH_STEPS - FIRST_STEPS, ROUGHLY);
            descent
        };
        let mut begun: Vec<_> = further.into_par_iter().filter_map(|setting| first(setting).ok()).collect();
        begun = leading_first(begun, |(descent, _)| descent);
        begun.truncate(FORETOLD * SCREENED * wanted);
        let mut fitted = leading_first(begun.into_par_iter().map(rest).collect(), |descent| descent);
        // Of several sizes of the same effects the best.
        let ids = |d: &Descent| -> Vec<&str> { d.point.effects.iter().map(|s| s.effect.description().id).collect() };
        let mut seen = HashSet::new();
        fitted.retain(|descent| seen.insert(ids(descent)));
        fitted.truncate(SCREENED * wanted);
        let settled = |mut descent: Descent| self.settle(&mut descent, false).is_ok().then_some(descent);
        let fitted = leading_first(fitted.into_par_iter().filter_map(settled).collect(), |descent| descent);
        fitted.into_iter().map(|descent| descent.point).collect()
    }

    /// Whether a fit leaves something of a smaller p-value even if its score's mean were as large as any.
    fn leaves_less_than(&self, p_value: f64, fit: &Fit, skip: &[&str]) -> bool {
        let Some(left) = self.blocks_left_uncentred(fit, skip) else { return false };
        let count = left.len() as f64;
        left.iter().any(|b| {
            let least = (b.statistic.max(0.0).sqrt() - LARGEST_MEAN).max(0.0);
            tail(b.rank, b.freedom, least * least) * count < p_value
        })
    }

    /// Estimates the noise and goes on until it has settled; returns whether it has. One that runs away is taken back to where it was
    /// most probable, and stays there.
    ///
    /// - `rounds`: at most
    fn follow(&self, descent: &mut Descent, rounds: usize) -> Result<bool, SimulationError> {
        for _ in 0..rounds {
            let before = descent.deviance();
            if descent.estimated && descent.least.as_ref().is_none_or(|least| before < least.deviance) {
                let (point, levels) = (descent.point.clone(), descent.noise.levels);
                descent.least = Some(Least { deviance: before, point, levels });
            }
            self.settle(descent, true)?;
            let after = descent.deviance();
            if let Some(least) = descent.least.take_if(|least| after > least.deviance + RUN_AWAY) {
                *descent = self.begin(least.point, least.levels)?;
                return Ok(true);
            }
            descent.quiet = if (before - after).abs() < SETTLED { descent.quiet + 1 } else { 0 };
            if descent.quiet >= QUIET {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Where a descent comes to that goes on in deeper valleys beside its own, if there are any.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    fn deeper(&self, mut descent: Descent) -> Result<Option<Drawn>, SimulationError> {
        self.descend(&mut descent, FINE_STEPS, CONVERGED);
        for valleys in 0.. {
            self.bring_noise_up_to_date(&mut descent);
            let deeper = if valleys < MOST_VALLEYS { self.deeper_beside(&descent) } else { None };
            match deeper {
                Some(deeper) => descent = deeper,
                None if valleys == 0 => return Ok(None),
                None => break,
            }
            self.follow(&mut descent, MOST_ROUNDS)?;
        }
        let (fit, inverse) = self.uncentred(&mut descent)?;
        self.drawn(fit, inverse).map(Some)
    }

    /// The deepest valley beside the one that a descent has come to, if any is deeper: every amplitude is moved to both sides, all else
    /// along with it as the valley runs, and set free, the noise held. Moments bend with the lengths of muscles, most where
    /// passive force begins, so that there are valleys within a standard error of each other.
    fn deeper_beside(&self, descent: &Descent) -> Option<Descent> {
        let inverse = descent.at.information.clone().try_inverse()?;
        let beside = |(column, distance): (usize, f64)| {
            let along = inverse.column(column) / inverse[(column, column)].max(f64::MIN_POSITIVE).sqrt();
            let point = self.moved(&descent.point, &(along * distance));
            let (point, linear, at) = self.evaluate(point, &descent.noise).ok()?;
            let begun = self.begun(point, linear, descent.noise.clone());
            let mut beside = Descent { at, noise_is_current: false, estimated: descent.estimated, ..begun };
            self.descend(&mut beside, STEPS_BESIDE, CONVERGED);
            Some(beside)
        };
        let parameters = descent.point.effects.iter().flat_map(|s| s.effect.description().parameters);
        let amplitudes = parameters.enumerate().filter(|(_, p)| p.role == Role::Amplitude);
        let columns = amplitudes.map(|(i, _)| self.n_nuisance() + i);
        let moves: Vec<_> = columns.flat_map(|column| [(column, ASIDE), (column, -ASIDE)]).collect();
        let found = moves.into_par_iter().with_max_len(1).map(beside).collect::<Vec<_>>();
        let deepest = found.into_iter().flatten().min_by(|a, b| a.misfit().total_cmp(&b.misfit()))?;
        // What a step promises has not come yet.
        (deepest.at.objective < descent.misfit() - DEEPER).then_some(deepest)
    }

    /// The fit without effects, from where the noise is only guessed.
    pub(super) fn followed(&self, mut descent: Descent) -> Result<Fit, SimulationError> {
        self.settle(&mut descent, true)?;
        self.follow(&mut descent, MOST_ROUNDS - 1)?;
        self.with_means_drawn(&mut descent)
    }

    /// The same from elsewhere: from every muscle's tendon shorter by one prior standard deviation, so that in turn each carries more of
    /// the passive moment. The most probable, if that is more probable than a fit from the model as given; where nothing can be simulated none is looked for.
    ///
    /// # Errors
    /// A fit whose scores' mean cannot be drawn.
    pub(super) fn fitted_elsewhere(&self, fit: &Fit) -> Result<Option<Fit>, SimulationError> {
        let from = |muscle: usize| {
            let mut start = self.nominal_point();
            start.parameters[muscle].tendon_slack_length *= (-self.prior_sd[2]).exp();
            let mut descent = self.begin(start, fit.levels)?;
            self.descend(&mut descent, ROUGH_STEPS, ROUGHLY);
            self.settle(&mut descent, false)?;
            let settled = self.follow(&mut descent, ROUNDS_AT_LEAST)?;
            if !settled && descent.deviance() < fit.deviance + RUN_AWAY {
                self.follow(&mut descent, MOST_ROUNDS - ROUNDS_AT_LEAST)?;
            }
            Ok::<_, SimulationError>(descent)
        };
        let descents: Vec<_> = (0..self.n_muscles()).into_par_iter().with_max_len(1).map(from).collect();
        let best = most_probable(descents.into_iter().flatten().collect()).into_iter().next();
        let Some(mut best) = best.filter(|best| best.deviance() < fit.deviance - SETTLED) else { return Ok(None) };
        self.with_means_drawn(&mut best).map(Some)
    }

    /// A finished descent of which no effect is on, with the mean of its scores.
    fn with_means_drawn(&self, descent: &mut Descent) -> Result<Fit, SimulationError> {
        let (fit, inverse) = self.uncentred(descent)?;
        let means = self.calc_bias(&fit, &self.truth_of(&fit)?, 0..MOST_PAIRS, &|_| true)?;
        Ok(self.centre(fit, &inverse, means))
    }

    /// How near a model comes to the moments of a fit with other effects, its noise held: standard deviations, priors of both included.
    ///
    /// - `start`: effects to come near with, and muscles to start from; `fit`: of which the targets are
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn distance(&self, start: Point, fit: &Fit) -> Result<f64, SimulationError> {
        let noise = Noise { structure: fit.noise.clone(), levels: fit.levels, factors: fit.factors.clone() };
        let linear = self.linearize(&start, &noise.structure)?;
        let mut descent = self.begun(start, linear, noise);
        self.descend(&mut descent, DISTANT_STEPS, CONVERGED);
        let n = self.n_muscles() * FITTED_PER_MUSCLE;
        let own: f64 = fit.precision.iter().zip(&fit.offset).take(n).map(|(a, b)| a * b * b).sum();
        let squared = (descent.misfit() - own).max(0.0);
        self.bring_noise_up_to_date(&mut descent);
        let scatter = scatter_of_all(&descent.noise.structure, &fit.noise, &fit.levels).unwrap_or(0.0);
        Ok(squared / (squared + scatter).sqrt().max(f64::MIN_POSITIVE))
    }

    /// A fit with usual noise: while the model is far off, its errors would be taken for noise.
    pub(super) fn rough_fit(&self, start: Point) -> Result<Descent, SimulationError> {
        let mut descent = self.begin(start, NoiseLevels::usual(self.forward.joint.strength))?;
        self.descend(&mut descent, ROUGH_STEPS, ROUGHLY);
        Ok(descent)
    }

    fn begin(&self, point: Point, levels: NoiseLevels) -> Result<Descent, SimulationError> {
        let mut linear = self.linearize(&point, &[])?;
        let noise = self.noise(&mut linear, &point, levels);
        Ok(self.begun(point, linear, noise))
    }

    /// A descent from where another begins, with one more effect; where that is absent, nothing is simulated again.
    fn begin_beside(&self, start: &Descent, setting: Setting) -> Result<Descent, SimulationError> {
        let absent = setting.is_absent();
        let mut point = start.point.clone();
        point.effects.push(setting);
        if !absent {
            return self.begin(point, start.noise.levels);
        }
        let linear = self.with_absent(&start.linear, &point)?;
        Ok(self.begun(point, linear, start.noise.clone()))
    }

    /// A descent at its start.
    fn begun(&self, point: Point, linear: Vec<Linear>, noise: Noise) -> Descent {
        let at = self.account(&linear, &point, &noise);
        let last_correction = vec![None; self.train.len()];
        Descent {
            point,
            linear,
            noise,
            last_step: [[0.0; 2]; COMPONENTS],
            last_correction,
            at,
            noise_is_current: true,
            directions: None,
            directions_are_current: false,
            estimated: false,
            quiet: 0,
            least: None,
        }
    }

    /// Forgets how the last rounds went: the noise goes otherwise with itself in time now.
    pub(super) fn starts_anew(&self, descent: &mut Descent) {
        descent.last_step = [[0.0; 2]; COMPONENTS];
        descent.last_correction = vec![None; self.train.len()];
        (descent.quiet, descent.least) = (0, None);
    }

    /// Passes the EMG's noise through the muscles as they are now.
    fn bring_noise_up_to_date(&self, descent: &mut Descent) {
        if !std::mem::replace(&mut descent.noise_is_current, true) {
            descent.noise = self.noise(&mut descent.linear, &descent.point, descent.noise.levels);
            descent.at = self.account(&descent.linear, &descent.point, &descent.noise);
        }
    }

    /// Directions at the point of a descent.
    pub(super) fn directions_at(&self, descent: &mut Descent) -> Result<Arc<Vec<DMatrix<f64>>>, SimulationError> {
        match &descent.directions {
            Some(known) if descent.directions_are_current => Ok(Arc::clone(known)),
            _ => {
                let found = Arc::new(self.calc_directions(&descent.linear, &descent.point)?.0);
                (descent.directions, descent.directions_are_current) = (Some(Arc::clone(&found)), true);
                Ok(found)
            }
        }
    }

    /// Directions that variances of the noise are estimated beside: where effects are on, those of a point before will do.
    fn directions_about(&self, descent: &mut Descent) -> Result<Arc<Vec<DMatrix<f64>>>, SimulationError> {
        match &descent.directions {
            Some(known) if !descent.point.effects.is_empty() => Ok(Arc::clone(known)),
            _ => self.directions_at(descent),
        }
    }

    /// Takes sensitivities where the EMG is expected without its noise, and goes on.
    ///
    /// - `estimate`: the variances of the noise before
    pub(super) fn settle(&self, descent: &mut Descent, estimate: bool) -> Result<(), SimulationError> {
        self.bring_noise_up_to_date(descent);
        if estimate {
            let directions = self.directions_about(descent)?;
            let Descent { point, linear, noise, last_step, .. } = descent;
            let estimated = self.estimate_noise(linear, &noise.structure, point, &directions, noise.levels);
            noise.levels = noise.levels.towards(&estimated, last_step);
            noise.factors = factors(noise);
            descent.at = self.account(&descent.linear, &descent.point, &descent.noise);
            descent.estimated = true;
        }
        let step = descent.at.information.clone().cholesky().map(|c| c.solve(&descent.at.gradient));
        let step = step.unwrap_or_else(|| descent.at.gradient.clone() * 0.0);
        self.correct(descent, &step)?;
        descent.linear = self.linearize(&descent.point, &[])?;
        (descent.noise_is_current, descent.directions_are_current) = (false, false);
        self.bring_noise_up_to_date(descent);
        self.descend(descent, FINE_STEPS, CONVERGED);
        Ok(())
    }

    /// The fit that a descent has come to, its V brought up to date and its scores as they are; and the inverse of its information.
    fn uncentred(&self, descent: &mut Descent) -> Result<(Fit, DMatrix<f64>), SimulationError> {
        self.bring_noise_up_to_date(descent);
        let directions = self.directions_at(descent)?;
        let Descent { point, linear, noise, at, .. } = &*descent;
        let level_spread = self.level_spread(linear, noise, point, &directions);
        let (p, n) = (at.precision.len(), self.n_nuisance());
        let inverse = at.information.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(p, p));
        let fit = Fit {
            point: point.clone(),
            deviance: descent.deviance(),
            covariance: inverse.view((n, n), (p - n, p - n)).into_owned(),
            levels: noise.levels,
            level_spread,
            noise: noise.structure.clone(),
            factors: noise.factors.clone(),
            whitened: at.whitened.clone(),
            offset: at.offset.clone(),
            precision: at.precision.clone(),
            directions,
            bias: Arc::new(self.no_bias(point)),
        };
        Ok((fit, inverse))
    }

    /// Steps with the noise held.
    ///
    /// The lengths and forces of muscles form a curved valley, whose walls are steep: steps are shortened as a whole
    /// while they promise what does not come.
    fn descend(&self, now: &mut Descent, steps: usize, enough: f64) {
        self.descend_on(now, f64::INFINITY, steps, enough);
    }

    /// As [`Analysis::descend`], after other steps.
    ///
    /// - `radius`: longest step, in standard deviations; returns that of the next
    fn descend_on(&self, now: &mut Descent, mut radius: f64, steps: usize, enough: f64) -> f64 {
        for _ in 0..steps {
            if now.at.gain < enough {
                break;
            }
            let Some(solver) = now.at.information.clone().cholesky() else { break };
            let length = now.at.gain.max(0.0).sqrt();
            let part = if length > radius { radius / length } else { 1.0 };
            let by = solver.solve(&now.at.gradient) * part;
            let point = self.moved(&now.point, &by);
            let promised = now.at.gain * part * (2.0 - part);
            // Where a muscle cannot be simulated the step was too long.
            let next = self.evaluate(point, &now.noise).ok();
            let fall = |at: &Account| now.at.objective - at.objective;
            match next {
                Some((point, linear, at)) if fall(&at) > -0.3 * promised - 0.05 => {
                    radius = if fall(&at) < 0.3 * promised { 0.7 * part * length } else { 1.5 * radius };
                    (now.point, now.linear, now.at) = (point, linear, at);
                    (now.noise_is_current, now.directions_are_current) = (false, false);
                }
                _ => radius = 0.4 * part * length,
            }
        }
        radius
    }

    /// A point simulated, with the noise as it was.
    fn evaluate(&self, mut point: Point, noise: &Noise) -> Result<(Point, Vec<Linear>, Account), SimulationError> {
        let mut linear = self.linearize(&point, &noise.structure)?;
        let mut at = self.account(&linear, &point, noise);
        // Where it turns the joint the moment is not linear in forces.
        if !point.effects.iter().any(|s| s.effect.feeds_back()) {
            at = self.solve_linear(&mut point, &mut linear, noise, at);
        }
        Ok((point, linear, at))
    }

    /// Solves for what the moment is linear in — maximum forces, baselines, moments that effects add — at the present
    /// lengths (variable projection): without a simulation, and the valley that these form with the lengths is followed.
    fn solve_linear(&self, point: &mut Point, linear: &mut [Linear], noise: &Noise, at: Account) -> Account {
        let n = self.n_nuisance();
        let muscles = self.n_muscles();
        let forces = (0..muscles).map(|m| m * FITTED_PER_MUSCLE);
        let baselines = muscles * FITTED_PER_MUSCLE..n;
        let parameters = point.effects.iter().flat_map(|s| {
            let description = s.effect.description();
            description.parameters.iter().map(|p| {
                p.role == Role::Amplitude && description.stage >= Stage::Joint && description.stage < Stage::Sensor
            })
        });
        let amplitudes = parameters.enumerate().filter(|(_, linear)| *linear).map(|(i, _)| n + i);
        let columns: Vec<usize> = forces.chain(baselines).chain(amplitudes).collect();
        let information = at.information.select_rows(&columns).select_columns(&columns);
        let gradient = at.gradient.select_rows(&columns);
        let Some(solver) = information.cholesky() else { return at };
        let solution = solver.solve(&gradient);
        if solution.iter().take(muscles).any(|s| s.abs() > LARGEST_CHANGE) {
            return at;
        }
        let mut step = DVector::zeros(at.gradient.len());
        columns.iter().zip(solution.iter()).for_each(|(c, s)| step[*c] = *s);
        for l in linear.iter_mut() {
            let change = &l.nuisance * step.rows(0, n) + &l.effects * step.rows(n, step.len() - n);
            let of_baselines = l.nuisance.columns(muscles * FITTED_PER_MUSCLE, muscles)
                * step.rows(muscles * FITTED_PER_MUSCLE, muscles);
            l.residual -= &change;
            l.bare -= change - of_baselines;
            for m in 0..muscles {
                let mut own = l.nuisance.columns_mut(m * FITTED_PER_MUSCLE, FITTED_PER_MUSCLE);
                own *= 1.0 + step[m * FITTED_PER_MUSCLE];
            }
        }
        // Steps are of logarithms.
        (0..muscles).for_each(|m| step[m * FITTED_PER_MUSCLE] = (1.0 + step[m * FITTED_PER_MUSCLE]).ln());
        *point = self.moved(point, &step);
        self.account(linear, point, noise)
    }

    /// Expected noise of the EMG once the parameters have taken a step; less of it where it swings from round to round.
    fn correct(&self, descent: &mut Descent, step: &DVector<f64>) -> Result<(), SimulationError> {
        let Descent { point, linear, noise, last_correction, .. } = descent;
        let n = self.n_nuisance();
        let found: Vec<Result<_, SimulationError>> = linear
            .par_iter()
            .with_max_len(ONE_BY_ONE)
            .zip(&*last_correction)
            .enumerate()
            .map(|(position, (l, last))| {
                let left = &l.residual - &l.nuisance * step.rows(0, n) - &l.effects * step.rows(n, step.len() - n);
                let weighted = noise.factors[position].solve(&left);
                let mut correction = noise.structure[position].expected_noise(&noise.levels, &weighted);
                for w in &mut correction {
                    w.iter_mut().for_each(|v| *v = v.clamp(-LARGEST_NOISE, LARGEST_NOISE));
                }
                let before = &point.correction[position];
                let asked =
                    correction.iter().zip(before).flat_map(|(to, from)| (to - from).as_slice().to_vec()).collect();
                let taken = Relaxation::next(last.as_ref(), asked);
                for (to, from) in correction.iter_mut().zip(before) {
                    to.zip_apply(from, |to, from| *to = from + taken.share() * (*to - from));
                }
                let g = self.train[position];
                let record = &self.forward.trials[g];
                let excitation = corrected(&record.time, &record.excitation, &correction);
                Ok((correction, Arc::new(self.forward.input(g, excitation)?), taken))
            })
            .collect();
        for (position, found) in found.into_iter().enumerate() {
            let (correction, input, taken) = found?;
            (point.correction[position], point.inputs[position]) = (correction, input);
            last_correction[position] = Some(taken);
        }
        Ok(())
    }

    /// Structure of the noise at a point, with these variances; the linearization is made to match.
    fn noise(&self, linear: &mut [Linear], point: &Point, levels: NoiseLevels) -> Noise {
        let structure = self.noise_structure(linear, point);
        linear
            .par_iter_mut()
            .zip(&structure)
            .enumerate()
            .for_each(|(position, (l, noise))| self.attach(l, position, point, noise));
        let mut noise = Noise { structure, levels, factors: Vec::new() };
        noise.factors = factors(&noise);
        noise
    }
}

/// Those first that lead by misfit or by deviance: the one favours what lets more of the EMG's noise pass while the noise is only
/// guessed, the other what lets less of it pass.
fn leading_first<T>(fitted: Vec<T>, descent: impl Fn(&T) -> &Descent) -> Vec<T> {
    let ranks = |of: &dyn Fn(&Descent) -> f64| {
        let values: Vec<f64> = fitted.iter().map(|f| of(descent(f))).collect();
        values.iter().map(|v| values.iter().filter(|other| other.total_cmp(v).is_lt()).count()).collect::<Vec<_>>()
    };
    let (by_misfit, by_deviance) = (ranks(&Descent::misfit), ranks(&Descent::deviance));
    let rank = |i: usize| (by_misfit[i].min(by_deviance[i]), by_misfit[i]);
    let mut ordered: Vec<(_, T)> = fitted.into_iter().enumerate().map(|(i, f)| (rank(i), f)).collect();
    ordered.sort_by_key(|(rank, _)| *rank);
    ordered.into_iter().map(|(_, f)| f).collect()
}

/// Those of least deviance first.
fn most_probable(mut fitted: Vec<Descent>) -> Vec<Descent> {
    fitted.sort_by(|a, b| a.deviance().total_cmp(&b.deviance()));
    fitted
}

/// V is a sum of a positive diagonal and positive semidefinite matrices: factors exist.
fn factors(noise: &Noise) -> Vec<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
    noise.structure.par_iter().filter_map(|n| noise::factor(n, &noise.levels)).collect()
}
