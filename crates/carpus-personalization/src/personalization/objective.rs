//! The objective of the dissertation, equation 3.4, without the other measures that come with it in
//! [`evaluation`](carpus_simulation::evaluation).

use super::problem::TrainingTrial;
use carpus_simulation::simulation::{MuscleParameters, SimulationError};

/// J of one trial (equations 3.1 to 3.4; see [`ErrorMeasures`](carpus_simulation::evaluation::ErrorMeasures)). The
/// measured moment is not zero throughout.
pub(super) fn objective(measured: &[f64], simulated: &[f64]) -> f64 {
    let (mut largest, mut largest_error, mut absolute) = (0.0_f64, 0.0_f64, 0.0);
    let (mut product, mut square) = (0.0, 0.0);
    for (exp, sim) in measured.iter().zip(simulated) {
        let error = (exp - sim).abs();
        largest = largest.max(exp.abs());
        largest_error = largest_error.max(error);
        absolute += error;
        product += exp * sim;
        square += exp * exp;
    }
    absolute / (measured.len() as f64 * largest) + largest_error / largest + (1.0 - product / square)
}

/// Mean objective J over trials.
///
/// # Errors
/// A simulation that fails.
pub fn mean_objective(trials: &[TrainingTrial], parameters: &[MuscleParameters]) -> Result<f64, SimulationError> {
    let mut total = 0.0;
    for trial in trials {
        total += objective(trial.measured, &trial.prepared.simulate(parameters)?.moment);
    }
    Ok(total / trials.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_objective_is_that_of_evaluation() {
        let measured: Vec<f64> = (0..200).map(|i| 3.0 * (0.05 * i as f64).sin() - 0.4).collect();
        let simulated: Vec<f64> = (0..200).map(|i| 2.5 * (0.05 * i as f64 + 0.2).sin()).collect();
        let expected =
            carpus_simulation::evaluation::error_measures(&measured, &simulated).unwrap().objective.value().unwrap();
        assert!((objective(&measured, &simulated) - expected).abs() < 1e-12);
    }
}
