//! Derivatives of a plant's rates by its states: muscles exactly, coordinates and speeds by differences.

use super::{DynamicsError, MassSolver, Plant, PlantMuscle, Work};
use crate::paths::Path;
use nalgebra::{DMatrix, DVector};

/// Step of differences of coordinates [rad or m] and speeds.
const STEP: f64 = 1e-7;
/// Smallest of them, and the share of the way to a bushing's pole that they may go.
const LEAST_STEP: f64 = 1e-10;
const SHARE_OF_WAY: f64 = 3e-4;
/// Nearer to a pole than this differences of coordinates are central: derivatives there are large and cancel one
/// another.
const NEAR_POLE: f64 = 0.05;

/// A state about which rates are differentiated.
struct Base {
    rates: Vec<f64>,
    /// Moment arms of every path for all speeds, and its tension [N].
    arms: Vec<Vec<f64>>,
    tension: Vec<f64>,
    /// What paths do along all speeds together.
    pull: Vec<f64>,
    /// Forces that accelerations lack.
    residual: DVector<f64>,
}

/// Buffers for one difference.
#[derive(Clone)]
struct Moved {
    rates: Vec<f64>,
    arms: Vec<f64>,
    pull: Vec<f64>,
    udot: Vec<f64>,
    residual: DVector<f64>,
}

impl Plant {
    /// Derivatives of the rates by the states.
    ///
    /// # Errors
    /// As [`Plant::rates`].
    pub fn jacobian(
        &self,
        time: f64,
        x: &[f64],
        excitation: &[f64],
        work: &mut Work,
        jacobian: &mut DMatrix<f64>,
    ) -> Result<(), DynamicsError> {
        jacobian.fill(0.0);
        let (n, free) = (self.model.n_coordinates(), self.reduction.n_free());
        let mut base = Base {
            rates: vec![0.0; self.n_states],
            arms: vec![vec![0.0; n]; work.paths.len()],
            tension: vec![0.0; work.paths.len()],
            pull: vec![0.0; n],
            residual: DVector::zeros(free),
        };
        self.rates(time, x, excitation, work, &mut base.rates)?;
        let solver = MassSolver::of(work.reduced_mass.clone()).ok_or(DynamicsError::NotFinite)?;
        let muscles = self.muscles.len();
        for (k, path) in self.paths().enumerate() {
            self.arms(k, path, work, &mut base.arms[k]);
            base.tension[k] = if k < muscles { work.tendon_force[k] } else { self.tension(k - muscles, work) };
            add_scaled(&mut base.pull, base.tension[k], &base.arms[k]);
        }
        // Accelerations by tension.
        let mut column = DVector::zeros(free);
        for (k, m) in self.muscles.iter().enumerate() {
            let (length, speed) = (work.paths[k].length(), self.speed(m, k, work));
            let state = m.state(x, excitation[k]);
            let by = m.muscle.linearize(state, length, speed);
            work.relation.reduce(&base.arms[k], &mut column);
            solver.solve_mut(&mut column);
            if let Some(joint) = &work.joint {
                joint.correct(&mut column, None);
            }
            for (position, by) in [m.activation, m.fiber_length, m.fiber_velocity].into_iter().zip(by) {
                let Some(j) = position else { continue };
                (0..free).for_each(|i| jacobian[(free + i, j)] = column[i] * by.tendon_force);
                if let Some(i) = m.fiber_length {
                    jacobian[(i, j)] = by.equilibrium_state;
                }
                if let Some(i) = m.fiber_velocity {
                    jacobian[(i, j)] = by.fiber_velocity;
                }
            }
            if let Some(i) = m.activation {
                jacobian[(i, i)] = m.muscle.activation_rate_slope(state.activation, excitation[k]);
            }
        }
        for (j, lagged) in (self.energies.end..).zip(&self.lagged) {
            jacobian[(j, j)] = -1.0 / lagged.time_constant;
            let Some(actuator) = &lagged.actuator else { continue };
            work.applied.clear();
            actuator.apply(&self.model, &work.cache, actuator.optimal_force, &mut work.applied);
            let Work { relation, cache, applied, generalized, .. } = &mut *work;
            generalized.copy_from_slice(&applied.mobility);
            self.model.gather(cache, &mut applied.bodies, generalized);
            relation.reduce(generalized, &mut column);
            solver.solve_mut(&mut column);
            if let Some(joint) = &work.joint {
                joint.correct(&mut column, None);
            }
            jacobian.view_mut((free, j), (free, 1)).copy_from(&column);
        }
        let margin = self.pole_margin(work);
        let step = STEP.min(SHARE_OF_WAY * margin).max(LEAST_STEP);
        if work.joint.is_some() {
            return self.differentiate_rates(time, x, excitation, step, &base, work, jacobian);
        }
        // M u̇ = f − c: what the present accelerations lack at a neighbouring state, divided by the mass.
        let mut moved = Moved {
            rates: base.rates.clone(),
            arms: vec![0.0; n],
            pull: base.pull.clone(),
            udot: vec![0.0; n],
            residual: DVector::zeros(free),
        };
        self.residual(&base, &mut moved, work);
        base.residual.copy_from(&moved.residual);
        let mut opposite = moved.clone();
        let mut at = x.to_vec();
        let mut by_state = DMatrix::zeros(free, 2 * free);
        // Speeds first: they leave the paths as they are.
        for j in (free..2 * free).chain(0..free) {
            let (of_coordinate, step) = if j < free { (Some(j), step) } else { (None, STEP) };
            let mut difference = |to: f64, moved: &mut Moved| {
                at[j] = to;
                self.update_skeleton(time, &at, work);
                moved.rates.copy_from_slice(&base.rates);
                self.move_paths(&at, excitation, (of_coordinate, j % free), &base, moved, work);
                self.residual(&base, moved, work);
                at[j] = x[j];
            };
            let up = x[j] + step;
            difference(up, &mut moved);
            let (rates, residual, down) = if j < free && margin < NEAR_POLE {
                difference(x[j] - step, &mut opposite);
                (&opposite.rates, &opposite.residual, x[j] - step)
            } else {
                (&base.rates, &base.residual, x[j])
            };
            let width = up - down;
            by_state.column_mut(j).copy_from(&((residual - &moved.residual) / width));
            for i in (0..free).chain(2 * free..self.n_states) {
                jacobian[(i, j)] = (moved.rates[i] - rates[i]) / width;
            }
        }
        solver.solve_columns_mut(&mut by_state);
        jacobian.view_mut((free, 0), (free, 2 * free)).copy_from(&by_state);
        if jacobian.iter().all(|x| x.is_finite()) { Ok(()) } else { Err(DynamicsError::NotFinite) }
    }

    /// What paths do after one coordinate (`of_coordinate`) or speed has moved, by its position among the free ones,
    /// and rates of everything but speeds.
    fn move_paths(
        &self,
        x: &[f64],
        excitation: &[f64],
        (of_coordinate, by): (Option<usize>, usize),
        base: &Base,
        moved: &mut Moved,
        work: &mut Work,
    ) {
        let muscles = self.muscles.len();
        moved.pull.copy_from_slice(&base.pull);
        for (k, path) in self.paths().enumerate().filter(|(k, _)| self.coordinates_of_paths[*k][by]) {
            if of_coordinate.is_none() && k < muscles && !self.muscles[k].muscle.depends_on_path_speed() {
                continue;
            }
            if of_coordinate.is_some() {
                path.update(&work.q, &work.cache, &mut work.paths[k]);
                self.arms(k, path, work, &mut moved.arms);
            } else {
                moved.arms.copy_from_slice(&base.arms[k]);
            }
            if k < muscles {
                self.muscle_rate(k, x, excitation, work, &mut moved.rates);
            }
            let tension = if k < muscles { work.tendon_force[k] } else { self.tension(k - muscles, work) };
            add_scaled(&mut moved.pull, tension, &moved.arms);
            add_scaled(&mut moved.pull, -base.tension[k], &base.arms[k]);
        }
        self.energy_rates(work, &mut moved.rates);
        for (k, i) in self.reduction.free.iter().enumerate() {
            moved.rates[k] = work.qdot[*i];
        }
    }

    /// Forces that the accelerations of the base lack at the state in `work`.
    fn residual(&self, base: &Base, moved: &mut Moved, work: &mut Work) {
        self.collect_forces(work);
        let free = self.reduction.n_free();
        let Work { relation, q, u, cache, buffers, applied, generalized, .. } = work;
        relation.expand_rates(&base.rates[free..2 * free], &mut moved.udot);
        self.model.update_accelerations_of_speeds(q, u, &moved.udot, cache);
        self.model.inverse_dynamics(cache, &applied.bodies, buffers, generalized);
        for ((needed, applied), pull) in generalized.iter_mut().zip(&applied.mobility).zip(&moved.pull) {
            *needed -= applied + pull;
        }
        relation.reduce(generalized, &mut moved.residual);
    }

    /// By differences of the rates themselves, as constraints between bodies need.
    fn differentiate_rates(
        &self,
        time: f64,
        x: &[f64],
        excitation: &[f64],
        step: f64,
        base: &Base,
        work: &mut Work,
        jacobian: &mut DMatrix<f64>,
    ) -> Result<(), DynamicsError> {
        let free = self.reduction.n_free();
        let (mut at, mut moved) = (x.to_vec(), vec![0.0; self.n_states]);
        for j in 0..2 * free {
            at[j] = x[j] + if j < free { step } else { STEP };
            let step = at[j] - x[j];
            self.rates(time, &at, excitation, work, &mut moved)?;
            at[j] = x[j];
            (0..self.n_states).for_each(|i| jacobian[(i, j)] = (moved[i] - base.rates[i]) / step);
        }
        Ok(())
    }

    fn speed(&self, muscle: &PlantMuscle, number: usize, work: &Work) -> f64 {
        let path: &Path = &muscle.path;
        path.lengthening_speed(&work.q, &work.qdot, &work.cache, &work.paths[number])
    }
}

fn add_scaled(sum: &mut [f64], factor: f64, values: &[f64]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}
