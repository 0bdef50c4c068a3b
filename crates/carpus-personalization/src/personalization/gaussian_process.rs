//! A Gaussian process that interpolates a cost: mean and standard deviation of what it may be elsewhere.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Variance of the observations' noise, of the standardized cost: so small that the process passes through them.
const NOISE: f64 = 1e-6;
/// A length scale is at least this, of the width of the box.
const LEAST_SCALE: f64 = 0.01;

/// The process, conditioned on observations.
pub(super) struct GaussianProcess<'a> {
    points: &'a [Vec<f64>],
    /// Per coordinate.
    scales: Vec<f64>,
    mean: f64,
    sd: f64,
    /// Of K + noise.
    cholesky: Cholesky<f64, Dyn>,
    /// (K + noise)⁻¹ y.
    weights: DVector<f64>,
}

impl<'a> GaussianProcess<'a> {
    /// A process with a Matérn 5/2 kernel through points of the unit box; `None` if points coincide.
    ///
    /// The length scales are the standard deviations of the points' coordinates, and the costs are standardized.
    ///
    /// - `costs`: at the points, all finite
    pub(super) fn through(points: &'a [Vec<f64>], costs: &[f64]) -> Option<GaussianProcess<'a>> {
        let (mean, sd) = moments(costs.iter().copied());
        let sd = sd.max(f64::MIN_POSITIVE);
        let scale = |k: usize| moments(points.iter().map(|p| p[k])).1.max(LEAST_SCALE);
        let scales: Vec<f64> = (0..points.first()?.len()).map(scale).collect();
        let n = points.len();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            matern_5_2(&points[i], &points[j], &scales) + if i == j { NOISE } else { 0.0 }
        });
        let cholesky = covariance.cholesky()?;
        let weights = cholesky.solve(&DVector::from_iterator(n, costs.iter().map(|c| (c - mean) / sd)));
        Some(GaussianProcess { points, scales, mean, sd, cholesky, weights })
    }

    /// Mean and standard deviation of the cost at a point.
    pub(super) fn at(&self, point: &[f64]) -> (f64, f64) {
        let to_points = self.points.iter().map(|p| matern_5_2(point, p, &self.scales));
        let mut covariance = DVector::from_iterator(self.points.len(), to_points);
        let mean = covariance.dot(&self.weights);
        // kᵀ (K + noise)⁻¹ k = |L⁻¹ k|²; L is regular.
        self.cholesky.l_dirty().solve_lower_triangular_mut(&mut covariance);
        let variance = (1.0 - covariance.norm_squared()).max(0.0);
        (self.mean + self.sd * mean, self.sd * variance.sqrt())
    }
}

/// (1 + √5 r + 5/3 r²) e^(−√5 r), r the distance in length scales.
fn matern_5_2(a: &[f64], b: &[f64], scales: &[f64]) -> f64 {
    let square: f64 = a.iter().zip(b).zip(scales).map(|((a, b), scale)| ((a - b) / scale).powi(2)).sum();
    let r = (5.0 * square).sqrt();
    (1.0 + r + r * r / 3.0) * (-r).exp()
}

/// Mean and standard deviation.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, (values.map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_process_passes_through_its_points_and_is_uncertain_far_from_them() {
        let points: Vec<Vec<f64>> = (0..9).map(|k| vec![0.05 * f64::from(k), 0.5]).collect();
        let cost = |x: f64| 3.0 + (6.0 * x).sin();
        let costs: Vec<f64> = points.iter().map(|p| cost(p[0])).collect();
        let process = GaussianProcess::through(&points, &costs).unwrap();
        for (point, cost) in points.iter().zip(&costs) {
            let (mean, sd) = process.at(point);
            assert!((mean - cost).abs() < 1e-4 && sd < 1e-2, "{mean} ± {sd}, not {cost}");
        }
        let (between, sd) = process.at(&[0.175, 0.5]);
        assert!((between - cost(0.175)).abs() < 0.01 && sd < 0.02, "{between} ± {sd}");
        let (far, sd) = process.at(&[1.0, 0.5]);
        assert!((far - costs.iter().sum::<f64>() / 9.0).abs() < 0.1 && sd > 0.2, "{far} ± {sd}");
    }

    #[test]
    fn verif_points_that_coincide_leave_it_regular() {
        let points = vec![vec![0.5], vec![0.5], vec![0.7]];
        let (mean, sd) = GaussianProcess::through(&points, &[1.0, 1.0, 1.0]).unwrap().at(&[0.6]);
        assert!(mean == 1.0 && sd < 1e-300, "{mean} ± {sd}");
    }
}
