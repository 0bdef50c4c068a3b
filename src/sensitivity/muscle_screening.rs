//! Muscle parameters as the parameters of a sensitivity analysis, and the model's error as its response.

use std::fmt;

use super::error::SensitivityError;
use super::parameter::Parameter;
use crate::evaluation::{EvaluationError, error_measures};
use crate::simulation::{MuscleParameters, PreparedTrial, SimulationError};

/// A muscle parameter that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScreenedProperty {
    /// `optimal_fiber_length`.
    OptimalFiberLength,
    /// `tendon_slack_length`.
    TendonSlackLength,
    /// `max_isometric_force`.
    MaxIsometricForce,
    /// `pennation_angle_at_optimal`.
    PennationAngleAtOptimal,
    /// `fiber_damping`.
    FiberDamping,
}

impl ScreenedProperty {
    /// All, in the order in which parameters of a muscle stand.
    pub const ALL: [ScreenedProperty; 5] = [
        ScreenedProperty::OptimalFiberLength,
        ScreenedProperty::TendonSlackLength,
        ScreenedProperty::MaxIsometricForce,
        ScreenedProperty::PennationAngleAtOptimal,
        ScreenedProperty::FiberDamping,
    ];

    /// OpenSim's property name.
    pub fn name(self) -> &'static str {
        match self {
            ScreenedProperty::OptimalFiberLength => "optimal_fiber_length",
            ScreenedProperty::TendonSlackLength => "tendon_slack_length",
            ScreenedProperty::MaxIsometricForce => "max_isometric_force",
            ScreenedProperty::PennationAngleAtOptimal => "pennation_angle_at_optimal",
            ScreenedProperty::FiberDamping => "fiber_damping",
        }
    }

    /// Range it is varied over, as fractions of the model's value: Jadelis (2025), table 2.1, after Lieber et al.
    /// (1990, 1992) for lengths and pennation, Holzbaur et al. (2007) for force, Millard et al. (2013) for damping.
    pub fn usual_bounds(self) -> [f64; 2] {
        match self {
            ScreenedProperty::OptimalFiberLength => [0.822, 1.178],
            ScreenedProperty::TendonSlackLength => [0.868, 1.132],
            ScreenedProperty::MaxIsometricForce => [0.42, 2.514],
            ScreenedProperty::PennationAngleAtOptimal => [0.0, 2.16],
            ScreenedProperty::FiberDamping => [0.0, 2.0],
        }
    }
}

/// Why a run gave no response.
#[derive(Debug)]
pub enum ScreeningError {
    /// The trial could not be simulated.
    Simulation(SimulationError),
    /// The simulated moment could not be compared with the measured one.
    Evaluation(EvaluationError),
    /// The error has no value: the measured moment is zero throughout.
    NoError,
}

impl fmt::Display for ScreeningError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ScreeningError::Simulation(error) => write!(f, "{error}"),
            ScreeningError::Evaluation(error) => write!(f, "{error}"),
            ScreeningError::NoError => write!(f, "the measured moment is zero throughout: no normalized error"),
        }
    }
}

impl std::error::Error for ScreeningError {}

/// Trials of one condition whose error is the response to muscle parameters.
#[derive(Clone, Debug)]
pub struct MuscleScreening<'a> {
    trials: Vec<(&'a PreparedTrial, &'a [f64])>,
    nominal: &'a [MuscleParameters],
    damping: Vec<f64>,
}

impl<'a> MuscleScreening<'a> {
    /// - `trials`: prepared trials with their measured moments [N·m]
    /// - `nominal`: the model's parameters of each active muscle
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]: no trial.
    pub fn new(
        trials: Vec<(&'a PreparedTrial, &'a [f64])>,
        nominal: &'a [MuscleParameters],
    ) -> Result<Self, SensitivityError> {
        let Some((first, _)) = trials.first() else {
            return Err(SensitivityError::TooFew { what: "trials of the condition", expected: 1, found: 0 });
        };
        let damping = first.fiber_damping();
        Ok(Self { trials, nominal, damping })
    }

    /// The parameters, as fractions of the model's values, within table 2.1: `MUSCLE.property`, muscle by muscle.
    ///
    /// # Errors
    /// None with the usual bounds.
    pub fn parameters(muscles: &[&str]) -> Result<Vec<Parameter>, SensitivityError> {
        let of_muscle = |muscle: &&str| {
            let muscle = (*muscle).to_owned();
            ScreenedProperty::ALL.map(move |property| {
                let [lower, upper] = property.usual_bounds();
                Parameter::new(format!("{muscle}.{}", property.name()), lower, upper)
            })
        };
        muscles.iter().flat_map(of_muscle).collect()
    }

    /// Equation 2.4, NRMSE + MaxErr + XCorr, averaged over the trials.
    ///
    /// - `fractions`: in the order of [`Self::parameters`]; a muscle without damping keeps none
    ///
    /// # Errors
    /// A trial that cannot be simulated or compared.
    pub fn response(&self, fractions: &[f64]) -> Result<f64, ScreeningError> {
        let mut damping = self.damping.clone();
        let mut parameters = self.nominal.to_vec();
        for (i, of_muscle) in fractions.chunks_exact(ScreenedProperty::ALL.len()).enumerate() {
            let (Some(p), Some(beta)) = (parameters.get_mut(i), damping.get_mut(i)) else { continue };
            p.optimal_fiber_length *= of_muscle[0];
            p.tendon_slack_length *= of_muscle[1];
            p.max_isometric_force *= of_muscle[2];
            p.pennation_angle_at_optimal *= of_muscle[3];
            *beta *= of_muscle[4];
        }
        let mut total = 0.0;
        for (trial, measured) in &self.trials {
            let damped = trial.with_fiber_damping(&damping).map_err(ScreeningError::Simulation)?;
            let simulated = damped.simulate(&parameters).map_err(ScreeningError::Simulation)?;
            let errors = error_measures(measured, &simulated.moment).map_err(ScreeningError::Evaluation)?;
            total += errors.objective.value().ok_or(ScreeningError::NoError)?;
        }
        Ok(total / self.trials.len() as f64)
    }
}
