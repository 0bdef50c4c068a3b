//! Generalized forces that are not muscles.
//!
//! In: a [`ModelSpec`] and the compiled [`Model`], then kinematics from a [`Cache`]. Out: generalized forces about one
//! coordinate, couplers followed: `f_c = Σᵢ fᵢ · dqᵢ/dq_c + Σ_B F_B · V_B(q̇_c = 1)`, [N·m] about an angle, [N] along a
//! displacement, positive when they tend to increase the coordinate.
//!
//! Forces along paths ([`Ligament`], [`PathSpring`]) are given the path's length and lengthening speed, so that this
//! module needs no path geometry; their generalized force is tension × moment arm.

mod actuator;
mod applied;
mod body_forces;
mod bushing;
mod coordinate_limit;
mod error;
mod expression;
mod path_forces;
mod points;
mod spring;

pub use actuator::Actuator;
pub use applied::AppliedForces;
pub use body_forces::{first_moment_of_mass, gravity_force, inertia_force};
pub use bushing::{BushingForce, BushingLaw};
pub use coordinate_limit::CoordinateLimitForce;
pub use error::ForceError;
pub use expression::ExpressionBasedCoordinateForce;
pub use path_forces::{Blankevoort1991Ligament, Ligament, PathForce, PathSpring};
pub use points::{PointToPointSpring, PrescribedForce};
pub use spring::SpringGeneralizedForce;

use crate::multibody::{Cache, Model};
use carpus_osim::osim::spec::{BodyIndex, CoordinateIndex, ForceKind, ModelSpec, PathSpec};

/// A force law that needs only coordinates and poses.
#[derive(Clone, Debug)]
pub enum ForceLaw {
    /// `CoordinateLimitForce`.
    CoordinateLimit(CoordinateLimitForce),
    /// `SpringGeneralizedForce`.
    SpringGeneralized(SpringGeneralizedForce),
    /// `ExpressionBasedCoordinateForce`.
    ExpressionBasedCoordinate(ExpressionBasedCoordinateForce),
    /// `BushingForce`, `FunctionBasedBushingForce`, `ExpressionBasedBushingForce`.
    Bushing(Box<BushingForce>),
    /// `PointToPointSpring`.
    PointToPointSpring(Box<PointToPointSpring>),
}

/// A force that needs only coordinates and poses.
#[derive(Clone, Debug)]
pub struct Force {
    /// Name.
    pub name: String,
    /// The law.
    pub law: ForceLaw,
}

impl Force {
    /// Power that the damping of a bushing or a limit takes \[W\]; of other forces 0.
    ///
    /// - `q`, `u`: values [rad or m] and speeds [rad/s or m/s] of the coordinates
    /// - `cache`: holds positions and velocities
    pub fn dissipated_power(&self, model: &Model, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        match &self.law {
            ForceLaw::Bushing(bushing) => bushing.dissipated_power(model, cache),
            ForceLaw::CoordinateLimit(limit) => limit.dissipated_power(q[limit.coordinate.0], u[limit.coordinate.0]),
            _ => 0.0,
        }
    }
}

/// A force along a path, with the path as the file states it.
#[derive(Clone, Debug)]
pub struct ForceAlongPath {
    /// Name.
    pub name: String,
    /// The path, not compiled.
    pub path: PathSpec,
    /// Tension as a function of the path's length.
    pub law: PathForce,
}

/// All forces of a model that are not muscles. Those that do not apply (`appliesForce` false) are left out.
#[derive(Clone, Debug, Default)]
pub struct Forces {
    /// Forces that need only coordinates and poses, in the order of the file.
    pub forces: Vec<Force>,
    /// Forces along paths, in the order of the file.
    pub along_paths: Vec<ForceAlongPath>,
    /// Forces given over time, in the order of the file.
    pub over_time: Vec<PrescribedForce>,
    /// Actuators without path, in the order of the file; without a control they do nothing.
    pub actuators: Vec<Actuator>,
    /// Names and classes of applied forces that this program does not compute.
    pub unsupported: Vec<(String, String)>,
}

impl Forces {
    /// Builds all forces of `spec` that are not muscles.
    ///
    /// # Errors
    /// Any [`ForceError`].
    pub fn compile(spec: &ModelSpec, model: &Model) -> Result<Forces, ForceError> {
        let mut forces = Forces::default();
        for force in spec.forces.iter().filter(|force| force.applies_force) {
            let name = force.name.clone();
            let law = match &force.kind {
                ForceKind::CoordinateLimit { .. } => {
                    ForceLaw::CoordinateLimit(CoordinateLimitForce::compile(force, model)?)
                }
                ForceKind::SpringGeneralized { .. } => {
                    ForceLaw::SpringGeneralized(SpringGeneralizedForce::compile(force, model)?)
                }
                ForceKind::ExpressionBasedCoordinate { .. } => {
                    ForceLaw::ExpressionBasedCoordinate(ExpressionBasedCoordinateForce::compile(force, model)?)
                }
                ForceKind::FunctionBasedBushing { .. }
                | ForceKind::Bushing { .. }
                | ForceKind::ExpressionBasedBushing { .. } => {
                    ForceLaw::Bushing(Box::new(BushingForce::compile(force, model)?))
                }
                ForceKind::PointToPointSpring { .. } => {
                    ForceLaw::PointToPointSpring(Box::new(PointToPointSpring::compile(force, model)?))
                }
                ForceKind::Prescribed(spec) => {
                    forces.over_time.push(PrescribedForce::compile(force, spec, model)?);
                    continue;
                }
                ForceKind::Actuator(spec) => {
                    forces.actuators.extend(Actuator::compile(&name, &force.at, spec, model)?);
                    continue;
                }
                ForceKind::Blankevoort1991Ligament { path, .. } => {
                    let law = PathForce::Blankevoort1991(Blankevoort1991Ligament::compile(force)?);
                    forces.along_paths.push(ForceAlongPath { name, path: path.clone(), law });
                    continue;
                }
                ForceKind::Ligament { path, .. } => {
                    let law = PathForce::Ligament(Ligament::compile(force)?);
                    forces.along_paths.push(ForceAlongPath { name, path: path.clone(), law });
                    continue;
                }
                ForceKind::PathSpring { path, .. } => {
                    let law = PathForce::PathSpring(PathSpring::compile(force)?);
                    forces.along_paths.push(ForceAlongPath { name, path: path.clone(), law });
                    continue;
                }
                ForceKind::Unsupported { class } => {
                    forces.unsupported.push((name, class.clone()));
                    continue;
                }
            };
            forces.forces.push(Force { name, law });
        }
        Ok(forces)
    }

    /// Sum of the generalized forces of [`Forces::forces`]; see [`Force::generalized_force`].
    pub fn generalized_force(&self, model: &Model, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        self.forces.iter().map(|force| force.generalized_force(model, q, u, cache)).sum()
    }

    /// Adds what [`Forces::forces`] do to bodies and coordinates.
    ///
    /// - `q`, `u`: coordinates and speeds, for which `cache` holds positions and velocities. What damps a coordinate
    ///   sees its speed as OpenSim defines it ([`Model::speeds_of_rates`]), which in some joints is not its rate.
    pub fn apply(&self, model: &Model, q: &[f64], u: &[f64], cache: &Cache, applied: &mut AppliedForces) {
        self.forces.iter().for_each(|force| force.apply(model, q, u, cache, applied));
    }

    /// Every force of which OpenSim keeps the energy that its damping took up, in the order of the file:
    /// `BushingForce`, and `CoordinateLimitForce` where it says so.
    pub fn dampers(&self) -> impl Iterator<Item = &Force> {
        self.forces.iter().filter(|force| match &force.law {
            ForceLaw::Bushing(bushing) => matches!(bushing.law, BushingLaw::Linear(_)),
            ForceLaw::CoordinateLimit(limit) => limit.computes_dissipation,
            _ => false,
        })
    }

    /// All bushings, in the order of the file.
    pub fn bushings(&self) -> impl Iterator<Item = &BushingForce> {
        self.forces.iter().filter_map(|force| match &force.law {
            ForceLaw::Bushing(bushing) => Some(bushing.as_ref()),
            _ => None,
        })
    }

    /// Those of [`Forces::forces`] that are affine in speed: all but formulas.
    pub fn affine_in_speed(&self) -> impl Iterator<Item = &Force> {
        self.forces.iter().filter(|force| !matches!(force.law, ForceLaw::ExpressionBasedCoordinate(_)))
    }

    /// Forces given by formulas.
    pub fn expressions(&self) -> impl Iterator<Item = &ExpressionBasedCoordinateForce> {
        self.forces.iter().filter_map(|force| match &force.law {
            ForceLaw::ExpressionBasedCoordinate(force) => Some(force),
            _ => None,
        })
    }
}

impl Force {
    /// Generalized force [N·m or N] about the coordinate that [`Model::update_unit_motion`] was last called for on
    /// `cache`, couplers followed.
    ///
    /// - `q`, `u`: coordinates and speeds, for which `cache` holds positions and velocities
    pub fn generalized_force(&self, model: &Model, q: &[f64], u: &[f64], cache: &Cache) -> f64 {
        match &self.law {
            ForceLaw::CoordinateLimit(force) => force.generalized_force(q, u, cache),
            ForceLaw::SpringGeneralized(force) => force.generalized_force(q, u, cache),
            ForceLaw::ExpressionBasedCoordinate(force) => force.generalized_force(q, u, cache),
            ForceLaw::Bushing(force) => force.generalized_force(model, cache),
            ForceLaw::PointToPointSpring(force) => force.generalized_force(cache),
        }
    }
}

impl Force {
    /// Adds what the force does to bodies and coordinates; arguments as [`Forces::apply`].
    pub fn apply(&self, model: &Model, q: &[f64], u: &[f64], cache: &Cache, applied: &mut AppliedForces) {
        let (coordinate, force) = match &self.law {
            ForceLaw::CoordinateLimit(force) => {
                let c = force.coordinate;
                (c, force.limit_force(q[c.0], u[c.0]))
            }
            ForceLaw::SpringGeneralized(force) => {
                let c = force.coordinate;
                (c, force.force(q[c.0], u[c.0]))
            }
            ForceLaw::ExpressionBasedCoordinate(force) => {
                let c = force.coordinate;
                (c, force.force(q[c.0], u[c.0]))
            }
            ForceLaw::PointToPointSpring(spring) => return spring.apply(cache, applied),
            ForceLaw::Bushing(bushing) => {
                let frames = [bushing.frame1, bushing.frame2];
                for (frame, force) in frames.into_iter().zip(bushing.forces_on_frames(model, cache)) {
                    let at = cache.X_GF(model, frame).p;
                    applied.add_spatial(cache, model.frame(frame).base, &at, &force);
                }
                return;
            }
        };
        applied.add_to_coordinate(coordinate, force);
    }

    /// Whether the force can have a generalized force about coordinate `c`, couplers followed: whether what it acts
    /// between moves with the coordinate.
    pub fn can_act_about(&self, model: &Model, c: CoordinateIndex) -> bool {
        let follows = |own: CoordinateIndex| model.are_coupled(own, c);
        match &self.law {
            ForceLaw::CoordinateLimit(force) => follows(force.coordinate),
            ForceLaw::SpringGeneralized(force) => follows(force.coordinate),
            ForceLaw::ExpressionBasedCoordinate(force) => follows(force.coordinate),
            ForceLaw::Bushing(force) => {
                model.moves_between(model.frame(force.frame1).base, model.frame(force.frame2).base, c)
            }
            ForceLaw::PointToPointSpring(force) => {
                let [first, second] = force.bases();
                model.moves_between(first, second, c)
            }
        }
    }

    /// The bodies whose poses the force depends on.
    pub fn bodies(&self, model: &Model) -> Vec<BodyIndex> {
        match &self.law {
            ForceLaw::PointToPointSpring(force) => force.bases().into_iter().filter_map(|base| base.body()).collect(),
            ForceLaw::Bushing(force) => {
                [force.frame1, force.frame2].into_iter().filter_map(|frame| model.frame(frame).base.body()).collect()
            }
            _ => Vec::new(),
        }
    }
}
