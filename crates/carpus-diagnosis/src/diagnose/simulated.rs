//! Simulated moments of recorded trials, and their error.

use rayon::prelude::*;

use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};
use carpus_study::study::TrialUse;

/// Simulated moments [N·m] of the trials of a use, from the EMG as recorded.
///
/// # Errors
/// A muscle whose forces cannot be balanced.
pub fn simulate(
    forward: &ForwardModel,
    parameters: &[MuscleParameters],
    effects: &[Setting],
    usage: TrialUse,
) -> Result<Vec<(usize, Vec<f64>)>, SimulationError> {
    let variant = forward.variant(effects)?;
    forward
        .trials_for(usage)
        .into_par_iter()
        .map(|g| {
            let core = forward.core(&variant, g, &forward.recorded_input(g), parameters, effects, false)?;
            Ok((g, forward.recorded_moment(g, &core, effects)))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

/// Root mean square of measured minus simulated moment over trials [N·m].
pub fn rmse(forward: &ForwardModel, simulated: &[(usize, Vec<f64>)]) -> Option<f64> {
    let squares =
        simulated.iter().flat_map(|(g, s)| forward.trials[*g].moment.iter().zip(s).map(|(y, s)| (y - s).powi(2)));
    let (sum, count) = squares.fold((0.0, 0usize), |(sum, n), s| (sum + s, n + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}
