//! How noise at one time goes with noise at another: families of correlation functions, of which the data choose one.
//!
//! A wrong choice is not harmless: the excitation that is expected without its noise then still goes with the residual,
//! and so do all signatures computed from it. Time constants and curvatures would be blamed.
//!
//! # References
//! Rasmussen & Williams (2006), Gaussian Processes for Machine Learning, section 4.2.

use nalgebra::{DMatrix, DVector};

use carpus_numerics::numerics::symmetric_root;

/// Smoothness of the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// e⁻ᵈ: rough, as the Ornstein–Uhlenbeck process.
    Exponential,
    /// Matérn-3/2: once differentiable.
    Matern32,
    /// Matérn-5/2: twice differentiable.
    Matern52,
    /// e^(−d²/2): smooth.
    Gaussian,
}

/// All families, from rough to smooth.
pub const FAMILIES: [Family; 4] = [Family::Exponential, Family::Matern32, Family::Matern52, Family::Gaussian];

/// Correlations below this count as none.
const NEGLIGIBLE: f64 = 1e-6;

/// A correlation function.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Kernel {
    /// Smoothness.
    pub family: Family,
    /// Correlation length [s].
    pub length: f64,
}

impl Kernel {
    /// Correlation at a distance in time [s].
    pub fn at(&self, distance: f64) -> f64 {
        let d = distance.abs() / self.length;
        match self.family {
            Family::Exponential => (-d).exp(),
            Family::Matern32 => {
                let x = 3f64.sqrt() * d;
                (1.0 + x) * (-x).exp()
            }
            Family::Matern52 => {
                let x = 5f64.sqrt() * d;
                (1.0 + x + x * x / 3.0) * (-x).exp()
            }
            Family::Gaussian => (-0.5 * d * d).exp(),
        }
    }

    /// Correlations at 0, 1, 2 … times a spacing, as far as they matter.
    pub fn by_step(&self, spacing: f64) -> Vec<f64> {
        (0..).map(|i| self.at(spacing * f64::from(i))).take_while(|k| *k > NEGLIGIBLE).collect()
    }

    /// Correlation matrix of times [s].
    pub fn matrix(&self, times: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(times.len(), times.len(), |i, j| self.at(times[i] - times[j]))
    }
}

/// Multiplies values at equal steps by their correlation matrix.
///
/// - `by_step`: from [`Kernel::by_step`]
pub fn correlated(by_step: &[f64], values: &DVector<f64>) -> DVector<f64> {
    let n = values.len();
    DVector::from_fn(n, |i, _| {
        let near = i.saturating_sub(by_step.len() - 1)..(i + by_step.len()).min(n);
        near.map(|j| by_step[i.abs_diff(j)] * values[j]).sum()
    })
}

/// A matrix L with L Lᵀ the given covariance, also where that is singular.
///
/// Smooth correlations, cut off where they are negligible, have eigenvalues a little below 0: as little as is needed is
/// added to the diagonal.
pub fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let largest = covariance.diagonal().iter().copied().fold(0.0, f64::max);
    let with_more = |exponent: i32| {
        let more =
            DMatrix::from_diagonal_element(covariance.nrows(), covariance.ncols(), 10f64.powi(exponent) * largest);
        (covariance + more).cholesky()
    };
    (-9..-3).find_map(with_more).map_or_else(|| symmetric_root(covariance), |factor| factor.l())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_roots_are_those_of_smooth_correlations_that_are_cut_off() {
        for family in FAMILIES {
            for length in [0.05, 0.1, 0.4] {
                let by_step = Kernel { family, length }.by_step(0.04);
                let n = 100;
                let matrix = DMatrix::from_fn(n, n, |i, j| by_step.get(i.abs_diff(j)).copied().unwrap_or(0.0));
                let root = root(&matrix);
                assert!((&root * root.transpose() - &matrix).amax() < 1e-4, "{family:?} {length}");
            }
        }
    }

    #[test]
    fn verif_half_integer_kernels_are_those_of_their_closed_forms() {
        let at = |family, distance| Kernel { family, length: 0.5 }.at(distance);
        assert_eq!(at(Family::Exponential, 1.0), (-2.0_f64).exp());
        assert!((at(Family::Gaussian, 1.0) - (-2.0_f64).exp()).abs() < 1e-15);
        let x = 12f64.sqrt();
        assert!((at(Family::Matern32, -1.0) - (1.0 + x) * (-x).exp()).abs() < 1e-15);
        let x = 20f64.sqrt();
        assert!((at(Family::Matern52, 1.0) - (1.0 + x + x * x / 3.0) * (-x).exp()).abs() < 1e-15);
    }

    #[test]
    fn verif_banded_product_is_that_of_the_dense_matrix() {
        for family in FAMILIES {
            let kernel = Kernel { family, length: 0.07 };
            let times: Vec<f64> = (0..60).map(|i| 0.04 * f64::from(i)).collect();
            let values = DVector::from_fn(60, |i, _| (i as f64).sin());
            let expected = kernel.matrix(&times) * &values;
            let found = correlated(&kernel.by_step(0.04), &values);
            assert!((found - expected).amax() < 1e-5);
        }
    }
}
