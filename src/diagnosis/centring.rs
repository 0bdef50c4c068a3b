//! What scores are on average when nothing is missing: signatures are computed from an excitation that was estimated from
//! the very residual that they are compared with, and a muscle's moment bends with its excitation. Both make scores of time
//! constants, cross-talk and curvature of the EMG differ from 0 on average, a little in every trial and always to the same
//! side.
//!
//! ```text
//! e* = ê exp(∓w),   y* = τ(ê) ± ε,   ŵ* ← K G*ᵀ V*⁻¹ (y* − τ(e* exp ŵ*) + G* ŵ*),   bias = mean of X*ᵀ V*⁻¹ r*
//! ```
//! (a parametric bootstrap through EMG and moment). Draws come in pairs of opposite sign: all that is linear in them
//! cancels, so that few pairs do.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::fit::{Analysis, Linear, Noise, Point, between_knots, block_means, block_starts, corrected, whiten};
use super::noise::{self, TrialNoise};
use super::score_test::normal;
use crate::simulation::SimulationError;

/// Rounds in which the EMG's noise is estimated.
const ROUNDS: usize = 2;

impl Analysis<'_> {
    /// Mean score of nuisance, effects that are on and directions, per training trial.
    ///
    /// - `pairs`: of draws
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn calc_bias(
        &self,
        point: &Point,
        noise: &Noise,
        pairs: usize,
    ) -> Result<Vec<DVector<f64>>, SimulationError> {
        if pairs == 0 {
            return Ok(vec![DVector::zeros(self.n_scores(point)); self.train.len()]);
        }
        let truth = self.simulated(&Point { baseline: vec![0.0; self.n_muscles()], ..point.clone() })?;
        let mut bias = Vec::new();
        for pair in 0..pairs {
            for sign in [1.0, -1.0] {
                let scores = self.scores_of_draw(point, noise, &truth, pair, sign)?;
                if bias.is_empty() {
                    bias = scores.iter().map(|s| DVector::zeros(s.len())).collect();
                }
                bias.iter_mut().zip(&scores).for_each(|(b, s): (&mut DVector<f64>, _)| *b += s / (2 * pairs) as f64);
            }
        }
        Ok(bias)
    }

    /// Nuisance, effects' parameters and directions.
    fn n_scores(&self, point: &Point) -> usize {
        let effects: usize = point.effects.iter().map(|s| s.values.len()).sum();
        self.n_nuisance() + effects + self.blocks.iter().map(|b| b.columns.len()).sum::<usize>()
    }

    /// Moments at a point, averaged over blocks.
    fn simulated(&self, point: &Point) -> Result<Vec<DVector<f64>>, SimulationError> {
        Ok(self.linearize(point, &[])?.iter().enumerate().map(|(i, l)| self.measured(i) - &l.bare).collect())
    }

    fn measured(&self, position: usize) -> DVector<f64> {
        let record = &self.forward.trials[self.train[position]];
        block_means(&record.moment, &block_starts(record.time.len()))
    }

    /// Scores of a recording that is drawn.
    fn scores_of_draw(
        &self,
        point: &Point,
        noise: &Noise,
        truth: &[DVector<f64>],
        pair: usize,
        sign: f64,
    ) -> Result<Vec<DVector<f64>>, SimulationError> {
        let mut moments = Vec::new();
        let mut recorded = Vec::new();
        for (position, structure) in noise.structure.iter().enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ ((position as u64) << 20) ^ ((pair as u64) << 40));
            let drawn = structure.draw(&noise.levels, || normal(&mut rng));
            let [w, added] = [0, 1].map(|part| drawn.iter().map(|d| &d[part] * sign).collect::<Vec<_>>());
            moments.push(&truth[position] + structure.draw_moment(&noise.levels, || normal(&mut rng)) * sign);
            let time = &self.forward.trials[self.train[position]].time;
            recorded.push(raised(time, &corrected(time, &point.inputs[position].excitation, &w), &added));
        }
        let mut at = Point { baseline: vec![0.0; self.n_muscles()], correction: self.no_correction(), ..point.clone() };
        self.set_inputs(&mut at, &recorded)?;
        let (mut linear, mut structure) = self.against(&at, &moments)?;
        for _ in 0..ROUNDS {
            at.correction = structure
                .par_iter()
                .zip(&linear)
                .map(|(s, l)| {
                    let weighted = noise::factor(s, &noise.levels).map(|f| f.solve(&l.residual));
                    weighted.map_or_else(Vec::new, |weighted| s.expected_noise(&noise.levels, &weighted))
                })
                .collect();
            self.set_inputs(&mut at, &recorded)?;
            (linear, structure) = self.against(&at, &moments)?;
        }
        let directions = self.calc_directions(&linear, &at)?.0;
        let scores = linear.par_iter().zip(&directions).zip(&structure).map(|((l, d), s)| {
            let (own, on, extra) = (l.nuisance.ncols(), l.effects.ncols(), d.ncols());
            let n = own + on;
            let mut all = DMatrix::zeros(l.residual.len(), n + extra + 1);
            all.columns_mut(0, own).copy_from(&l.nuisance);
            all.columns_mut(own, on).copy_from(&l.effects);
            all.columns_mut(n, extra).copy_from(d);
            all.set_column(n + extra, &l.residual);
            let Some(factor) = noise::factor(s, &noise.levels) else { return DVector::zeros(n + extra) };
            let all = whiten(&factor, &all);
            all.columns(0, n + extra).tr_mul(&all.column(n + extra))
        });
        Ok(scores.collect())
    }

    /// The excitation of a point: as recorded, times what is expected of its noise.
    fn set_inputs(&self, point: &mut Point, recorded: &[Vec<Vec<f64>>]) -> Result<(), SimulationError> {
        let inputs: Vec<Result<_, SimulationError>> = self
            .train
            .par_iter()
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

    /// Linearization at a point against other moments than the measured.
    fn against(
        &self,
        point: &Point,
        moments: &[DVector<f64>],
    ) -> Result<(Vec<Linear>, Vec<TrialNoise>), SimulationError> {
        let mut linear = self.linearize(point, &[])?;
        let structure = self.noise_structure(&linear, point);
        for (position, l) in linear.iter_mut().enumerate() {
            l.bare += &moments[position] - self.measured(position);
            self.attach(l, position, point, &structure[position]);
        }
        Ok((linear, structure))
    }
}

/// An excitation and what is added to it on knots; no recording is negative.
fn raised(time: &[f64], excitation: &[Vec<f64>], added: &[DVector<f64>]) -> Vec<Vec<f64>> {
    let of_muscle = |(e, added): (&Vec<f64>, &DVector<f64>)| {
        e.iter().zip(time).map(|(e, t)| (e + between_knots(added, t - time[0])).clamp(0.0, 1.0)).collect()
    };
    excitation.iter().zip(added).map(of_muscle).collect()
}
