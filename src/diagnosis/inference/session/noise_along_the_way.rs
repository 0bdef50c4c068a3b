//! Noise along the way: what is expected of the EMG, how it passes through the muscles, variances and autocorrelation
//! (`docs/src/theory/many-small-errors.md`, equations (8) to (12)).

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::excitation::{self, Expected};
use super::super::linear_model::Sizes;
use super::{LARGEST_NOISE, Passage, Session, State};
use crate::diagnosis::effect::interpolate;
use crate::diagnosis::fit::{Linear, Point, corrected, knot_count, trial_times};
use crate::diagnosis::kernel::{FAMILIES, Kernel};
use crate::diagnosis::noise::{self, KNOT_SPACING, NoiseLevels, TrialNoise};
use crate::simulation::SimulationError;

/// Families of autocorrelation are compared on so many trials at most, evenly spread over the session; lengths on twice as many.
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

    /// Takes the excitations that are expected before the moment is looked at.
    pub(super) fn start_at_expected(&self, point: &mut Point, levels: &NoiseLevels) -> Result<(), SimulationError> {
        let expected = excitation::expected(&self.envelopes(), levels, &self.analysis.kernels.emg, &self.signals);
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
    pub(super) fn envelopes(&self) -> Vec<Vec<DVector<f64>>> {
        let of = |g: &usize| {
            let record = &self.forward().trials[*g];
            let knots = knot_count(&record.time);
            let at = |e: &Vec<f64>, j: usize| interpolate(&record.time, e, record.time[0] + KNOT_SPACING * j as f64);
            record.excitation.iter().map(|e| DVector::from_fn(knots, |j, _| at(e, j))).collect()
        };
        self.analysis.train.iter().map(of).collect()
    }

    /// How noise enters every trial, equation (12); the linearization is made to match.
    pub(super) fn structure(&self, linear: &mut [Linear], point: &Point, levels: &NoiseLevels) -> Passage {
        let bare = self.analysis.noise_structure(linear, point);
        let expected = excitation::expected(&self.envelopes(), levels, &self.analysis.kernels.emg, &self.signals);
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

    /// Residuals with what is expected of the EMG, equation (13), and baselines' columns.
    pub(super) fn attach(&self, linear: &mut [Linear], point: &Point, passage: &Passage) {
        linear.par_iter_mut().enumerate().for_each(|(i, l)| {
            self.analysis.attach(l, i, point, &passage.bare[i]);
            let means: Vec<DVector<f64>> = passage.expected[i].iter().map(|e| e.mean.clone()).collect();
            l.residual -= passage.bare[i].respond(&means);
        });
    }

    /// Linearized at a point, noise passing as it does.
    pub(super) fn linearized(&self, point: &Point, passage: &Passage) -> Result<Vec<Linear>, SimulationError> {
        let mut linear = self.analysis.linearize(point, &[])?;
        self.attach(&mut linear, point, passage);
        Ok(linear)
    }

    /// Chooses how noise is autocorrelated by restricted likelihood: of the EMG's, then of the moment's.
    ///
    /// - `set`, `sizes`: of effects and of everything else meanwhile; `anew`: all families are compared, else lengths alone
    pub(super) fn choose_kernels(&mut self, state: &mut State, set: &[usize], sizes: &Sizes, anew: bool) {
        let columns = self.all_columns(&state.point, &state.linear, &state.directions);
        let regressors = Self::regressors(&state.model, &columns, &state.model.sds(set, sizes));
        let count = regressors.first().map_or(0, |(x, _)| x.ncols());
        let precision = DVector::from_element(count, 1.0);
        let least = self.analysis.least_white();
        for of_emg in [true, false] {
            let known = if of_emg { self.analysis.kernels.emg } else { self.analysis.kernels.moment };
            let noise = &state.noise.noise;
            let levels = state.levels;
            let with = |kernel: &Kernel, every: usize| -> Vec<TrialNoise> {
                let of = |(n, g): (&TrialNoise, &usize)| match of_emg {
                    true => n.clone().with_emg_kernel(kernel),
                    false => n.clone().with_times(trial_times(&self.forward().trials[*g], kernel)),
                };
                noise.par_iter().zip(&self.analysis.train).step_by(every).map(of).collect()
            };
            let every = noise.len().div_ceil(TRIALS_FOR_KERNELS).max(1);
            let every = if anew { every } else { every.div_ceil(2) };
            let families = if anew { &FAMILIES[..] } else { &[known.family] };
            let best = noise::best_kernel(&known, families, |kernel| {
                let noise = with(kernel, every);
                let regressors = regressors.iter().step_by(every);
                let trials: Vec<_> = noise.iter().zip(regressors).map(|(n, (x, r))| (n, x, r)).collect();
                let levels = noise::estimate_within(2, &trials, &precision, least, levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            let found = with(&best, 1);
            state.levels = self.levels(&found, &regressors, state.levels);
            state.noise.noise = found;
            if of_emg { self.analysis.kernels.emg = best } else { self.analysis.kernels.moment = best }
        }
        let time = |g: &usize| trial_times(&self.forward().trials[*g], &self.analysis.kernels.moment);
        self.analysis.times = self.analysis.train.iter().map(time).collect();
        self.signals = excitation::signals(&self.envelopes(), &state.levels, &self.analysis.kernels.emg);
    }
}
