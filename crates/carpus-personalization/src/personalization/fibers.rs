//! Fibre lengths that imaging measured at rest, as data of a fit.
//!
//! ```text
//! Σ ((l(θ) − l_measured) / s)²,   l(θ): fibre length in equilibrium in the posture of the image
//! ```

use super::joint::NormalEquations;
use carpus_multibody::muscles::{EquilibriumError, Millard2012, Millard2012Parameters};
use carpus_numerics::numerics::{Dual, Scalar};
use carpus_simulation::simulation::MuscleParameters;

/// A muscle's fascicle length in an image, and where the model has it then.
#[derive(Clone, Debug)]
pub struct RestingFiber {
    /// Position among the active muscles.
    pub muscle: usize,
    /// The muscle, with the model's own values.
    pub millard: Millard2012,
    /// Length of its path in the posture of the image [m].
    pub path_length: f64,
    /// Activation while imaged.
    pub activation: f64,
    /// Measured fascicle length [m].
    pub measured: f64,
    /// Its standard deviation, that of the model included [m].
    pub standard_deviation: f64,
}

impl RestingFiber {
    /// Fibre length [m] with its derivatives by optimal fibre length and tendon slack length.
    fn length(&self, p: &MuscleParameters) -> Result<Dual<2>, EquilibriumError> {
        let parameters = Millard2012Parameters {
            optimal_fiber_length: Dual::variable(p.optimal_fiber_length, 0),
            tendon_slack_length: Dual::variable(p.tendon_slack_length, 1),
            max_isometric_force: Dual::constant(p.max_isometric_force),
            ..self.millard.parameters().lift::<Dual<2>>()
        };
        // Values within the bounds of a fit are positive, which is all that is asked of them.
        let Ok(muscle) = self.millard.with_parameters(parameters) else { return Ok(Dual::constant(self.measured)) };
        Ok(muscle.equilibrium(Dual::constant(self.path_length), Dual::constant(self.activation))?.fiber_length)
    }

    /// Adds its row to the normal equations; a muscle that has no equilibrium adds none.
    ///
    /// - `factors`: of all parameters, property by property
    pub(super) fn add_row(&self, parameters: &[MuscleParameters], factors: &[f64], sums: &mut NormalEquations) {
        let (m, i) = (parameters.len(), self.muscle);
        let p = &parameters[i];
        let Ok(length) = self.length(p) else { return };
        let mut row = vec![0.0; 3 * m];
        row[i] = length.gradient[0] * p.optimal_fiber_length / factors[i] / self.standard_deviation;
        row[m + i] = length.gradient[1] * p.tendon_slack_length / factors[m + i] / self.standard_deviation;
        sums.add_row((length.value - self.measured) / self.standard_deviation, &row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_osim::osim::OsimFile;

    #[test]
    fn verif_row_is_that_of_differences() {
        let model = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("models/wrist.osim");
        let spec = OsimFile::read(&model).unwrap().spec;
        let millard = Millard2012::from_spec(&spec.muscles[0]).unwrap();
        let p = *millard.parameters();
        let parameters = |length: f64, slack: f64| MuscleParameters {
            optimal_fiber_length: p.optimal_fiber_length * length,
            tendon_slack_length: p.tendon_slack_length * slack,
            max_isometric_force: p.max_isometric_force,
            pennation_angle_at_optimal: p.pennation_angle_at_optimal,
        };
        let path_length = p.tendon_slack_length + 0.9 * p.optimal_fiber_length;
        let fiber = RestingFiber {
            muscle: 0,
            millard,
            path_length,
            activation: 0.01,
            measured: 0.05,
            standard_deviation: 0.002,
        };
        let at = fiber.length(&parameters(1.05, 0.99)).unwrap();
        let mut sums = NormalEquations::new(3);
        fiber.add_row(&[parameters(1.05, 0.99)], &[1.05, 0.99, 1.0], &mut sums);
        let value = |length: f64, slack: f64| fiber.length(&parameters(length, slack)).unwrap().value;
        let h = 1e-5;
        let by = [
            (value(1.05 + h, 0.99) - value(1.05 - h, 0.99)) / (2.0 * h),
            (value(1.05, 0.99 + h) - value(1.05, 0.99 - h)) / (2.0 * h),
        ];
        let residual = (at.value - 0.05) / 0.002;
        assert!((sums.square - residual * residual).abs() < 1e-9 * sums.square);
        for i in 0..2 {
            let expected = residual * by[i] / 0.002;
            assert!((sums.gradient[i] - expected).abs() < 1e-4 * expected.abs().max(1.0), "{i}: {}", sums.gradient[i]);
        }
        assert_eq!(sums.gradient[2], 0.0);
    }
}
