//! Actuators: forces that follow a control.

use super::applied::AppliedForces;
use super::error::{ForceError, check_finite, check_index};
use crate::multibody::{Cache, Model};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::spec::{ActuatorActivation, ActuatorKind, ActuatorSpec, CoordinateIndex, FrameIndex, Location};
use nalgebra::Vector3;

/// What an actuator acts on, in the model's bodies.
#[derive(Clone, Debug)]
enum Target {
    Coordinate(CoordinateIndex),
    /// Torque on one body and the opposite on another, about an axis in ground or the first body.
    Torque {
        bodies: [FrameIndex; 2],
        axis: Vector3<f64>,
        is_global: bool,
    },
    /// Force that pushes two points apart.
    PointToPoint {
        bodies: [FrameIndex; 2],
        points: [Vector3<f64>; 2],
        are_global: bool,
    },
    /// Force at a point.
    Point {
        body: FrameIndex,
        point: Vector3<f64>,
        point_is_global: bool,
        direction: Vector3<f64>,
        force_is_global: bool,
    },
}

/// An actuator without path: control (or the activation that follows it) · `optimal_force`.
#[derive(Clone, Debug)]
pub struct Actuator {
    /// Name.
    pub name: String,
    /// Force or torque for a control of 1 [N or N·m].
    pub optimal_force: f64,
    /// Lowest and highest control; OpenSim keeps to them only where it looks for controls (static optimization).
    pub control_range: [f64; 2],
    /// What takes the control's place, as a state.
    pub activation: Option<ActuatorActivation>,
    target: Target,
}

impl Actuator {
    /// Builds an actuator; `None` for one along a path.
    ///
    /// # Errors
    /// References to what does not exist; numbers that are not finite.
    pub fn compile(
        name: &str,
        at: &Location,
        spec: &ActuatorSpec,
        model: &Model,
    ) -> Result<Option<Actuator>, ForceError> {
        let frames = |bodies: [FrameIndex; 2]| {
            for frame in bodies {
                check_index(at, "frame", frame.0, model.frames.len())?;
            }
            Ok(bodies)
        };
        let target = match &spec.kind {
            ActuatorKind::Coordinate { coordinate, .. } => {
                check_index(at, "coordinate", coordinate.0, model.n_coordinates())?;
                Target::Coordinate(*coordinate)
            }
            ActuatorKind::Torque { body_a, body_b, axis, torque_is_global } => Target::Torque {
                bodies: frames([*body_a, *body_b])?,
                axis: axis.normalize(),
                is_global: *torque_is_global,
            },
            ActuatorKind::PointToPoint { body_a, body_b, point_a, point_b, points_are_global } => {
                let bodies = frames([*body_a, *body_b])?;
                Target::PointToPoint { bodies, points: [*point_a, *point_b], are_global: *points_are_global }
            }
            ActuatorKind::Point { body, point, point_is_global, direction, force_is_global } => Target::Point {
                body: frames([*body, *body])?[0],
                point: *point,
                point_is_global: *point_is_global,
                direction: direction.normalize(),
                force_is_global: *force_is_global,
            },
            ActuatorKind::Path { .. } => return Ok(None),
        };
        let activation = match &spec.kind {
            ActuatorKind::Coordinate { activation, .. } => *activation,
            _ => None,
        };
        Ok(Some(Actuator {
            name: name.to_owned(),
            activation,
            optimal_force: check_finite(at, "optimal_force", spec.optimal_force)?,
            control_range: [spec.min_control, spec.max_control],
            target,
        }))
    }

    /// Adds a force or torque [N or N·m].
    pub fn apply(&self, model: &Model, cache: &Cache, force: f64, applied: &mut AppliedForces) {
        let base = |frame: &FrameIndex| model.frame(*frame).base;
        match &self.target {
            Target::Coordinate(coordinate) => applied.add_to_coordinate(*coordinate, force),
            Target::Torque { bodies: [a, b], .. } => {
                let moment = force * self.direction(model, cache);
                let mut add = |frame, moment| {
                    applied.bodies[base(frame).0] += SpatialForce { moment, force: Vector3::zeros() };
                };
                add(a, moment);
                add(b, -moment);
            }
            Target::PointToPoint { bodies, .. } => {
                let along = force * self.direction(model, cache);
                let [a, b] = self.points(model, cache);
                applied.add_at_point(cache, base(&bodies[0]), &a, &along);
                applied.add_at_point(cache, base(&bodies[1]), &b, &-along);
            }
            Target::Point { body, .. } => {
                let along = force * self.direction(model, cache);
                let [point, _] = self.points(model, cache);
                applied.add_at_point(cache, base(body), &point, &along);
            }
        }
    }

    /// Speed that the force does work with [rad/s or m/s] (OpenSim: `getSpeed`, a `PointActuator`'s without sign).
    ///
    /// - `u`: speeds, for which `cache` holds velocities
    pub fn speed(&self, model: &Model, u: &[f64], cache: &Cache) -> f64 {
        let velocity_at = |frame: &FrameIndex, point: &Vector3<f64>| {
            let base = model.frame(*frame).base;
            cache.V_GB(base).velocity_at(&(point - cache.X_GB(base).p))
        };
        match &self.target {
            Target::Coordinate(coordinate) => u[coordinate.0],
            Target::Torque { bodies: [a, b], .. } => {
                let w = |frame: &FrameIndex| cache.V_GB(model.frame(*frame).base).w;
                // OpenSim takes the axis as given, also where it is fixed in the first body.
                let Target::Torque { axis, .. } = &self.target else { return f64::NAN };
                (w(a) - w(b)).dot(axis)
            }
            Target::PointToPoint { are_global: true, .. } => 0.0,
            Target::PointToPoint { bodies: [body_a, body_b], .. } => {
                let [a, b] = self.points(model, cache);
                (velocity_at(body_a, &a) - velocity_at(body_b, &b)).dot(&self.direction(model, cache))
            }
            Target::Point { body, point, .. } => velocity_at(body, &(cache.X_GF(model, *body) * *point)).norm(),
        }
    }

    /// The points in ground; the same one twice if there is one, zero if there is none.
    fn points(&self, model: &Model, cache: &Cache) -> [Vector3<f64>; 2] {
        match &self.target {
            Target::PointToPoint { points, are_global: true, .. } => *points,
            Target::PointToPoint { bodies, points, .. } => {
                std::array::from_fn(|k| cache.X_GF(model, bodies[k]) * points[k])
            }
            Target::Point { point, point_is_global: true, .. } => [*point; 2],
            Target::Point { body, point, .. } => [cache.X_GF(model, *body) * *point; 2],
            _ => [Vector3::zeros(); 2],
        }
    }

    /// Unit vector in ground along which, or about which, a positive force acts.
    fn direction(&self, model: &Model, cache: &Cache) -> Vector3<f64> {
        match &self.target {
            Target::Torque { axis, is_global: true, .. } => *axis,
            Target::Torque { bodies, axis, .. } => cache.X_GF(model, bodies[0]).R * axis,
            Target::PointToPoint { .. } => {
                let [a, b] = self.points(model, cache);
                (a - b).normalize()
            }
            Target::Point { direction, force_is_global: true, .. } => *direction,
            Target::Point { body, direction, .. } => cache.X_GF(model, *body).R * direction,
            Target::Coordinate(_) => Vector3::zeros(),
        }
    }
}
