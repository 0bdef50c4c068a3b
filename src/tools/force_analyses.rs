//! Analyses of forces: `ForceReporter`, `Actuation`, `JointReaction`.

use nalgebra::Vector3;

use super::analysis::{Analysis, Instant, Options, UNITS};
use super::error::{ToolError, ToolProblem};
use super::setup::Properties;
use super::system::{Actor, System};
use crate::forces::ForceLaw;
use crate::multibody::BaseIndex;
use crate::osim::spec::FrameIndex;
use crate::spatial::SpatialForce;
use crate::storage::Storage;

/// Labels of what a force reports (`Force::getRecordLabels`).
pub fn record_labels(system: &System, actor: &Actor) -> Vec<String> {
    let name = actor.name(&system.muscles);
    match actor {
        Actor::Law(force) => match &force.law {
            ForceLaw::CoordinateLimit(_) => vec![name.to_owned(), "PotentialEnergy".to_owned()],
            ForceLaw::SpringGeneralized(_) => vec![format!("{name}_Force")],
            ForceLaw::ExpressionBasedCoordinate(_) => vec![name.to_owned()],
            ForceLaw::FunctionBasedBushing(bushing) => [bushing.frame1, bushing.frame2]
                .iter()
                .flat_map(|frame| {
                    let frame = &system.spec.frames[frame.0].name;
                    ["force.X", "force.Y", "force.Z", "torque.X", "torque.Y", "torque.Z"]
                        .map(|k| format!("{name}.{frame}.{k}"))
                })
                .collect(),
        },
        Actor::Along { law, .. } => match **law {
            crate::forces::PathForce::PathSpring(_) => vec![format!("{name}_tension")],
            crate::forces::PathForce::Ligament(_) => vec![name.to_owned()],
        },
        Actor::External(force) => force.labels(),
        Actor::Muscle(_) | Actor::Coordinate(_) => vec![name.to_owned()],
    }
}

/// Values of what a force reports; `control` gives the force of an actuator that follows a control.
pub fn record_values(instant: &Instant, position: usize, control: &dyn Fn(usize) -> Option<f64>) -> Vec<f64> {
    let system = instant.system;
    let cache = instant.work.dynamics.cache();
    match &system.actors[position] {
        Actor::Muscle(i) => {
            let own = || instant.evaluation.muscles[*i].as_ref().map_or(f64::NAN, |m| m.tendon_force);
            vec![control(position).unwrap_or_else(own)]
        }
        Actor::Coordinate(actuator) => {
            vec![control(position).unwrap_or_else(|| actuator.force(&system.controls, instant.state.time))]
        }
        Actor::Along { .. } => vec![instant.evaluation.tension[position]],
        Actor::External(force) => force.record(&system.model, cache, instant.state.time),
        Actor::Law(force) => {
            let qdot = instant.work.dynamics.qdot();
            let q = &instant.state.q;
            match &force.law {
                ForceLaw::CoordinateLimit(force) => {
                    let c = force.coordinate.0;
                    vec![force.limit_force(q[c], qdot[c]), force.potential_energy(q[c])]
                }
                ForceLaw::SpringGeneralized(force) => {
                    vec![force.force(q[force.coordinate.0], qdot[force.coordinate.0])]
                }
                ForceLaw::ExpressionBasedCoordinate(force) => {
                    vec![force.force(q[force.coordinate.0], qdot[force.coordinate.0])]
                }
                ForceLaw::FunctionBasedBushing(force) => {
                    let forces = force.forces_on_frames(&system.model, cache);
                    forces
                        .iter()
                        .flat_map(|f| f.force.iter().chain(f.moment.iter()).copied().collect::<Vec<_>>())
                        .collect()
                }
            }
        }
    }
}

/// Forces of everything that acts.
pub struct ForceReporter {
    options: Options,
    store: Storage,
}

/// A storage as `ForceReporter` writes it.
pub fn force_storage(system: &System) -> Storage {
    let labels = system.actors.iter().flat_map(|actor| record_labels(system, actor)).collect();
    let mut store = Storage::new("ModelForces", labels);
    store.description = format!(
        "\nThis file contains the forces exerted on a model during a simulation.\n\nA force is a generalized force, meaning that it can be either a force (N) or a torque (Nm).\n{UNITS}"
    );
    store
}

impl ForceReporter {
    /// Reads the analysis.
    ///
    /// # Errors
    /// Constraint forces are asked for.
    pub fn read(analysis: &Properties, system: &System) -> Result<ForceReporter, ToolError> {
        let options = Options::read(analysis)?;
        if analysis.boolean("include_constraint_forces", false)? {
            return Err(analysis.unsupported("include_constraint_forces", "set it to false"));
        }
        Ok(ForceReporter { options, store: force_storage(system) })
    }
}

impl Analysis for ForceReporter {
    fn options(&self) -> &Options {
        &self.options
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let values = (0..instant.system.actors.len()).flat_map(|k| record_values(instant, k, &|_| None));
        let values = values.collect();
        self.store.push(instant.state.time, values);
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        vec![("forces".to_owned(), &self.store)]
    }
}

/// Force, speed and power of every actuator.
pub struct Actuation {
    options: Options,
    /// Actuators by position among what acts.
    actuators: Vec<usize>,
    stores: [Storage; 3],
}

impl Actuation {
    /// Reads the analysis.
    ///
    /// # Errors
    /// Values that cannot be used.
    pub fn read(analysis: &Properties, system: &System) -> Result<Actuation, ToolError> {
        let options = Options::read(analysis)?;
        let is_actuator = |k: &usize| matches!(system.actors[*k], Actor::Muscle(_) | Actor::Coordinate(_));
        let actuators: Vec<usize> = (0..system.actors.len()).filter(is_actuator).collect();
        let labels: Vec<String> =
            actuators.iter().map(|k| system.actors[*k].name(&system.muscles).to_owned()).collect();
        let description = format!(
            "\nThis file contains either the forces, speeds, or powers developed\nby the actuators of a model during a simulation.\n\nAn actuator force is a generalized force, meaning that it can be either a force (N) or a torque (Nm).\n\nAn actuator speed is the rate at which an actuator shortens. Depending on the actuator,\na speed can be either a translational speed (m/s) or an angular speed (deg/s or rad/s).\n\nAn actuator power (Watts) is the rate at which an actuator does work.  Positive power means\nthat the actuator is delivering energy to the model; negative power means that the actuator\nis absorbing energy from the model.\n{UNITS}"
        );
        let stores = ["ActuatorForces", "ActuatorSpeeds", "ActuatorPowers"].map(|name| {
            let mut store = Storage::new(name, labels.clone());
            store.description.clone_from(&description);
            store
        });
        Ok(Actuation { options, actuators, stores })
    }
}

impl Analysis for Actuation {
    fn options(&self) -> &Options {
        &self.options
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let (system, evaluation, time) = (instant.system, instant.evaluation, instant.state.time);
        let mut rows: [Vec<f64>; 3] = Default::default();
        for &k in &self.actuators {
            // Power is force times shortening speed.
            let (force, speed, power) = match &system.actors[k] {
                Actor::Muscle(i) => {
                    let force = evaluation.muscles[*i].as_ref().map_or(f64::NAN, |m| m.tendon_force);
                    (force, evaluation.muscle_speed[*i], -force * evaluation.muscle_speed[*i])
                }
                Actor::Coordinate(actuator) => {
                    let (force, speed) =
                        (actuator.force(&system.controls, time), instant.state.u[actuator.coordinate.0]);
                    (force, speed, force * speed)
                }
                _ => continue,
            };
            [force, speed, power].into_iter().zip(&mut rows).for_each(|(value, row)| row.push(value));
        }
        for (store, row) in self.stores.iter_mut().zip(rows) {
            store.push(time, row);
        }
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        ["force", "speed", "power"].into_iter().map(str::to_owned).zip(&self.stores).collect()
    }
}

/// One joint whose load is reported.
struct Reaction {
    joint: usize,
    on_child: bool,
    in_frame: FrameIndex,
}

/// Loads of joints.
pub struct JointReaction {
    options: Options,
    reactions: Vec<Reaction>,
    forces: Option<Storage>,
    store: Storage,
    warnings: Vec<String>,
}

impl JointReaction {
    /// Reads the analysis.
    ///
    /// # Errors
    /// Lists of unequal lengths, frames that the model does not have, a file of forces that cannot be read.
    pub fn read(analysis: &Properties, system: &System) -> Result<JointReaction, ToolError> {
        let options = Options::read(analysis)?;
        let list = |property: &str, default: &str| {
            let words = analysis.words(property).unwrap_or_default();
            if words.is_empty() { vec![default.to_owned()] } else { words }
        };
        let joints = &system.spec.joints;
        let mut names = list("joint_names", "ALL");
        if names[0].eq_ignore_ascii_case("ALL") {
            names = joints.iter().map(|j| j.name.clone()).collect();
        }
        let (on_bodies, in_frames) = (list("apply_on_bodies", "child"), list("express_in_frame", "ground"));
        for (property, words) in [("apply_on_bodies", &on_bodies), ("express_in_frame", &in_frames)] {
            if words.len() != 1 && words.len() != names.len() {
                let expected = format!("one word, or as many as joint_names ({})", names.len());
                return Err(analysis.bad_value(property, &expected, &words.join(" ")));
            }
        }
        let base = |frame: FrameIndex| match system.model.frame(frame).base.body() {
            Some(body) => system.spec.bodies[body.0].frame,
            None => FrameIndex(0),
        };
        let (mut reactions, mut labels, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
        for (i, name) in names.iter().enumerate() {
            let Some(joint) = joints.iter().position(|j| j.name == *name) else {
                warnings.push(format!("{}: the model has no joint `{name}`", options.name));
                continue;
            };
            let pick = |words: &[String]| words.get(i).unwrap_or(&words[0]).clone();
            let on = pick(&on_bodies).to_lowercase();
            if on != "child" && on != "parent" {
                return Err(analysis.bad_value("apply_on_bodies", "child or parent", &on));
            }
            let frame = pick(&in_frames);
            let (parent, child) = (base(joints[joint].parent_frame), base(joints[joint].child_frame));
            let in_frame = match system.frame(&frame) {
                Some(found) => found,
                None => match frame.to_lowercase().as_str() {
                    "child" => child,
                    "parent" => parent,
                    _ => return Err(analysis.bad_value("express_in_frame", "a frame, child or parent", &frame)),
                },
            };
            let on_child = on == "child";
            let body = if on_child { child } else { parent };
            let name_of = |f: FrameIndex| &system.spec.frames[f.0].name;
            let stem = format!("{name}_on_{}_in_{}", name_of(body), name_of(in_frame));
            labels.extend(["fx", "fy", "fz", "mx", "my", "mz", "px", "py", "pz"].map(|k| format!("{stem}_{k}")));
            reactions.push(Reaction { joint, on_child, in_frame });
        }
        let mut store = Storage::new("Joint Reaction Loads", labels);
        store.description = "\nThis file contains the reaction forces and moments\napplied to the specified body of a joint pair and expressed  in the specified reference frame.\n\nUnits are S.I. units (seconds, meters, Newtons, ...)".to_owned();
        let forces = match analysis.file("forces_file") {
            Some(file) => Some(Storage::read(file)?),
            None => None,
        };
        let between = |c: &&crate::osim::spec::ConstraintSpec| {
            c.is_enforced && !matches!(c.kind, crate::osim::spec::ConstraintKind::CoordinateCoupler { .. })
        };
        if let Some(constraint) = system.spec.constraints.iter().find(between) {
            let what = format!("{} with {}", analysis.class(), constraint.kind.class());
            let instead = "forces of constraints between bodies are not shared out among joints yet";
            return Err(analysis.error_at("joint_names", ToolProblem::Unsupported { what, instead: instead.into() }));
        }
        Ok(JointReaction { options, reactions, forces, store, warnings })
    }
}

impl Analysis for JointReaction {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_accelerations(&self) -> bool {
        true
    }

    #[allow(non_snake_case)]
    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let (system, state) = (instant.system, instant.state);
        let mut applied = instant.evaluation.applied.clone();
        let mut udot = instant.udot.cloned();
        if let Some(forces) = &self.forces {
            // Forces of actuators are those of the file.
            let values = forces.at(state.time);
            let control = |name: &str| forces.find(name).map(|i| values[i]);
            applied = system.with_actuator_forces(instant.work, state, &control);
            let found = instant.work.dynamics.accelerations(state.time, &state.q, &state.u, &applied);
            let fail = |source| ToolError::new(&system.path, ToolProblem::Dynamics { time: state.time, source });
            udot = Some(found.map_err(fail)?.udot);
        }
        let Some(udot) = udot else { return Ok(()) };
        instant.work.dynamics.inverse_dynamics(&state.q, &state.u, udot.as_slice(), &applied);
        let cache = instant.work.dynamics.cache();
        let model = &system.model;
        // What each body needs beyond gravity and applied forces, at its origin.
        let mut forces = vec![SpatialForce::default(); model.n_bases()];
        for (i, body) in model.bodies.iter().enumerate() {
            let base = BaseIndex(i + 1);
            let (R, V, A) = (cache.X_GB(base).R, cache.V_GB(base), cache.A_GB(base));
            let p = R * body.mass_center;
            let turned = |vector: &Vector3<f64>| R * (body.inertia * R.tr_mul(vector));
            let force = body.mass * (A.acceleration_at(&p, &V.w) - model.gravity);
            let moment = turned(&A.alpha) + V.w.cross(&turned(&V.w));
            forces[base.0] = SpatialForce { moment, force }.shift_to_origin(&p) + -applied.bodies[base.0];
        }
        let mut unused = vec![0.0; model.n_coordinates()];
        model.gather(cache, &mut forces, &mut unused);
        let mut row = Vec::with_capacity(9 * self.reactions.len());
        for reaction in &self.reactions {
            let joint = &system.spec.joints[reaction.joint];
            let (parent, child) = (model.frame(joint.parent_frame).base, model.frame(joint.child_frame).base);
            let is_inboard = |base: BaseIndex| {
                base.body().is_some_and(|body| model.inboard_joint(body).is_some_and(|j| j.0 == reaction.joint))
            };
            let (outboard, carries_child) = if is_inboard(child) { (child, true) } else { (parent, false) };
            let frame = if reaction.on_child { joint.child_frame } else { joint.parent_frame };
            let at = cache.X_GF(model, frame).p;
            let shift = at - cache.X_GB(outboard).p;
            let total = forces[outboard.0];
            let sign = if reaction.on_child == carries_child { 1.0 } else { -1.0 };
            let (force, moment) = (sign * total.force, sign * (total.moment - shift.cross(&total.force)));
            let X = cache.X_GF(model, reaction.in_frame);
            let columns = [X.R.tr_mul(&force), X.R.tr_mul(&moment), X.inverse_transform_point(&at)];
            columns.iter().for_each(|c| row.extend(c.iter()));
        }
        self.store.push(state.time, row);
        Ok(())
    }

    fn results(&self) -> Vec<(String, &Storage)> {
        vec![("ReactionLoads".to_owned(), &self.store)]
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }
}
