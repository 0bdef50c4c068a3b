//! The mean of the residual under EMG noise: a muscle's moment bends with its excitation, so that noise with mean zero
//! leaves a moment whose mean is not. It is small in every sample but the same everywhere, and would be taken for time
//! constants, cross-talk or curvature of the EMG.
//!
//! ```text
//! e* = ê exp(∓w),   y* = τ(ê),   ŵ* = K Gᵀ V⁻¹ (y* − τ(e*)),   m = mean of y* − τ(e* exp ŵ*) + G* ŵ*
//! ```
//! (a parametric bootstrap through the EMG input). Draws come in pairs of opposite sign: all that is linear in them
//! cancels, so that few pairs do.

use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::fit::{Analysis, Noise, Point, block_means, block_starts, corrected};
use super::score_test::normal;
use crate::simulation::SimulationError;

/// Pairs of draws.
const PAIRS: usize = 2;

impl Analysis<'_> {
    /// Mean of the residual that noise of the EMG causes, per training trial, averaged over blocks [N·m].
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn calc_mean_noise(&self, point: &Point, noise: &Noise) -> Result<Vec<DVector<f64>>, SimulationError> {
        let variant = self.forward.variant(&point.effects)?;
        (0..self.train.len())
            .into_par_iter()
            .map(|position| {
                let g = self.train[position];
                let record = &self.forward.trials[g];
                let starts = block_starts(record.time.len());
                let structure = &noise.structure[position];
                let simulate = |excitation: Vec<Vec<f64>>| {
                    let input = self.forward.input(g, excitation)?;
                    let core = self.forward.core(&variant, g, &input, &point.parameters, &point.effects, true)?;
                    let moment = self.forward.recorded_moment(g, &core, &point.effects);
                    Ok::<_, SimulationError>((block_means(&moment, &starts), core))
                };
                let smooth = &point.inputs[position].excitation;
                let truth = simulate(smooth.clone())?.0;
                let mut mean = DVector::zeros(truth.len());
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ ((position as u64) << 20));
                for _ in 0..PAIRS {
                    let w = structure.draw(&noise.levels, || normal(&mut rng));
                    for sign in [1.0, -1.0] {
                        let wrong: Vec<DVector<f64>> = w.iter().map(|w| w * sign).collect();
                        let recorded = corrected(&record.time, smooth, &wrong);
                        let first = &truth - simulate(recorded.clone())?.0;
                        let expected = structure.expected_noise(&noise.levels, &noise.factors[position].solve(&first));
                        let (simulated, core) = simulate(corrected(&record.time, &recorded, &expected))?;
                        let there = self.trial_noise(position, &core, &point.parameters);
                        mean += (&truth - simulated + there.respond(&expected)) / (2 * PAIRS) as f64;
                    }
                }
                Ok(mean)
            })
            .collect::<Vec<_>>()
            .into_iter()
            .collect()
    }
}
