//! Roots of covariances.

use nalgebra::{DMatrix, SymmetricEigen};

/// A matrix L with L Lᵀ a symmetric matrix, eigenvalues below 0 counting as 0.
pub fn symmetric_root(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(matrix.clone());
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
}
