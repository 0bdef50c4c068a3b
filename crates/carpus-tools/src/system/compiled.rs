//! A model compiled with all that acts in it, and the types of its states and of what it does at them.

use std::path::{Path, PathBuf};

use super::actor::{Actor, PathActuator, SystemMuscle};
use crate::controls::Controls;
use crate::correction::Correction;
use crate::error::{ToolError, ToolProblem};
use crate::result::Outcome;
use crate::setup::{Properties, Setup};
use carpus_multibody::dynamics::{Constraints, Dynamics, DynamicsError};
use carpus_multibody::forces::{AppliedForces, Forces};
use carpus_multibody::multibody::Model;
use carpus_multibody::muscles::{EquilibriumError, MuscleDynamics, MuscleModel, MuscleState};
use carpus_multibody::paths::{Path as MusclePath, PathGeometry};
use carpus_osim::osim::Document;
use carpus_osim::osim::spec::{
    ActuatorActivation, ActuatorKind, ActuatorSpec, BodyIndex, CoordinateIndex, ForceKind, ForceSpec, FrameIndex,
    Location, ModelSpec, MotionType,
};

/// A model with all that acts in it.
#[derive(Debug)]
pub struct System {
    /// Where the model was read from.
    pub path: PathBuf,
    /// Files of forces after the model's, by [`Location::source`] from 1 on.
    force_sets: Vec<PathBuf>,
    /// The specification.
    pub spec: ModelSpec,
    /// The skeleton.
    pub model: Model,
    /// Constraints, locked and prescribed coordinates among them.
    pub constraints: Constraints,
    /// Muscles in the order of the force set.
    pub muscles: Vec<SystemMuscle>,
    /// What acts, in the order of the force set.
    pub actors: Vec<Actor>,
    /// Forces of classes that are not computed: name and class.
    pub unsupported: Vec<(String, String)>,
    /// Controls of actuators.
    pub controls: Controls,
    /// Whether results without such forces are wanted.
    pub allow_unsupported: bool,
    /// Coordinates in the order of Simbody's tree.
    pub tree_order: Vec<CoordinateIndex>,
}

/// A state of the system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SystemState {
    /// Time [s].
    pub time: f64,
    /// Coordinates.
    pub q: Vec<f64>,
    /// Speeds.
    pub u: Vec<f64>,
    /// Activation of every muscle.
    pub activation: Vec<f64>,
    /// Fibre length of every muscle [m], or what its class has in its place ([`MuscleState`]); NaN: at equilibrium.
    pub fiber_length: Vec<f64>,
    /// Fibre velocity of every muscle [m/s], where it is a state.
    pub fiber_velocity: Vec<f64>,
    /// Energy that every `BushingForce` has taken up [J].
    pub dissipated_energy: Vec<f64>,
    /// Activation of every actuator that has one.
    pub actuator_activation: Vec<f64>,
}

/// What the system does at a state.
#[derive(Debug)]
pub struct Evaluation {
    /// Length of every muscle [m].
    pub muscle_length: Vec<f64>,
    /// Lengthening speed of every muscle [m/s].
    pub muscle_speed: Vec<f64>,
    /// Everything about every muscle; `None` where the class is not computed.
    pub muscles: Vec<Option<MuscleDynamics>>,
    /// Tension of every force along a path that is no muscle, by position among the actors [N].
    pub tension: Vec<f64>,
    /// Length of the path, as the above [m].
    pub path_length: Vec<f64>,
    /// Lengthening speed of the path, as the above [m/s].
    pub path_speed: Vec<f64>,
    /// Sum of forces.
    pub applied: AppliedForces,
}

/// Buffers of evaluations.
pub struct SystemWork<'a> {
    /// Kinematics and equations of motion.
    pub dynamics: Dynamics<'a>,
    /// Paths of muscles.
    pub paths: Vec<PathGeometry>,
    pub(super) others: Vec<Option<PathGeometry>>,
}

impl System {
    /// Compiles a specification.
    ///
    /// # Errors
    /// Anything of it that cannot be built.
    pub fn of_spec(path: &Path, spec: ModelSpec) -> Result<System, ToolError> {
        System::of_files(path, &[], spec)
    }

    /// Compiles a specification that was read from several files.
    ///
    /// - `force_sets`: those after the model's, by [`Location::source`] from 1 on
    ///
    /// # Errors
    /// Anything of it that cannot be built, with the file in which it stands.
    pub fn of_files(path: &Path, force_sets: &[PathBuf], spec: ModelSpec) -> Result<System, ToolError> {
        let fail = |at: &Location, problem: ToolProblem| {
            let file = at.source.checked_sub(1).and_then(|i| force_sets.get(i));
            ToolError::at(file.map_or(path, PathBuf::as_path), at.line, problem)
        };
        let model = Model::compile(&spec).map_err(|e| fail(&e.at().clone(), e.into()))?.with_accelerations_of_opensim();
        let constraints =
            Constraints::compile(&spec, &model, true, true).map_err(|e| fail(&e.at().clone(), e.into()))?;
        let forces = Forces::compile(&spec, &model).map_err(|e| fail(&e.at().clone(), e.into()))?;
        let mut muscles = Vec::new();
        let mut actors = Vec::new();
        for muscle in &spec.muscles {
            let compiled = MusclePath::compile(&muscle.path, &spec, &model).map_err(|e| fail(&muscle.at, e.into()))?;
            // What is wrong is said by `require_all_forces`, where the muscle acts: other tools do without its force,
            // as OpenSim.
            let law = MuscleModel::from_spec(muscle).ok();
            let class = match &muscle.kind {
                carpus_osim::osim::spec::MuscleKind::OtherClass { class, .. } => class.clone(),
                _ => "Millard2012EquilibriumMuscle".to_owned(),
            };
            if muscle.applies_force {
                actors.push((muscle.at.order(), Actor::Muscle(muscles.len())));
            }
            muscles.push(SystemMuscle {
                name: muscle.name.clone(),
                path_name: muscle.at.path.clone(),
                path: compiled,
                law,
                class,
                applies_force: muscle.applies_force,
            });
        }
        let nowhere = Location::default();
        let at = |name: &str| spec.forces.iter().find(|f| f.name == name).map_or(&nowhere, |f| &f.at);
        for force in forces.forces {
            actors.push((at(&force.name).order(), Actor::Law(Box::new(force))));
        }
        for force in forces.along_paths {
            let at = at(&force.name);
            let path = MusclePath::compile(&force.path, &spec, &model).map_err(|e| fail(at, e.into()))?;
            actors
                .push((at.order(), Actor::Along { name: force.name, path: Box::new(path), law: Box::new(force.law) }));
        }
        for force in spec.forces.iter().filter(|f| f.applies_force) {
            let ForceKind::Actuator(actuator) = &force.kind else { continue };
            let ActuatorKind::Path { path } = &actuator.kind else { continue };
            let path = MusclePath::compile(path, &spec, &model).map_err(|e| fail(&force.at, e.into()))?;
            let (name, optimal_force) = (force.name.clone(), actuator.optimal_force);
            let control_range = [actuator.min_control, actuator.max_control];
            let actuator = PathActuator { name, path, optimal_force, control_range };
            actors.push((force.at.order(), Actor::PathActuator(Box::new(actuator))));
        }
        for force in forces.over_time {
            actors.push((at(&force.name).order(), Actor::OverTime(Box::new(force))));
        }
        for actuator in forces.actuators {
            actors.push((at(&actuator.name).order(), Actor::Actuator(Box::new(actuator))));
        }
        actors.sort_by_key(|(order, _)| *order);
        let actors = actors.into_iter().map(|(_, actor)| actor).collect();
        let tree_order = tree_order(&spec, &model);
        let (path, unsupported) = (path.to_owned(), forces.unsupported);
        let force_sets = force_sets.to_vec();
        let (allow_unsupported, controls) = (false, Controls::default());
        Ok(System {
            path,
            force_sets,
            spec,
            model,
            constraints,
            muscles,
            actors,
            unsupported,
            controls,
            allow_unsupported,
            tree_order,
        })
    }

    /// Buffers.
    pub fn new_work(&self) -> SystemWork<'_> {
        let geometry = |actor: &Actor| match actor {
            Actor::Along { path, .. } => Some(path.new_geometry()),
            Actor::PathActuator(actuator) => Some(actuator.path.new_geometry()),
            _ => None,
        };
        SystemWork {
            dynamics: Dynamics::new(&self.model, &self.constraints),
            paths: self.muscles.iter().map(|m| m.path.new_geometry()).collect(),
            others: self.actors.iter().map(geometry).collect(),
        }
    }

    /// The state in which OpenSim's `initSystem` leaves the model: default values, constraints satisfied if they can
    /// be.
    ///
    /// # Errors
    /// Numbers that are not finite.
    pub fn default_state(&self) -> Result<SystemState, ToolError> {
        let mut q: Vec<f64> = self.model.coordinates.iter().map(|c| c.default_value).collect();
        let mut u: Vec<f64> = self.model.coordinates.iter().map(|c| c.default_speed_value).collect();
        let given = q.clone();
        match self.assemble(0.0, &mut q) {
            Ok(()) => {}
            // What needs constraints assembles again where it starts; what does not goes on, as in OpenSim.
            Err(error)
                if matches!(
                    &*error.problem,
                    ToolProblem::Dynamics { source: DynamicsError::NotAssembled { .. }, .. }
                ) =>
            {
                q = given;
            }
            Err(error) => return Err(error),
        }
        // An open loop of joints asks nothing of them yet.
        if self.is_assembled_at_start() {
            self.project_speeds(0.0, &q, &mut u);
        }
        let of = |get: fn(MuscleState) -> f64| {
            let one = |m: &SystemMuscle| m.law.as_ref().map_or(f64::NAN, |law| get(law.default_state()));
            self.muscles.iter().map(one).collect()
        };
        Ok(SystemState {
            time: 0.0,
            q,
            u,
            activation: of(|state| state.activation),
            fiber_length: of(|state| state.equilibrium_state),
            fiber_velocity: vec![0.0; self.muscles.len()],
            dissipated_energy: vec![0.0; self.dampers().count()],
            actuator_activation: self.lagged().map(|(_, activation)| activation.default_activation).collect(),
        })
    }

    /// Moves coordinates as little as possible so that they satisfy the constraints; couplers are followed first, as in
    /// OpenSim a dependent coordinate gives way, and so does one that is free to satisfy constraints. Speeds stay as
    /// they are. A model without any constraint of its own is left as it is, loops of joints open, unless a coordinate
    /// is held (OpenSim's `Model::assemble`).
    ///
    /// # Errors
    /// Constraints that cannot be satisfied.
    pub fn assemble(&self, time: f64, q: &mut [f64]) -> Result<(), ToolError> {
        for (i, coordinate) in self.model.coordinates.iter().enumerate() {
            if let Some(function) = &coordinate.prescribed {
                q[i] = function.value(time);
            }
        }
        if !self.is_assembled_at_start() {
            return Ok(());
        }
        if self.spec.constraints.is_empty() {
            return self.project(time, q);
        }
        self.model.satisfy_couplers(q);
        let drawn: Vec<bool> = (0..q.len()).map(|i| !self.follows_constraints(i)).collect();
        let fail = |source| ToolError::new(&self.path, ToolProblem::Dynamics { time, source });
        Dynamics::new(&self.model, &self.constraints).assemble_near(time, q, &drawn).map_err(fail)
    }

    /// Whether `initSystem` looks at constraints at all: not where there are only loops of joints.
    fn is_assembled_at_start(&self) -> bool {
        !self.spec.constraints.is_empty() || (0..self.model.n_coordinates()).any(|i| self.is_constrained(i))
    }

    /// Moves coordinates onto all constraints, each as little as it must, loops of joints among them.
    ///
    /// # Errors
    /// Constraints that cannot be satisfied.
    pub fn project(&self, time: f64, q: &mut [f64]) -> Result<(), ToolError> {
        let fail = |source| ToolError::new(&self.path, ToolProblem::Dynamics { time, source });
        Dynamics::new(&self.model, &self.constraints).assemble(time, q).map_err(fail)
    }

    /// Changes speeds as little as possible so that they satisfy the constraints at `q`.
    pub fn project_speeds(&self, time: f64, q: &[f64], u: &mut [f64]) {
        if self.model.speeds_are_rates() {
            self.model.follow_couplers(q, u);
        }
        Dynamics::new(&self.model, &self.constraints).project_speeds(time, q, u);
    }

    /// Names and classes of forces that act and are not computed.
    pub fn forces_not_computed(&self, excluded: &dyn Fn(&str) -> bool) -> Vec<String> {
        let muscles = self.muscles.iter().filter(|m| m.applies_force && m.law.is_none());
        let muscles = muscles.map(|m| (m.name.clone(), m.class.clone()));
        let all = self.unsupported.iter().cloned().chain(muscles).filter(|(name, _)| !excluded(name));
        all.map(|(name, class)| format!("{name} ({class})")).collect()
    }

    /// Fails if a force that acts is of a class that is not computed, unless that is allowed.
    ///
    /// # Errors
    /// Names and classes of such forces; a muscle with parameters that make no muscle.
    pub fn require_all_forces(&self, excluded: &dyn Fn(&str) -> bool) -> Result<(), ToolError> {
        for (muscle, spec) in self.muscles.iter().zip(&self.spec.muscles) {
            if !muscle.applies_force || muscle.law.is_some() || excluded(&muscle.name) {
                continue;
            }
            match MuscleModel::from_spec(spec) {
                Ok(_) | Err(carpus_multibody::muscles::MuscleError::NotComputed { .. }) => {}
                Err(error) => {
                    let file = spec.at.source.checked_sub(1).and_then(|i| self.force_sets.get(i));
                    let file = file.map_or(self.path.as_path(), PathBuf::as_path);
                    return Err(ToolError::at(file, spec.at.line, ToolProblem::from(error)));
                }
            }
        }
        let names = self.forces_not_computed(excluded);
        if names.is_empty() || self.allow_unsupported {
            return Ok(());
        }
        let what = format!("forces that are not computed: {}", names.join(", "));
        let instead = "results would lack them; --allow-unsupported goes on without them".to_owned();
        Err(ToolError::new(&self.path, ToolProblem::Unsupported { what, instead }))
    }

    /// Length of every path, then state of every muscle at equilibrium.
    ///
    /// Muscles that cannot be balanced keep their fibre length; why is returned.
    pub fn equilibrate(&self, work: &mut SystemWork, state: &mut SystemState) -> Vec<EquilibriumError> {
        work.dynamics.update(&state.q, &state.u);
        let mut failed = Vec::new();
        for (i, muscle) in self.muscles.iter().enumerate() {
            // OpenSim balances muscles that act.
            let Some(law) = muscle.law.as_ref().filter(|_| muscle.applies_force) else { continue };
            muscle.path.update(&state.q, work.dynamics.cache(), &mut work.paths[i]);
            let (cache, qdot) = (work.dynamics.cache(), work.dynamics.qdot());
            let speed = muscle.path.lengthening_speed(&state.q, qdot, cache, &work.paths[i]);
            match law.equilibrium(work.paths[i].length(), speed, self.muscle_state(state, i).activation) {
                Ok(found) => state.fiber_length[i] = found,
                Err(error) => failed.push(error),
            }
        }
        failed
    }

    /// States of one muscle; an activation that is none is the control, 0 without one.
    pub(super) fn muscle_state(&self, state: &SystemState, i: usize) -> MuscleState {
        let muscle = &self.muscles[i];
        let is_control = muscle.law.as_ref().is_some_and(MuscleModel::ignore_activation_dynamics);
        let control = || self.controls.at(&muscle.name, state.time).unwrap_or(0.0);
        MuscleState {
            activation: if is_control { control() } else { state.activation[i] },
            equilibrium_state: state.fiber_length[i],
            fiber_velocity: state.fiber_velocity[i],
        }
    }

    /// Reads the controllers of the model and of a setup.
    ///
    /// # Errors
    /// A class that is not supported, functions that cannot be built.
    pub fn read_controllers(
        &mut self,
        document: Document,
        tool: &Properties,
        outcome: &mut Outcome,
    ) -> Result<(), ToolError> {
        let names = self.actuator_names();
        let mut controls = Controls::default();
        let own = Setup::of_document(&self.path, document);
        let model = own.object();
        // Further ones may stand among the model's other components, where they act as well.
        let others = ["ComponentSet", "components"].iter().flat_map(|list| model.members(list));
        let others = others.filter(|component| component.class().ends_with("Controller"));
        let of_model: Vec<Properties> = model.objects("ControllerSet").into_iter().chain(others).collect();
        controls.read(&of_model, &names, outcome)?;
        let of_tool = tool.objects("ControllerSet").into_iter().filter(|c| !Correction::acts_in(tool, c));
        controls.read(&of_tool.collect::<Vec<_>>(), &names, outcome)?;
        self.controls = controls;
        Ok(())
    }

    /// As [`System::read_controllers`]; controllers that are not understood are left out, with a warning, where nothing
    /// acts by its control alone.
    ///
    /// - `is_excluded`: which forces do not act, by name, whether it is a muscle, and whether any actuator
    ///
    /// # Errors
    /// Controllers that are needed and not understood.
    pub fn read_controllers_as_needed(
        &mut self,
        document: Document,
        tool: &Properties,
        is_excluded: &dyn Fn(&str, bool, bool) -> bool,
        outcome: &mut Outcome,
    ) -> Result<(), ToolError> {
        let by_control = |m: &SystemMuscle| m.law.as_ref().is_some_and(MuscleModel::ignore_activation_dynamics);
        let needed = self.actors.iter().any(|actor| {
            let (is_muscle, needs) = match actor {
                Actor::Muscle(i) => (true, by_control(&self.muscles[*i])),
                actor => (false, actor.is_actuator()),
            };
            needs && !is_excluded(actor.name(&self.muscles), is_muscle, actor.is_actuator())
        });
        match self.read_controllers(document, tool, outcome) {
            Err(error) if needed => Err(error),
            Err(error) => {
                outcome.warn(tool.setup().path(), tool.line(), format!("controllers are not used: {error}"));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Names of muscles and other forces that act but do not stand in the force set, so that OpenSim's tools neither
    /// exclude nor list them.
    pub fn outside_of_force_set(&self) -> Vec<String> {
        let muscles = self.spec.muscles.iter().map(|m| (&m.at, &m.name));
        let all = muscles.chain(self.spec.forces.iter().map(|f| (&f.at, &f.name)));
        all.filter(|(at, _)| !at.is_in_force_set()).map(|(_, name)| name.clone()).collect()
    }

    /// Names of all muscles and other actuators in the order of the file, also of those that apply no force.
    pub fn actuator_names(&self) -> Vec<String> {
        let is_actuator = |f: &&ForceSpec| matches!(f.kind, ForceKind::Actuator(_));
        let others = self.spec.forces.iter().filter(is_actuator).map(|f| (f.at.order(), &f.name));
        let mut all: Vec<_> = self.spec.muscles.iter().map(|m| (m.at.order(), &m.name)).chain(others).collect();
        all.sort_by_key(|(order, _)| *order);
        all.into_iter().map(|(_, name)| name.clone()).collect()
    }

    /// Whether a force of this name is an actuator of a class that is not computed.
    pub fn is_actuator(&self, name: &str) -> bool {
        self.unsupported.iter().any(|(n, class)| n == name && class.ends_with("Actuator"))
    }

    /// The frame of a body or ground by its name, or of any frame by its path, from the model, its bodies or its joints
    /// on.
    pub fn frame(&self, name: &str) -> Option<FrameIndex> {
        let mut steps: Vec<&str> = Vec::new();
        for step in name.split('/').filter(|step| !step.is_empty() && *step != ".") {
            match step {
                ".." => drop(steps.pop()),
                step => steps.push(step),
            }
        }
        let relative = steps.join("/");
        let at = |path: String| self.spec.frames.iter().position(|f| f.at.path == path).map(FrameIndex);
        if relative == "ground" {
            return Some(FrameIndex(0));
        }
        let sets = ["", "/bodyset", "/jointset"];
        let by_path = || sets.iter().find_map(|set| at(format!("{set}/{relative}")));
        by_path().or_else(|| self.spec.bodies.iter().find(|b| b.name == name).map(|b| b.frame))
    }

    /// The body of that name.
    pub fn body(&self, name: &str) -> Option<BodyIndex> {
        self.model.body(name)
    }

    /// Every force that applies and has the energy that its damping takes as a state: position among the forces of the
    /// specification, and the state's name.
    pub(super) fn dampers(&self) -> impl Iterator<Item = (usize, &'static str)> + '_ {
        let forces = self.spec.forces.iter().enumerate().filter(|(_, force)| force.applies_force);
        forces.filter_map(|(i, force)| match force.kind {
            ForceKind::Bushing { .. } => Some((i, "dissipated_energy")),
            ForceKind::CoordinateLimit { computes_dissipation: true, .. } => Some((i, "dissipatedEnergy")),
            _ => None,
        })
    }

    /// Every actuator that has an activation: position among the forces of the specification, and the activation.
    pub fn lagged(&self) -> impl Iterator<Item = (usize, ActuatorActivation)> + '_ {
        self.spec.forces.iter().enumerate().filter_map(|(i, force)| match &force.kind {
            ForceKind::Actuator(ActuatorSpec {
                kind: ActuatorKind::Coordinate { activation: Some(activation), .. },
                ..
            }) => Some((i, *activation)),
            _ => None,
        })
    }

    /// Force of an actuator that is no muscle at a state [N or N·m].
    pub fn actuator_force(&self, actor: &Actor, state: &SystemState) -> f64 {
        match actor {
            Actor::Actuator(actuator) if actuator.activation.is_some() => {
                let own = self.lagged().position(|(i, _)| self.spec.forces[i].name == actuator.name);
                own.map_or(0.0, |k| state.actuator_activation[k]) * actuator.optimal_force
            }
            actor => actor.controlled_force(&self.controls, state.time).unwrap_or(0.0),
        }
    }

    /// Whether a coordinate cannot be moved by a force: locked, prescribed, dependent, or free to satisfy constraints
    /// (`Coordinate::isConstrained`).
    pub fn is_constrained(&self, coordinate: usize) -> bool {
        let c = &self.model.coordinates[coordinate];
        c.locked || c.prescribed.is_some() || self.follows_constraints(coordinate)
    }

    /// Whether constraints give a coordinate its value: a coupler's dependent one, or one that is free to satisfy them
    /// (`Coordinate::isDependent`).
    fn follows_constraints(&self, coordinate: usize) -> bool {
        self.model.coordinates[coordinate].is_free_to_satisfy_constraints
            || self.model.is_dependent(CoordinateIndex(coordinate))
    }

    /// Whether a coordinate is an angle in OpenSim's files.
    pub fn is_angle(&self, coordinate: usize) -> bool {
        self.model.coordinates[coordinate].motion_type == MotionType::Rotational
    }
}

/// Coordinates by distance of their joint from ground, then in the order of the model: Simbody numbers speeds level by
/// level.
fn tree_order(spec: &ModelSpec, model: &Model) -> Vec<CoordinateIndex> {
    let depth = |c: &CoordinateIndex| {
        let mut joint = spec.coordinates[c.0].joint;
        let mut depth = 0;
        while depth <= spec.joints.len() {
            depth += 1;
            let inboard = model.frame(spec.joints[joint.0].parent_frame).base;
            match inboard.body().and_then(|body| model.inboard_joint(body)) {
                Some(next) => joint = next,
                None => break,
            }
        }
        depth
    };
    let mut order: Vec<CoordinateIndex> = (0..spec.coordinates.len()).map(CoordinateIndex).collect();
    order.sort_by_key(depth);
    order
}
