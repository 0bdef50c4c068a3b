//! Parameters, and the response at many points.

use std::fmt::Display;

use rayon::prelude::*;

use super::error::SensitivityError;

/// A parameter and the range it is varied over, uniformly.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Lower bound, in the parameter's unit.
    pub lower: f64,
    /// Upper bound, in the parameter's unit.
    pub upper: f64,
}

impl Parameter {
    /// # Errors
    /// [`SensitivityError::Bounds`] unless both are finite and lower < upper.
    pub fn new(name: impl Into<String>, lower: f64, upper: f64) -> Result<Self, SensitivityError> {
        let name = name.into();
        if lower < upper && lower.is_finite() && upper.is_finite() {
            Ok(Self { name, lower, upper })
        } else {
            Err(SensitivityError::Bounds { parameter: name, lower, upper })
        }
    }

    /// The value at a fraction of the range (0: lower, 1: upper).
    pub fn at(&self, fraction: f64) -> f64 {
        self.lower + fraction * (self.upper - self.lower)
    }
}

/// A run that gave no response.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RunFailure {
    /// Parameter values of the run, in the parameters' units.
    pub values: Vec<f64>,
    /// Why it failed.
    pub reason: String,
}

/// The response at points of the unit cube, in their order, on all threads. A response that is not a finite number is
/// a failure.
pub fn run_all<E: Display>(
    parameters: &[Parameter],
    points: &[Vec<f64>],
    response: impl Fn(&[f64]) -> Result<f64, E> + Sync,
) -> Vec<Result<f64, RunFailure>> {
    points
        .par_iter()
        .map(|point| {
            let values: Vec<f64> = parameters.iter().zip(point).map(|(p, fraction)| p.at(*fraction)).collect();
            match response(&values) {
                Ok(y) if y.is_finite() => Ok(y),
                Ok(y) => Err(RunFailure { values, reason: format!("the response is {y}") }),
                Err(error) => Err(RunFailure { values, reason: error.to_string() }),
            }
        })
        .collect()
}
