//! The whole model as a system of differential equations: skeleton, muscles, passive forces.
//!
//! State: free coordinates, their speeds, of every muscle the activation (unless it ignores activation dynamics) and
//! the fibre length (unless its tendon is rigid), dissipated energies, and activations of actuators that are no
//! muscles.

mod linearize;
pub(super) mod states;

use super::constraints::Constraints;
use super::error::{DynamicsError, PlantError};
use super::mass::MassSolver;
use super::reduction::{Reduction, Relation};
use super::solve::without_solution;
use crate::forces::{Actuator, AppliedForces, Forces, PathForce};
use crate::multibody::{BodySubset, Cache, DynamicsBuffers, Model};
use crate::muscles::{MuscleModel, MuscleState};
use crate::paths::{Path, PathGeometry};
use carpus_numerics::numerics::{StiffSystem, is_finite};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::spec::{CoordinateIndex, ModelSpec};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Classes of forces that do nothing without a control.
const WITHOUT_CONTROL: [&str; 1] = ["BodyActuator"];
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
            equilibrium_state: self.fiber_length.map_or(f64::NAN, |i| x[i]),
            fiber_velocity: self.fiber_velocity.map_or(0.0, |i| x[i]),
        }
    }
}

/// A force from outside: of coordinates and speeds, kinematics and time.
pub type Load = Arc<dyn Fn(&Model, [&[f64]; 2], &Cache, f64, &mut AppliedForces) + Send + Sync>;

/// An actuator that is no muscle and follows its control with a delay of first order.
#[derive(Clone, Debug)]
pub struct LaggedActuator {
    /// Its force for an activation of 1; `None`: it applies none.
    pub actuator: Option<Actuator>,
    /// Time constant [s].
    pub time_constant: f64,
}

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
    /// Constraints that the reduction does not satisfy: between bodies, above all.
    joining: Constraints,
    /// Rate at which violations of those constraints decay while the plant is integrated [1/s] (Baumgarte);
    /// 0: accelerations satisfy the constraints and nothing else.
    pub stabilization: f64,
    /// Muscles that apply force, in the order of the file.
    pub muscles: Vec<PlantMuscle>,
    forces: Forces,
    path_forces: Vec<(Path, PathForce)>,
    /// For the path of every muscle, then of every other force along a path: its bodies and those inboard of them.
    bodies_of_paths: Vec<BodySubset>,
    /// For the same: the free coordinates that it depends on, by their positions.
    coordinates_of_paths: Vec<Vec<bool>>,
    loads: Loads,
    /// Positions of dissipated energies in the state.
    energies: std::ops::Range<usize>,
    lagged: Vec<LaggedActuator>,
    n_states: usize,
}

/// Buffers for evaluations of a [`Plant`].
pub struct Work {
    cache: Cache,
    buffers: DynamicsBuffers,
    relation: Relation,
    applied: AppliedForces,
    /// Paths of muscles, then of other forces along paths.
    paths: Vec<PathGeometry>,
    body_forces: Vec<SpatialForce>,
    q: Vec<f64>,
    u: Vec<f64>,
    /// Activations of lagged actuators.
    lagged: Vec<f64>,
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
        let joining = Constraints::compile(spec, model, true, true)?.beyond(&reduction).kept_in_motion();
        let forces = Forces::compile(spec, model)?;
        let acts = |class: &str| !WITHOUT_CONTROL.contains(&class);
        let mut unsupported: Vec<_> = forces.unsupported.iter().filter(|(_, class)| acts(class)).cloned().collect();
        let mut muscles = Vec::new();
        let mut n_states = 2 * reduction.n_free();
        for muscle in spec.muscles.iter().filter(|m| m.applies_force) {
            let path = Path::compile(&muscle.path, spec, model)?;
            let muscle = match MuscleModel::from_spec(muscle) {
                Ok(muscle) => muscle,
                Err(crate::muscles::MuscleError::NotComputed { muscle, class }) => {
                    unsupported.push((muscle, class));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            muscle.require_rates()?;
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
        let mut plant = Plant {
            model,
            reduction,
            joining,
            stabilization: 0.0,
            muscles,
            forces,
            path_forces,
            bodies_of_paths: Vec::new(),
            coordinates_of_paths: Vec::new(),
            loads,
            energies,
            lagged: Vec::new(),
            n_states,
        };
        plant.bodies_of_paths = plant.paths().map(|path| plant.model.body_subset(&path.bodies())).collect();
        let free = plant.reduction.free.iter().map(|i| CoordinateIndex(*i));
        let depends = |path: &Path| free.clone().map(|c| path.depends_on(&plant.model, c)).collect();
        plant.coordinates_of_paths = plant.paths().map(depends).collect();
        Ok(plant)
    }

    /// Paths of muscles, then of other forces along paths.
    fn paths(&self) -> impl Iterator<Item = &Path> {
        self.muscles.iter().map(|m| &m.path).chain(self.path_forces.iter().map(|(path, _)| path))
    }

    /// The same with a force from outside.
    pub fn with_load(mut self, load: Load) -> Plant {
        self.loads.0.push(load);
        self
    }

    /// The same with actuators that follow their controls with a delay; their controls come after the muscles'
    /// excitations.
    pub fn with_lagged_actuators(mut self, actuators: Vec<LaggedActuator>) -> Plant {
        self.n_states = self.energies.end + actuators.len();
        self.lagged = actuators;
        self
    }

    /// Number of excitations: of the muscles, then of lagged actuators.
    pub fn n_excitations(&self) -> usize {
        self.muscles.len() + self.lagged.len()
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
            paths: self.paths().map(Path::new_geometry).collect(),
            body_forces: vec![SpatialForce::default(); self.model.n_bases()],
            q: self.model.default_coordinates(),
            u: vec![0.0; n],
            lagged: vec![0.0; self.lagged.len()],
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

    /// Positions and velocities of everything at a state.
    fn update_skeleton(&self, time: f64, x: &[f64], work: &mut Work) {
        let free = self.reduction.n_free();
        work.time = time;
        work.lagged.copy_from_slice(&x[self.energies.end..]);
        let Work { relation, q, u, qdot, cache, .. } = work;
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (q, u), relation);
        self.model.update_positions(q, cache);
        self.model.update_joint_axes(q, cache);
        self.model.update_velocities_of_speeds(q, u, cache);
        self.model.rates_of_speeds(cache, u, qdot);
    }

    /// Lengths of all paths.
    fn update_paths(&self, work: &mut Work) {
        let Work { q, cache, paths, .. } = work;
        self.paths().zip(paths).for_each(|(path, geometry)| path.update(q, cache, geometry));
    }

    /// Moment arms of one path for all speeds, not reduced.
    fn arms(&self, number: usize, path: &Path, work: &mut Work, arms: &mut [f64]) {
        let Work { q, cache, paths, body_forces, .. } = work;
        body_forces.fill(SpatialForce::default());
        arms.fill(0.0);
        path.unit_tension(
            q,
            cache,
            &paths[number],
            |base, point, force| {
                let offset = point - cache.X_GB(base).p;
                body_forces[base.0] += SpatialForce::from_force_at(&offset, force);
            },
            |c: CoordinateIndex, force| arms[c.0] += force,
        );
        self.model.gather_in(&self.bodies_of_paths[number], cache, body_forces, arms);
    }

    /// Adds what a tension does to bodies and coordinates.
    fn pull(path: &Path, geometry: &PathGeometry, tension: f64, q: &[f64], cache: &Cache, applied: &mut AppliedForces) {
        if tension == 0.0 {
            return;
        }
        let AppliedForces { mobility, bodies } = applied;
        path.unit_tension(
            q,
            cache,
            geometry,
            |base, point, force| {
                let offset = point - cache.X_GB(base).p;
                bodies[base.0] += SpatialForce::from_force_at(&offset, &(tension * force));
            },
            |c, force| mobility[c.0] += tension * force,
        );
    }

    /// Tension of a force along a path that is no muscle.
    fn tension(&self, number: usize, work: &Work) -> f64 {
        let ((path, law), geometry) = (&self.path_forces[number], &work.paths[self.muscles.len() + number]);
        law.tension(geometry.length(), path.lengthening_speed(&work.q, &work.qdot, &work.cache, geometry))
    }

    /// Rates of the states of one muscle, and its tendon force into `work`.
    fn muscle_rate(&self, k: usize, x: &[f64], excitation: &[f64], work: &mut Work, rates: &mut [f64]) {
        let m = &self.muscles[k];
        let length = work.paths[k].length();
        let speed = match m.muscle.depends_on_path_speed() {
            true => m.path.lengthening_speed(&work.q, &work.qdot, &work.cache, &work.paths[k]),
            false => 0.0,
        };
        let state = m.state(x, excitation[k]);
        let found = m.muscle.rates(state, length, speed);
        work.tendon_force[k] = found.tendon_force;
        if let Some(i) = m.activation {
            rates[i] = m.muscle.activation_rate(state.activation, excitation[k]);
        }
        if let Some(i) = m.fiber_length {
            rates[i] = found.equilibrium_state;
        }
        if let Some(i) = m.fiber_velocity {
            rates[i] = found.fiber_velocity;
        }
    }

    /// Rates of the states of muscles and lagged actuators and of dissipated energies, and tendon forces into `work`.
    fn muscle_rates(&self, x: &[f64], excitation: &[f64], work: &mut Work, rates: &mut [f64]) {
        (0..self.muscles.len()).for_each(|k| self.muscle_rate(k, x, excitation, work, rates));
        self.energy_rates(work, rates);
        let controls = excitation[self.muscles.len()..].iter().zip(&self.lagged);
        for (i, (control, lagged)) in (self.energies.end..).zip(controls) {
            rates[i] = (control - x[i]) / lagged.time_constant;
        }
    }

    fn energy_rates(&self, work: &Work, rates: &mut [f64]) {
        for (i, damper) in self.energies.clone().zip(self.forces.dampers()) {
            rates[i] = damper.dissipated_power(&self.model, &work.q, &work.u, &work.cache);
        }
    }

    /// How far the nearest bushing with a pole is from it: |cos θy| (1 without any), at the positions in `work`.
    pub(super) fn pole_margin(&self, work: &Work) -> f64 {
        let margins = self.forces.bushings().filter(|b| b.has_pole()).map(|b| b.pole_margin(&self.model, &work.cache));
        margins.fold(1.0, f64::min)
    }

    /// Forces of springs, bushings, limits, lagged actuators and loads.
    fn collect_forces(&self, work: &mut Work) {
        let Work { q, u, lagged, cache, applied, time, .. } = work;
        applied.clear();
        self.forces.apply(&self.model, q, u, cache, applied);
        self.forces.over_time.iter().for_each(|force| force.apply(&self.model, *time, cache, applied));
        for (own, activation) in self.lagged.iter().zip(lagged) {
            if let Some(actuator) = &own.actuator {
                actuator.apply(&self.model, cache, *activation * actuator.optimal_force, applied);
            }
        }
        self.loads.0.iter().for_each(|load| load(&self.model, [q, u], cache, *time, applied));
    }

    /// Forces along paths, added to those collected.
    fn collect_tensions(&self, work: &mut Work) {
        for k in 0..work.paths.len() {
            let muscles = self.muscles.len();
            let (path, tension) = match k.checked_sub(muscles) {
                None => (&self.muscles[k].path, work.tendon_force[k]),
                Some(other) => (&self.path_forces[other].0, self.tension(other, work)),
            };
            Self::pull(path, &work.paths[k], tension, &work.q, &work.cache, &mut work.applied);
        }
    }

    /// Accelerations of the free coordinates from the forces in `work`.
    fn accelerate(&self, work: &mut Work, rates: &mut [f64]) -> Result<(), DynamicsError> {
        self.collect_forces(work);
        self.collect_tensions(work);
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
        let Some(solver) = MassSolver::of(reduced_mass.clone()) else {
            let names = self.reduction.free.iter().map(|i| self.model.coordinates[*i].name.clone());
            return Err(without_solution(&self.model, || DynamicsError::Massless { coordinates: names.collect() }));
        };
        solver.solve_mut(right);
        *joint = None;
        if self.joining.n_rows() > 0 {
            // The cache has accelerations of the bias, so that the right sides are less what it does.
            let at = self.joining.rows(&self.model, *time, (q, qdot), Some(relation.bias()), cache);
            let rows = relation.reduce_columns(&at.G, free);
            let mut response = rows.transpose();
            solver.solve_columns_mut(&mut response);
            let compliance = &rows * &response;
            let smallest = REDUNDANT * compliance.amax();
            if !is_finite(&compliance) {
                return Err(DynamicsError::NotFinite);
            }
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

    /// How far the nearest bushing with a pole is from it at a state: |cos θy|, 1 without any.
    pub fn pole_margin_at(&self, time: f64, x: &[f64], work: &mut Work) -> f64 {
        if !self.forces.bushings().any(|bushing| bushing.has_pole()) {
            return 1.0;
        }
        let free = self.reduction.n_free();
        let Work { relation, q, u, cache, .. } = work;
        self.reduction.expand(time, (&x[..free], &x[free..2 * free]), (q, u), relation);
        self.model.update_positions(q, cache);
        self.pole_margin(work)
    }

    /// Rates of all states.
    ///
    /// - `excitation`: of every muscle, then of every lagged actuator
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

    /// All forces of the model at a state, muscles too; gravity is not among them.
    ///
    /// - `x`, `excitation`, `work`: as last given to [`Plant::rates`]
    pub fn applied_forces(&self, x: &[f64], excitation: &[f64], work: &mut Work) -> AppliedForces {
        let mut rates = vec![0.0; self.n_states];
        self.muscle_rates(x, excitation, work, &mut rates);
        self.collect_forces(work);
        self.collect_tensions(work);
        work.applied.clone()
    }
}

/// A plant driven by excitations that are functions of time.
pub struct DrivenPlant<'a, E: FnMut(f64, &mut [f64])> {
    /// The plant.
    pub plant: &'a Plant,
    /// Buffers.
    pub work: Work,
    /// Excitation of every muscle at a time, then of every lagged actuator.
    pub excite: E,
    excitation: Vec<f64>,
}

impl<'a, E: FnMut(f64, &mut [f64])> DrivenPlant<'a, E> {
    /// A plant and its excitations.
    pub fn new(plant: &'a Plant, excite: E) -> Self {
        DrivenPlant { plant, work: plant.new_work(), excite, excitation: vec![0.0; plant.n_excitations()] }
    }

    /// Excitations at a time.
    pub fn excitation(&mut self, time: f64) -> &[f64] {
        (self.excite)(time, &mut self.excitation);
        &self.excitation
    }
}

impl<E: FnMut(f64, &mut [f64])> StiffSystem for DrivenPlant<'_, E> {
    type Error = DynamicsError;

    fn groups(&self) -> Vec<std::ops::Range<usize>> {
        let of_muscle = |m: &PlantMuscle| {
            let states = [m.activation, m.fiber_length, m.fiber_velocity];
            let first = states.iter().flatten().next().copied();
            first.map(|first| first..first + states.iter().flatten().count())
        };
        let muscles = self.plant.muscles.iter().filter_map(of_muscle);
        muscles.chain((self.plant.energies.start..self.plant.n_states).map(|i| i..i + 1)).collect()
    }

    fn derivative(&mut self, time: f64, x: &[f64], derivative: &mut [f64]) -> Result<(), DynamicsError> {
        (self.excite)(time, &mut self.excitation);
        self.plant.rates(time, x, &self.excitation, &mut self.work, derivative)
    }

    fn jacobian(&mut self, time: f64, x: &[f64], jacobian: &mut DMatrix<f64>) -> Result<(), DynamicsError> {
        (self.excite)(time, &mut self.excitation);
        self.plant.jacobian(time, x, &self.excitation, &mut self.work, jacobian)
    }
}
