//! Variances and correlations of the noise of a fit, all directions being among the regressors.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::ONE_BY_ONE;
use super::super::descent::Descent;
use super::super::kernel::{FAMILIES, Kernel};
use super::super::noise::{self, COMPONENTS, Kernels, NoiseLevels, TrialNoise};
use super::{Analysis, Linear, Noise, Point, trial_times};
use crate::simulation::SimulationError;

#[derive(Clone, Copy)]
enum Kind {
    Emg,
    Moment,
}

/// Least white noise of the moment at a wrist [N·m].
///
/// A torque that was filtered has none, and less of what the muscles did, too: with 0.003 N·m or less, a filter of 6 Hz alone can raise an
/// alarm.
const LEAST_WHITE_AT_WRIST: f64 = 0.01;

impl Analysis<'_> {
    /// Least white noise of the moment, which goes with the joint's strength [N·m].
    pub(crate) fn least_white(&self) -> f64 {
        (LEAST_WHITE_AT_WRIST * self.forward.joint.strength).max(noise::LEAST_WHITE)
    }

    /// Variances of the noise, all directions being among the regressors.
    ///
    /// - `directions`: at the point
    pub(crate) fn estimate_noise(
        &self,
        linear: &[Linear],
        noise: &[TrialNoise],
        point: &Point,
        directions: &[DMatrix<f64>],
        start: NoiseLevels,
    ) -> NoiseLevels {
        let (columns, precision) = self.regressors(linear, point, directions);
        let trials: Vec<_> = noise.iter().zip(&columns).zip(linear).map(|((n, x), l)| (n, x, &l.residual)).collect();
        noise::estimate(&trials, &precision, self.least_white(), start)
    }

    /// Per trial all that a residual is regressed on while noise is estimated — nuisance, effects and directions — and prior
    /// precisions.
    ///
    /// With all directions among them what an effect does is not taken for noise. They are those at the very point: others,
    /// from another estimate of the EMG, go with what differs between the estimates, and take a tenth of the noise away.
    fn regressors(
        &self,
        linear: &[Linear],
        point: &Point,
        directions: &[DMatrix<f64>],
    ) -> (Vec<DMatrix<f64>>, DVector<f64>) {
        let extra = directions.first().map_or(0, DMatrix::ncols);
        let columns = linear
            .iter()
            .enumerate()
            .map(|(i, l)| {
                let (n, e) = (l.nuisance.ncols(), l.effects.ncols());
                let mut x = DMatrix::zeros(l.residual.len(), n + e + extra);
                x.columns_mut(0, n).copy_from(&l.nuisance);
                x.columns_mut(n, e).copy_from(&l.effects);
                x.columns_mut(n + e, extra).copy_from(&directions[i]);
                x
            })
            .collect();
        let (mut precision, _) = self.prior(point);
        // Directions are in units of their scale; ten times that is wide.
        precision.extend(std::iter::repeat_n(0.01, extra));
        (columns, DVector::from_vec(precision))
    }

    /// Covariance of the logarithms of the noise's variances.
    pub(crate) fn level_spread(
        &self,
        linear: &[Linear],
        noise: &Noise,
        point: &Point,
        directions: &[DMatrix<f64>],
    ) -> DMatrix<f64> {
        let (columns, precision) = self.regressors(linear, point, directions);
        let trials: Vec<_> =
            noise.structure.iter().zip(&columns).zip(linear).map(|((n, x), l)| (n, x, &l.residual)).collect();
        noise::spread(&trials, &precision, &noise.levels).unwrap_or_else(|| DMatrix::zeros(COMPONENTS, COMPONENTS))
    }

    /// Chooses the correlations of the noise by restricted likelihood: of the EMG's, then of the moment's, then again.
    pub(super) fn choose_kernels(&mut self, descent: &mut Descent) -> Result<(), SimulationError> {
        let directions = self.directions_at(descent)?;
        let (columns, precision) = self.regressors(&descent.linear, &descent.point, &directions);
        let residuals: Vec<&DVector<f64>> = descent.linear.iter().map(|l| &l.residual).collect();
        let mut levels = descent.noise.levels;
        let mut structure = descent.noise.structure.clone();
        let least = self.least_white();
        for kind in [Kind::Emg, Kind::Moment, Kind::Emg] {
            let known = self.kernels;
            let changed = |kernel: &Kernel| match kind {
                Kind::Emg => Kernels { emg: *kernel, ..known },
                Kind::Moment => Kernels { moment: *kernel, ..known },
            };
            let with = |structure: &[TrialNoise], kernels: &Kernels| -> Vec<TrialNoise> {
                structure
                    .par_iter()
                    .with_max_len(ONE_BY_ONE)
                    .zip(&self.train)
                    .map(|(n, g)| match kind {
                        Kind::Emg => n.clone().with_emg_kernel(&kernels.emg),
                        Kind::Moment => n.clone().with_times(trial_times(&self.forward.trials[*g], &kernels.moment)),
                    })
                    .collect()
            };
            let start = match kind {
                Kind::Emg => known.emg,
                Kind::Moment => known.moment,
            };
            let best = noise::best_kernel(&start, &FAMILIES, |kernel| {
                let noise = with(&structure, &changed(kernel));
                let trials: Vec<_> = noise.iter().zip(&columns).zip(&residuals).map(|((n, x), r)| (n, x, *r)).collect();
                let levels = noise::estimate_within(2, &trials, &precision, least, levels);
                noise::restricted_deviance(&trials, &precision, &levels)
            });
            self.kernels = changed(&best);
            structure = with(&structure, &self.kernels);
            let trials: Vec<_> = structure.iter().zip(&columns).zip(&residuals).map(|((n, x), r)| (n, x, *r)).collect();
            levels = noise::estimate(&trials, &precision, least, levels);
        }
        self.times = self.train.iter().map(|g| trial_times(&self.forward.trials[*g], &self.kernels.moment)).collect();
        descent.noise.levels = levels;
        descent.noise_is_current = false;
        self.starts_anew(descent);
        Ok(())
    }
}
