//! Simulated moments of recorded trials, from the EMG as recorded.

use rayon::prelude::*;

use super::forward_model::{Core, ForwardModel, Setting};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};

/// A trial simulated with effects.
pub struct SimulatedTrial {
    /// Everything before joint and sensor.
    pub core: Core,
    /// The moment that the sensor records [N·m].
    pub moment: Vec<f64>,
}

/// Simulates all trials, in their order.
///
/// # Errors
/// A muscle whose forces cannot be balanced.
pub fn simulate_all(
    forward: &ForwardModel,
    parameters: &[MuscleParameters],
    effects: &[Setting],
) -> Result<Vec<SimulatedTrial>, SimulationError> {
    let variant = forward.variant(effects)?;
    (0..forward.trials.len())
        .into_par_iter()
        .map(|g| {
            let core = forward.core(&variant, g, &forward.recorded_input(g), parameters, effects, false)?;
            let moment = forward.recorded_moment(g, &core, effects);
            Ok(SimulatedTrial { core, moment })
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}
