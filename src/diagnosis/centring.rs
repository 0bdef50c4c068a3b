//! What scores are on average when nothing is missing: signatures are computed from an excitation that was estimated from
//! the very residual that they are compared with, and a muscle's moment bends with its excitation. Both make scores of time
//! constants, cross-talk and curvature of the EMG differ from 0 on average, a little in every trial and always to the same
//! side.
//!
//! ```text
//! e* = ê exp(∓w),   y* = τ(ê) ± ε,   ŵ* ← K G*ᵀ V*⁻¹ (y* − τ(e* exp ŵ*) + G* ŵ*),   bias = mean of X*ᵀ V*⁻¹ r*
//! ```
//! (a parametric bootstrap through EMG and moment). Draws come in pairs of opposite sign: all that is linear in them
//! cancels. They are roots of covariances times signs, not normal numbers: the mean of what is quadratic in them is the same, and
//! what is quadratic in one of them, as in a trial's gain, is the same in every draw. Few pairs do, if one that goes astray — an EMG
//! near 0 in a muscle that is bent strongly there may, in one draw of many — is not let count for more than a mean can be: a trial's
//! mean scores are 0.1 to 0.3 of their standard deviations, at times 0.8.
//!
//! # References
//! Hutchinson (1990), A stochastic estimator of the trace of the influence matrix, doi:10.1080/03610919008812866.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::ONE_BY_ONE;
use super::descent::{BEYOND_DOUBT, Hopeless};
use super::effect::Role;
use super::fit::{
    Analysis, Fit, LARGEST_MEAN, Linear, Point, between_knots, block_means, block_starts, corrected, whiten,
};
use super::noise::{self, TrialNoise};
use crate::simulation::SimulationError;

/// Pairs of draws for the mean of scores.
const PAIRS: usize = 2;
/// Of these, the ones that come first: a fit that others are nearer than, and that leaves what is beyond doubt with this mean, is given up.
const FEW_PAIRS: usize = 1;
/// Pairs of draws where it matters: for a fit that no other is much nearer than, and that would be rejected with fewer.
/// Where the fit without effects is near, its [`MOST_PAIRS`] take the place of the further ones.
const MANY_PAIRS: usize = 8;
/// The same beside two effects, which take longer.
const MANY_PAIRS_OF_TWO: usize = 4;
/// A fit is looked at more closely while its misfit is no larger than this above the least.
const NEAR: f64 = 20.0;
/// … and if it leaves something of a smaller p-value, times the number of directions.
const MAY_BE_CHANCE: f64 = 0.1;
/// … unless it leaves, by that measure, something of a p-value that further draws do not lift above the line: of 25 fits below it after
/// two pairs all were within a factor of 3 of that after eight, and of those that eight let survive the least had 1e-3 after two. They are
/// fits of six studies, four of which are of the final table.
const NO_CHANCE: f64 = 1e-4;
/// Pairs of draws for the mean of scores where nothing is known to be missing yet: there it decides on false alarms.
pub(super) const MOST_PAIRS: usize = 4;
/// Largest mean of a trial's score beside an effect [standard deviations]: of twenty trials of one sign more would be beyond [`LARGEST_MEAN`].
const LARGEST_MEAN_OF_TRIAL: f64 = 1.0;

/// Scores of a trial and their standard deviations.
struct Scores {
    values: DVector<f64>,
    deviations: DVector<f64>,
}

/// A fit, the inverse of its information, and mean scores of the first [`FEW_PAIRS`].
pub(super) struct Drawn {
    fit: Fit,
    inverse: DMatrix<f64>,
    truth: Vec<DVector<f64>>,
    few: Vec<DVector<f64>>,
}

impl Analysis<'_> {
    /// Draws the first few.
    ///
    /// - `inverse`: of its information
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn drawn(&self, fit: Fit, inverse: DMatrix<f64>) -> Result<Drawn, SimulationError> {
        let truth = self.truth_of(&fit)?;
        let few = self.calc_bias(&fit, &truth, 0..FEW_PAIRS, &|_| true)?;
        Ok(Drawn { fit, inverse, truth, few })
    }

    /// Directions that a fit, with these mean scores, leaves, and their p-values times the number of directions.
    fn left_with(&self, drawn: &Drawn, means: &[DVector<f64>], skip: &[&str]) -> Vec<(String, f64)> {
        let centred = self.centre(drawn.fit.clone(), &drawn.inverse, means.to_vec());
        let left = self.blocks_left(&centred, skip).unwrap_or_default();
        let count = left.len() as f64;
        left.into_iter().map(|b| (b.name, b.p_value * count)).collect()
    }

    /// Whether a fit, with these mean scores, leaves something of a p-value, times the number of directions, below this.
    fn leaves_less_with(&self, p_value: f64, drawn: &Drawn, means: &[DVector<f64>], skip: &[&str]) -> bool {
        self.left_with(drawn, means, skip).iter().any(|(_, p)| *p < p_value)
    }

    /// Whether a fit's misfit is at most [`NEAR`] above the least.
    fn is_near(&self, fit: &Fit, hopeless: &Hopeless) -> bool {
        self.misfit(fit, &hopeless.levels) < hopeless.best + NEAR
    }

    /// Whether a fit's first few draws, or further ones where those may be drawn, leave it a chance.
    pub(super) fn has_a_chance(&self, drawn: &Drawn, hopeless: &Hopeless) -> bool {
        let line = if self.is_near(&drawn.fit, hopeless) { NO_CHANCE } else { BEYOND_DOUBT };
        !self.leaves_less_with(line, drawn, &drawn.few, hopeless.skip)
    }

    /// A fit with the mean of its scores drawn; a hopeless one with that of a few draws.
    ///
    /// - `near`: a fit without effects whose scores have nearly the same mean: where more draws are wanted, its own do
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn centre_by_draws(
        &self,
        drawn: Drawn,
        near: Option<&Fit>,
        hopeless: Option<Hopeless>,
    ) -> Result<Fit, SimulationError> {
        let is_near = hopeless.is_some_and(|h| self.is_near(&drawn.fit, &h));
        let skip = hopeless.map_or(&[][..], |h| h.skip);
        if hopeless.is_some() && !is_near && self.leaves_less_with(BEYOND_DOUBT, &drawn, &drawn.few, skip) {
            let Drawn { fit, inverse, few, .. } = drawn;
            return Ok(self.centre(fit, &inverse, few));
        }
        let further = self.calc_bias(&drawn.fit, &drawn.truth, FEW_PAIRS..PAIRS, &|_| true)?;
        let mut means = pooled(&drawn.few, FEW_PAIRS, &further, PAIRS - FEW_PAIRS);
        let left = self.left_with(&drawn, &means, skip);
        let least = left.iter().map(|(_, p)| *p).fold(f64::INFINITY, f64::min);
        if is_near && (NO_CHANCE..MAY_BE_CHANCE).contains(&least) {
            means = match near {
                Some(near) => pooled(&means, PAIRS, &self.means_with_effects(near, &drawn.fit.point), MOST_PAIRS),
                None => {
                    // Directions of which little is left need not be known better.
                    let in_question = |name: &str| left.iter().any(|(known, p)| known == name && *p < MAY_BE_CHANCE);
                    let many = if drawn.fit.point.effects.len() > 1 { MANY_PAIRS_OF_TWO } else { MANY_PAIRS };
                    let further = self.calc_bias(&drawn.fit, &drawn.truth, PAIRS..many, &in_question)?;
                    let mut all = pooled(&means, PAIRS, &further, many - PAIRS);
                    self.keep_others(&mut all, &means, &drawn.fit.point, in_question);
                    all
                }
            };
        }
        Ok(self.centre(drawn.fit, &drawn.inverse, means))
    }

    /// A fit with the mean of its scores, and its parameters where the gradient is that mean instead of 0.
    ///
    /// - `inverse`: of its information; `bias`: per training trial the mean score
    pub(super) fn centre(&self, mut fit: Fit, inverse: &DMatrix<f64>, bias: Vec<DVector<f64>>) -> Fit {
        let p = fit.precision.len();
        let mean = bias.iter().fold(DVector::zeros(p), |sum, b| sum + b.rows(0, p));
        let step = inverse * -&mean;
        let share = (LARGEST_MEAN / (-step.dot(&mean)).max(1e-300).sqrt()).min(1.0);
        fit.point = self.moved(&fit.point, &(step * share));
        fit.bias = Arc::new(bias);
        fit
    }

    /// Puts back the mean scores of effects' directions that are not wanted.
    fn keep_others(
        &self,
        means: &mut [DVector<f64>],
        before: &[DVector<f64>],
        point: &Point,
        wanted: impl Fn(&str) -> bool,
    ) {
        let first = self.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>();
        let is_effect = |name: &str| self.candidates.iter().any(|e| e.description().id == name);
        let others = self.blocks.iter().filter(|b| is_effect(&b.name) && !wanted(&b.name));
        for column in others.flat_map(|b| &b.columns).map(|c| first + c) {
            means.iter_mut().zip(before).for_each(|(mean, before)| mean[column] = before[column]);
        }
    }

    /// Mean score of nuisance, effects that are on and directions, per training trial.
    ///
    /// - `truth`: see [`Analysis::truth_of`]; `pairs`: which pairs of draws; `wanted`: names of effects of which the direction is asked
    ///   for, 0 for others
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn calc_bias(
        &self,
        fit: &Fit,
        truth: &[DVector<f64>],
        pairs: Range<usize>,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Result<Vec<DVector<f64>>, SimulationError> {
        let count = pairs.len() as f64;
        let sides: Vec<(usize, f64)> = pairs.flat_map(|pair| [(pair, 1.0), (pair, -1.0)]).collect();
        let scores: Vec<_> =
            sides.into_par_iter().map(|(pair, side)| self.scores_of_draw(fit, truth, pair, side, wanted)).collect();
        let scores = scores.into_iter().collect::<Result<Vec<_>, _>>()?;
        // The line for alarms was set with the means of fits without effects as they are.
        let largest = if fit.point.effects.is_empty() { f64::MAX } else { LARGEST_MEAN_OF_TRIAL };
        let mut bias = self.no_bias(&fit.point);
        for pair in scores.chunks_exact(2) {
            for ((bias, a), b) in bias.iter_mut().zip(&pair[0]).zip(&pair[1]) {
                *bias += mean_of_pair(a, b, largest) / count;
            }
        }
        Ok(bias)
    }

    /// What a fit takes for the truth where recordings are drawn: moments without baselines, averaged over blocks.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn truth_of(&self, fit: &Fit) -> Result<Vec<DVector<f64>>, SimulationError> {
        let point = Point { baseline: vec![0.0; self.n_muscles()], ..fit.point.clone() };
        Ok(self.linearize_muscles(&point)?.iter().enumerate().map(|(i, l)| self.measured(i) - &l.bare).collect())
    }

    /// Scores at a point whose means are 0, or not computed.
    pub(super) fn no_bias(&self, point: &Point) -> Vec<DVector<f64>> {
        vec![DVector::zeros(self.n_scores(point)); self.train.len()]
    }

    /// The mean scores of a fit without effects, in the order of a point with effects: what is the mean of an effect's direction
    /// there is that of its amplitude here.
    pub(super) fn means_with_effects(&self, without: &Fit, point: &Point) -> Vec<DVector<f64>> {
        let n = self.n_nuisance();
        let of_trial = |bias: &DVector<f64>| {
            let mut directions = bias.rows_range(n..).into_owned();
            let mut own = Vec::new();
            for setting in &point.effects {
                let description = setting.effect.description();
                let mut columns =
                    self.blocks.iter().filter(|b| b.name == description.id).flat_map(|b| b.columns.iter());
                for p in description.parameters {
                    let column = if p.role == Role::Amplitude { columns.next() } else { None };
                    own.push(column.map_or(0.0, |c| std::mem::take(&mut directions[*c])));
                }
            }
            let all = bias.rows(0, n).iter().chain(&own).chain(directions.iter()).copied().collect();
            DVector::from_vec(all)
        };
        without.bias.iter().map(of_trial).collect()
    }

    /// Nuisance, effects' parameters and directions.
    fn n_scores(&self, point: &Point) -> usize {
        let effects: usize = point.effects.iter().map(|s| s.values.len()).sum();
        self.n_nuisance() + effects + self.blocks.iter().map(|b| b.columns.len()).sum::<usize>()
    }

    fn measured(&self, position: usize) -> DVector<f64> {
        let target = self.target(position);
        block_means(target, &block_starts(&self.forward.trials[self.train[position]].time))
    }

    /// Scores of a recording that is drawn.
    fn scores_of_draw(
        &self,
        fit: &Fit,
        truth: &[DVector<f64>],
        pair: usize,
        side: f64,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Result<Vec<Scores>, SimulationError> {
        let Fit { point, noise, factors, levels, .. } = fit;
        let draw = |(position, structure): (usize, &TrialNoise)| {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ ((position as u64) << 20) ^ ((pair as u64) << 40));
            let drawn = structure.draw(levels, || side * sign(&mut rng));
            let of_moment = structure.draw_moment(levels, || side * sign(&mut rng));
            // To first order; then without a simulation.
            let shown = &of_moment - structure.respond(&structure.relative(&drawn));
            let correction = structure.expected_noise(levels, &factors[position].solve(&shown));
            let recorded = self.disturbed(position, &point.inputs[position].excitation, &drawn);
            (&truth[position] + of_moment, (recorded, correction))
        };
        let (moments, (recorded, correction)): (Vec<_>, (Vec<_>, Vec<_>)) =
            noise.par_iter().with_max_len(ONE_BY_ONE).enumerate().map(draw).unzip();
        let mut at = Point { baseline: vec![0.0; self.n_muscles()], correction, ..point.clone() };
        self.set_inputs(&mut at, &recorded)?;
        // Effects' columns are not needed yet.
        let (linear, structure) = self.against(self.linearize_muscles(&at)?, &at, &moments);
        at.correction = structure
            .par_iter()
            .zip(&linear)
            .map(|(s, l)| {
                let weighted = noise::factor(s, levels).map(|f| f.solve(&l.residual));
                weighted.map_or_else(Vec::new, |weighted| s.expected_noise(levels, &weighted))
            })
            .collect();
        self.set_inputs(&mut at, &recorded)?;
        let (linear, structure) = self.against(self.linearize(&at, &[])?, &at, &moments);
        let directions = self.calc_directions_of(&linear, &at, wanted)?.0;
        let scores = linear.par_iter().with_max_len(ONE_BY_ONE).zip(&directions).zip(&structure).map(|((l, d), s)| {
            let (own, on, extra) = (l.nuisance.ncols(), l.effects.ncols(), d.ncols());
            let n = own + on;
            let mut all = DMatrix::zeros(l.residual.len(), n + extra + 1);
            all.columns_mut(0, own).copy_from(&l.nuisance);
            all.columns_mut(own, on).copy_from(&l.effects);
            all.columns_mut(n, extra).copy_from(d);
            all.set_column(n + extra, &l.residual);
            let Some(factor) = noise::factor(s, levels) else {
                return Scores { values: DVector::zeros(n + extra), deviations: DVector::zeros(n + extra) };
            };
            let all = whiten(&factor, &all);
            let columns = all.columns(0, n + extra);
            let deviations = DVector::from_iterator(n + extra, columns.column_iter().map(|c| c.norm()));
            Scores { values: columns.tr_mul(&all.column(n + extra)), deviations }
        });
        Ok(scores.collect())
    }

    /// An excitation with noise; no recording is negative.
    fn disturbed(&self, position: usize, excitation: &[Vec<f64>], drawn: &[[DVector<f64>; 2]]) -> Vec<Vec<f64>> {
        let time = &self.forward.trials[self.train[position]].time;
        let of_muscle = |(e, [w, added]): (&Vec<f64>, &[DVector<f64>; 2])| {
            let at = |(e, t): (&f64, &f64)| {
                let t = t - time[0];
                (e * between_knots(w, t).exp() + between_knots(added, t)).clamp(0.0, 1.0)
            };
            e.iter().zip(time).map(at).collect()
        };
        excitation.iter().zip(drawn).map(of_muscle).collect()
    }

    /// The excitation of a point: as recorded, times what is expected of its noise.
    fn set_inputs(&self, point: &mut Point, recorded: &[Vec<Vec<f64>>]) -> Result<(), SimulationError> {
        let inputs: Vec<Result<_, SimulationError>> = self
            .train
            .par_iter()
            .with_max_len(ONE_BY_ONE)
            .zip(recorded)
            .zip(&point.correction)
            .map(|((g, e), w)| {
                let time = &self.forward.trials[*g].time;
                Ok(Arc::new(self.forward.input(*g, corrected(time, e, w))?))
            })
            .collect();
        point.inputs = inputs.into_iter().collect::<Result<_, _>>()?;
        Ok(())
    }

    /// A linearization at a point against other moments than the measured, and how noise enters there.
    fn against(
        &self,
        mut linear: Vec<Linear>,
        point: &Point,
        moments: &[DVector<f64>],
    ) -> (Vec<Linear>, Vec<TrialNoise>) {
        let structure = self.noise_structure(&linear, point);
        linear.par_iter_mut().zip(moments).zip(&structure).enumerate().for_each(|(position, ((l, moment), noise))| {
            l.bare += moment - self.measured(position);
            self.attach(l, position, point, noise);
        });
        (linear, structure)
    }
}

/// Mean scores of draws and of further ones.
///
/// - `means`: of so many pairs; `further`: of so many more
fn pooled(means: &[DVector<f64>], pairs: usize, further: &[DVector<f64>], more: usize) -> Vec<DVector<f64>> {
    let share = pairs as f64 / (pairs + more) as f64;
    means.iter().zip(further).map(|(a, b)| a * share + b * (1.0 - share)).collect()
}

/// Mean scores of a trial by two draws of opposite sign.
///
/// - `largest`: standard deviations that none may exceed
fn mean_of_pair(a: &Scores, b: &Scores, largest: f64) -> DVector<f64> {
    let most = (&a.deviations + &b.deviations) * (0.5 * largest);
    let mean = (&a.values + &b.values) * 0.5;
    mean.zip_map(&most, |mean, most| mean.max(-most).min(most))
}

/// 1 or −1.
fn sign(rng: &mut ChaCha8Rng) -> f64 {
    if rng.random() { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_draw_that_goes_astray_counts_for_no_more_than_a_mean_can_be() {
        let scores = |values: &[f64]| Scores {
            values: DVector::from_column_slice(values),
            deviations: DVector::from_vec(vec![2.0, 2.0, 2.0, 0.0]),
        };
        let (a, b) = (scores(&[3.0, 30.0, -30.0, 0.0]), scores(&[-2.0, -10.0, 10.0, 0.0]));
        assert_eq!(mean_of_pair(&a, &b, 1.0).as_slice(), [0.5, 2.0, -2.0, 0.0]);
        assert_eq!(mean_of_pair(&a, &b, f64::MAX).as_slice(), [0.5, 10.0, -10.0, 0.0]);
    }
}
