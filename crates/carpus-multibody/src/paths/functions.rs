//! Paths whose length is a function of coordinates: OpenSim's `FunctionBasedPath`.

use super::error::PathError;
use carpus_osim::functions::FunctionOfSeveral;
use carpus_osim::osim::spec::{CoordinateIndex, FunctionSpec, Location, PathFunctionsSpec};

/// Largest departure of a lengthening speed from what is proportional to the coordinates' rates, relative to it.
const PROPORTIONAL: f64 = 1e-9;

/// Functions that give length, moment arms and lengthening speed of a path.
#[derive(Clone, Debug)]
pub(super) struct PathFunctions {
    /// Arguments of the functions, in their order.
    pub coordinates: Vec<CoordinateIndex>,
    length: FunctionOfSeveral,
    /// Moment arms about the coordinates; empty: minus the derivatives of the length.
    moment_arms: Vec<FunctionOfSeveral>,
    /// By the coordinates, then their rates.
    lengthening_speed: Option<FunctionOfSeveral>,
}

impl PathFunctions {
    /// - `n_coordinates`: of the model
    pub fn compile(spec: &PathFunctionsSpec, at: &Location, n_coordinates: usize) -> Result<PathFunctions, PathError> {
        let n = spec.coordinates.len();
        if let Some(beyond) = spec.coordinates.iter().find(|c| c.0 >= n_coordinates) {
            let (index, count) = (beyond.0, n_coordinates);
            return Err(PathError::BadReference { at: at.clone(), what: "coordinate", index, count });
        }
        let compile = |function: &FunctionSpec, dimension: usize, property: &'static str| {
            FunctionOfSeveral::compile(function, dimension).map_err(|source| PathError::Function {
                at: at.clone(),
                property,
                source,
            })
        };
        if n == 0 {
            return Err(PathError::NoCoordinates { at: at.clone() });
        }
        if !spec.moment_arms.is_empty() && spec.moment_arms.len() != n {
            let found = spec.moment_arms.len();
            return Err(PathError::MomentArmFunctions { at: at.clone(), expected: n, found });
        }
        let functions = PathFunctions {
            coordinates: spec.coordinates.clone(),
            length: compile(&spec.length, n, "length_function")?,
            moment_arms: spec
                .moment_arms
                .iter()
                .map(|function| compile(function, n, "moment_arm_functions"))
                .collect::<Result<_, _>>()?,
            lengthening_speed: spec
                .lengthening_speed
                .as_ref()
                .map(|function| compile(function, 2 * n, "lengthening_speed_function"))
                .transpose()?,
        };
        if !functions.is_proportional_to_rates() {
            return Err(PathError::NotProportional { at: at.clone() });
        }
        Ok(functions)
    }

    /// Whether a lengthening speed of its own is 0 at rest and grows in proportion to the rates, seen at two poses.
    fn is_proportional_to_rates(&self) -> bool {
        let Some(speed) = &self.lengthening_speed else { return true };
        let n = self.coordinates.len();
        [0.0, 0.37].into_iter().all(|pose| {
            let at = |factor: f64| speed.value(|k| if k < n { pose } else { factor * (1.0 + 0.1 * (k - n) as f64) });
            let [rest, once, thrice] = [0.0, 1.0, 3.0].map(at);
            let scale = PROPORTIONAL * once.abs().max(thrice.abs());
            rest.abs() <= scale && (thrice - 3.0 * once).abs() <= 3.0 * scale
        })
    }

    /// Length [m].
    pub fn length(&self, q: &[f64]) -> f64 {
        self.length.value(|k| q[self.coordinates[k].0])
    }

    /// Moment arm [m] about the coordinate at position `k`, the others at rest.
    fn moment_arm_about(&self, q: &[f64], k: usize) -> f64 {
        let x = |k: usize| q[self.coordinates[k].0];
        match self.moment_arms.get(k) {
            Some(arm) => arm.value(x),
            None => -self.length.derivative(x, k),
        }
    }

    /// Coordinates and the moment arms about them.
    pub fn moment_arms<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = (CoordinateIndex, f64)> + 'a {
        self.coordinates.iter().enumerate().map(|(k, c)| (*c, self.moment_arm_about(q, k)))
    }

    /// Moment arm about a coordinate whose unit speed moves the others as `rates` says.
    pub fn moment_arm(&self, q: &[f64], rates: &[f64]) -> f64 {
        let moving = self.coordinates.iter().enumerate().filter(|(_, c)| rates[c.0] != 0.0);
        moving.fold(0.0, |sum, (k, c)| sum + self.moment_arm_about(q, k) * rates[c.0])
    }

    /// Lengthening speed [m/s].
    pub fn lengthening_speed(&self, q: &[f64], rates: &[f64]) -> f64 {
        let n = self.coordinates.len();
        match &self.lengthening_speed {
            Some(speed) => speed.value(|k| match k.checked_sub(n) {
                None => q[self.coordinates[k].0],
                Some(k) => rates[self.coordinates[k].0],
            }),
            None => -self.moment_arm(q, rates),
        }
    }
}
