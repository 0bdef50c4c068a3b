//! Fibre lengths that imaging measured at rest, as data of a session (`docs/src/theory/many-small-errors.md`,
//! equation (30)).
//!
//! ```text
//! r = (l_measured − l(θ)) / s ~ N(0, 1)                                                               (30)
//! l(θ): fibre length in equilibrium in the posture of the image
//! ```

use nalgebra::DVector;

use super::muscle_columns::place;
use carpus_effects::forward_model::FITTED_PER_MUSCLE;
use carpus_multibody::muscles::{Millard2012, Millard2012Parameters, MuscleError, MuscleModel};
use carpus_numerics::numerics::{Dual, Scalar};
use carpus_osim::osim::spec::MuscleSpec;
use carpus_simulation::simulation::{FiberAtRest, MuscleParameters, Property};

/// Step of differences of parameters, over their size.
const STEP: f64 = 1e-4;

/// The muscle of an image, with the model's own values.
#[derive(Clone, Debug)]
pub enum ImagedMuscle {
    /// A `Millard2012EquilibriumMuscle`; derivatives are exact.
    Millard2012(Box<Millard2012>),
    /// A muscle of another class; derivatives are exact.
    Other(FiberAtRest),
    /// A muscle with a rigid tendon; derivatives are central differences.
    RigidTendon(Box<MuscleSpec>),
}

/// A muscle's fascicle length in an image, and where the model has it then.
#[derive(Clone, Debug)]
pub struct RestingFiber {
    /// Position among the active muscles.
    pub muscle: usize,
    /// The muscle.
    pub imaged: ImagedMuscle,
    /// Length of its path in the posture of the image [m].
    pub path_length: f64,
    /// Activation while imaged.
    pub activation: f64,
    /// Measured fascicle length [m].
    pub measured: f64,
    /// Its standard deviation, that of the model included [m].
    pub standard_deviation: f64,
}

impl ImagedMuscle {
    /// The muscle that a model file specifies.
    ///
    /// # Errors
    /// A class that is not simulated; properties that OpenSim too would refuse.
    pub fn from_spec(spec: &MuscleSpec) -> Result<ImagedMuscle, MuscleError> {
        Ok(match MuscleModel::from_spec(spec)? {
            MuscleModel::Millard2012(muscle) => ImagedMuscle::Millard2012(muscle),
            _ => match FiberAtRest::of(spec)? {
                Some(fiber) => ImagedMuscle::Other(fiber),
                None => ImagedMuscle::RigidTendon(Box::new(spec.clone())),
            },
        })
    }
}

impl RestingFiber {
    /// Fibre length [m] with its derivatives by optimal fibre length and tendon slack length; `None` without an
    /// equilibrium.
    fn length(&self, p: &MuscleParameters) -> Option<Dual<2>> {
        match &self.imaged {
            ImagedMuscle::Millard2012(muscle) => self.millard_length(muscle, p),
            ImagedMuscle::Other(fiber) => {
                let [value, gradient @ ..] = fiber.length(p, self.path_length, self.activation)?;
                Some(Dual { value, gradient })
            }
            ImagedMuscle::RigidTendon(spec) => self.length_by_differences(spec, p),
        }
    }

    fn millard_length(&self, muscle: &Millard2012, p: &MuscleParameters) -> Option<Dual<2>> {
        let parameters = Millard2012Parameters {
            optimal_fiber_length: Dual::variable(p.optimal_fiber_length, 0),
            tendon_slack_length: Dual::variable(p.tendon_slack_length, 1),
            max_isometric_force: Dual::constant(p.max_isometric_force),
            ..muscle.parameters().lift::<Dual<2>>()
        };
        // Values within the bounds of a fit are positive, which is all that is asked of them.
        let Ok(muscle) = muscle.with_parameters(parameters) else { return Some(Dual::constant(self.measured)) };
        Some(muscle.equilibrium(Dual::constant(self.path_length), Dual::constant(self.activation)).ok()?.fiber_length)
    }

    fn length_by_differences(&self, spec: &MuscleSpec, p: &MuscleParameters) -> Option<Dual<2>> {
        let at = |fiber: f64, slack: f64| {
            let mut spec = spec.clone();
            spec.max_isometric_force = p.max_isometric_force;
            spec.optimal_fiber_length = p.optimal_fiber_length * fiber;
            spec.tendon_slack_length = p.tendon_slack_length * slack;
            let muscle = MuscleModel::from_spec(&spec).ok()?;
            Some(muscle.at_rest(self.path_length, self.activation).ok()?.0.fiber_length)
        };
        let [more, less] = [1.0 + STEP, 1.0 - STEP];
        let slope = |[up, down]: [f64; 2], size: f64| (up - down) / (2.0 * STEP * size);
        Some(Dual {
            value: at(1.0, 1.0)?,
            gradient: [
                slope([at(more, 1.0)?, at(less, 1.0)?], p.optimal_fiber_length),
                slope([at(1.0, more)?, at(1.0, less)?], p.tendon_slack_length),
            ],
        })
    }

    /// Derivatives of its whitened length by the columns of the linear model, and the residual, the last;
    /// `None` for a muscle that has no equilibrium.
    ///
    /// - `columns`: of the linear model
    pub(crate) fn row(&self, parameters: &[MuscleParameters], columns: usize) -> Option<DVector<f64>> {
        let p = &parameters[self.muscle];
        let length = self.length(p)?;
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

    /// Derivatives are those of differences, and lengths those of the class itself, for muscles of every class.
    #[test]
    fn verif_rows_are_those_of_differences() {
        let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        for class in [
            "",
            "Thelen2003Muscle",
            "DeGrooteFregly2016Muscle",
            "DeGrooteFregly2016Muscle_rigid",
            "RigidTendonMuscle",
            "Schutte1993Muscle_Deprecated",
            "Delp1990Muscle_Deprecated",
        ] {
            let file = match class {
                "" => root.join("models/wrist.osim"),
                class => root.join(format!("fixtures/muscle_laws/{class}.osim")),
            };
            let spec = OsimFile::read(file).unwrap().spec;
            let p = &spec.muscles[0];
            let parameters = |length: f64, slack: f64| MuscleParameters {
                optimal_fiber_length: p.optimal_fiber_length * length,
                tendon_slack_length: p.tendon_slack_length * slack,
                max_isometric_force: p.max_isometric_force,
                pennation_angle_at_optimal: p.pennation_angle_at_optimal,
            };
            let fiber = RestingFiber {
                muscle: 0,
                imaged: ImagedMuscle::from_spec(p).unwrap(),
                path_length: p.tendon_slack_length + 0.9 * p.optimal_fiber_length,
                activation: 0.05,
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
                assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{class}: {found} {expected}");
            }
            assert_eq!(row[0], 0.0);
            // OpenSim's search for the equilibrium of the deprecated classes ends within 0.01 N.
            let own = MuscleModel::from_spec(p).unwrap().at_rest(fiber.path_length, fiber.activation).unwrap().0;
            let found = fiber.length(&parameters(1.0, 1.0)).unwrap().value;
            assert!((found / own.fiber_length - 1.0).abs() < 1e-4, "{class}: {found} {}", own.fiber_length);
            // Without activation, also where the tendon is slack: no number, or numbers.
            for path_length in [fiber.path_length, 0.9 * p.tendon_slack_length] {
                let resting = RestingFiber { path_length, activation: 0.0, ..fiber.clone() };
                let row = resting.row(&[parameters(1.0, 1.0)], 3);
                assert!(row.is_none_or(|row| row.iter().all(|v| v.is_finite())), "{class}");
            }
        }
    }
}
