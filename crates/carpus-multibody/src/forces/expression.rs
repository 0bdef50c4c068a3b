//! A force on a coordinate, given by a formula.

use super::error::{ForceError, check_index};
use crate::multibody::{Cache, Model};
use carpus_osim::functions::Expression;
use carpus_osim::osim::spec::{CoordinateIndex, ForceKind, ForceSpec};

/// OpenSim's `ExpressionBasedCoordinateForce`: f(q, u), of value and speed, which formulas call `qdot`, in SI units
/// always.
#[derive(Clone, Debug)]
pub struct ExpressionBasedCoordinateForce {
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// The formula.
    pub expression: Expression,
}

impl ExpressionBasedCoordinateForce {
    pub(super) fn compile(force: &ForceSpec, model: &Model) -> Result<Self, ForceError> {
        let ForceKind::ExpressionBasedCoordinate { coordinate, expression } = &force.kind else {
            unreachable!("called for an ExpressionBasedCoordinate only")
        };
        check_index(&force.at, "coordinate", coordinate.0, model.n_coordinates())?;
        let expression =
            Expression::parse(expression).map_err(|source| ForceError::Expression { at: force.at.clone(), source })?;
        Ok(Self { coordinate: *coordinate, expression })
    }

    /// Force on the coordinate itself [N·m or N].
    pub fn force(&self, q: f64, u: f64) -> f64 {
        self.expression.value(q, u)
    }

    /// Generalized force about the coordinate of the cache's unit motion.
    pub fn generalized_force(&self, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        let coupling = cache.coupling()[self.coordinate.0];
        if coupling == 0.0 { 0.0 } else { coupling * self.force(q[self.coordinate.0], u[self.coordinate.0]) }
    }
}
