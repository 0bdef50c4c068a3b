//! Springs between two points, and forces given over time.

use super::applied::AppliedForces;
use super::error::{ForceError, check_finite, check_index};
use crate::multibody::{BaseIndex, Cache, Model};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::{ForceKind, ForceSpec, FrameIndex, FunctionSpec, PrescribedForceSpec};
use nalgebra::Vector3;

/// A point fixed in a body or ground.
#[derive(Clone, Copy, Debug)]
#[allow(non_snake_case)]
pub(super) struct Station {
    pub base: BaseIndex,
    pub p_BS: Vector3<f64>,
}

impl Station {
    /// From the body's origin, and in ground.
    fn place(&self, cache: &Cache) -> (Vector3<f64>, Vector3<f64>) {
        let offset = cache.X_GB(self.base).R * self.p_BS;
        (offset, cache.X_GB(self.base).p + offset)
    }
}

/// OpenSim's `PointToPointSpring`: `stiffness · (distance − rest_length)` along the line between two points.
#[derive(Clone, Debug)]
pub struct PointToPointSpring {
    /// Frames by which the file names the bodies.
    pub frames: [FrameIndex; 2],
    /// Points as the file gives them [m].
    pub points: [Vector3<f64>; 2],
    /// Stiffness [N/m].
    pub stiffness: f64,
    /// Length without force [m].
    pub rest_length: f64,
    stations: [Station; 2],
}

impl PointToPointSpring {
    pub(super) fn compile(force: &ForceSpec, model: &Model) -> Result<Self, ForceError> {
        let ForceKind::PointToPointSpring { body1, body2, point1, point2, stiffness, rest_length } = &force.kind else {
            unreachable!("called for a PointToPointSpring only")
        };
        for frame in [body1, body2] {
            check_index(&force.at, "frame", frame.0, model.frames.len())?;
        }
        let station =
            |frame: &FrameIndex, point: &Vector3<f64>| Station { base: model.frame(*frame).base, p_BS: *point };
        Ok(Self {
            frames: [*body1, *body2],
            points: [*point1, *point2],
            stiffness: check_finite(&force.at, "stiffness", *stiffness)?,
            rest_length: check_finite(&force.at, "rest_length", *rest_length)?,
            stations: [station(body1, point1), station(body2, point2)],
        })
    }

    /// Force on the first point, expressed in ground [N]; the opposite acts on the second.
    pub fn force(&self, cache: &Cache) -> Vector3<f64> {
        let between = self.stations[1].place(cache).1 - self.stations[0].place(cache).1;
        let distance = between.norm();
        // The direction of points that coincide is not defined; Simbody gives none.
        if distance == 0.0 {
            return Vector3::zeros();
        }
        between * (self.stiffness * (distance - self.rest_length) / distance)
    }

    pub(super) fn apply(&self, cache: &Cache, applied: &mut AppliedForces) {
        let force = self.force(cache);
        for (station, force) in self.stations.iter().zip([force, -force]) {
            applied.bodies[station.base.0] += SpatialForce::from_force_at(&station.place(cache).0, &force);
        }
    }

    /// Generalized force about the coordinate of the cache's unit motion.
    pub fn generalized_force(&self, cache: &Cache) -> f64 {
        let [v1, v2] =
            self.stations.map(|station| cache.partial_velocity(station.base).velocity_at(&station.place(cache).0));
        let relative = v1 - v2;
        if relative == Vector3::zeros() { 0.0 } else { self.force(cache).dot(&relative) }
    }

    pub(super) fn bases(&self) -> [BaseIndex; 2] {
        self.stations.map(|station| station.base)
    }
}

/// OpenSim's `PrescribedForce`: force, point of application and torque as functions of time.
#[derive(Clone, Debug)]
pub struct PrescribedForce {
    /// Name.
    pub name: String,
    /// Frame that it acts on.
    pub frame: FrameIndex,
    /// Whether the point is given in ground.
    pub point_is_global: bool,
    /// Whether force and torque are given in ground.
    pub force_is_global: bool,
    /// Force [N].
    pub force: Option<[Function; 3]>,
    /// Point [m].
    pub point: Option<[Function; 3]>,
    /// Torque [N·m].
    pub torque: Option<[Function; 3]>,
}

impl PrescribedForce {
    pub(super) fn compile(
        force: &ForceSpec,
        spec: &PrescribedForceSpec,
        model: &Model,
    ) -> Result<PrescribedForce, ForceError> {
        check_index(&force.at, "frame", spec.frame.0, model.frames.len())?;
        let compile = |functions: &Option<[FunctionSpec; 3]>, property: &'static str| {
            let Some(functions) = functions else { return Ok(None) };
            let one = |i: usize| {
                Function::compile(&functions[i]).map_err(|source| ForceError::Function {
                    at: force.at.clone(),
                    property,
                    source,
                })
            };
            Ok(Some([one(0)?, one(1)?, one(2)?]))
        };
        Ok(PrescribedForce {
            name: force.name.clone(),
            frame: spec.frame,
            point_is_global: spec.point_is_global,
            force_is_global: spec.force_is_global,
            force: compile(&spec.force, "forceFunctions")?,
            point: compile(&spec.point, "pointFunctions")?,
            torque: compile(&spec.torque, "torqueFunctions")?,
        })
    }

    /// Force expressed in ground, point in the frame, torque expressed in ground, of those that are given.
    #[allow(non_snake_case)]
    pub fn values(&self, model: &Model, cache: &Cache, time: f64) -> [Option<Vector3<f64>>; 3] {
        let X_GF = cache.X_GF(model, self.frame);
        let at = |functions: &Option<[Function; 3]>| {
            functions.as_ref().map(|f| Vector3::new(f[0].value(time), f[1].value(time), f[2].value(time)))
        };
        let in_ground = |vector: Vector3<f64>| if self.force_is_global { vector } else { X_GF.R * vector };
        let in_frame =
            |point: Vector3<f64>| if self.point_is_global { X_GF.inverse_transform_point(&point) } else { point };
        [at(&self.force).map(in_ground), at(&self.point).map(in_frame), at(&self.torque).map(in_ground)]
    }

    /// Adds what it does at a time [s].
    pub fn apply(&self, model: &Model, time: f64, cache: &Cache, applied: &mut AppliedForces) {
        let [force, point, torque] = self.values(model, cache, time);
        let base = model.frame(self.frame).base;
        if let Some(force) = force {
            let at = cache.X_GF(model, self.frame) * point.unwrap_or_default();
            applied.add_at_point(cache, base, &at, &force);
        }
        if let Some(moment) = torque {
            applied.bodies[base.0] += SpatialForce { moment, force: Vector3::zeros() };
        }
    }
}
