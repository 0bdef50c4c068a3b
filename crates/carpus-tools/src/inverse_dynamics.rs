//! Forces that a motion needs: OpenSim's `InverseDynamicsTool`.

use std::collections::HashSet;
use std::path::Path;

use super::analyze::Faults;
use super::error::{ToolError, ToolProblem};
use super::external_loads::add_external_loads;
use super::motion::{columns_of, coordinate_splines, read_coordinates, to_radians};
use super::result::Outcome;
use super::setup::Properties;
use super::system::{Actor, System, SystemState};
use carpus_numerics::spatial::SpatialForce;
use carpus_osim::osim::Document;
use carpus_osim::storage::Storage;

/// Runs the tool.
///
/// - `document`: the model's own text, for its controllers
///
/// # Errors
/// The setup, its files, or a model whose forces are not all computed.
pub fn run(tool: &Properties, mut system: System, document: Document, outcome: &mut Outcome) -> Result<(), ToolError> {
    let setup = tool.setup().path().to_owned();
    let results = tool.setup().resolve(&tool.string("results_directory"));
    let [start, end] = tool.time_range("time_range", [f64::NEG_INFINITY, f64::INFINITY])?;
    let excluded = tool.words("forces_to_exclude").unwrap_or_default();
    let cutoff = tool.number("lowpass_cutoff_frequency_for_coordinates", -1.0)?;
    let file = tool.file("coordinates_file").ok_or_else(|| tool.missing("coordinates_file", "a .mot or .sto file"))?;
    let output = tool.text("output_gen_force_file").unwrap_or_else(|| "inverse_dynamics.sto".into());
    let joints = tool.words("joints_to_report_body_forces").unwrap_or_default();
    let body_output = tool.text("output_body_forces_file").unwrap_or_else(|| "body_forces_at_joints.sto".into());
    tool.ignore_all(&["input_directory", "coordinates_in_degrees"]);
    if let Some(loads) = tool.file("external_loads_file") {
        let warnings = add_external_loads(&loads, &mut system)?;
        warnings.into_iter().for_each(|text| outcome.warn(&loads, 0, text));
    }
    let named = exclusion(&excluded, &groups_of_forces(&document), tool, &system, outcome);
    let outside = system.outside_of_force_set();
    let is_excluded = |name: &str, is_muscle: bool, is_actuator: bool| {
        named(name, is_muscle, is_actuator) && !outside.iter().any(|other| other == name)
    };
    let muscles_excluded = |name: &str| {
        let is_muscle = system.muscles.iter().any(|m| m.name == name);
        is_excluded(name, is_muscle, is_muscle || system.is_actuator(name))
    };
    system.require_all_forces(&muscles_excluded)?;
    system.read_controllers_as_needed(document, tool, &is_excluded, outcome)?;

    let mut data = read_coordinates(&file, cutoff, &system)?;
    data.warnings.iter().for_each(|text| outcome.warn(&file, 0, text.clone()));
    to_radians(&mut data, &system);
    let columns = columns_of(&data, &system);
    let splines = coordinate_splines(&data, &columns, &file)?;
    for (coordinate, _) in system.model.coordinates.iter().zip(&splines).filter(|(_, s)| s.is_none()) {
        let text = format!("coordinate `{}` is not in this file: its default value is taken", coordinate.name);
        outcome.warn(&file, 0, text);
    }
    let [first, last] = [data.time[0], data.time[data.len() - 1]];
    let first = data.index_at(first.max(start));
    let last = data.index_at(last.min(end));
    if last < first {
        return Err(tool.bad_value("time_range", "a range that meets the data", &format!("{start} {end}")));
    }

    let forces = solve(&system, &splines, &data.time[first..=last], &is_excluded)?;
    let labels = system.tree_order.iter().map(|c| {
        let unit = if system.is_angle(c.0) { "moment" } else { "force" };
        format!("{}_{unit}", system.model.coordinates[c.0].name)
    });
    let mut storage = Storage::new("Inverse Dynamics Generalized Forces", labels.collect());
    for (time, solution) in data.time[first..=last].iter().zip(&forces) {
        storage.push(*time, system.tree_order.iter().map(|c| solution.generalized[c.0]).collect());
    }
    outcome.add_storage(&results, &output, &storage, 8);
    outcome.summary.push(format!("inverse dynamics of {} times, {}", storage.len(), file.display()));
    if !joints.is_empty() {
        let storage = body_forces(&system, &joints, &data.time[first..=last], &forces, &setup, outcome);
        if !storage.labels.is_empty() {
            outcome.add_storage(&results, &body_output, &storage, 8);
        }
    }
    Ok(())
}

/// Groups of the force set of a model: name and members.
fn groups_of_forces(document: &Document) -> Vec<(String, Vec<String>)> {
    let model = document.object();
    let set = ["ForceSet", "ActuatorSet"].iter().find_map(|tag| document.child(model, tag));
    let groups = set.and_then(|set| document.child(set, "groups"));
    let groups = groups.map_or(&[][..], |groups| document.children(groups)).iter();
    let members = |group| document.child(group, "members").map(|m| document.text(m)).unwrap_or_default();
    let words = |text: String| text.split_ascii_whitespace().map(str::to_owned).collect();
    groups.map(|&group| (document.attribute(group, "name").unwrap_or_default(), words(members(group)))).collect()
}

/// Whether a force of the model's force set is excluded: as muscle, actuator or any; by its group; or by its name,
/// which OpenSim 4.6 looks for only in a force set without groups. Names that match nothing are said.
fn exclusion(
    names: &[String],
    groups: &[(String, Vec<String>)],
    tool: &Properties,
    system: &System,
    outcome: &mut Outcome,
) -> impl Fn(&str, bool, bool) -> bool + use<> {
    let [mut all, mut actuators, mut muscles] = [false; 3];
    let in_set = system.spec.muscles.iter().map(|m| (&m.at, &m.name));
    let in_set = in_set.chain(system.spec.forces.iter().map(|f| (&f.at, &f.name)));
    let forces: Vec<&str> = in_set.filter(|(at, _)| at.is_in_force_set()).map(|(_, name)| name.as_str()).collect();
    let mut excluded: HashSet<String> = HashSet::new();
    for name in names {
        let group = groups.iter().find(|(group, _)| group == name);
        match (name.to_ascii_uppercase().as_str(), group) {
            ("ALL", _) => all = true,
            ("ACTUATORS", _) => actuators = true,
            ("MUSCLES", _) => muscles = true,
            (_, Some((_, members))) => excluded.extend(members.iter().cloned()),
            (_, None) if groups.is_empty() && forces.contains(&name.as_str()) => drop(excluded.insert(name.clone())),
            (_, None) => {
                let known = groups.iter().map(|(group, _)| group.as_str());
                let why = if forces.contains(&name.as_str()) {
                    let known = known.map(|group| format!("`{group}`")).collect::<Vec<_>>().join(", ");
                    format!(
                        "force `{name}` acts: as in OpenSim 4.6 only groups are found where the force set has any \
                         ({known})"
                    )
                } else {
                    let known = known.chain(if groups.is_empty() { forces.clone() } else { Vec::new() });
                    let nearest = carpus_osim::osim::error::nearest(name, known);
                    let nearest = nearest.map_or(String::new(), |nearest| format!(" (did you mean `{nearest}`?)"));
                    format!("the model has no force or group `{name}`: nothing is excluded by it{nearest}")
                };
                let line = tool.child("forces_to_exclude").map_or(0, |property| property.line());
                outcome.warn(tool.setup().path(), line, format!("forces_to_exclude: {why}"));
            }
        }
    }
    move |name, is_muscle, is_actuator| {
        all || (actuators && is_actuator) || (muscles && is_muscle) || excluded.contains(name)
    }
}

/// Forces at one time.
struct Solution {
    generalized: Vec<f64>,
    /// Force that each joint carries on its outboard body, at the origin of its child frame: by joint.
    joints: Vec<SpatialForce>,
}

fn solve(
    system: &System,
    splines: &[Option<carpus_osim::functions::Function>],
    times: &[f64],
    is_excluded: &dyn Fn(&str, bool, bool) -> bool,
) -> Result<Vec<Solution>, ToolError> {
    let mut work = system.new_work();
    let default = system.default_state()?;
    let acts: Vec<bool> = system
        .actors
        .iter()
        .map(|actor| {
            let is_muscle = matches!(actor, Actor::Muscle(_));
            // External loads are no members of the model's force set, the only forces that OpenSim excludes.
            matches!(actor, Actor::External(_))
                || !is_excluded(actor.name(&system.muscles), is_muscle, actor.is_actuator())
        })
        .collect();
    let mut solutions = Vec::with_capacity(times.len());
    for &time in times {
        let value = |i: usize, order: usize| match (&splines[i], order) {
            (Some(spline), 0) => spline.value(time),
            (Some(spline), 1) => spline.derivative(time),
            (Some(spline), _) => spline.second_derivative(time),
            (None, 0) => system.model.coordinates[i].default_value,
            (None, _) => 0.0,
        };
        let n = splines.len();
        let of_order = |order: usize| (0..n).map(|i| value(i, order)).collect::<Vec<f64>>();
        let state = SystemState { time, q: of_order(0), u: of_order(1), ..default.clone() };
        let udot = of_order(2);
        let evaluation = system.evaluate(&mut work, &state, &|k| acts[k]);
        let generalized = work.dynamics.inverse_dynamics(&state.q, &state.u, &udot, &evaluation.applied);
        if !generalized.iter().all(|f| f.is_finite()) {
            Faults::default().require_finite(system, &mut work, &state, &|k| acts[k])?;
            let source = carpus_multibody::dynamics::DynamicsError::NotFinite;
            return Err(ToolError::new(&system.path, ToolProblem::Dynamics { time, source }));
        }
        let generalized: Vec<f64> = generalized.iter().copied().collect();
        let joints = system.equivalent_joint_forces(work.dynamics.cache(), &generalized);
        solutions.push(Solution { generalized, joints });
    }
    Ok(solutions)
}

fn body_forces(
    system: &System,
    names: &[String],
    times: &[f64],
    solutions: &[Solution],
    setup: &Path,
    outcome: &mut Outcome,
) -> Storage {
    let mut joints = Vec::new();
    for name in names {
        if name.eq_ignore_ascii_case("ALL") {
            joints.extend(0..system.spec.joints.len());
            break;
        }
        match system.spec.joints.iter().position(|j| j.name == *name) {
            Some(joint) => joints.push(joint),
            None => outcome.warn(setup, 0, format!("joints_to_report_body_forces: the model has no joint `{name}`")),
        }
    }
    let labels = joints.iter().flat_map(|&j| {
        let joint = &system.spec.joints[j];
        let stem = format!("{}_{}", joint.name, system.spec.frames[joint.child_frame.0].name);
        ["FX", "FY", "FZ", "MX", "MY", "MZ"].map(|k| format!("{stem}_{k}"))
    });
    let mut storage = Storage::new("Inverse Dynamics Body Forces at Specified Joints", labels.collect());
    for (time, solution) in times.iter().zip(solutions) {
        let row = joints.iter().flat_map(|&j| {
            let force = &solution.joints[j];
            force.force.iter().chain(force.moment.iter()).copied().collect::<Vec<_>>()
        });
        storage.push(*time, row.collect());
    }
    storage
}
