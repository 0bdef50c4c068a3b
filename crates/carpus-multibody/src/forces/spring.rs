//! A linear spring and damper on a coordinate.

use super::error::{ForceError, check_finite, check_index};
use crate::multibody::{Cache, Model};
use carpus_osim::osim::spec::{CoordinateIndex, ForceKind, ForceSpec};

/// OpenSim's `SpringGeneralizedForce`: `f = −stiffness·(q − rest_length) − viscosity·u`, in SI units always.
#[derive(Clone, Copy, Debug)]
pub struct SpringGeneralizedForce {
    /// The coordinate.
    pub coordinate: CoordinateIndex,
    /// Stiffness [N·m/rad or N/m].
    pub stiffness: f64,
    /// Value of the coordinate at which the spring is slack [rad or m].
    pub rest_length: f64,
    /// Viscosity [N·m·s/rad or N·s/m].
    pub viscosity: f64,
}

impl SpringGeneralizedForce {
    pub(super) fn compile(force: &ForceSpec, model: &Model) -> Result<Self, ForceError> {
        let &ForceKind::SpringGeneralized { coordinate, stiffness, rest_length, viscosity } = &force.kind else {
            unreachable!("called for a SpringGeneralized only")
        };
        check_index(&force.at, "coordinate", coordinate.0, model.n_coordinates())?;
        check_finite(&force.at, "stiffness", stiffness)?;
        check_finite(&force.at, "rest_length", rest_length)?;
        check_finite(&force.at, "viscosity", viscosity)?;
        Ok(Self { coordinate, stiffness, rest_length, viscosity })
    }

    /// Force on the coordinate itself [N·m or N].
    pub fn force(&self, q: f64, u: f64) -> f64 {
        -self.stiffness * (q - self.rest_length) - self.viscosity * u
    }

    /// Generalized force about the coordinate of the cache's unit motion.
    pub fn generalized_force(&self, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        let coupling = cache.coupling()[self.coordinate.0];
        if coupling == 0.0 { 0.0 } else { coupling * self.force(q[self.coordinate.0], u[self.coordinate.0]) }
    }
}
