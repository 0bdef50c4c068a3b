//! Forces and accelerations of a system at a state.

use nalgebra::{DVector, Vector3};

use super::actor::Actor;
use super::compiled::{Evaluation, System, SystemState, SystemWork};
use carpus_multibody::dynamics::{Accelerations, DynamicsError};
use carpus_multibody::forces::AppliedForces;
use carpus_multibody::multibody::Cache;
use carpus_multibody::paths::{Path as MusclePath, PathGeometry};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::spec::CoordinateIndex;

impl System {
    /// Everything at a state but accelerations.
    ///
    /// - `acts`: whether an actor applies its force
    pub fn evaluate(&self, work: &mut SystemWork, state: &SystemState, acts: &dyn Fn(usize) -> bool) -> Evaluation {
        let SystemWork { dynamics, paths, others } = work;
        dynamics.update(&state.q, &state.u);
        let qdot = dynamics.qdot().to_vec();
        let cache = dynamics.cache();
        let n = self.muscles.len();
        let mut found = Evaluation {
            muscle_length: vec![0.0; n],
            muscle_speed: vec![0.0; n],
            muscles: vec![None; n],
            tension: vec![0.0; self.actors.len()],
            path_length: vec![0.0; self.actors.len()],
            path_speed: vec![0.0; self.actors.len()],
            applied: AppliedForces::new(&self.model),
        };
        for (i, muscle) in self.muscles.iter().enumerate() {
            muscle.path.update(&state.q, cache, &mut paths[i]);
            found.muscle_length[i] = paths[i].length();
            found.muscle_speed[i] = muscle.path.lengthening_speed(&state.q, &qdot, cache, &paths[i]);
            found.muscles[i] = muscle
                .law
                .as_ref()
                .map(|law| law.dynamics(self.muscle_state(state, i), found.muscle_length[i], found.muscle_speed[i]));
        }
        for (k, actor) in self.actors.iter().enumerate() {
            let applied = &mut found.applied;
            match actor {
                Actor::Muscle(i) => {
                    let Some(muscle) = &found.muscles[*i] else { continue };
                    if acts(k) {
                        let path = &self.muscles[*i].path;
                        apply_tension(path, &state.q, cache, &paths[*i], muscle.tendon_force, applied);
                    }
                }
                Actor::Law(force) => {
                    if acts(k) {
                        force.apply(&self.model, &state.q, &state.u, cache, applied);
                    }
                }
                Actor::Along { path, law, .. } => {
                    let Some(geometry) = &mut others[k] else { continue };
                    path.update(&state.q, cache, geometry);
                    found.path_length[k] = geometry.length();
                    found.path_speed[k] = path.lengthening_speed(&state.q, &qdot, cache, geometry);
                    found.tension[k] = law.tension(found.path_length[k], found.path_speed[k]);
                    if acts(k) {
                        apply_tension(path, &state.q, cache, geometry, found.tension[k], applied);
                    }
                }
                Actor::Actuator(actuator) => {
                    let force = self.actuator_force(actor, state);
                    if acts(k) && force != 0.0 {
                        actuator.apply(&self.model, cache, force, applied);
                    }
                }
                Actor::PathActuator(actuator) => {
                    let Some(geometry) = &mut others[k] else { continue };
                    actuator.path.update(&state.q, cache, geometry);
                    found.path_speed[k] = actuator.path.lengthening_speed(&state.q, &qdot, cache, geometry);
                    found.tension[k] = self.actuator_force(actor, state);
                    if acts(k) {
                        apply_tension(&actuator.path, &state.q, cache, geometry, found.tension[k], applied);
                    }
                }
                Actor::OverTime(force) => {
                    if acts(k) {
                        force.apply(&self.model, state.time, cache, applied);
                    }
                }
                Actor::External(force) => {
                    if acts(k) {
                        force.apply(&self.model, cache, state.time, applied);
                    }
                }
                Actor::Correction(correction) => {
                    if acts(k) {
                        correction.apply(state.time, &state.q, &state.u, applied);
                    }
                }
            }
        }
        found
    }

    /// Sum of forces with those of actuators given by their names; actuators without are as evaluated.
    pub fn with_actuator_forces(
        &self,
        work: &mut SystemWork,
        state: &SystemState,
        force_of: &dyn Fn(&str) -> Option<f64>,
    ) -> AppliedForces {
        let given: Vec<Option<f64>> = self
            .actors
            .iter()
            .map(|actor| match actor {
                actor if actor.is_actuator() => force_of(actor.name(&self.muscles)),
                _ => None,
            })
            .collect();
        let mut applied = self.evaluate(work, state, &|k| given[k].is_none()).applied;
        for (k, force) in given.iter().enumerate() {
            if let Some(force) = force {
                self.apply_actuator(work, state, k, *force, &mut applied);
            }
        }
        applied
    }

    /// Adds a force of one actuator at the state last evaluated.
    ///
    /// - `k`: its position among the actors
    /// - `force`: [N or N·m]
    pub fn apply_actuator(
        &self,
        work: &SystemWork,
        state: &SystemState,
        k: usize,
        force: f64,
        applied: &mut AppliedForces,
    ) {
        let cache = work.dynamics.cache();
        match &self.actors[k] {
            Actor::Muscle(i) => {
                apply_tension(&self.muscles[*i].path, &state.q, cache, &work.paths[*i], force, applied);
            }
            Actor::Actuator(actuator) => actuator.apply(&self.model, cache, force, applied),
            Actor::PathActuator(actuator) => {
                if let Some(geometry) = &work.others[k] {
                    apply_tension(&actuator.path, &state.q, cache, geometry, force, applied);
                }
            }
            _ => {}
        }
    }

    /// Accelerations at the state last evaluated; where the equations of motion have no solution not numbers, as in
    /// OpenSim, and why there is none.
    ///
    /// - `applied`: forces
    pub fn accelerations(
        &self,
        work: &mut SystemWork,
        state: &SystemState,
        applied: &AppliedForces,
    ) -> (Accelerations, Option<DynamicsError>) {
        match work.dynamics.accelerations(state.time, &state.q, &state.u, applied) {
            Ok(found) => (found, None),
            Err(error) => {
                let nothing = |n: usize| DVector::from_element(n, f64::NAN);
                let (udot, constraint_forces) = (nothing(state.u.len()), nothing(state.u.len()));
                let multipliers = nothing(self.constraints.n_rows());
                (Accelerations { udot, constraint_forces, multipliers }, Some(error))
            }
        }
    }
}

/// Forces of a tension along a path.
pub fn apply_tension(
    path: &MusclePath,
    q: &[f64],
    cache: &Cache,
    geometry: &PathGeometry,
    tension: f64,
    applied: &mut AppliedForces,
) {
    let AppliedForces { mobility, bodies } = applied;
    path.unit_tension(
        q,
        cache,
        geometry,
        |base, point: &Vector3<f64>, force| {
            let offset = point - cache.X_GB(base).p;
            bodies[base.0] += SpatialForce::from_force_at(&offset, &(force * tension));
        },
        |c: CoordinateIndex, force| mobility[c.0] += force * tension,
    );
}
