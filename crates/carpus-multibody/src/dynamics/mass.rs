//! Equations with the mass matrix as their matrix.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, LU};

/// A pivot below this share of the largest is none: something that moves has no mass. Ten times the rounding of
/// matrices of some fifty rows.
const NO_MASS: f64 = 1e-14;

/// The decomposition of a mass matrix.
///
/// Moments of inertia in files may be negative, so that the matrix is not positive definite; equations of motion have a
/// solution even so, which OpenSim gives.
pub(super) enum MassSolver {
    Definite(Cholesky<f64, Dyn>),
    Indefinite(LU<f64, Dyn, Dyn>),
}

impl MassSolver {
    /// `None` if the matrix is singular.
    pub fn of(matrix: DMatrix<f64>) -> Option<MassSolver> {
        if let Some(definite) = matrix.clone().cholesky() {
            return Some(MassSolver::Definite(definite));
        }
        let indefinite = matrix.lu();
        let pivots = indefinite.u().diagonal().abs();
        let is_regular = pivots.iter().all(|pivot| pivot.is_finite() && *pivot > NO_MASS * pivots.max());
        is_regular.then_some(MassSolver::Indefinite(indefinite))
    }

    /// As [`MassSolver::of`], of a matrix whose diagonal is 1 or -1: also `None` where a positive definite one has a
    /// pivot at the level of rounding.
    pub fn of_scaled(matrix: DMatrix<f64>) -> Option<MassSolver> {
        let solver = MassSolver::of(matrix)?;
        match &solver {
            MassSolver::Definite(own) if own.l_dirty().diagonal().iter().any(|p| p * p < NO_MASS) => None,
            _ => Some(solver),
        }
    }

    /// Replaces a right side by the solution.
    pub fn solve_mut(&self, right: &mut DVector<f64>) {
        match self {
            MassSolver::Definite(solver) => solver.solve_mut(right),
            MassSolver::Indefinite(solver) => {
                solver.solve_mut(right);
            }
        }
    }

    /// Replaces right sides, by columns, by their solutions.
    pub fn solve_columns_mut(&self, right: &mut DMatrix<f64>) {
        match self {
            MassSolver::Definite(solver) => solver.solve_mut(right),
            MassSolver::Indefinite(solver) => {
                solver.solve_mut(right);
            }
        }
    }
}
