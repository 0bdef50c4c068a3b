//! Coordinates from marker trajectories: OpenSim's `InverseKinematicsTool`.

use super::error::{ToolError, ToolProblem};
use super::ik_solver::{CoordinateGoal, InverseKinematics, MarkerGoal};
use super::motion::{columns_of, coordinate_splines, read_coordinates};
use super::result::Outcome;
use super::setup::Properties;
use super::system::System;
use carpus_numerics::printable::number;
use carpus_osim::functions::Function;
use carpus_osim::osim::spec::CoordinateIndex;
use carpus_osim::storage::{Markers, Storage};

/// Tasks of a setup.
#[derive(Debug, Default)]
pub struct Tasks {
    /// Markers and their weights.
    pub markers: Vec<(String, f64)>,
    /// Coordinates, their weights, and the wanted value over time.
    pub coordinates: Vec<(CoordinateIndex, f64, Function)>,
}

/// What `Kinematics` writes into its files.
pub const DESCRIPTION: &str = "\nUnits are S.I. units (second, meters, Newtons, ...)\nIf the header above contains a \
                               line with 'inDegrees', this indicates whether rotational values are in degrees (yes) or \
                               radians (no).\n\n";

/// Reads an `IKTaskSet`.
///
/// # Errors
/// Tasks of another class, coordinates that the model or the file lacks.
pub fn read_tasks(tool: &Properties, system: &System) -> Result<Tasks, ToolError> {
    let file = tool.file("coordinate_file");
    // As in OpenSim a file that is named has to be there, whether a task needs it or not.
    file.as_ref().map(Storage::read).transpose()?;
    let mut tasks = Tasks::default();
    let mut splines: Option<Vec<Option<Function>>> = None;
    for task in tool.objects("IKTaskSet") {
        if !task.boolean("apply", true)? {
            task.ignore();
            continue;
        }
        let is_weight = |weight: f64| (0.0..f64::INFINITY).contains(&weight);
        let weight = task.number_that("weight", 0.0, "a weight of 0 or more", is_weight)?;
        let kind = task.string("value_type").to_lowercase();
        let value = task.number("value", 0.0)?;
        match task.class() {
            "IKMarkerTask" => tasks.markers.push((task.name(), weight)),
            "IKCoordinateTask" => {
                let name = task.name();
                let Some(coordinate) = system.model.coordinate(&name) else {
                    let names = system.model.coordinates.iter().map(|c| c.name.as_str());
                    let nearest = carpus_osim::osim::error::nearest(&name, names);
                    let problem = ToolProblem::Unknown { kind: "coordinate", name, nearest };
                    return Err(ToolError::at(tool.setup().path(), task.line(), problem));
                };
                let wanted = match kind.as_str() {
                    "from_file" => {
                        let Some(file) = &file else {
                            return Err(tool.missing("coordinate_file", "the file that tasks with from_file need"));
                        };
                        if splines.is_none() {
                            // OpenSim takes angles of this file for degrees, whatever its header says.
                            let mut storage = read_coordinates(file, -1.0, system)?;
                            storage.in_degrees = true;
                            super::motion::to_radians(&mut storage, system);
                            splines = Some(coordinate_splines(&storage, &columns_of(&storage, system), file)?);
                        }
                        let found = splines.as_ref().and_then(|s| s[coordinate.0].clone());
                        found.ok_or_else(|| {
                            let what = format!("{}: has no column for coordinate `{name}`", file.display());
                            ToolError::at(tool.setup().path(), task.line(), ToolProblem::Data { what })
                        })?
                    }
                    "manual_value" => Function::constant(value),
                    "default_value" | "" => Function::constant(system.model.coordinates[coordinate.0].default_value),
                    other => {
                        let expected = "default_value, manual_value or from_file";
                        return Err(task.bad_value("value_type", expected, other));
                    }
                };
                // Coordinates that are held anyway are no goals.
                if !system.model.coordinates[coordinate.0].locked {
                    tasks.coordinates.push((coordinate, weight, wanted));
                }
            }
            other => return Err(task.unsupported(other, "expected IKMarkerTask or IKCoordinateTask")),
        }
    }
    Ok(tasks)
}

/// Goals for the markers that both model and data have, and their positions among the data's columns.
pub fn marker_goals(system: &System, data: &Markers, tasks: &Tasks) -> (Vec<MarkerGoal>, Vec<usize>, Vec<String>) {
    let (mut goals, mut columns, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for (column, name) in data.names.iter().enumerate() {
        let weight = match tasks.markers.iter().find(|(n, _)| n == name) {
            Some((_, weight)) => *weight,
            // Without any marker task all markers count alike.
            None if tasks.markers.is_empty() => 1.0,
            None => continue,
        };
        let Some(marker) = system.spec.markers.iter().find(|m| m.name == *name) else { continue };
        let frame = system.model.frame(marker.frame);
        goals.push(MarkerGoal { base: frame.base, station: frame.X_BF * marker.location, weight });
        columns.push(column);
        names.push(name.clone());
    }
    (goals, columns, names)
}

/// End of the range that OpenSim 4.6 takes where a setup gives none [s]: meant to be infinite there, 2 by a slip.
const OPENSIM_DEFAULT_END: f64 = 2.0;

/// Runs the tool.
///
/// # Errors
/// The setup, its files, or names that do not fit together.
pub fn run(tool: &Properties, system: System, outcome: &mut Outcome) -> Result<(), ToolError> {
    let setup = tool.setup().path().to_owned();
    let results = tool.setup().resolve(&tool.string("results_directory"));
    let constraint_weight =
        tool.number_that("constraint_weight", f64::INFINITY, "a number from 0 on, or Inf", |weight| weight >= 0.0)?;
    if constraint_weight.is_finite() {
        let text = format!(
            "constraint_weight {} has no effect, as in OpenSim 4.6: constraints hold",
            number(constraint_weight)
        );
        outcome.warn(&setup, tool.child("constraint_weight").map_or(0, |weight| weight.line()), text);
    }
    // Searches end at the minimum, whatever accuracy is asked for.
    tool.number_that("accuracy", 1e-5, "a number above 0 and below 1", |value| value > 0.0 && value < 1.0)?;
    let [start, end] = tool.time_range("time_range", [f64::NEG_INFINITY, OPENSIM_DEFAULT_END])?;
    let report_errors = tool.boolean("report_errors", true)?;
    let report_places = tool.boolean("report_marker_locations", false)?;
    let output = tool.file("output_motion_file");
    let marker_file = tool.file("marker_file").ok_or_else(|| tool.missing("marker_file", "a .trc or .sto file"))?;
    tool.ignore_all(&["input_directory", "model_file"]);
    let tasks = read_tasks(tool, &system)?;
    let data = Markers::read(&marker_file)?;
    data.warnings.iter().for_each(|text| outcome.warn(&marker_file, 0, text.clone()));
    let (goals, columns, names) = marker_goals(&system, &data, &tasks);
    if goals.is_empty() {
        let what = format!("none of the markers of {} that have a task is in the model", marker_file.display());
        return Err(tool.error_at("IKTaskSet", ToolProblem::Data { what }));
    }
    for (name, _) in tasks.markers.iter().filter(|(name, _)| !names.contains(name)) {
        let whose = if data.names.contains(name) { "the model" } else { "the marker file" };
        outcome.warn(
            &setup,
            tool.child("IKTaskSet").map_or(0, |t| t.line()),
            format!("marker `{name}`: {whose} has none"),
        );
    }
    let (first, last) = (data.time[0], data.time[data.time.len() - 1]);
    if tool.string("time_range").is_empty() && last > OPENSIM_DEFAULT_END {
        let text = format!(
            "no time_range: as in OpenSim 4.6 frames after {OPENSIM_DEFAULT_END} s are left out, of data to {last} s; \
             <time_range> takes more"
        );
        outcome.warn(&setup, 0, text);
    }
    let (start, end) = (start.max(first), end.min(last));
    if end < start {
        return Err(tool.bad_value("time_range", "a range that meets the marker data", &format!("{start} {end}")));
    }
    let frames = data.nearest(start)..=data.nearest(end);

    let mut solver = InverseKinematics::new(&system);
    solver.markers = goals;
    solver.coordinates =
        tasks.coordinates.iter().map(|(c, weight, _)| CoordinateGoal { coordinate: *c, weight: *weight }).collect();
    let mut q = system.default_state()?.q;
    let coordinate_names = system.model.coordinates.iter().map(|c| c.name.clone()).collect();
    let mut motion = Storage::new("Coordinates", coordinate_names);
    (motion.in_degrees, motion.description) = (true, DESCRIPTION.to_owned());
    let error_labels = ["total_squared_error", "marker_error_RMS", "marker_error_max"].map(str::to_owned);
    let mut errors = Storage::new("Model Marker Errors from IK", error_labels.into());
    let place_labels = names.iter().flat_map(|n| ["tx", "ty", "tz"].map(|k| format!("{n}_{k}"))).collect();
    let mut places = Storage::new("Model Marker Locations from IK", place_labels);
    let mut unsolved = Vec::new();
    for frame in frames {
        let time = data.time[frame];
        let seen: Vec<_> = columns.iter().map(|c| data.rows[frame][*c]).collect();
        let values: Vec<f64> = tasks.coordinates.iter().map(|(_, _, f)| f.value(time)).collect();
        let converged = if motion.is_empty() {
            solver.solve_from_afar(time, &mut q, &seen, &values)
        } else {
            solver.solve(time, &mut q, &seen, &values)
        };
        if !converged {
            unsolved.push(time);
        }
        let row = q.iter().enumerate().map(|(i, q)| if system.is_angle(i) { q.to_degrees() } else { *q });
        motion.push(time, row.collect());
        let found = solver.marker_places(&q);
        let squared = found.iter().zip(&seen).zip(&solver.markers).map(|((p, s), m)| {
            let error = (p - s).norm_squared();
            if error.is_finite() && m.weight > 0.0 { error } else { 0.0 }
        });
        let squared: Vec<f64> = squared.collect();
        let total: f64 = squared.iter().sum();
        let largest = squared.iter().copied().fold(0.0, f64::max);
        errors.push(time, vec![total, (total / squared.len() as f64).sqrt(), largest.sqrt()]);
        places.push(time, found.iter().flat_map(|p| [p.x, p.y, p.z]).collect());
    }
    if let Some(time) = unsolved.first() {
        let count = unsolved.len();
        let frames = if count == 1 { "frame" } else { "frames" };
        let text = format!("{count} {frames} did not converge, the first at {time} s");
        outcome.warn(&marker_file, 0, text);
    }
    let rms = errors.column(1);
    outcome.summary.push(format!(
        "inverse kinematics of {} frames, {} markers, error RMS {:.2} mm on average, {:.2} mm at most",
        motion.len(),
        names.len(),
        1e3 * rms.iter().sum::<f64>() / rms.len() as f64,
        1e3 * rms.iter().copied().fold(0.0, f64::max)
    ));
    if let Some(path) = output {
        outcome.files.push(super::result::ResultFile { path, bytes: motion.text(8).into_bytes(), is_named: true });
    }
    if report_errors {
        outcome.add_storage(&results, &format!("{}_ik_marker_errors", tool.name()), &errors, 8);
    }
    if report_places {
        outcome.add_storage(&results, &format!("{}_ik_model_marker_locations", tool.name()), &places, 8);
    }
    Ok(())
}
