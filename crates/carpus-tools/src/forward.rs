//! Motion from forces: OpenSim's `ForwardTool`.
//!
//! OpenSim records every step of its explicit integrator; steps of the implicit one used here can be long, so that rows
//! are at even times (or at those of the states file, with `use_specified_dt`), each as exact as the steps. Neither
//! steps nor rows are further apart than the largest step allowed.

use std::sync::Arc;

use super::analysis::add_results;
use super::analyze::{Faults, Frame, read_analyses, record, states_from_file};
use super::correction::Correction;
use super::error::{ToolError, ToolProblem};
use super::result::{Outcome, ResultFile};
use super::setup::Properties;
use super::system::{Actor, System, apply_tension};
use carpus_multibody::dynamics::{ForwardOptions, LaggedActuator, Load, Plant, PlantState, simulate_forward};
use carpus_osim::osim::Document;
use carpus_osim::storage::{Storage, printed};

/// Rows of results per second, at least this many rows in all.
const ROWS_PER_SECOND: f64 = 100.0;
const FEWEST_ROWS: f64 = 200.0;
/// Rows of results at most.
const MOST_ROWS: f64 = 1e6;
/// Longest simulation [s].
const LONGEST: f64 = MOST_ROWS / ROWS_PER_SECOND;
/// Rate at which violations of constraints between bodies decay [1/s].
const STABILIZATION: f64 = 50.0;

/// Runs the tool.
///
/// - `document`: the model's own text, for its controllers
///
/// # Errors
/// The setup, its files, or a motion that cannot be integrated.
pub fn run(tool: &Properties, mut system: System, document: Document, outcome: &mut Outcome) -> Result<(), ToolError> {
    let frame = Frame::read(tool, &mut system, outcome)?;
    let specified = tool.boolean("use_specified_dt", false)?;
    system.require_all_forces(&|_| false)?;
    system.read_controllers(document, tool, outcome)?;

    let [mut start, end] = frame.time;
    let mut state = system.default_state()?;
    let mut times_of_file = None;
    let mut states = Vec::new();
    if let Some(file) = tool.file("states_file") {
        states = states_from_file(&file, &system, outcome)?;
        let index = states.partition_point(|s| s.time <= start).saturating_sub(1);
        if states[index].time != start {
            start = states[index].time;
            outcome.warn(
                &file,
                0,
                format!("the simulation starts at {start} s, the time of the nearest earlier state"),
            );
        }
        times_of_file = Some(states.iter().map(|s| s.time).filter(|t| *t >= start && *t <= end).collect::<Vec<_>>());
        state = states[index].clone();
    }
    if let Some((correction, second)) = Correction::read(tool, &system, &states)? {
        second.into_iter().for_each(|text| outcome.warn(tool.setup().path(), tool.line(), text));
        system.actors.insert(0, Actor::Correction(Box::new(correction)));
    }
    if !start.is_finite() {
        return Err(tool.bad_value("initial_time", "a finite time", &tool.string("initial_time")));
    }
    if !(end > start) {
        return Err(tool.bad_value("final_time", "a time after initial_time", &end.to_string()));
    }
    if !(end - start <= LONGEST) {
        let expected = format!("a time at most {LONGEST} s after initial_time");
        return Err(tool.bad_value("final_time", &expected, &tool.string("final_time")));
    }
    state.time = start;
    system.assemble(start, &mut state.q)?;
    // OpenSim's integrator starts on all constraints.
    system.project(start, &mut state.q)?;
    system.project_speeds(start, &state.q, &mut state.u);
    let mut work = system.new_work();
    let mut faults = Faults::default();
    if frame.equilibrate {
        let failed = system.equilibrate(&mut work, &mut state);
        faults.note_unbalanced(start, failed);
    }
    faults.require_finite(&system, &mut work, &state, &|_| true)?;
    let plant = plant_of(&system).map_err(|e| ToolError::new(&system.path, e))?;
    let times = match times_of_file.filter(|times| specified && times.len() > 1) {
        Some(times) => times,
        None => even_times(start, end, frame.integrator.step_range[1]),
    };
    let mut driven: Vec<String> = plant.muscles.iter().map(|m| m.muscle.name().to_owned()).collect();
    let positions: Vec<usize> =
        driven.iter().map(|name| system.muscles.iter().position(|m| m.name == *name).unwrap_or(0)).collect();
    driven.extend(system.lagged().map(|(i, _)| system.spec.forces[i].name.clone()));
    let first = PlantState {
        q: state.q.clone(),
        u: state.u.clone(),
        activation: positions.iter().map(|i| state.activation[*i]).collect(),
        fiber_length: positions.iter().map(|i| state.fiber_length[*i]).collect(),
        fiber_velocity: positions.iter().map(|i| state.fiber_velocity[*i]).collect(),
        dissipated_energy: state.dissipated_energy.clone(),
        actuator_activation: state.actuator_activation.clone(),
    };
    let options = ForwardOptions {
        times,
        accuracy: frame.integrator.error_tolerance.min(1e-5),
        first_step: 1e-3,
        step_range: frame.integrator.step_range,
        most_steps: frame.integrator.most_steps,
    };
    let excite = |time: f64, values: &mut [f64]| {
        values.iter_mut().zip(&driven).for_each(|(value, name)| *value = system.controls.at(name, time).unwrap_or(0.0));
    };
    let trajectory = simulate_forward(&plant, &first, excite, &options).map_err(|e| ToolError::new(&system.path, e))?;

    let mut analyses = read_analyses(tool, &system, None)?;
    let mut states = Storage::new(&frame.name, system.state_names());
    let last = trajectory.times.len() - 1;
    let mut full = state.clone();
    for (k, (time, found)) in trajectory.times.iter().zip(&trajectory.states).enumerate() {
        (full.time, full.q, full.u) = (*time, found.q.clone(), found.u.clone());
        for (j, i) in positions.iter().enumerate() {
            (full.activation[*i], full.fiber_length[*i]) = (found.activation[j], found.fiber_length[j]);
            full.fiber_velocity[*i] = found.fiber_velocity[j];
        }
        full.dissipated_energy.clone_from(&found.dissipated_energy);
        full.actuator_activation.clone_from(&found.actuator_activation);
        states.push(*time, system.state_values(&full));
        if !analyses.is_empty() {
            let step = (k != 0 && k != last).then_some(k);
            record(&mut analyses, &system, &mut work, &full, step, &mut faults)?;
        }
    }
    faults.conclude(&system, outcome)?;
    if trajectory.cost.forced > 0 {
        let text = format!(
            "minimum_integrator_step_size: {} of {} steps have a larger error than integrator_error_tolerance allows, \
             as in \
             OpenSim",
            trajectory.cost.forced, trajectory.cost.steps
        );
        let line = tool.child("minimum_integrator_step_size").map_or(0, |property| property.line());
        outcome.warn(tool.setup().path(), line, text);
    }
    for analysis in &analyses {
        analysis.warnings().into_iter().for_each(|text| outcome.warn(tool.setup().path(), 0, text));
        add_results(analysis.as_ref(), &frame.name, &frame.results, frame.precision, outcome);
    }
    write(&frame, &states, &system, outcome);
    let cost = &trajectory.cost;
    outcome.summary.push(format!("simulated {start} to {end} s; steps: {}, rejected: {}", cost.steps, cost.rejected));
    Ok(())
}

/// The system as a plant: its skeleton, muscles, forces and loads.
fn plant_of(system: &System) -> Result<Plant, ToolProblem> {
    let controls = &system.controls;
    let mut plant = Plant::compile(&system.spec, &system.model, true)?;
    plant.stabilization = STABILIZATION;
    for actor in &system.actors {
        match actor {
            Actor::External(force) => {
                let force = force.clone();
                let load: Load =
                    Arc::new(move |model, _, cache, time, applied| force.apply(model, cache, time, applied));
                plant = plant.with_load(load);
            }
            Actor::Actuator(actuator) if actuator.activation.is_none() => {
                let (actor, actuator, controls) = (actor.clone(), actuator.clone(), controls.clone());
                plant = plant.with_load(Arc::new(move |model, _, cache, time, applied| {
                    let force = actor.controlled_force(&controls, time).unwrap_or(0.0);
                    if force != 0.0 {
                        actuator.apply(model, cache, force, applied);
                    }
                }));
            }
            Actor::PathActuator(actuator) => {
                let (actor, actuator, controls) = (actor.clone(), actuator.clone(), controls.clone());
                plant = plant.with_load(Arc::new(move |_, [q, _], cache, time, applied| {
                    let tension = actor.controlled_force(&controls, time).unwrap_or(0.0);
                    if tension != 0.0 {
                        let mut geometry = actuator.path.new_geometry();
                        actuator.path.update(q, cache, &mut geometry);
                        apply_tension(&actuator.path, q, cache, &geometry, tension, applied);
                    }
                }));
            }
            Actor::Correction(correction) => {
                let correction = correction.clone();
                plant =
                    plant.with_load(Arc::new(move |_, [q, u], _, time, applied| correction.apply(time, q, u, applied)));
            }
            _ => {}
        }
    }
    let acting = |name: &str| {
        system.actors.iter().find_map(|actor| match actor {
            Actor::Actuator(actuator) if actuator.name == name => Some(actuator.as_ref().clone()),
            _ => None,
        })
    };
    let lagged = system.lagged().map(|(i, activation)| LaggedActuator {
        actuator: acting(&system.spec.forces[i].name),
        time_constant: activation.time_constant,
    });
    Ok(plant.with_lagged_actuators(lagged.collect()))
}

/// Times of rows, at most the largest step apart as far as there may be as many rows.
fn even_times(start: f64, end: f64, largest_step: f64) -> Vec<f64> {
    // Without the rounding of a quotient that is meant to be whole.
    let steps = ((end - start) / largest_step - 1e-9).ceil();
    let rows = ((end - start) * ROWS_PER_SECOND).max(FEWEST_ROWS).ceil().max(steps.min(MOST_ROWS)) as usize;
    (0..=rows).map(|i| if i == rows { end } else { start + (end - start) * i as f64 / rows as f64 }).collect()
}

/// Controls of all actuators over time, also of those that apply no force; those of a `CorrectionController` first, as
/// in the rows (not the labels) that OpenSim writes.
fn controls_of(states: &Storage, system: &System) -> Storage {
    let correction = system.actors.iter().find_map(|actor| match actor {
        Actor::Correction(correction) => Some(correction),
        _ => None,
    });
    let actuators = system.actuator_names();
    let labels = correction.iter().flat_map(|c| c.labels.clone()).chain(actuators.iter().cloned());
    let mut storage = Storage::new("controls", labels.collect());
    if storage.labels.is_empty() {
        return storage;
    }
    let n = system.model.n_coordinates();
    for (&time, row) in states.time.iter().zip(&states.rows) {
        let [q, u]: [Vec<f64>; 2] = [0, 1].map(|of| (0..n).map(|i| row[2 * i + of]).collect());
        let mut values = correction.map_or_else(Vec::new, |c| c.forces(time, &q, &u));
        values.extend(actuators.iter().map(|a| system.controls.at(a, time).unwrap_or(0.0)));
        storage.push(time, values);
    }
    storage
}

fn write(frame: &Frame, states: &Storage, system: &System, outcome: &mut Outcome) {
    let storage = controls_of(states, system);
    let name = &frame.name;
    outcome.add_storage(&frame.results, &format!("{name}_controls.sto"), &storage, frame.precision);
    outcome.add_storage(&frame.results, &format!("{name}_states.sto"), states, frame.precision);
    let mut degrees = states.clone();
    degrees.in_degrees = true;
    for row in &mut degrees.rows {
        for i in (0..system.model.n_coordinates()).filter(|i| system.is_angle(*i)) {
            row[2 * i] = row[2 * i].to_degrees();
            row[2 * i + 1] = row[2 * i + 1].to_degrees();
        }
    }
    let (columns, rows) = (degrees.labels.len() + 1, degrees.len());
    let range = |time: f64| printed(time, 6).trim().to_owned();
    let (first, last) = (range(degrees.time[0]), range(degrees.time[rows - 1]));
    degrees.description = format!(
        "\n# SIMM Motion File Header:\nname {name}\ndatacolumns {columns}\ndatarows {rows}\notherdata 1\nrange {first} \
         {last}\n"
    );
    let path = frame.results.join(format!("{name}_states_degrees.mot"));
    outcome.files.push(ResultFile { path, bytes: degrees.text(frame.precision).into_bytes(), is_named: false });
}
