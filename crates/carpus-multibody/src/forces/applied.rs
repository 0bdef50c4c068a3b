//! Forces on bodies and along coordinates, collected before they are turned into generalized forces of all speeds.

use crate::multibody::{BaseIndex, Cache, Model};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::spec::CoordinateIndex;
use nalgebra::Vector3;

/// Applied forces of one instant.
#[derive(Clone, Debug)]
pub struct AppliedForces {
    /// Along each coordinate's speed [N·m or N].
    pub mobility: Vec<f64>,
    /// On each base at its origin, expressed in ground.
    pub bodies: Vec<SpatialForce>,
}

impl AppliedForces {
    /// None yet.
    pub fn new(model: &Model) -> AppliedForces {
        AppliedForces {
            mobility: vec![0.0; model.n_coordinates()],
            bodies: vec![SpatialForce::default(); model.n_bases()],
        }
    }

    /// The first of its numbers that is not finite.
    pub fn first_not_finite(&self) -> Option<f64> {
        let of_bodies = self.bodies.iter().flat_map(|force| force.moment.iter().chain(force.force.iter()));
        self.mobility.iter().chain(of_bodies).copied().find(|value| !value.is_finite())
    }

    /// Back to none.
    pub fn clear(&mut self) {
        self.mobility.fill(0.0);
        self.bodies.fill(SpatialForce::default());
    }

    /// Adds a force along a coordinate's speed [N·m or N].
    pub fn add_to_coordinate(&mut self, coordinate: CoordinateIndex, force: f64) {
        self.mobility[coordinate.0] += force;
    }

    /// Adds a force [N] on a body at a point given in ground [m].
    pub fn add_at_point(&mut self, cache: &Cache, base: BaseIndex, point: &Vector3<f64>, force: &Vector3<f64>) {
        let offset = point - cache.X_GB(base).p;
        self.bodies[base.0] += SpatialForce::from_force_at(&offset, force);
    }

    /// Adds a moment and a force that act at a point given in ground [m].
    pub fn add_spatial(&mut self, cache: &Cache, base: BaseIndex, point: &Vector3<f64>, force: &SpatialForce) {
        let offset = point - cache.X_GB(base).p;
        self.bodies[base.0] += force.shift_to_origin(&offset);
    }
}
