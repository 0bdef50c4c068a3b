//! Noise along the way: what EMG and moment say of it, how it passes through the muscles, variances and autocorrelation
//! (`docs/src/theory/many-small-errors.md`, equations (8) to (12)).

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::super::linear_model::Sizes;
use super::state::{Session, State};
use crate::fit::linearization::Linear;
use crate::fit::{Point, corrected, trial_times};
use crate::kernel::{FAMILIES, Kernel};
use crate::noise::{self, NoiseLevels, TrialNoise};
use carpus_simulation::simulation::SimulationError;

/// Largest expected error of the logarithm of the EMG.
pub(super) const LARGEST_NOISE: f64 = 0.7;
/// Autocorrelations are compared on so many trials at most, evenly spread over the session.
const TRIALS_FOR_KERNELS: usize = 12;

impl Session<'_> {
    pub(super) fn levels(
        &self,
        noise: &[TrialNoise],
        regressors: &[(DMatrix<f64>, DVector<f64>)],
        start: NoiseLevels,
    ) -> NoiseLevels {
        let trials: Vec<_> = noise.iter().zip(regressors).map(|(n, (x, r))| (n, x, r)).collect();
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        noise::estimate(&trials, &DVector::from_element(count, 1.0), self.analysis.least_white(), start)
    }

    /// Error of the logarithm of every trial's EMG that is expected of recorded EMG and moment together, per
    /// muscle on knots, equation (10).
    ///
    /// - `noise`: at the point; `weighted`: what the linear model leaves of the residual, the noise's factors applied
    pub(super) fn expected_emg(
        &self,
        noise: &[TrialNoise],
        weighted: &[DVector<f64>],
        levels: &NoiseLevels,
    ) -> Vec<Vec<DVector<f64>>> {
        let clamped = |w: DVector<f64>| w.map(|w| w.clamp(-LARGEST_NOISE, LARGEST_NOISE));
        let of = |(noise, weighted): (&TrialNoise, &DVector<f64>)| {
            noise.expected_noise(levels, weighted).into_iter().map(clamped).collect()
        };
        noise.par_iter().zip(weighted).map(of).collect()
    }

    /// The point with other errors of its EMG.
    pub(super) fn with_emg(&self, point: &Point, correction: Vec<Vec<DVector<f64>>>) -> Result<Point, SimulationError> {
        let of = |(g, correction): (&usize, &Vec<DVector<f64>>)| {
            let record = &self.forward().trials[*g];
            let excitation = corrected(&record.time, &record.excitation, correction);
            Ok(Arc::new(self.forward().input(*g, excitation)?))
        };
        let inputs: Vec<Result<_, SimulationError>> = self.analysis.train.par_iter().zip(&correction).map(of).collect();
        let inputs = inputs.into_iter().collect::<Result<_, _>>()?;
        Ok(Point { correction, inputs, ..point.clone() })
    }

    /// How noise enters every trial, equation (12); the linearization is made to match.
    pub(super) fn structure(&self, linear: &mut [Linear], point: &Point) -> Vec<TrialNoise> {
        let noise = self.analysis.noise_structure(linear, point);
        self.attach(linear, point, &noise);
        noise
    }

    /// Residuals of the recorded EMG, equation (13), and baselines' columns.
    pub(super) fn attach(&self, linear: &mut [Linear], point: &Point, noise: &[TrialNoise]) {
        linear.par_iter_mut().enumerate().for_each(|(i, l)| self.analysis.attach(l, i, point, &noise[i]));
    }

    /// Linearized at a point, noise passing as it does.
    ///
    /// - `near`: derivatives by parameters of effects that are near enough
    pub(super) fn linearized(
        &self,
        point: &Point,
        noise: &[TrialNoise],
        near: Option<&[Linear]>,
    ) -> Result<Vec<Linear>, SimulationError> {
        let mut linear = match near {
            Some(near) => self.analysis.linearize_beside(point, near)?,
            None => self.analysis.linearize(point, &[])?,
        };
        self.attach(&mut linear, point, noise);
        Ok(linear)
    }

    /// Chooses how noise is autocorrelated by restricted likelihood: of the EMG's, then of the moment's.
    ///
    /// - `set`, `sizes`: of effects and of everything else meanwhile
    pub(super) fn choose_kernels(&mut self, state: &mut State, set: &[usize], sizes: &Sizes) {
        let columns = self.all_columns(&state.point, &state.linear, &state.directions);
        let regressors = Self::regressors(&state.model, &columns, &state.model.sds(set, sizes));
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        let precision = DVector::from_element(count, 1.0);
        let least = self.analysis.least_white();
        for of_emg in [true, false] {
            let known = if of_emg { self.analysis.kernels.emg } else { self.analysis.kernels.moment };
            let noise = &state.noise;
            let levels = state.levels;
            let with = |kernel: &Kernel, every: usize| -> Vec<TrialNoise> {
                let of = |(n, g): (&TrialNoise, &usize)| match of_emg {
                    true => n.clone().with_emg_kernel(kernel),
                    false => n.clone().with_times(trial_times(&self.forward().trials[*g], kernel)),
                };
                noise.par_iter().zip(&self.analysis.train).step_by(every).map(of).collect()
            };
            let every = noise.len().div_ceil(TRIALS_FOR_KERNELS).max(1);
            let best = noise::best_kernel(&known, &FAMILIES, |kernel| {
                let noise = with(kernel, every);
                let regressors = regressors.iter().step_by(every);
                let trials: Vec<_> = noise.iter().zip(regressors).map(|(n, (x, r))| (n, x, r)).collect();
                let levels = noise::estimate_within(2, &trials, &precision, least, levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            let found = with(&best, 1);
            state.levels = self.levels(&found, &regressors, state.levels);
            state.noise = found;
            if of_emg { self.analysis.kernels.emg = best } else { self.analysis.kernels.moment = best }
        }
        let time = |g: &usize| trial_times(&self.forward().trials[*g], &self.analysis.kernels.moment);
        self.analysis.times = self.analysis.train.iter().map(time).collect();
    }
}

/// V⁻¹ times what a step of all columns leaves of the residual, per trial.
pub(super) fn weighted(
    columns: &[DMatrix<f64>],
    step: &DVector<f64>,
    factors: &[Cholesky<f64, Dyn>],
) -> Vec<DVector<f64>> {
    let p = step.len();
    let of =
        |(all, factor): (&DMatrix<f64>, &Cholesky<f64, Dyn>)| factor.solve(&(all.column(p) - all.columns(0, p) * step));
    columns.par_iter().zip(factors).map(of).collect()
}

/// Factors of V of all trials.
///
/// # Errors
/// A covariance that is not positive definite.
pub(super) fn factors(noise: &[TrialNoise], levels: &NoiseLevels) -> Result<Vec<Cholesky<f64, Dyn>>, SimulationError> {
    noise
        .par_iter()
        .map(|n| noise::factor(n, levels).ok_or(SimulationError::NoiseCovariance))
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}
