//! Trials whose noise is held, as a fit found it: excitations without their expected noise, and the covariance of the
//! rest.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use carpus_diagnosis::noise::{KNOT_SPACING, Kernels, NoiseLevels, TrialNoise};
use carpus_simulation::simulation::{MuscleParameters, PreparedTrial, SimulationError};

/// A trial with one of the excitations that its expected moment is put together from.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) weight: f64,
    pub(super) excitation: Vec<Vec<f64>>,
    pub(super) prepared: PreparedTrial,
}

/// A trial with its noise held.
#[derive(Clone, Debug)]
pub(super) struct HeldTrial {
    /// With the excitation ê.
    pub(super) views: Vec<View>,
    pub(super) correction: Vec<DVector<f64>>,
    pub(super) starts: Vec<usize>,
    /// Block means of what was measured less what is not of muscles.
    pub(super) target: DVector<f64>,
    /// Columns of baselines.
    pub(super) baselines: DMatrix<f64>,
    pub(super) noise: Option<TrialNoise>,
    pub(super) factor: Cholesky<f64, Dyn>,
}

/// The noise, held: all trials.
#[derive(Clone, Debug)]
pub(super) struct Held {
    pub(super) trials: Vec<HeldTrial>,
    pub(super) levels: NoiseLevels,
    pub(super) kernels: Kernels,
}

/// Adds a weighted series.
pub(super) fn add(total: &mut [f64], weight: f64, series: &[f64]) {
    total.iter_mut().zip(series).for_each(|(t, s)| *t += weight * s);
}

impl HeldTrial {
    /// A muscle's unit force, as it is expected without the noise of its EMG.
    ///
    /// - `variant`: the views prepared for another model
    pub(super) fn expected_force(
        &self,
        variant: Option<&[PreparedTrial]>,
        muscle: usize,
        parameters: &MuscleParameters,
    ) -> Result<Vec<f64>, SimulationError> {
        let mut force = vec![0.0; self.views[0].prepared.len()];
        for (k, view) in self.views.iter().enumerate() {
            let prepared = variant.map_or(&view.prepared, |v| &v[k]);
            add(&mut force, view.weight, &prepared.unit_force(muscle, parameters)?);
        }
        Ok(force)
    }

    pub(super) fn whiten(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        whiten(&self.factor, columns)
    }
}

pub(super) fn whiten(factor: &Cholesky<f64, Dyn>, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = columns.clone();
    // The factor has a positive diagonal, so that this always succeeds.
    let solved = factor.l_dirty().solve_lower_triangular_mut(&mut out);
    debug_assert!(solved);
    out
}

/// Cholesky factor of a covariance: a positive diagonal plus positive semidefinite matrices, so that only rounding can
/// make it fail, and a little more of the diagonal repairs that.
pub(super) fn positive(mut covariance: DMatrix<f64>) -> Cholesky<f64, Dyn> {
    let mut ridge = 1e-12 * covariance.diagonal().max().max(1e-300);
    loop {
        if let Some(factor) = covariance.clone().cholesky() {
            return factor;
        }
        for i in 0..covariance.nrows() {
            covariance[(i, i)] += ridge;
        }
        ridge *= 100.0;
    }
}

pub(super) fn knot_count(time: &[f64]) -> usize {
    ((time[time.len() - 1] - time[0]) / KNOT_SPACING).ceil() as usize + 1
}

/// Recorded excitation times exp(correction), linear between knots.
pub(super) fn corrected(time: &[f64], excitation: &[Vec<f64>], correction: &[DVector<f64>]) -> Vec<Vec<f64>> {
    let one = |(e, w): (&Vec<f64>, &DVector<f64>)| {
        e.iter()
            .zip(time)
            .map(|(e, t)| {
                let x = (t - time[0]) / KNOT_SPACING;
                let i = (x as usize).min(w.len() - 2);
                let log = w[i] + (x - i as f64) * (w[i + 1] - w[i]);
                (e * log.exp()).min(1.0)
            })
            .collect()
    };
    excitation.iter().zip(correction).map(one).collect()
}

/// Disturbance of an excitation by one unit of its logarithm on a knot: first sample and values.
pub(super) fn hat(time: &[f64], excitation: &[f64], knot: usize) -> (usize, Vec<f64>) {
    let center = time[0] + KNOT_SPACING * knot as f64;
    let first = time.partition_point(|t| *t <= center - KNOT_SPACING);
    let end = time.partition_point(|t| *t < center + KNOT_SPACING);
    let weight = |t: f64| (1.0 - (t - center).abs() / KNOT_SPACING).max(0.0);
    (first.min(time.len()), (first..end).map(|k| excitation[k] * weight(time[k])).collect())
}

pub(super) fn at_time(time: &[f64], values: &[f64], t: f64) -> f64 {
    let i = time.partition_point(|x| *x <= t).clamp(1, time.len() - 1);
    let part = ((t - time[i - 1]) / (time[i] - time[i - 1])).clamp(0.0, 1.0);
    values[i - 1] + part * (values[i] - values[i - 1])
}
