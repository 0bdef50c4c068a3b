//! Forward simulation: from a state and excitations to a trajectory.

use super::error::PlantError;
use super::plant::{DrivenPlant, Plant, PlantState};
use crate::numerics::{Bdf, Cost};

/// How a simulation is made.
#[derive(Clone, Debug)]
pub struct ForwardOptions {
    /// Times at which the state is wanted, ascending, the first one being the start [s].
    pub times: Vec<f64>,
    /// Error allowed per step, relative to 1 rad, 1 m/s or rad/s, an activation of 1, or an optimal fibre length.
    pub accuracy: f64,
    /// Largest first step [s].
    pub first_step: f64,
}

/// What a simulation gives.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Times [s].
    pub times: Vec<f64>,
    /// State at every time.
    pub states: Vec<PlantState>,
    /// What it cost.
    pub cost: Cost,
}

/// Simulates a plant forward.
///
/// - `excite`: excitation of every muscle at a time
///
/// # Errors
/// [`PlantError::Stopped`] where no step is small enough.
pub fn simulate_forward(
    plant: &Plant,
    start: &PlantState,
    excite: impl FnMut(f64, &mut [f64]),
    options: &ForwardOptions,
) -> Result<Trajectory, PlantError> {
    let Some((&first, &last)) = options.times.first().zip(options.times.last()) else {
        return Ok(Trajectory { times: Vec::new(), states: Vec::new(), cost: Cost::default() });
    };
    let mut system = DrivenPlant::new(plant, excite);
    let mut x = plant.pack(start);
    let absolute = tolerances(plant, options.accuracy);
    let stopped = |error: crate::numerics::StepError<_>| PlantError::Stopped { time: first, reason: error.to_string() };
    let mut bdf = Bdf::new(&mut system, first, &x, &absolute, options.accuracy, options.first_step).map_err(stopped)?;
    let mut states = Vec::with_capacity(options.times.len());
    let mut next = 0;
    loop {
        while next < options.times.len() && options.times[next] <= bdf.time {
            let at = options.times[next];
            if at == bdf.time {
                x.copy_from_slice(bdf.state())
            } else {
                bdf.interpolate(at, &mut x)
            }
            let excitation = system.excitation(at).to_vec();
            states.push(plant.unpack(at, &x, &excitation, &mut system.work));
            next += 1;
        }
        if next == options.times.len() {
            return Ok(Trajectory { times: options.times.clone(), states, cost: bdf.cost });
        }
        bdf.step(&mut system, last)
            .map_err(|error| PlantError::Stopped { time: bdf.time, reason: error.to_string() })?;
    }
}

/// Error allowed for every state.
fn tolerances(plant: &Plant, accuracy: f64) -> Vec<f64> {
    let mut absolute = vec![accuracy; plant.n_states()];
    for muscle in &plant.muscles {
        if let Some(i) = muscle.fiber_length {
            absolute[i] = accuracy * muscle.muscle.length_state_scale();
        }
    }
    absolute
}
