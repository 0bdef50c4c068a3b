//! Fibre lengths that imaging measured at rest, as data of a session (`docs/src/theory/many-small-errors.md`,
//! equation (30)).
//!
//! ```text
//! r = (l_measured − l(θ)) / s ~ N(0, 1)                                                               (30)
//! l(θ): fibre length in equilibrium in the posture of the image
//! ```

use nalgebra::DVector;

use super::muscle_columns::place;
use crate::forward_model::FITTED_PER_MUSCLE;
use carpus_multibody::muscles::{EquilibriumError, Millard2012, Millard2012Parameters};
use carpus_numerics::numerics::{Dual, Scalar};
use carpus_simulation::simulation::{MuscleParameters, Property};

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

    /// Derivatives of its whitened length by the columns of the linear model, and the residual, the last;
    /// `None` for a muscle that has no equilibrium.
    ///
    /// - `columns`: of the linear model
    pub(crate) fn row(&self, parameters: &[MuscleParameters], columns: usize) -> Option<DVector<f64>> {
        let p = &parameters[self.muscle];
        let length = self.length(p).ok()?;
        let mut row = DVector::zeros(columns + 1);
        let first = self.muscle * FITTED_PER_MUSCLE;
        // By the logarithms of parameters.
        let by_fiber = length.gradient[0] * p.optimal_fiber_length / self.standard_deviation;
        row[first + place(Property::OptimalFiberLength)] = by_fiber;
        let by_tendon = length.gradient[1] * p.tendon_slack_length / self.standard_deviation;
        row[first + place(Property::TendonSlackLength)] = by_tendon;
        row[columns] = (self.measured - length.value) / self.standard_deviation;
        Some(row)
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
        let row = fiber.row(&[parameters(1.05, 0.99)], 3).unwrap();
        let value = |length: f64, slack: f64| fiber.length(&parameters(length, slack)).unwrap().value;
        let h = 1e-5;
        let by = [
            (value(1.05 * (1.0 + h), 0.99) - value(1.05 * (1.0 - h), 0.99)) / (2.0 * h),
            (value(1.05, 0.99 * (1.0 + h)) - value(1.05, 0.99 * (1.0 - h))) / (2.0 * h),
        ];
        assert!((row[3] + (at.value - 0.05) / 0.002).abs() < 1e-9);
        for (found, expected) in [(row[1], by[0] / 0.002), (row[2], by[1] / 0.002)] {
            assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{found} {expected}");
        }
        assert_eq!(row[0], 0.0);
    }
}
