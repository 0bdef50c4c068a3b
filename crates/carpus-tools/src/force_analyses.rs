//! Analyses of forces: `ForceReporter`, `Actuation`, `JointReaction`.

use nalgebra::Vector3;

use super::analysis::{Analysis, Instant, Options, UNITS};
use super::error::ToolError;
use super::finite_columns::require_finite;
use super::setup::Properties;
use super::system::{Actor, System};
use carpus_multibody::forces::{BushingLaw, ForceLaw, PathForce};
use carpus_multibody::multibody::BaseIndex;
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::spec::{ConstraintKind, ConstraintSpec, CoordinateIndex, FrameIndex};
use carpus_osim::storage::Storage;

/// Labels of what a force reports (`Force::getRecordLabels`).
pub fn record_labels(system: &System, actor: &Actor) -> Vec<String> {
    let name = actor.name(&system.muscles);
    match actor {
        Actor::Law(force) => match &force.law {
            ForceLaw::CoordinateLimit(_) => vec![name.to_owned(), "PotentialEnergy".to_owned()],
            ForceLaw::SpringGeneralized(_) => vec![format!("{name}_Force")],
            ForceLaw::ExpressionBasedCoordinate(_) => vec![name.to_owned()],
            ForceLaw::PointToPointSpring(spring) => spring
                .frames
                .iter()
                .flat_map(|frame| {
                    let frame = &system.spec.frames[frame.0].name;
                    ["force.X", "force.Y", "force.Z", "point.X", "point.Y", "point.Z"]
                        .map(|k| format!("{name}.{frame}.{k}"))
                })
                .collect(),
            ForceLaw::Bushing(bushing) => [bushing.frame1, bushing.frame2]
                .iter()
                .flat_map(|frame| {
                    let frame = &system.spec.frames[frame.0].name;
                    ["force.X", "force.Y", "force.Z", "torque.X", "torque.Y", "torque.Z"]
                        .map(|k| format!("{name}.{frame}.{k}"))
                })
                .collect(),
        },
        Actor::Along { law, .. } => match **law {
            PathForce::PathSpring(_) => vec![format!("{name}_tension")],
            PathForce::Ligament(_) => vec![name.to_owned()],
            PathForce::Blankevoort1991(_) => {
                ["force_spring", "force_damping", "force_total", "length", "lengthening_speed", "strain", "strain_rate"]
                    .map(|k| format!("{name}.{k}"))
                    .to_vec()
            }
        },
        Actor::External(force) => force.labels(),
        Actor::Correction(correction) => correction.labels.clone(),
        Actor::OverTime(force) => {
            let frame = &system.spec.frames[force.frame.0].name;
            let of = if force.force_is_global { "ground" } else { frame };
            let groups =
                [(force.force.is_some(), "f"), (force.point.is_some(), "p"), (force.torque.is_some(), "torque_")];
            let groups = groups.into_iter().filter(|(given, _)| *given);
            groups.flat_map(|(_, kind)| ["x", "y", "z"].map(|k| format!("{of}_{name}_{kind}{k}"))).collect()
        }
        Actor::Muscle(_) | Actor::Actuator(_) | Actor::PathActuator(_) => vec![name.to_owned()],
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
        actor @ (Actor::Actuator(_) | Actor::PathActuator(_)) => {
            let own = || system.actuator_force(actor, instant.state);
            vec![control(position).unwrap_or_else(own)]
        }
        Actor::Along { law, .. } => {
            let tension = instant.evaluation.tension[position];
            let PathForce::Blankevoort1991(ligament) = law.as_ref() else { return vec![tension] };
            let length = instant.evaluation.path_length[position];
            let speed = instant.evaluation.path_speed[position];
            let (spring, damping) = (ligament.spring_force(length), ligament.damping_force(length, speed));
            let (strain, rate) = (ligament.strain(length), speed / ligament.slack_length);
            vec![spring, damping, tension, length, speed, strain, rate]
        }
        Actor::OverTime(force) => {
            let [pull, point, torque] = force.values(&system.model, cache, instant.state.time);
            // OpenSim labels a point that belongs to no force, but gives no values for it.
            let point = point.map(|point| if pull.is_some() { point } else { Vector3::repeat(f64::NAN) });
            [pull, point, torque].into_iter().flatten().flat_map(|v| [v.x, v.y, v.z]).collect()
        }
        Actor::External(force) => force.record(&system.model, cache, instant.state.time),
        Actor::Correction(correction) => correction.forces(instant.state.time, &instant.state.q, &instant.state.u),
        Actor::Law(force) => {
            let (q, u) = (&instant.state.q, &instant.state.u);
            match &force.law {
                ForceLaw::CoordinateLimit(force) => {
                    let c = force.coordinate.0;
                    vec![force.limit_force(q[c], u[c]), force.potential_energy(q[c])]
                }
                ForceLaw::SpringGeneralized(force) => {
                    vec![force.force(q[force.coordinate.0], u[force.coordinate.0])]
                }
                ForceLaw::ExpressionBasedCoordinate(force) => {
                    vec![force.force(q[force.coordinate.0], u[force.coordinate.0])]
                }
                ForceLaw::PointToPointSpring(spring) => {
                    let force = spring.force(cache);
                    let at = |k: usize| cache.X_GF(&system.model, spring.frames[k]) * spring.points[k];
                    [force, at(0), -force, at(1)].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
                }
                ForceLaw::Bushing(force) => {
                    let forces = match force.law {
                        BushingLaw::Linear(_) => force.forces_on_bodies(&system.model, cache),
                        _ => force.forces_on_frames(&system.model, cache),
                    };
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
    /// Whether forces of constraints follow.
    constraints: bool,
    store: Storage,
}

/// What the constraint at a position reports.
enum ConstraintColumns {
    /// Forces on two bodies, expressed in the nearest body that both descend from.
    Bodies([BaseIndex; 2], BaseIndex),
    /// Forces along all coordinates of the joints that it couples.
    Mobilities(Vec<CoordinateIndex>),
}

fn constraint_columns(system: &System, constraint: &ConstraintSpec) -> ConstraintColumns {
    let bodies = |first: FrameIndex, second: FrameIndex| {
        let bases = [system.model.frame(first).base, system.model.frame(second).base];
        let chain = |base: BaseIndex| {
            let inboard = |at: &BaseIndex| {
                let joint = &system.spec.joints[system.model.inboard_joint(at.body()?)?.0];
                let ends = [joint.parent_frame, joint.child_frame].map(|f| system.model.frame(f).base);
                Some(if ends[0] == *at { ends[1] } else { ends[0] })
            };
            std::iter::successors(Some(base), inboard).collect::<Vec<_>>()
        };
        let second = chain(bases[1]);
        let ancestor = chain(bases[0]).into_iter().find(|base| second.contains(base));
        ConstraintColumns::Bodies(bases, ancestor.unwrap_or(BaseIndex::GROUND))
    };
    match &constraint.kind {
        ConstraintKind::Weld { frame1, frame2 } => bodies(*frame1, *frame2),
        ConstraintKind::Point { body_1, body_2, .. } | ConstraintKind::ConstantDistance { body_1, body_2, .. } => {
            bodies(*body_1, *body_2)
        }
        ConstraintKind::PointOnLine { line_body, follower_body, .. } => bodies(*line_body, *follower_body),
        ConstraintKind::CoordinateCoupler { independent_coordinates, dependent_coordinate, .. } => {
            let mut joints = Vec::new();
            for coordinate in independent_coordinates.iter().chain([dependent_coordinate]) {
                let joint = system.spec.coordinates[coordinate.0].joint;
                if !joints.contains(&joint) {
                    joints.push(joint);
                }
            }
            let coordinates = joints.iter().flat_map(|joint| system.spec.joints[joint.0].coordinates.clone());
            ConstraintColumns::Mobilities(coordinates.collect())
        }
        ConstraintKind::Unsupported { .. } => ConstraintColumns::Mobilities(Vec::new()),
    }
}

/// Labels of the forces of all enforced constraints (`Constraint::getRecordLabels`).
fn constraint_labels(system: &System) -> Vec<String> {
    let enforced = system.spec.constraints.iter().filter(|c| c.is_enforced);
    enforced
        .flat_map(|constraint| match constraint_columns(system, constraint) {
            ConstraintColumns::Bodies(bases, _) => bases
                .iter()
                .flat_map(|base| {
                    let body = base.body().map_or("ground", |body| system.spec.bodies[body.0].name.as_str());
                    ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].map(|k| format!("{}_{body}_{k}", constraint.name))
                })
                .collect::<Vec<_>>(),
            ConstraintColumns::Mobilities(coordinates) => {
                (0..coordinates.len()).map(|i| format!("{}_mobility_F{i}", constraint.name)).collect()
            }
        })
        .collect()
}

/// Their values, which OpenSim gives as `Gᵀ λ`: the opposite of what acts on the bodies.
#[allow(non_snake_case)]
fn constraint_values(instant: &Instant) -> Vec<f64> {
    let (system, cache) = (instant.system, instant.work.dynamics.cache());
    let forces = instant.multipliers.map(|m| system.constraints.forces(cache, &instant.state.q, m)).unwrap_or_default();
    let mut values = Vec::new();
    for (i, constraint) in system.spec.constraints.iter().enumerate().filter(|(_, c)| c.is_enforced) {
        let found = forces.iter().find(|force| force.constraint == Some(i));
        match constraint_columns(system, constraint) {
            ConstraintColumns::Bodies(bases, ancestor) => {
                let R = cache.X_GB(ancestor).R;
                for k in 0..bases.len() {
                    let on = found.map_or(SpatialForce::default(), |force| force.bodies[k].1);
                    values.extend(R.tr_mul(&-on.force).iter().chain(R.tr_mul(&-on.moment).iter()));
                }
            }
            ConstraintColumns::Mobilities(coordinates) => values.extend(coordinates.iter().map(|c| {
                let along = found.into_iter().flat_map(|force| &force.mobilities).filter(|(on, _)| on == c);
                -along.map(|(_, force)| force).sum::<f64>()
            })),
        }
    }
    values
}

/// A storage as `ForceReporter` writes it.
pub fn force_storage(system: &System) -> Storage {
    let labels = system.actors.iter().flat_map(|actor| record_labels(system, actor)).collect();
    let mut store = Storage::new("ModelForces", labels);
    store.description = format!(
        "\nThis file contains the forces exerted on a model during a simulation.\n\nA force is a generalized force, \
         meaning that it can be either a force (N) or a torque (Nm).\n{UNITS}"
    );
    store
}

impl ForceReporter {
    /// Reads the analysis.
    ///
    /// # Errors
    /// Values that cannot be used.
    pub fn read(analysis: &Properties, system: &System) -> Result<ForceReporter, ToolError> {
        let options = Options::read(analysis)?;
        let constraints = analysis.boolean("include_constraint_forces", false)?;
        let mut store = force_storage(system);
        if constraints {
            store.labels.extend(constraint_labels(system));
        }
        Ok(ForceReporter { options, constraints, store })
    }
}

impl Analysis for ForceReporter {
    fn options(&self) -> &Options {
        &self.options
    }

    fn needs_accelerations(&self) -> bool {
        self.constraints
    }

    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError> {
        let values = (0..instant.system.actors.len()).flat_map(|k| record_values(instant, k, &|_| None));
        let mut values: Vec<f64> = values.collect();
        if self.constraints {
            values.extend(constraint_values(instant));
        }
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
        let outside = system.outside_of_force_set();
        let is_listed = |k: &usize| {
            let actor = &system.actors[*k];
            actor.is_actuator() && !outside.iter().any(|name| name == actor.name(&system.muscles))
        };
        let actuators: Vec<usize> = (0..system.actors.len()).filter(is_listed).collect();
        let labels: Vec<String> =
            actuators.iter().map(|k| system.actors[*k].name(&system.muscles).to_owned()).collect();
        let description = format!(
            "\nThis file contains either the forces, speeds, or powers developed\nby the actuators of a model during a \
             simulation.\n\nAn actuator force is a generalized force, meaning that it can be either a force (N) or a \
             torque (Nm).\n\nAn actuator speed is the rate at which an actuator shortens. Depending on the \
             actuator,\na speed can be either a translational speed (m/s) or an angular speed (deg/s or rad/s).\n\nAn \
             actuator power (Watts) is the rate at which an actuator does work.  Positive power means\nthat the \
             actuator is delivering energy to the model; negative power means that the actuator\nis absorbing energy \
             from the model.\n{UNITS}"
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
                actor @ Actor::Actuator(actuator) => {
                    let force = system.actuator_force(actor, instant.state);
                    let cache = instant.work.dynamics.cache();
                    let speed = actuator.speed(&system.model, &instant.state.u, cache);
                    (force, speed, force * speed)
                }
                Actor::PathActuator(_) => {
                    let (force, speed) = (evaluation.tension[k], evaluation.path_speed[k]);
                    (force, speed, -force * speed)
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
        store.description = "\nThis file contains the reaction forces and moments\napplied to the specified body of a \
                             joint pair and expressed  in the specified reference frame.\n\nUnits are S.I. units \
                             (seconds, meters, Newtons, ...)"
            .to_owned();
        let forces = match analysis.file("forces_file") {
            Some(file) => {
                let forces = Storage::read(&file)?;
                let of_actuator = |actor: &Actor| match actor.is_actuator() {
                    true => forces.find(actor.name(&system.muscles)),
                    false => None,
                };
                let columns: Vec<usize> = system.actors.iter().filter_map(of_actuator).collect();
                require_finite(&forces, &columns, &file)?;
                Some(forces)
            }
            None => None,
        };
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
        let mut multipliers = instant.multipliers.cloned();
        if let Some(forces) = &self.forces {
            // Forces of actuators are those of the file.
            let values = forces.at(state.time);
            let control = |name: &str| forces.find(name).map(|i| values[i]);
            applied = system.with_actuator_forces(instant.work, state, &control);
            let (found, _) = system.accelerations(instant.work, state, &applied);
            (udot, multipliers) = (Some(found.udot), Some(found.multipliers));
        }
        let (Some(udot), Some(multipliers)) = (udot, multipliers) else { return Ok(()) };
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
        // What constraints between bodies bear, joints do not.
        for constraint in system.constraints.forces(cache, &state.q, &multipliers) {
            constraint.bodies.iter().for_each(|(base, force)| forces[base.0] += -*force);
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
