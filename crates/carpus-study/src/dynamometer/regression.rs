//! Least squares with intervals that hold although neighbouring samples err alike.

use nalgebra::{DMatrix, DVector};

/// Singular values below this share of the largest are none.
const RANK_TOLERANCE: f64 = 1e-9;

/// A linear regression whose errors are independent between clusters of samples, not within them.
#[derive(Clone, Debug, PartialEq)]
pub struct ClusteredRegression {
    /// Coefficients of the columns.
    pub coefficients: Vec<f64>,
    /// Standard errors of the coefficients, robust to correlation within clusters.
    pub standard_errors: Vec<f64>,
    /// Root mean square of the residuals, with as many degrees of freedom as remain.
    pub residual: f64,
    /// Share of the variance about the mean that is explained.
    pub r_squared: f64,
    /// Clusters.
    pub clusters: usize,
}

/// Why there is no regression.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegressionError {
    /// Not more samples than columns.
    #[error("{samples} samples for {columns} coefficients")]
    TooFewSamples {
        /// Samples.
        samples: usize,
        /// Columns.
        columns: usize,
    },
    /// One cluster shows no scatter between clusters.
    #[error("{found} separate pieces of recording; expected at least 2")]
    TooFewClusters {
        /// Clusters.
        found: usize,
    },
    /// A sample that is not a number.
    #[error("a sample is not a finite number")]
    NotFinite,
}

impl ClusteredRegression {
    /// The two-sided interval of a coefficient at a confidence, e.g. 0.95, by Student's t with clusters − 1 degrees of
    /// freedom.
    pub fn interval(&self, column: usize, confidence: f64) -> [f64; 2] {
        use statrs::distribution::{ContinuousCDF, StudentsT};
        let freedom = (self.clusters - 1).max(1) as f64;
        let quantile = StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |t| t.inverse_cdf(0.5 + 0.5 * confidence));
        let [value, half] = [self.coefficients[column], quantile * self.standard_errors[column]];
        [value - half, value + half]
    }
}

/// Ordinary least squares with the cluster-robust covariance
///
/// ```text
/// V = (X'X)⁺ (Σ_g X_g'u_g u_g'X_g) (X'X)⁺ · G/(G−1) · (N−1)/(N−K)
/// ```
/// Columns that others span share their coefficient (the solution of least norm).
///
/// - `cluster`: of each sample, numbered from 0 without gaps
///
/// # Errors
/// [`RegressionError`].
///
/// # References
/// Cameron & Miller (2015), J Hum Resour 50:317, equation 11; `statsmodels` `cov_type="cluster"`.
pub fn clustered_regression(
    design: &DMatrix<f64>,
    y: &[f64],
    cluster: &[usize],
) -> Result<ClusteredRegression, RegressionError> {
    let (n, k) = design.shape();
    if n <= k || y.len() != n || cluster.len() != n {
        return Err(RegressionError::TooFewSamples { samples: n.min(y.len()), columns: k });
    }
    let clusters = cluster.iter().max().map_or(0, |last| last + 1);
    if clusters < 2 {
        return Err(RegressionError::TooFewClusters { found: clusters });
    }
    if design.iter().chain(y).any(|v| !v.is_finite()) {
        return Err(RegressionError::NotFinite);
    }
    let y = DVector::from_column_slice(y);
    // Columns of like size, so that what is negligible does not depend on units.
    let sizes: Vec<f64> = (0..k).map(|j| design.column(j).norm()).map(|s| if s > 0.0 { s } else { 1.0 }).collect();
    let mut x = design.clone();
    sizes.iter().enumerate().for_each(|(j, size)| x.column_mut(j).scale_mut(1.0 / size));
    let svd = x.clone().svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u.as_ref(), svd.v_t.as_ref()) else { return Err(RegressionError::NotFinite) };
    let largest = svd.singular_values.max();
    let inverse = svd.singular_values.map(|s| if s > RANK_TOLERANCE * largest { 1.0 / s } else { 0.0 });
    let rank = inverse.iter().filter(|s| **s > 0.0).count();
    let coefficients = v_t.transpose() * (u.transpose() * &y).component_mul(&inverse);
    let residuals = &y - &x * &coefficients;
    let mut scores = DMatrix::zeros(k, clusters);
    for i in 0..n {
        for j in 0..k {
            scores[(j, cluster[i])] += x[(i, j)] * residuals[i];
        }
    }
    let bread = v_t.transpose() * DMatrix::from_diagonal(&inverse.map(|s| s * s)) * v_t;
    let [g, samples, columns] = [clusters, n, rank].map(|v| v as f64);
    let correction = g / (g - 1.0) * (samples - 1.0) / (samples - columns);
    let half = &bread * scores;
    let covariance = &half * half.transpose() * correction;
    let mean = y.mean();
    let total: f64 = y.iter().map(|v| (v - mean).powi(2)).sum();
    Ok(ClusteredRegression {
        coefficients: coefficients.iter().zip(&sizes).map(|(c, size)| c / size).collect(),
        standard_errors: (0..k).map(|j| covariance[(j, j)].max(0.0).sqrt() / sizes[j]).collect(),
        residual: (residuals.norm_squared() / (samples - columns)).sqrt(),
        r_squared: if total > 0.0 { 1.0 - residuals.norm_squared() / total } else { f64::NAN },
        clusters,
    })
}
