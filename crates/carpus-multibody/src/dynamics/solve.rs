//! Accelerations from forces, forces from accelerations, and states that satisfy the constraints.

use super::constraints::{Constraints, Rows};
use super::error::DynamicsError;
use super::mass::MassSolver;
use crate::forces::AppliedForces;
use crate::multibody::{Body, Cache, DynamicsBuffers, Model};
use carpus_numerics::numerics::{is_finite, symmetric_eigen};
use carpus_osim::osim::spec::{CoordinateIndex, negative_principal_moment};
use nalgebra::{DMatrix, DVector};

/// Singular values of the constraints' Jacobian below this share of the largest count as zero: redundant constraints.
pub(super) const RANK_TOLERANCE: f64 = 1e-10;

/// Accelerations and the forces of constraints.
#[derive(Clone, Debug)]
pub struct Accelerations {
    /// Rates of the speeds [rad/s² or m/s²].
    pub udot: DVector<f64>,
    /// Generalized forces of the constraints `−Gᵀ λ` along every speed [N·m or N].
    pub constraint_forces: DVector<f64>,
    /// Multipliers λ of `M u̇ + Gᵀ λ = f`, the smallest ones where constraints are redundant.
    pub multipliers: DVector<f64>,
}

/// Solves the equations of motion of one model; holds the buffers that this needs.
pub struct Dynamics<'a> {
    /// The model.
    pub model: &'a Model,
    /// Its constraints.
    pub constraints: &'a Constraints,
    cache: Cache,
    buffers: DynamicsBuffers,
    mass_matrix: DMatrix<f64>,
    qdot: Vec<f64>,
    bias: Vec<f64>,
}

impl<'a> Dynamics<'a> {
    /// For a model and its constraints.
    pub fn new(model: &'a Model, constraints: &'a Constraints) -> Dynamics<'a> {
        let n = model.n_coordinates();
        Dynamics {
            model,
            constraints,
            cache: model.new_cache(),
            buffers: model.new_dynamics_buffers(),
            mass_matrix: DMatrix::zeros(n, n),
            qdot: vec![0.0; n],
            bias: vec![0.0; n],
        }
    }

    /// Positions, velocities and joint axes at a state, for computing forces.
    ///
    /// - `q`: coordinates; `u`: speeds, both of all coordinates
    pub fn update(&mut self, q: &[f64], u: &[f64]) -> &Cache {
        self.model.update_positions(q, &mut self.cache);
        self.model.update_joint_axes(q, &mut self.cache);
        self.model.update_velocities_of_speeds(q, u, &mut self.cache);
        self.model.rates_of_speeds(&self.cache, u, &mut self.qdot);
        &self.cache
    }

    /// Positions alone at coordinates.
    pub fn update_positions(&mut self, q: &[f64]) -> &Cache {
        self.model.update_positions(q, &mut self.cache);
        &self.cache
    }

    /// Kinematics of the state last given to [`Dynamics::update`].
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// Rates of the coordinates at the state last given to [`Dynamics::update`].
    pub fn qdot(&self) -> &[f64] {
        &self.qdot
    }

    /// Mass matrix at the state last given to [`Dynamics::update`].
    pub fn mass_matrix(&mut self) -> &DMatrix<f64> {
        self.model.update_mass_matrix(&self.cache, &mut self.buffers, &mut self.mass_matrix);
        &self.mass_matrix
    }

    /// Accelerations under applied forces and gravity, constraints satisfied at the level of accelerations.
    ///
    /// Call [`Dynamics::update`] with the same state first.
    ///
    /// # Errors
    /// Massless parts that can move; numbers that are not finite.
    pub fn accelerations(
        &mut self,
        time: f64,
        q: &[f64],
        u: &[f64],
        applied: &AppliedForces,
    ) -> Result<Accelerations, DynamicsError> {
        let n = self.model.n_coordinates();
        let force = self.free_force(q, u, applied);
        self.mass_matrix();
        let rows = self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache);
        if !force.iter().chain(rows.b.iter()).chain(self.mass_matrix.iter()).all(|x| x.is_finite()) {
            return Err(DynamicsError::NotFinite);
        }
        let space = Space::of(&rows.G, n);
        let particular = space.particular(&rows.b);
        let reduced_mass = space.free.tr_mul(&(&self.mass_matrix * &space.free));
        let right = space.free.tr_mul(&(&force - &self.mass_matrix * &particular));
        let right = DMatrix::from_column_slice(right.len(), 1, right.as_slice());
        let udot = match solve_scaled(reduced_mass, &right) {
            Some(y) => particular + &space.free * y.column(0),
            None => return Err(without_solution(self.model, || self.massless(&space))),
        };
        let constraint_forces = &self.mass_matrix * &udot - force;
        let multipliers = -space.inverse.tr_mul(&constraint_forces);
        Ok(Accelerations { udot, constraint_forces, multipliers })
    }

    /// By how much each of further forces changes the accelerations, in a column each; what else acts does not matter.
    ///
    /// Call [`Dynamics::update`] with the same state first.
    ///
    /// # Errors
    /// As [`Dynamics::accelerations`].
    pub fn responses(
        &mut self,
        time: f64,
        q: &[f64],
        u: &[f64],
        forces: &[AppliedForces],
    ) -> Result<DMatrix<f64>, DynamicsError> {
        let n = self.model.n_coordinates();
        let rest = self.free_force(q, u, &AppliedForces::new(self.model));
        let mut along = DMatrix::zeros(n, forces.len());
        for (mut column, applied) in along.column_iter_mut().zip(forces) {
            column.copy_from(&(self.free_force(q, u, applied) - &rest));
        }
        self.mass_matrix();
        let rows = self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache);
        if !is_finite(&along) || !is_finite(&self.mass_matrix) {
            return Err(DynamicsError::NotFinite);
        }
        let space = Space::of(&rows.G, n);
        let reduced_mass = space.free.tr_mul(&(&self.mass_matrix * &space.free));
        match solve_scaled(reduced_mass, &space.free.tr_mul(&along)) {
            Some(changes) => Ok(&space.free * changes),
            None => Err(without_solution(self.model, || self.massless(&space))),
        }
    }

    /// What forces have to do so that some accelerations are as wanted and constraints hold, `Nᵀ (M u̇ + c − f)` along
    /// the directions N that constraints leave free, and what each of further forces does along them, in a column each.
    /// Both are determined also where accelerations are not.
    ///
    /// Call [`Dynamics::update`] with the same state first.
    ///
    /// - `wanted`: acceleration of some coordinates, by position
    /// - `applied`: forces that act anyway
    ///
    /// # Errors
    /// Numbers that are not finite.
    pub fn demands(
        &mut self,
        time: f64,
        [q, u]: [&[f64]; 2],
        wanted: &[(usize, f64)],
        applied: &AppliedForces,
        forces: &[AppliedForces],
    ) -> Result<(DVector<f64>, DMatrix<f64>), DynamicsError> {
        let n = self.model.n_coordinates();
        let rest = self.free_force(q, u, &AppliedForces::new(self.model));
        let mut along = DMatrix::zeros(n, forces.len());
        for (mut column, applied) in along.column_iter_mut().zip(forces) {
            column.copy_from(&(self.free_force(q, u, applied) - &rest));
        }
        let rows = self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache);
        let space = Space::of(&rows.G, n);
        let particular = space.particular(&rows.b);
        let given = DMatrix::from_fn(wanted.len(), space.free.ncols(), |i, j| space.free[(wanted[i].0, j)]);
        let left = DVector::from_fn(wanted.len(), |i, _| wanted[i].1 - particular[wanted[i].0]);
        if !is_finite(&along) || !is_finite(&given) || !left.iter().all(|x| x.is_finite()) {
            return Err(DynamicsError::NotFinite);
        }
        let along_free = given.svd(true, true).solve(&left, RANK_TOLERANCE).map_err(|_| DynamicsError::NotFinite)?;
        let udot = particular + &space.free * along_free;
        let needed = self.inverse_dynamics(q, u, udot.as_slice(), applied);
        Ok((space.free.tr_mul(&needed), space.free.tr_mul(&along)))
    }

    /// Generalized forces that accelerations need beyond gravity and applied forces: `M u̇ + c − f`.
    ///
    /// Call [`Dynamics::update`] with the same state first.
    pub fn inverse_dynamics(&mut self, q: &[f64], u: &[f64], udot: &[f64], applied: &AppliedForces) -> DVector<f64> {
        self.model.update_accelerations_of_speeds(q, u, udot, &mut self.cache);
        self.model.inverse_dynamics(&self.cache, &applied.bodies, &mut self.buffers, &mut self.bias);
        DVector::from_iterator(self.bias.len(), self.bias.iter().zip(&applied.mobility).map(|(b, f)| b - f))
    }

    /// How far accelerations are from solving the equations: the part of `M u̇ + c − f` that no constraint can supply
    /// [N·m or N], and the violation of the constraints [rad/s² or m/s²]; the largest of each.
    ///
    /// Call [`Dynamics::update`] with the same state first.
    pub fn imbalance(&mut self, time: f64, q: &[f64], u: &[f64], udot: &[f64], applied: &AppliedForces) -> (f64, f64) {
        let zero = vec![0.0; self.model.n_coordinates()];
        self.model.update_accelerations_of_speeds(q, u, &zero, &mut self.cache);
        let rows = self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache);
        let force = self.inverse_dynamics(q, u, udot, applied);
        let space = Space::of(&rows.G, udot.len());
        let free = space.free.tr_mul(&force);
        let violation = &rows.G * DVector::from_column_slice(udot) - rows.b;
        (free.amax(), if violation.is_empty() { 0.0 } else { violation.amax() })
    }

    /// Force that is left for acceleration: applied and gravity forces less the bias.
    fn free_force(&mut self, q: &[f64], u: &[f64], applied: &AppliedForces) -> DVector<f64> {
        let zero = vec![0.0; self.model.n_coordinates()];
        -self.inverse_dynamics(q, u, &zero, applied)
    }

    fn massless(&self, space: &Space) -> DynamicsError {
        let reduced = space.free.tr_mul(&(&self.mass_matrix * &space.free));
        let eigen = symmetric_eigen(reduced);
        let motion = &space.free * eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let largest = motion.amax();
        let names = self.model.coordinates.iter().zip(motion.iter());
        let coordinates = names.filter(|(_, m)| m.abs() > 0.1 * largest).map(|(c, _)| c.name.clone()).collect();
        DynamicsError::Massless { coordinates }
    }

    /// Constraint violations and Jacobian for speeds u, at [`Dynamics::update`]'s state.
    pub(super) fn rows_at(&mut self, time: f64, q: &[f64], u: &[f64]) -> Rows {
        self.update(q, u);
        let zero = vec![0.0; self.model.n_coordinates()];
        self.model.update_accelerations_of_speeds(q, u, &zero, &mut self.cache);
        self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache)
    }

    /// Violation of the constraints at coordinates [rad or m], and its derivative by the speeds.
    pub fn constraint_jacobian(&mut self, time: f64, q: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let zero = vec![0.0; q.len()];
        self.update(q, &zero);
        // What the rows say of accelerations is not looked at: those of bodies are not brought up to date.
        let rows = self.constraints.rows(self.model, time, (q, &self.qdot), None, &self.cache);
        (rows.error, rows.G)
    }

    /// Speeds that go with unit speed of one coordinate: those nearest to that speed alone that the constraints allow,
    /// the coordinate itself free, in proportion (OpenSim's `MomentArmSolver`).
    pub fn unit_motion(&mut self, time: f64, q: &[f64], coordinate: CoordinateIndex) -> Vec<f64> {
        let (_, jacobian) = self.constraint_jacobian(time, q);
        let (n, c) = (q.len(), coordinate.0);
        let holds_it = |row: &usize| jacobian[(*row, c)] != 0.0 && (0..n).all(|j| j == c || jacobian[(*row, j)] == 0.0);
        let kept: Vec<usize> = (0..jacobian.nrows()).filter(|row| !holds_it(row)).collect();
        let jacobian = jacobian.select_rows(&kept);
        let change = Space::of(&jacobian, n).particular(&-jacobian.column(c));
        let speed = |j: usize| f64::from(u8::from(j == c)) + change[j];
        (0..n).map(|j| speed(j) / speed(c)).collect()
    }
}

/// Why equations of motion have no unique solution: an inertia that no body has, or else motion without mass.
pub(super) fn without_solution(model: &Model, massless: impl FnOnce() -> DynamicsError) -> DynamicsError {
    let is_negative = |body: &&Body| negative_principal_moment(&body.inertia).is_some();
    let bodies: Vec<String> = model.bodies.iter().filter(is_negative).map(|body| body.name.clone()).collect();
    if bodies.is_empty() { massless() } else { DynamicsError::Singular { bodies } }
}

/// Speeds that constraints leave free, and the smallest speeds that satisfy them.
pub(super) struct Space {
    /// Orthonormal columns that span the null space of G.
    pub free: DMatrix<f64>,
    /// Pseudo-inverse of G.
    inverse: DMatrix<f64>,
}

impl Space {
    /// Of numbers that are not finite the inverse is not a number (their decomposition would not end).
    ///
    /// - `jacobian`: G, with n columns
    pub fn of(jacobian: &DMatrix<f64>, n: usize) -> Space {
        let rows = jacobian.nrows();
        if !is_finite(jacobian) {
            return Space { free: DMatrix::zeros(n, 0), inverse: DMatrix::from_element(n, rows, f64::NAN) };
        }
        if rows == 0 {
            return Space { free: DMatrix::identity(n, n), inverse: DMatrix::zeros(n, 0) };
        }
        // Padded to a square so that the decomposition gives all n right singular vectors.
        let size = rows.max(n);
        let mut padded = DMatrix::zeros(size, n);
        padded.rows_mut(0, rows).copy_from(jacobian);
        let svd = padded.svd(true, true);
        let (Some(left), Some(right)) = (svd.u, svd.v_t) else {
            return Space { free: DMatrix::zeros(n, 0), inverse: DMatrix::zeros(n, rows) };
        };
        let largest = svd.singular_values.max();
        let is_active = |i: &usize| svd.singular_values[*i] > RANK_TOLERANCE * largest;
        let free: Vec<usize> = (0..n).filter(|i| !is_active(i)).collect();
        let free = DMatrix::from_fn(n, free.len(), |i, j| right[(free[j], i)]);
        let mut inverse = DMatrix::zeros(n, rows);
        for k in (0..n).filter(is_active) {
            let column = right.row(k).transpose() / svd.singular_values[k];
            inverse += column * left.view((0, k), (rows, 1)).transpose();
        }
        Space { free, inverse }
    }

    pub fn particular(&self, right: &DVector<f64>) -> DVector<f64> {
        &self.inverse * right
    }
}

/// Solves a symmetric system whose rows may differ in size by many orders of magnitude, for several right sides; `None`
/// if it is singular.
fn solve_scaled(matrix: DMatrix<f64>, right: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    if n == 0 {
        return Some(DMatrix::zeros(0, right.ncols()));
    }
    // Of a matrix that is not positive definite a row may have nothing on the diagonal.
    let size = |i: usize| if matrix[(i, i)] == 0.0 { matrix.row(i).amax() } else { matrix[(i, i)].abs() };
    let scale = DVector::from_fn(n, |i, _| size(i).sqrt().recip());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| scale[i] * matrix[(i, j)] * scale[j]);
    let scaled_rows = |columns: &DMatrix<f64>| DMatrix::from_fn(n, right.ncols(), |i, j| scale[i] * columns[(i, j)]);
    let mut found = scaled_rows(right);
    MassSolver::of_scaled(scaled)?.solve_columns_mut(&mut found);
    Some(scaled_rows(&found))
}
