//! Decompositions that end whatever a matrix holds: nalgebra's iterate for ever on numbers that are not finite.

use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

/// Whether every element of a matrix is finite, so that it can be decomposed.
pub fn is_finite(matrix: &DMatrix<f64>) -> bool {
    matrix.iter().all(|v| v.is_finite())
}

/// Eigenvalues and eigenvectors of a symmetric matrix; all NaN where an element is not finite.
pub fn symmetric_eigen(matrix: DMatrix<f64>) -> SymmetricEigen<f64, Dyn> {
    if is_finite(&matrix) {
        return matrix.symmetric_eigen();
    }
    let n = matrix.nrows();
    SymmetricEigen {
        eigenvectors: DMatrix::from_element(n, n, f64::NAN),
        eigenvalues: DVector::from_element(n, f64::NAN),
    }
}

/// A matrix L with L Lᵀ a symmetric matrix, eigenvalues below 0 counting as 0.
pub fn symmetric_root(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = symmetric_eigen(matrix.clone());
    let mut out = eigen.eigenvectors;
    for (mut column, value) in out.column_iter_mut().zip(eigen.eigenvalues.iter()) {
        column *= value.max(0.0).sqrt();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_roots_of_singular_and_of_indefinite_matrices() {
        let squared = |m: &DMatrix<f64>| symmetric_root(m) * symmetric_root(m).transpose();
        let flat = DMatrix::from_element(3, 3, 2.0);
        assert!((squared(&flat) - &flat).amax() < 1e-12);
        assert_eq!(squared(&DMatrix::zeros(2, 2)), DMatrix::zeros(2, 2));
        // Eigenvalues 3 and -1.
        let indefinite = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
        assert!((squared(&indefinite) - DMatrix::from_element(2, 2, 1.5)).amax() < 1e-12);
    }

    #[test]
    fn verif_what_is_not_finite_is_nowhere_a_number() {
        for bad in [f64::NAN, f64::INFINITY] {
            let matrix = DMatrix::from_row_slice(2, 2, &[1.0, bad, bad, 1.0]);
            assert!(symmetric_root(&matrix).iter().all(|v| v.is_nan()));
            assert!(symmetric_eigen(matrix).eigenvalues.iter().all(|v| v.is_nan()));
        }
    }
}
