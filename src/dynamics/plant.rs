//! The whole model as a system of differential equations: skeleton, muscles, passive forces.
//!
//! State: free coordinates, their speeds, and of every muscle the activation (unless it ignores activation dynamics) and
//! the fibre length (unless its tendon is rigid).

use super::constraints::Constraints;
use super::error::PlantError;
use super::reduction::{Reduction, Relation};
use super::solve::DynamicsError;
use crate::forces::{AppliedForces, Forces, PathForce};
use crate::multibody::{Cache, DynamicsBuffers, Model};
use crate::muscles::{MuscleModel, MuscleState};
use crate::numerics::StiffSystem;
use crate::osim::spec::{CoordinateIndex, ModelSpec};
use crate::paths::{Path, PathGeometry};
use crate::spatial::SpatialForce;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Classes of forces that do nothing without a control.
const WITHOUT_CONTROL: [&str; 2] = ["BodyActuator", "ActivationCoordinateActuator"];
/// Step of differences of coordinates [rad or m] and speeds.
const STEP: f64 = 1e-7;
/// Constraints between bodies whose response is smaller than this share of the largest are redundant.
const REDUNDANT: f64 = 1e-10;

/// A muscle of the plant.
#[derive(Clone, Debug)]
pub struct PlantMuscle {
    /// Forces.
    pub muscle: MuscleModel,
    /// Path.
    pub path: Path,
    /// Position of its activation in the state.
    pub activation: Option<usize>,
    /// Position of its fibre length (or what takes its place) in the state.
    pub fiber_length: Option<usize>,
    /// Position of its fibre velocity in the state.
    pub fiber_velocity: Option<usize>,
}

impl PlantMuscle {
    /// Its states; an activation that is none is the excitation.
    fn state(&self, x: &[f64], excitation: f64) -> MuscleState {
        MuscleState {
            activation: self.activation.map_or(excitation, |i| x[i]),
            fiber_length: self.fiber_length.map_or(f64::NAN, |i| x[i]),
            fiber_velocity: self.fiber_velocity.map_or(0.0, |i| x[i]),
        }
    }
}

/// A force from outside: of coordinates, kinematics and time.
pub type Load = Arc<dyn Fn(&Model, &[f64], &Cache, f64, &mut AppliedForces) + Send + Sync>;

/// Forces from outside.
#[derive(Clone, Default)]
struct Loads(Vec<Load>);

impl std::fmt::Debug for Loads {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} loads", self.0.len())
    }
}

/// A model ready to be simulated forward. Immutable.
#[derive(Clone, Debug)]
pub struct Plant {
    /// The skeleton.
    pub model: Model,
    /// Free and dependent coordinates.
    pub reduction: Reduction,
    /// Constraints between bodies.
    joining: Constraints,
    /// Rate at which violations of constraints between bodies decay while the plant is integrated [1/s] (Baumgarte);
    /// 0: accelerations satisfy the constraints and nothing else.
    pub stabilization: f64,
    /// Muscles that apply force, in the order of the file.
    pub muscles: Vec<PlantMuscle>,
    forces: Forces,
    path_forces: Vec<(Path, PathForce)>,
    loads: Loads,
    /// Positions of dissipated energies in the state.
    energies: std::ops::Range<usize>,
    n_states: usize,
}

/// A state of the plant, named.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantState {
    /// All coordinates [rad or m].
    pub q: Vec<f64>,
    /// All speeds [rad/s or m/s].
    pub u: Vec<f64>,
    /// Activation of every muscle.
    pub activation: Vec<f64>,
    /// Fibre length of every muscle [m], or what its class has in its place ([`MuscleState`]).
    pub fiber_length: Vec<f64>,
    /// Fibre velocity of every muscle [m/s], where it is a state.
    pub fiber_velocity: Vec<f64>,
    /// Energy that every `BushingForce` has taken up [J].
    pub dissipated_energy: Vec<f64>,
}

/// Buffers for evaluations of a [`Plant`].
pub struct Work {
    cache: Cache,
    buffers: DynamicsBuffers,
    relation: Relation,
    applied: AppliedForces,
    paths: Vec<PathGeometry>,
    path_forces: Vec<PathGeometry>,
    /// Moment arms of every muscle for all speeds, not reduced.
    unit_forces: Vec<Vec<f64>>,
    unit_path_forces: Vec<Vec<f64>>,
    body_forces: Vec<SpatialForce>,
    q: Vec<f64>,
    u: Vec<f64>,
    time: f64,
    qdot: Vec<f64>,
    generalized: Vec<f64>,
    mass: DMatrix<f64>,
    reduced_mass: DMatrix<f64>,
    right: DVector<f64>,
    joint: Option<Joint>,
    /// Tendon forces [N].
    pub tendon_force: Vec<f64>,
}

/// What constraints between bodies make of free accelerations at one state.
struct Joint {
    /// Derivatives of the constraints by the free speeds.
    rows: DMatrix<f64>,
    /// Accelerations by multipliers.
    response: DMatrix<f64>,
    /// Pseudo-inverse of `rows · response`.
    inverse: DMatrix<f64>,
}

impl Joint {
    /// Accelerations with the constraints, from those without.
    fn correct(&self, accelerations: &mut DVector<f64>, wanted: Option<&DVector<f64>>) {
        let mut violation = &self.rows * &*accelerations;
        if let Some(wanted) = wanted {
            violation -= wanted;
        }
        *accelerations -= &self.response * (&self.inverse * violation);
    }
}

impl Plant {
    /// Compiles a model with all that moves it.
    ///
    /// - `allow_unsupported`: leave out forces that are not computed, instead of refusing them
    ///
    /// # Errors
    /// Any component that cannot be built, or is not computed.
    pub fn compile(spec: &ModelSpec, model: &Model, allow_unsupported: bool) -> Result<Plant, PlantError> {
        let reduction = Reduction::new(model, true)?;
        let joining = Constraints::compile(spec, model, false, false)?.between_bodies();
        let forces = Forces::compile(spec, model)?;
        let acts = |class: &str| !WITHOUT_CONTROL.contains(&class);
        let mut unsupported: Vec<_> = forces.unsupported.iter().filter(|(_, class)| acts(class)).cloned().collect();
        let mut muscles = Vec::new();
        let mut n_states = 2 * reduction.n_free();
        for muscle in spec.muscles.iter().filter(|m| m.applies_force) {
            let path = Path::compile(&muscle.path, spec, model)?;
            let muscle = match MuscleModel::from_spec(muscle) {
                Ok(muscle) => muscle,
                Err(crate::muscles::MuscleError::NotMillard2012 { muscle, class }) => {
                    unsupported.push((muscle, class));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let mut next = |exists: bool| {
                exists.then(|| {
                    n_states += 1;
                    n_states - 1
                })
            };
            let activation = next(!muscle.ignore_activation_dynamics());
            let fiber_length = next(!muscle.ignore_tendon_compliance());
            let fiber_velocity = next(muscle.has_velocity_state());
            muscles.push(PlantMuscle { muscle, path, activation, fiber_length, fiber_velocity });
        }
        if !unsupported.is_empty() && !allow_unsupported {
            return Err(PlantError::UnsupportedForces { forces: unsupported });
        }
        let path_forces = forces
            .along_paths
            .iter()
            .map(|force| Ok((Path::compile(&force.path, spec, model)?, force.law.clone())))
            .collect::<Result<_, PlantError>>()?;
        let energies = n_states..n_states + forces.dampers().count();
        let (model, loads, n_states) = (model.clone(), Loads::default(), energies.end);
        Ok(Plant {
            model,
            reduction,
            joining,
            stabilization: 0.0,
            muscles,
            forces,
            path_forces,
            loads,
            energies,
            n_states,
        })
    }

    /// The same with a force from outside.
    pub fn with_load(mut self, load: Load) -> Plant {
        self.loads.0.push(load);
        self
    }

    /// Number of states.
    pub fn n_states(&self) -> usize {
        self.n_states
    }

    /// Buffers.
    pub fn new_work(&self) -> Work {
        let (n, free) = (self.model.n_coordinates(), self.reduction.n_free());
        Work {
            cache: self.model.new_cache(),
            buffers: self.model.new_dynamics_buffers(),
            relation: self.reduction.new_relation(&self.model),
            applied: AppliedForces::new(&self.model),
            paths: self.muscles.iter().map(|m| m.path.new_geometry()).collect(),
            path_forces: self.path_forces.iter().map(|(path, _)| path.new_geometry()).collect(),
            unit_forces: vec![vec![0.0; n]; self.muscles.len()],
            unit_path_forces: vec![vec![0.0; n]; self.path_forces.len()],
            body_forces: vec![SpatialForce::default(); self.model.n_bases()],
            q: self.model.default_coordinates(),
            u: vec![0.0; n],
            time: 0.0,
            qdot: vec![0.0; n],
            generalized: vec![0.0; n],
            mass: DMatrix::zeros(n, n),
            reduced_mass: DMatrix::zeros(free, free),
            right: DVector::zeros(free),
            joint: None,
            tendon_force: vec![0.0; self.muscles.len()],
        }
    }

    /// The state vector of a named state; dependent coordinates are not looked at.
    pub fn pack(&self, state: &PlantState) -> Vec<f64> {
        let free = &self.reduction.free;
        let mut x: Vec<f64> = free.iter().map(|i| state.q[*i]).chain(free.iter().map(|i| state.u[*i])).collect();
        x.resize(self.n_states, 0.0);
        for (k, muscle) in self.muscles.iter().enumerate() {
            if let Some(i) = muscle.activation {
                x[i] = state.activation[k];
            }
            if let Some(i) = muscle.fiber_length {
                x[i] = state.fiber_length[k];
            }
            if let Some(i) = muscle.fiber_velocity {
                x[i] = state.fiber_velocity[k];
            }
        }
        x[self.energies.clone()].iter_mut().zip(&state.dissipated_energy).for_each(|(x, energy)| *x = *energy);
        x
    }

    /// The named state of a state vector; activations that are no states are the excitations, fibre lengths of rigid
    /// tendons NaN.
    pub fn unpack(&self, time: f64, x: &[f64], excitation: &[f64], work: &mut Work) -> PlantState {
        let free = self.reduction.n_free();
        let (mut q, mut u) = (work.q.clone(), work.u.clone());
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (&mut q, &mut u), &mut work.relation);
        let activation = |(k, m): (usize, &PlantMuscle)| m.activation.map_or(excitation[k], |i| x[i]);
        PlantState {
            q,
            u,
            activation: self.muscles.iter().enumerate().map(activation).collect(),
            fiber_length: self.muscles.iter().map(|m| m.fiber_length.map_or(f64::NAN, |i| x[i])).collect(),
            fiber_velocity: self.muscles.iter().map(|m| m.fiber_velocity.map_or(0.0, |i| x[i])).collect(),
            dissipated_energy: x[self.energies.clone()].to_vec(),
        }
    }

    /// A state at rest muscles: given coordinates and speeds, activations, and the fibre lengths at which fibre and
    /// tendon balance.
    ///
    /// # Errors
    /// A muscle that cannot be balanced.
    pub fn equilibrium_state(
        &self,
        time: f64,
        q: &[f64],
        u: &[f64],
        activation: &[f64],
        work: &mut Work,
    ) -> Result<PlantState, PlantError> {
        let fiber_length = vec![f64::NAN; self.muscles.len()];
        let mut state = PlantState {
            q: q.to_vec(),
            u: u.to_vec(),
            activation: activation.to_vec(),
            fiber_length,
            fiber_velocity: vec![0.0; self.muscles.len()],
            dissipated_energy: vec![0.0; self.energies.len()],
        };
        let x = self.pack(&state);
        let free = self.reduction.n_free();
        let (mut q, mut u) = (q.to_vec(), u.to_vec());
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (&mut q, &mut u), &mut work.relation);
        self.model.update_positions(&q, &mut work.cache);
        for (k, muscle) in self.muscles.iter().enumerate() {
            muscle.path.update(&q, &work.cache, &mut work.paths[k]);
            let length = work.paths[k].length();
            state.fiber_length[k] = muscle.muscle.equilibrium(length, 0.0, activation[k])?;
        }
        (state.q, state.u) = (q, u);
        Ok(state)
    }

    /// Positions and velocities of everything at a state.
    fn update_skeleton(&self, time: f64, x: &[f64], work: &mut Work) {
        let free = self.reduction.n_free();
        work.time = time;
        let Work { relation, q, u, qdot, cache, .. } = work;
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (q, u), relation);
        self.model.update_positions(q, cache);
        self.model.update_joint_axes(q, cache);
        self.model.update_velocities_of_speeds(q, u, cache);
        self.model.rates_of_speeds(cache, u, qdot);
    }

    /// Lengths of all paths and what unit tension does.
    fn update_paths(&self, work: &mut Work) {
        let Work { q, cache, paths, path_forces, unit_forces, unit_path_forces, body_forces, .. } = work;
        let muscles = self.muscles.iter().map(|m| &m.path).zip(paths.iter_mut()).zip(unit_forces.iter_mut());
        let others = self.path_forces.iter().map(|p| &p.0).zip(path_forces.iter_mut()).zip(unit_path_forces.iter_mut());
        for ((path, geometry), unit) in muscles.chain(others) {
            path.update(q, cache, geometry);
            body_forces.fill(SpatialForce::default());
            unit.fill(0.0);
            path.unit_tension(
                q,
                cache,
                geometry,
                |base, point, force| {
                    let offset = point - cache.X_GB(base).p;
                    body_forces[base.0] += SpatialForce::from_force_at(&offset, force);
                },
                |c: CoordinateIndex, force| unit[c.0] += force,
            );
            self.model.gather(cache, body_forces, unit);
        }
    }

    /// Rates of muscle states, and tendon forces into `work`.
    fn muscle_rates(&self, x: &[f64], excitation: &[f64], work: &mut Work, rates: &mut [f64]) {
        for (k, m) in self.muscles.iter().enumerate() {
            let length = work.paths[k].length();
            let speed = m.path.lengthening_speed(&work.q, &work.qdot, &work.cache, &work.paths[k]);
            let state = m.state(x, excitation[k]);
            let found = m.muscle.rates(state, length, speed);
            work.tendon_force[k] = found.tendon_force;
            if let Some(i) = m.activation {
                rates[i] = m.muscle.activation_rate(state.activation, excitation[k]);
            }
            if let Some(i) = m.fiber_length {
                rates[i] = found.fiber_length;
            }
            if let Some(i) = m.fiber_velocity {
                rates[i] = found.fiber_velocity;
            }
        }
        for (i, bushing) in self.energies.clone().zip(self.forces.dampers()) {
            rates[i] = bushing.dissipated_power(&self.model, &work.cache);
        }
    }

    /// Forces of springs, bushings, limits and everything along paths.
    fn collect_forces(&self, work: &mut Work) {
        let Work { q, qdot, cache, applied, time, .. } = work;
        applied.clear();
        self.forces.apply(&self.model, q, qdot, cache, applied);
        self.forces.over_time.iter().for_each(|force| force.apply(&self.model, *time, cache, applied));
        self.loads.0.iter().for_each(|load| load(&self.model, q, cache, *time, applied));
        let muscles = work.unit_forces.iter().zip(work.tendon_force.iter().copied());
        for (unit, tension) in muscles {
            applied.mobility.iter_mut().zip(unit).for_each(|(f, r)| *f += r * tension);
        }
        for ((path, law), (geometry, unit)) in
            self.path_forces.iter().zip(work.path_forces.iter().zip(&work.unit_path_forces))
        {
            let tension = law.tension(geometry.length(), path.lengthening_speed(q, qdot, cache, geometry));
            applied.mobility.iter_mut().zip(unit).for_each(|(f, r)| *f += r * tension);
        }
    }

    /// Accelerations of the free coordinates from the forces in `work`.
    fn accelerate(&self, work: &mut Work, rates: &mut [f64]) -> Result<(), DynamicsError> {
        self.collect_forces(work);
        let Work {
            relation,
            q,
            u,
            time,
            qdot,
            cache,
            buffers,
            applied,
            generalized,
            mass,
            reduced_mass,
            right,
            joint,
            ..
        } = work;
        self.model.update_accelerations_of_speeds(q, u, relation.bias(), cache);
        self.model.inverse_dynamics(cache, &applied.bodies, buffers, generalized);
        generalized.iter_mut().zip(&applied.mobility).for_each(|(g, f)| *g = f - *g);
        relation.reduce(generalized, right);
        self.model.update_mass_matrix(cache, buffers, mass);
        relation.reduce_matrix(mass, reduced_mass);
        let free = right.len();
        if !right.iter().all(|x| x.is_finite()) {
            return Err(DynamicsError::NotFinite);
        }
        let Some(solver) = reduced_mass.clone().cholesky() else {
            let names = self.reduction.free.iter().map(|i| self.model.coordinates[*i].name.clone());
            return Err(DynamicsError::Massless { coordinates: names.collect() });
        };
        solver.solve_mut(right);
        *joint = None;
        if self.joining.n_rows() > 0 {
            // The cache has accelerations of the bias, so that the right sides are less what it does.
            let at = self.joining.rows(&self.model, *time, q, qdot, cache);
            let rows = relation.reduce_columns(&at.G, free);
            let response = solver.solve(&rows.transpose());
            let compliance = &rows * &response;
            let smallest = REDUNDANT * compliance.amax();
            let inverse = compliance.pseudo_inverse(smallest).map_err(|_| DynamicsError::NotFinite)?;
            let speeds = &at.G * DVector::from_column_slice(u) - &at.v;
            let rate = self.stabilization;
            let wanted = at.b - speeds * (2.0 * rate) - at.error * (rate * rate);
            let found = Joint { rows, response, inverse };
            found.correct(right, Some(&wanted));
            *joint = Some(found);
        }
        rates[free..2 * free].copy_from_slice(right.as_slice());
        for (k, i) in self.reduction.free.iter().enumerate() {
            rates[k] = qdot[*i];
        }
        Ok(())
    }

    /// Rates of all states.
    ///
    /// - `excitation`: of every muscle
    ///
    /// # Errors
    /// Massless parts that can move; states that are not finite.
    pub fn rates(
        &self,
        time: f64,
        x: &[f64],
        excitation: &[f64],
        work: &mut Work,
        rates: &mut [f64],
    ) -> Result<(), DynamicsError> {
        if !x.iter().all(|x| x.is_finite()) {
            return Err(DynamicsError::NotFinite);
        }
        self.update_skeleton(time, x, work);
        self.update_paths(work);
        self.muscle_rates(x, excitation, work, rates);
        self.accelerate(work, rates)
    }

    /// All forces of the model at a state, muscles among those along speeds; gravity is not among them.
    ///
    /// - `x`, `excitation`, `work`: as last given to [`Plant::rates`]
    pub fn applied_forces(&self, x: &[f64], excitation: &[f64], work: &mut Work) -> AppliedForces {
        let mut rates = vec![0.0; self.n_states];
        self.muscle_rates(x, excitation, work, &mut rates);
        self.collect_forces(work);
        work.applied.clone()
    }

    /// Derivatives of the rates by the states: muscles exactly, coordinates and speeds by differences.
    ///
    /// # Errors
    /// As [`Plant::rates`].
    pub fn jacobian(
        &self,
        time: f64,
        x: &[f64],
        excitation: &[f64],
        work: &mut Work,
        jacobian: &mut DMatrix<f64>,
    ) -> Result<(), DynamicsError> {
        let free = self.reduction.n_free();
        jacobian.fill(0.0);
        let (mut base, mut moved) = (vec![0.0; self.n_states], vec![0.0; self.n_states]);
        let mut at = x.to_vec();
        for j in 0..free {
            at[j] = x[j] + STEP;
            self.rates(time, &at, excitation, work, &mut moved)?;
            at[j] = x[j] - STEP;
            self.rates(time, &at, excitation, work, &mut base)?;
            at[j] = x[j];
            for i in 0..self.n_states {
                jacobian[(i, j)] = (moved[i] - base[i]) / (2.0 * STEP);
            }
        }
        self.rates(time, x, excitation, work, &mut base)?;
        let solver = work.reduced_mass.clone().cholesky().ok_or(DynamicsError::NotFinite)?;
        let mut column = DVector::zeros(free);
        for (k, m) in self.muscles.iter().enumerate() {
            let length = work.paths[k].length();
            let speed = m.path.lengthening_speed(&work.q, &work.qdot, &work.cache, &work.paths[k]);
            let state = m.state(x, excitation[k]);
            let by = m.muscle.linearize(state, length, speed);
            // Acceleration by tension.
            work.relation.reduce(&work.unit_forces[k], &mut column);
            solver.solve_mut(&mut column);
            if let Some(joint) = &work.joint {
                joint.correct(&mut column, None);
            }
            for (position, by) in [m.activation, m.fiber_length, m.fiber_velocity].into_iter().zip(by) {
                let Some(j) = position else { continue };
                (0..free).for_each(|i| jacobian[(free + i, j)] = column[i] * by.tendon_force);
                if let Some(i) = m.fiber_length {
                    jacobian[(i, j)] = by.fiber_length;
                }
                if let Some(i) = m.fiber_velocity {
                    jacobian[(i, j)] = by.fiber_velocity;
                }
            }
            if let Some(i) = m.activation {
                jacobian[(i, i)] = m.muscle.activation_rate_slope(state.activation, excitation[k]);
            }
        }
        // Speeds leave the paths as they are.
        for j in free..2 * free {
            at[j] = x[j] + STEP;
            self.update_skeleton(time, &at, work);
            self.muscle_rates(&at, excitation, work, &mut moved);
            self.accelerate(work, &mut moved)?;
            at[j] = x[j];
            for i in 0..self.n_states {
                jacobian[(i, j)] = (moved[i] - base[i]) / STEP;
            }
        }
        Ok(())
    }
}

/// A plant driven by excitations that are functions of time.
pub struct DrivenPlant<'a, E: FnMut(f64, &mut [f64])> {
    /// The plant.
    pub plant: &'a Plant,
    /// Buffers.
    pub work: Work,
    /// Excitation of every muscle at a time.
    pub excite: E,
    excitation: Vec<f64>,
}

impl<'a, E: FnMut(f64, &mut [f64])> DrivenPlant<'a, E> {
    /// A plant and its excitations.
    pub fn new(plant: &'a Plant, excite: E) -> Self {
        DrivenPlant { plant, work: plant.new_work(), excite, excitation: vec![0.0; plant.muscles.len()] }
    }

    /// Excitations at a time.
    pub fn excitation(&mut self, time: f64) -> &[f64] {
        (self.excite)(time, &mut self.excitation);
        &self.excitation
    }
}

impl<E: FnMut(f64, &mut [f64])> StiffSystem for DrivenPlant<'_, E> {
    type Error = DynamicsError;

    fn derivative(&mut self, time: f64, x: &[f64], derivative: &mut [f64]) -> Result<(), DynamicsError> {
        (self.excite)(time, &mut self.excitation);
        self.plant.rates(time, x, &self.excitation, &mut self.work, derivative)
    }

    fn jacobian(&mut self, time: f64, x: &[f64], jacobian: &mut DMatrix<f64>) -> Result<(), DynamicsError> {
        (self.excite)(time, &mut self.excitation);
        self.plant.jacobian(time, x, &self.excitation, &mut self.work, jacobian)
    }
}
