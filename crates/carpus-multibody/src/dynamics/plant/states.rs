//! States of a plant by name, and as the vector that is integrated.

use super::{Plant, PlantMuscle, Work};
use crate::dynamics::error::PlantError;

/// A state of the plant, named.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantState {
    /// All coordinates [rad or m].
    pub q: Vec<f64>,
    /// All speeds [rad/s or m/s].
    pub u: Vec<f64>,
    /// Activation of every muscle.
    pub activation: Vec<f64>,
    /// Fibre length of every muscle [m], or what its class has in its place ([`MuscleState`]).
    pub fiber_length: Vec<f64>,
    /// Fibre velocity of every muscle [m/s], where it is a state.
    pub fiber_velocity: Vec<f64>,
    /// Energy that every `BushingForce` has taken up [J].
    pub dissipated_energy: Vec<f64>,
    /// Activation of every [`LaggedActuator`].
    pub actuator_activation: Vec<f64>,
}

impl Plant {
    /// The state vector of a named state; dependent coordinates are not looked at.
    pub fn pack(&self, state: &PlantState) -> Vec<f64> {
        let free = &self.reduction.free;
        let mut x: Vec<f64> = free.iter().map(|i| state.q[*i]).chain(free.iter().map(|i| state.u[*i])).collect();
        x.resize(self.n_states, 0.0);
        for (k, muscle) in self.muscles.iter().enumerate() {
            if let Some(i) = muscle.activation {
                x[i] = state.activation[k];
            }
            if let Some(i) = muscle.fiber_length {
                x[i] = state.fiber_length[k];
            }
            if let Some(i) = muscle.fiber_velocity {
                x[i] = state.fiber_velocity[k];
            }
        }
        x[self.energies.clone()].iter_mut().zip(&state.dissipated_energy).for_each(|(x, energy)| *x = *energy);
        x[self.energies.end..].iter_mut().zip(&state.actuator_activation).for_each(|(x, activation)| *x = *activation);
        x
    }

    /// The named state of a state vector; activations that are no states are the excitations, fibre lengths of rigid
    /// tendons NaN.
    pub fn unpack(&self, time: f64, x: &[f64], excitation: &[f64], work: &mut Work) -> PlantState {
        let free = self.reduction.n_free();
        let (mut q, mut u) = (work.q.clone(), work.u.clone());
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (&mut q, &mut u), &mut work.relation);
        let activation = |(k, m): (usize, &PlantMuscle)| m.activation.map_or(excitation[k], |i| x[i]);
        PlantState {
            q,
            u,
            activation: self.muscles.iter().enumerate().map(activation).collect(),
            fiber_length: self.muscles.iter().map(|m| m.fiber_length.map_or(f64::NAN, |i| x[i])).collect(),
            fiber_velocity: self.muscles.iter().map(|m| m.fiber_velocity.map_or(0.0, |i| x[i])).collect(),
            dissipated_energy: x[self.energies.clone()].to_vec(),
            actuator_activation: x[self.energies.end..].to_vec(),
        }
    }

    /// A state at rest muscles: given coordinates and speeds, activations, and the fibre lengths at which fibre and
    /// tendon balance.
    ///
    /// # Errors
    /// A muscle that cannot be balanced.
    pub fn equilibrium_state(
        &self,
        time: f64,
        q: &[f64],
        u: &[f64],
        activation: &[f64],
        work: &mut Work,
    ) -> Result<PlantState, PlantError> {
        let fiber_length = vec![f64::NAN; self.muscles.len()];
        let mut state = PlantState {
            q: q.to_vec(),
            u: u.to_vec(),
            activation: activation.to_vec(),
            fiber_length,
            fiber_velocity: vec![0.0; self.muscles.len()],
            dissipated_energy: vec![0.0; self.energies.len()],
            actuator_activation: vec![0.0; self.lagged.len()],
        };
        let x = self.pack(&state);
        let free = self.reduction.n_free();
        let (mut q, mut u) = (q.to_vec(), u.to_vec());
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (&mut q, &mut u), &mut work.relation);
        self.model.update_positions(&q, &mut work.cache);
        for (k, muscle) in self.muscles.iter().enumerate() {
            muscle.path.update(&q, &work.cache, &mut work.paths[k]);
            let length = work.paths[k].length();
            state.fiber_length[k] = muscle.muscle.equilibrium(length, 0.0, activation[k])?;
        }
        (state.q, state.u) = (q, u);
        Ok(state)
    }
}
