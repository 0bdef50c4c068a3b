//! Positions and speeds that satisfy the constraints.

use super::error::DynamicsError;
use super::solve::{Dynamics, RANK_TOLERANCE, Space};
use carpus_numerics::numerics::is_finite;
use nalgebra::{DMatrix, DVector};

/// Largest violation of constraints that assembly leaves [rad or m].
const ASSEMBLED: f64 = 1e-12;
/// Largest step along the constraints at which assembly ends [rad or m]: far below what motion capture can tell, and
/// above rounding of sums of some hundred squares.
const SETTLED: f64 = 1e-10;
/// Iterations of assembly.
const ASSEMBLY_ITERATIONS: usize = 100;
/// Whole steps of Newton's method at most: those of Simbody's `projectQ`.
const WHOLE_STEPS: usize = 20;

/// Shift of a coordinate by which derivatives are taken [rad or m].
const DIFFERENCE: f64 = 1e-6;

impl Dynamics<'_> {
    /// Moves coordinates so that they satisfy the constraints, by Newton's method with the smallest steps in sum of
    /// squares.
    ///
    /// Steps are those of Simbody's `projectQ`, so that coordinates which are far from satisfying the constraints end
    /// where OpenSim's do. Where those end nowhere, no step turns a joint by more than half a radian.
    ///
    /// # Errors
    /// Constraints that cannot be satisfied together.
    pub fn assemble(&mut self, time: f64, q: &mut [f64]) -> Result<(), DynamicsError> {
        let mut moved = q.to_vec();
        if self.whole_steps(time, &mut moved).is_ok() {
            q.copy_from_slice(&moved);
            return Ok(());
        }
        self.short_steps(time, q)
    }

    fn whole_steps(&mut self, time: f64, q: &mut [f64]) -> Result<(), DynamicsError> {
        let zero = vec![0.0; q.len()];
        let mut violation = f64::INFINITY;
        for iteration in 0..=WHOLE_STEPS {
            let rows = self.rows_at(time, q, &zero);
            violation = rows.error.amax();
            if !(violation > ASSEMBLED) || iteration == WHOLE_STEPS {
                break;
            }
            let step = Space::of(&self.by_rates(rows.G), q.len()).particular(&-rows.error);
            q.iter_mut().zip(step.iter()).for_each(|(q, step)| *q += step);
        }
        assembled(violation)
    }

    /// Away from the constraints their Jacobian, as Simbody's, is not the derivative of the violation: that is taken by
    /// differences.
    fn short_steps(&mut self, time: f64, q: &mut [f64]) -> Result<(), DynamicsError> {
        let mut violation = f64::INFINITY;
        for iteration in 0..=ASSEMBLY_ITERATIONS {
            let error = self.violation(time, q);
            violation = error.amax();
            if !(violation > ASSEMBLED) || iteration == ASSEMBLY_ITERATIONS {
                break;
            }
            let mut moved = q.to_vec();
            let mut derivative = DMatrix::zeros(error.len(), q.len());
            for (i, mut column) in derivative.column_iter_mut().enumerate() {
                let mut at = |shift: f64| {
                    moved[i] = q[i] + shift;
                    self.violation(time, &moved)
                };
                column.copy_from(&((at(DIFFERENCE) - at(-DIFFERENCE)) / (2.0 * DIFFERENCE)));
                moved[i] = q[i];
            }
            let step = Space::of(&derivative, q.len()).particular(&-error);
            let shorten = 1.0 / (step.amax() / 0.5).max(1.0);
            q.iter_mut().zip(step.iter()).for_each(|(q, step)| *q += shorten * step);
        }
        assembled(violation)
    }

    /// Whether the constraints leave no coordinate free to move.
    pub fn is_determined(&mut self, time: f64, q: &[f64]) -> bool {
        let rows = self.rows_at(time, q, &vec![0.0; q.len()]);
        Space::of(&rows.G, q.len()).free.ncols() == 0
    }

    fn violation(&mut self, time: f64, q: &[f64]) -> DVector<f64> {
        self.rows_at(time, q, &vec![0.0; q.len()]).error
    }

    /// A Jacobian by the rates of coordinates instead of speeds.
    fn by_rates(&self, by_speeds: DMatrix<f64>) -> DMatrix<f64> {
        if self.model.speeds_are_rates() {
            return by_speeds;
        }
        let n = by_speeds.ncols();
        let mut speeds = DMatrix::identity(n, n);
        let mut rates = vec![0.0; n];
        for (i, mut column) in speeds.column_iter_mut().enumerate() {
            rates.fill(0.0);
            rates[i] = 1.0;
            self.model.speeds_of_rates(self.cache(), &rates, column.as_mut_slice());
        }
        by_speeds * speeds
    }

    /// Moves coordinates so that they satisfy the constraints and some of them are as near as possible to where they
    /// were, in sum of squares (OpenSim's `AssemblySolver`).
    ///
    /// - `drawn`: whether a coordinate is drawn to where it was; the others move as constraints ask
    ///
    /// # Errors
    /// Constraints that cannot be satisfied together.
    pub fn assemble_near(&mut self, time: f64, q: &mut [f64], drawn: &[bool]) -> Result<(), DynamicsError> {
        let n = q.len();
        let goals: Vec<usize> = (0..n).filter(|i| drawn[*i]).collect();
        let (start, zero) = (q.to_vec(), vec![0.0; n]);
        let (mut violation, mut rates) = (0.0, vec![0.0; n]);
        for iteration in 0..ASSEMBLY_ITERATIONS {
            let rows = self.rows_at(time, q, &zero);
            violation = rows.error.amax();
            if iteration == 0 && !(violation > ASSEMBLED) {
                break;
            }
            let space = Space::of(&rows.G, n);
            let mut step = space.particular(&-rows.error);
            if !step.iter().all(|v| v.is_finite()) {
                return Err(DynamicsError::NotFinite);
            }
            // Along the constraints: what brings the drawn ones back most.
            let mut by_free = DMatrix::zeros(goals.len(), space.free.ncols());
            for (k, column) in space.free.column_iter().enumerate() {
                let speeds: Vec<f64> = column.iter().copied().collect();
                self.model.rates_of_speeds(self.cache(), &speeds, &mut rates);
                goals.iter().enumerate().for_each(|(row, i)| by_free[(row, k)] = rates[*i]);
            }
            self.model.rates_of_speeds(self.cache(), step.as_slice(), &mut rates);
            let away = DVector::from_iterator(goals.len(), goals.iter().map(|i| start[*i] - q[*i] - rates[*i]));
            let mut along = 0.0;
            if !by_free.is_empty() && is_finite(&by_free) {
                let decomposed = by_free.svd(true, true);
                let smallest = RANK_TOLERANCE * decomposed.singular_values.max();
                if let Ok(back) = decomposed.solve(&away, smallest) {
                    let back = &space.free * back;
                    along = back.amax();
                    step += back;
                }
            }
            if !(violation > ASSEMBLED) && !(along > SETTLED) {
                break;
            }
            self.model.rates_of_speeds(self.cache(), step.as_slice(), &mut rates);
            // No step turns a joint by more than half a radian.
            let shorten = 1.0 / (step.amax() / 0.5).max(1.0);
            q.iter_mut().zip(&rates).for_each(|(q, rate)| *q += shorten * rate);
        }
        // Where the nearest place is not found, any on the constraints.
        if violation <= ASSEMBLED { Ok(()) } else { self.assemble(time, q) }
    }

    /// Changes speeds as little as possible so that they satisfy the constraints at `q`.
    pub fn project_speeds(&mut self, time: f64, q: &[f64], u: &mut [f64]) {
        let rows = self.rows_at(time, q, u);
        let violation = &rows.v - &rows.G * DVector::from_column_slice(u);
        let change = Space::of(&rows.G, u.len()).particular(&violation);
        u.iter_mut().zip(change.iter()).for_each(|(u, change)| *u += change);
    }
}

/// Whether a violation is none.
fn assembled(violation: f64) -> Result<(), DynamicsError> {
    match violation {
        v if v.is_nan() => Err(DynamicsError::NotFinite),
        v if v > 1e3 * ASSEMBLED => Err(DynamicsError::NotAssembled { violation }),
        _ => Ok(()),
    }
}
