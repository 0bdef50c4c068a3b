//! Decompositions that end whatever a matrix holds: nalgebra's iterate for ever on numbers that are not finite.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

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

/// Columns that are factored at a time: what is left of them is taken away as one product of matrices.
const BLOCK: usize = 24;

/// Factor L with L Lᵀ a symmetric matrix, of which the lower triangle is read; `None` if it is not positive definite.
///
/// By blocks of columns (Golub & Van Loan, Matrix Computations, section 4.2.9), so that most of the work is products of
/// matrices.
pub fn cholesky(mut matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let n = matrix.nrows();
    for start in (0..n).step_by(BLOCK) {
        let size = BLOCK.min(n - start);
        let (done, mut block) = matrix.columns_range_pair_mut(0..start, start..start + size);
        let mut below = block.rows_mut(start, n - start);
        if start > 0 {
            let known = done.rows(start, n - start);
            let own = done.rows(start, size).transpose();
            below.gemm(-1.0, &known, &own, 1.0);
        }
        for j in 0..size {
            let (known, mut column) = below.columns_range_pair_mut(0..j, j);
            for k in 0..j {
                let factor = known[(j, k)];
                column.rows_range_mut(j..).axpy(-factor, &known.view((j, k), (n - start - j, 1)).column(0), 1.0);
            }
            let diagonal = column[j];
            if !(diagonal > 0.0 && diagonal.is_finite()) {
                return None;
            }
            let root = diagonal.sqrt();
            column[j] = root;
            column.rows_range_mut(j + 1..).scale_mut(1.0 / root);
        }
    }
    Some(Cholesky::pack_dirty(matrix))
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
    fn verif_factors_by_blocks_are_those_of_single_columns() {
        for n in [0, 1, 5, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 7] {
            let root = DMatrix::from_fn(n, n, |i, j| (1.3 * i as f64 + 0.7 * j as f64 * j as f64).sin());
            let matrix = &root * root.transpose() + DMatrix::identity(n, n);
            let found = cholesky(matrix.clone()).unwrap().l();
            assert!(
                found.iter().zip(matrix.clone().cholesky().unwrap().l().iter()).all(|(a, b)| (a - b).abs() < 1e-11)
            );
        }
        let mut indefinite = DMatrix::identity(2 * BLOCK, 2 * BLOCK);
        indefinite[(BLOCK + 3, BLOCK + 3)] = -1.0;
        assert!(cholesky(indefinite).is_none());
        assert!(cholesky(DMatrix::from_element(2, 2, f64::NAN)).is_none());
    }

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
