//! A force from data: OpenSim's `ExternalForce`.

use nalgebra::Vector3;

use carpus_multibody::forces::AppliedForces;
use carpus_multibody::multibody::{Cache, Model};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::FrameIndex;

/// A force or torque from data.
#[derive(Clone, Debug)]
pub struct ExternalForce {
    /// Name.
    pub name: String,
    /// Name of the body as the file gives it, for labels.
    pub applied_to_body: String,
    pub(super) applied_to: FrameIndex,
    pub(super) force_expressed_in: FrameIndex,
    pub(super) point_expressed_in: FrameIndex,
    pub(super) force: Option<[Function; 3]>,
    pub(super) point: Option<[Function; 3]>,
    pub(super) torque: Option<[Function; 3]>,
}

fn at(functions: &Option<[Function; 3]>, time: f64) -> Option<Vector3<f64>> {
    functions.as_ref().map(|f| Vector3::new(f[0].value(time), f[1].value(time), f[2].value(time)))
}

impl ExternalForce {
    /// Force, point in ground and torque at a time, force and torque expressed in ground.
    #[allow(non_snake_case)]
    fn in_ground(&self, model: &Model, cache: &Cache, time: f64) -> [Option<Vector3<f64>>; 3] {
        let R = cache.X_GF(model, self.force_expressed_in).R;
        let point = match at(&self.point, time) {
            Some(point) => cache.X_GF(model, self.point_expressed_in) * point,
            None => cache.X_GF(model, self.applied_to).p,
        };
        [at(&self.force, time).map(|f| R * f), Some(point), at(&self.torque, time).map(|t| R * t)]
    }

    /// Adds what it does.
    pub fn apply(&self, model: &Model, cache: &Cache, time: f64, applied: &mut AppliedForces) {
        let base = model.frame(self.applied_to).base;
        let [force, point, torque] = self.in_ground(model, cache, time);
        if let (Some(force), Some(point)) = (force, point) {
            applied.add_at_point(cache, base, &point, &force);
        }
        if let Some(moment) = torque {
            applied.bodies[base.0] += SpatialForce { moment, force: Vector3::zeros() };
        }
    }

    /// Labels of what is reported (`ExternalForce::getRecordLabels`).
    pub fn labels(&self) -> Vec<String> {
        let mut labels = Vec::new();
        let mut add = |kind: &str| {
            ["x", "y", "z"]
                .iter()
                .for_each(|k| labels.push(format!("{}_{}_{kind}{k}", self.applied_to_body, self.name)));
        };
        if self.force.is_some() {
            add("F");
            if self.point.is_some() {
                add("p");
            }
        }
        if self.torque.is_some() {
            add("T");
        }
        labels
    }

    /// Values of what is reported: force in ground, point in the body, torque in ground.
    pub fn record(&self, model: &Model, cache: &Cache, time: f64) -> Vec<f64> {
        let [force, point, torque] = self.in_ground(model, cache, time);
        let mut values = Vec::new();
        if let Some(force) = force {
            values.extend(force.iter());
            if let (Some(_), Some(point)) = (&self.point, point) {
                let local = cache.X_GF(model, self.applied_to).inverse_transform_point(&point);
                values.extend(local.iter());
            }
        }
        if let Some(torque) = torque {
            values.extend(torque.iter());
        }
        values
    }
}
