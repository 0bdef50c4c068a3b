//! Scaling a model to a participant by markers and placing its markers: OpenSim's `ScaleTool`.

use std::path::PathBuf;

use nalgebra::Vector3;

use super::error::{ToolError, ToolProblem};
use super::ik_solver::{CoordinateGoal, InverseKinematics};
use super::inverse_kinematics::{marker_goals, read_tasks};
use super::result::{Outcome, ResultFile};
use super::setup::{Properties, Setup};
use super::system::System;
use carpus_osim::osim::spec::{MarkerSpec, ModelSpec};
use carpus_osim::osim::{ComponentSet, OsimFile};
use carpus_osim::storage::{Markers, Storage};
use carpus_simulation::scaling::{ScaleRequest, scale};

/// Runs the tool.
///
/// # Errors
/// The setup, its files, names that the model does not have.
pub fn run(tool: &Properties, path: PathBuf, mut file: OsimFile, outcome: &mut Outcome) -> Result<(), ToolError> {
    let mass = tool.number("mass", -1.0)?;
    tool.ignore_all(&["height", "age", "notes"]);
    if let Some(maker) = tool.child("GenericModelMaker") {
        maker.ignore_all(&["model_file"]);
        if let Some(markers) = maker.file("marker_set_file") {
            let count = add_markers(&markers, &mut file)?;
            outcome.summary.push(format!("{count} markers from {}", markers.display()));
        }
    }
    if let Some(scaler) = tool.child("ModelScaler") {
        if scaler.boolean("apply", true)? {
            scale_model(&scaler, mass, &mut file, outcome)?;
        } else {
            scaler.ignore();
        }
    }
    if let Some(scaler) = tool.child("ModelScaler")
        && let Some(output) = scaler.file("output_model_file")
    {
        outcome.files.push(ResultFile { path: output, bytes: named(&file, &tool.name()), is_named: true });
    }
    match tool.child("MarkerPlacer") {
        Some(placer) if placer.boolean("apply", true)? => place_markers(&placer, &tool.name(), &path, file, outcome),
        Some(placer) => {
            placer.ignore();
            Ok(())
        }
        None => Ok(()),
    }
}

/// Adds the markers of a file to a model; those that it has already get the file's body and location.
fn add_markers(path: &std::path::Path, file: &mut OsimFile) -> Result<usize, ToolError> {
    let setup = Setup::read(path)?;
    let markers = setup.object().objects("");
    let (mut moved, mut removed, mut added) = (Vec::new(), Vec::new(), Vec::new());
    for marker in &markers {
        let name = marker.name();
        let location = marker.vector("location")?;
        let location = format!("{} {} {}", location.x, location.y, location.z);
        let fixed = marker.boolean("fixed", false)?;
        let sockets = ["body", "socket_parent_frame", "socket_parent_frame_connectee_name"];
        let Some(frame) = sockets.iter().find_map(|s| marker.text(s)) else {
            return Err(marker.missing("socket_parent_frame", "the body that the marker is fixed to"));
        };
        let body = frame.rsplit('/').next().unwrap_or_default();
        let there = file.spec.markers.iter().find(|m| m.name == name);
        if let Some(there) = there {
            if file.spec.frames[there.frame.0].name == body {
                moved.push((there.at.path.clone(), "location", location));
                if there.fixed != fixed {
                    moved.push((there.at.path.clone(), "fixed", fixed.to_string()));
                }
                continue;
            }
            removed.push(there.at.path.clone());
        }
        let socket = match file.spec.document_version {
            ..30505 => format!("<body>{body}</body>"),
            30505..40000 => format!("<socket_parent_frame_connectee_name>{body}</socket_parent_frame_connectee_name>"),
            _ if body == "ground" => "<socket_parent_frame>/ground</socket_parent_frame>".to_owned(),
            _ => format!("<socket_parent_frame>/bodyset/{body}</socket_parent_frame>"),
        };
        added.push(format!(
            "<Marker name=\"{name}\">\n\t{socket}\n\t<location>{location}</location>\n\t<fixed>{fixed}</fixed>\n\
             </Marker>"
        ));
    }
    let moved: Vec<_> = moved.iter().map(|(path, property, text)| (path.as_str(), *property, text.clone())).collect();
    let removed: Vec<&str> = removed.iter().map(String::as_str).collect();
    file.set_properties(&moved)
        .and_then(|()| file.remove_components(&removed))
        .and_then(|()| file.add_components(ComponentSet::Markers, &added))
        .map_err(|e| ToolError::new(path, e))?;
    Ok(markers.len())
}

/// A marker set as a file.
fn marker_set(spec: &ModelSpec) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<OpenSimDocument Version=\"40000\">\n\t<MarkerSet \
         name=\"markerset\">\n\t\t<objects>\n",
    );
    for marker in &spec.markers {
        let p = marker.location;
        text.push_str(&format!(
            "\t\t\t<Marker name=\"{}\">\n\t\t\t\t<socket_parent_frame>{}</socket_parent_frame>\n\t\t\t\t<location>{} \
             {} {}</location>\n\t\t\t\t<fixed>{}</fixed>\n\t\t\t</Marker>\n",
            marker.name, spec.frames[marker.frame.0].at.path, p.x, p.y, p.z, marker.fixed
        ));
    }
    text.push_str("\t\t</objects>\n\t\t<groups />\n\t</MarkerSet>\n</OpenSimDocument>\n");
    text
}

/// The text of the model with another name.
fn named(file: &OsimFile, name: &str) -> Vec<u8> {
    let bytes = file.document.bytes();
    let Some(&model) = file.document.children(file.document.root()).first() else { return bytes.to_vec() };
    let old = file.document.attribute(model, "name").unwrap_or_default();
    let start = file.document.range(model).start;
    let attribute = format!("name=\"{old}\"");
    let end = bytes[start..].iter().position(|b| *b == b'>').map_or(bytes.len(), |i| start + i);
    let found = bytes[start..end].windows(attribute.len()).position(|w| w == attribute.as_bytes());
    let Some(found) = found.filter(|_| !name.is_empty() && !name.contains(['"', '<', '&'])) else {
        return bytes.to_vec();
    };
    let at = start + found;
    [&bytes[..at], format!("name=\"{name}\"").as_bytes(), &bytes[at + attribute.len()..]].concat()
}

fn range_of(properties: &Properties) -> Result<Option<[f64; 2]>, ToolError> {
    match properties.words("time_range") {
        Some(words) if words.len() >= 2 => properties.time_range("time_range", [0.0, 0.0]).map(Some),
        _ => Ok(None),
    }
}

/// Frames between two times as `MarkerData::findFrameRange` takes them.
fn frames(markers: &Markers, [start, end]: [f64; 2]) -> std::ops::RangeInclusive<usize> {
    let first = markers.time.iter().rposition(|t| *t <= start).unwrap_or(0);
    let last = (first..markers.time.len()).find(|i| markers.time[*i] >= end - 1e-12);
    first..=last.unwrap_or(markers.time.len() - 1)
}

fn scale_model(scaler: &Properties, mass: f64, file: &mut OsimFile, outcome: &mut Outcome) -> Result<(), ToolError> {
    let setup = scaler.setup().path().to_owned();
    let order = scaler.words("scaling_order").unwrap_or_default();
    let preserve = scaler.boolean("preserve_mass_distribution", false)?;
    let markers = match scaler.file("marker_file") {
        Some(path) => {
            let markers = Markers::read(&path)?;
            markers.warnings.iter().for_each(|text| outcome.warn(&path, 0, text.clone()));
            Some(markers)
        }
        None => None,
    };
    let range = range_of(scaler)?;
    let mut factors: Vec<(String, [f64; 3])> = Vec::new();
    let mut set = |body: &str, axes: [bool; 3], values: [f64; 3]| {
        let at = match factors.iter().position(|(name, _)| name == body) {
            Some(at) => at,
            None => {
                factors.push((body.to_owned(), [1.0; 3]));
                factors.len() - 1
            }
        };
        (0..3).filter(|k| axes[*k]).for_each(|k| factors[at].1[k] = values[k]);
    };
    let (measurements, scales) = (scaler.objects("MeasurementSet"), scaler.objects("ScaleSet"));
    for step in &order {
        match step.as_str() {
            "measurements" => {
                let system = System::of_spec(&setup, file.spec.clone())?;
                for measurement in &measurements {
                    if !measurement.boolean("apply", true)? {
                        measurement.ignore();
                        continue;
                    }
                    let Some(markers) = &markers else {
                        return Err(scaler.missing("marker_file", "a .trc file, for measurements"));
                    };
                    let Some(range) = range else {
                        return Err(scaler.missing("time_range", "two times, for measurements"));
                    };
                    let factor = measure(measurement, &system, markers, range)?;
                    for body in measurement.objects("BodyScaleSet") {
                        let axes = body.words("axes").unwrap_or_default();
                        let has = |axis: &str| axes.iter().any(|a| a.eq_ignore_ascii_case(axis));
                        let Ok(factor) = &factor else { continue };
                        set(&body.name(), [has("X"), has("Y"), has("Z")], [*factor; 3]);
                    }
                    match factor {
                        Ok(factor) => {
                            outcome.summary.push(format!("measurement {}: factor {factor:.6}", measurement.name()));
                        }
                        Err(what) => outcome.warn(&setup, measurement.line(), format!("{what}; not used")),
                    }
                }
            }
            "manualScale" => {
                for scale in &scales {
                    let body = scale.string("segment");
                    let values = scale.numbers_that("scales", [1.0; 3], "3 numbers above 0", |factors| {
                        factors.iter().all(|factor| *factor > 0.0 && factor.is_finite())
                    })?;
                    if scale.boolean("apply", true)? {
                        set(&body, [true; 3], values);
                    }
                }
            }
            other => return Err(scaler.bad_value("scaling_order", "measurements or manualScale", other)),
        }
    }
    measurements.iter().chain(&scales).for_each(Properties::ignore);
    // As in OpenSim, factors of bodies that the model does not have scale nothing.
    factors.retain(|(name, _)| {
        let known = name == "ground" || file.spec.bodies.iter().any(|b| b.name == *name);
        if !known {
            outcome.warn(
                &setup,
                scaler.line(),
                format!("the model has no body `{name}`: its scale factors are not used"),
            );
        }
        known
    });
    let request = ScaleRequest {
        factors: factors.clone(),
        preserve_mass_distribution: preserve,
        final_mass: (mass > 0.0).then_some(mass),
    };
    let scaled = scale(file, &request).map_err(|error| {
        let what = error.to_string();
        scaler.error_at("MeasurementSet", ToolProblem::Data { what })
    })?;
    for (component, why) in &scaled.left {
        outcome.warn(&setup, scaler.line(), format!("{component} was not scaled: {why}"));
    }
    for (what, hint) in scaled.doubts() {
        outcome.warn(&setup, scaler.line(), format!("{what}: {hint}"));
    }
    let [before, after] = scaled.mass;
    outcome.summary.push(format!("scaled: mass {before:.6} kg to {after:.6} kg"));
    if let Some(output) = scaler.file("output_scale_file") {
        let text = scale_set(&file.spec, &factors);
        outcome.files.push(ResultFile { path: output, bytes: text.into_bytes(), is_named: true });
    }
    Ok(())
}

/// Mean over marker pairs of the distance in the data over that in the model; `Err`: why there is none.
fn measure(
    measurement: &Properties,
    system: &System,
    markers: &Markers,
    range: [f64; 2],
) -> Result<Result<f64, String>, ToolError> {
    let state = system.default_state()?;
    let mut work = system.new_work();
    let cache = work.dynamics.update(&state.q, &state.u);
    let pairs = measurement.objects("MarkerPairSet");
    let mut sum = 0.0;
    for pair in &pairs {
        let names = pair.words("markers").unwrap_or_default();
        let [first, second] = names.as_slice() else {
            return Err(pair.bad_value("markers", "the names of two markers", &names.join(" ")));
        };
        let place = |name: &String| {
            let marker = system.spec.markers.iter().find(|m| m.name == *name);
            marker.map(|m| cache.X_GF(&system.model, m.frame) * m.location)
        };
        let column = |name: &String| markers.names.iter().position(|n| n == name);
        let lacks =
            |name: &str, whose: &str| format!("measurement {}: {whose} has no marker `{name}`", measurement.name());
        let (a, b) = match (place(first), place(second)) {
            (Some(a), Some(b)) => (a, b),
            (None, _) => return Ok(Err(lacks(first, "the model"))),
            (_, None) => return Ok(Err(lacks(second, "the model"))),
        };
        let (c, d) = match (column(first), column(second)) {
            (Some(c), Some(d)) => (c, d),
            (None, _) => return Ok(Err(lacks(first, "the marker file"))),
            (_, None) => return Ok(Err(lacks(second, "the marker file"))),
        };
        let rows = frames(markers, range);
        let count = rows.clone().count() as f64;
        let length: f64 = rows.map(|i| (markers.rows[i][c] - markers.rows[i][d]).norm()).sum::<f64>() / count;
        sum += length / (a - b).norm();
    }
    let factor = sum / pairs.len() as f64;
    if factor.is_nan() {
        return Ok(Err(format!("measurement {}: a marker is not seen in all frames", measurement.name())));
    }
    if !(factor > 0.0 && factor.is_finite()) {
        let text = "two of its markers are at the same place, in the model or in the marker file";
        return Ok(Err(format!("measurement {}: {text}", measurement.name())));
    }
    Ok(Ok(factor))
}

/// The factors as OpenSim writes them: of every frame.
fn scale_set(spec: &ModelSpec, factors: &[(String, [f64; 3])]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n<OpenSimDocument \
         Version=\"40600\">\n\t<ScaleSet>\n\t\t<objects>\n",
    );
    let names = std::iter::once("ground").chain(spec.bodies.iter().map(|b| b.name.as_str()));
    for name in names {
        let [x, y, z] = factors.iter().find(|(n, _)| n == name).map_or([1.0; 3], |(_, f)| *f);
        text.push_str(&format!(
            "\t\t\t<Scale>\n\t\t\t\t<scales> {x} {y} \
             {z}</scales>\n\t\t\t\t<segment>{name}</segment>\n\t\t\t\t<apply>true</apply>\n\t\t\t</Scale>\n"
        ));
    }
    text.push_str("\t\t</objects>\n\t\t<groups />\n\t</ScaleSet>\n</OpenSimDocument>\n");
    text
}

fn place_markers(
    placer: &Properties,
    name: &str,
    path: &std::path::Path,
    mut file: OsimFile,
    outcome: &mut Outcome,
) -> Result<(), ToolError> {
    let marker_file = placer.file("marker_file").ok_or_else(|| placer.missing("marker_file", "a .trc file"))?;
    let range = range_of(placer)?.ok_or_else(|| placer.missing("time_range", "two times"))?;
    let move_markers = placer.boolean("move_model_markers", true)?;
    placer.ignore_all(&["max_marker_movement"]);
    let data = Markers::read(&marker_file)?;
    data.warnings.iter().for_each(|text| outcome.warn(&marker_file, 0, text.clone()));
    let system = System::of_spec(path, file.spec.clone())?;
    let tasks = read_tasks(placer, &system)?;
    let (goals, columns, _) = marker_goals(&system, &data, &tasks);
    if goals.is_empty() {
        let found = format!("{} markers of the model", system.spec.markers.len());
        let expected = format!("tasks of markers that the model and {} have", marker_file.display());
        return Err(placer.bad_value("IKTaskSet", &expected, &found));
    }
    let rows: Vec<usize> = {
        let within = |i: &usize| data.time[*i] >= range[0] - 1e-9 && data.time[*i] <= range[1] + 1e-9;
        (0..data.time.len()).filter(within).collect()
    };
    if rows.is_empty() {
        return Err(placer.bad_value("time_range", "a range that meets the marker data", &format!("{range:?}")));
    }
    // Frames in which a marker is not seen do not count for it.
    let mean = |column: usize| {
        let seen =
            || rows.iter().map(|i| data.rows[*i][column]).filter(|p: &Vector3<f64>| p.iter().all(|x| x.is_finite()));
        seen().sum::<Vector3<f64>>() / seen().count() as f64
    };
    let means: Vec<Vector3<f64>> = (0..data.names.len()).map(mean).collect();
    let mut solver = InverseKinematics::new(&system);
    solver.markers = goals;
    solver.coordinates =
        tasks.coordinates.iter().map(|(c, weight, _)| CoordinateGoal { coordinate: *c, weight: *weight }).collect();
    let mut state = system.default_state()?;
    state.time = range[0];
    let seen: Vec<Vector3<f64>> = columns.iter().map(|c| means[*c]).collect();
    let values: Vec<f64> = tasks.coordinates.iter().map(|(_, _, f)| f.value(range[0])).collect();
    if !solver.solve_from_afar(range[0], &mut state.q, &seen, &values) {
        outcome.warn(&marker_file, 0, "the static pose did not converge");
    }
    let found = solver.marker_places(&state.q);
    let total: f64 = found.iter().zip(&seen).map(|(p, s)| (p - s).norm_squared()).filter(|e| e.is_finite()).sum();
    outcome.summary.push(format!(
        "static pose: marker error RMS {:.2} mm over {} markers",
        1e3 * (total / found.len().max(1) as f64).sqrt(),
        found.len()
    ));
    let mut work = system.new_work();
    let cache = work.dynamics.update(&state.q, &state.u);
    if move_markers {
        let mut moved = Vec::new();
        for marker in &system.spec.markers {
            let Some(column) = data.names.iter().position(|n| *n == marker.name) else { continue };
            if marker.fixed || !means[column].iter().all(|x| x.is_finite()) {
                continue;
            }
            let place = cache.X_GF(&system.model, marker.frame).inverse_transform_point(&means[column]);
            let text = format!("{} {} {}", place.x, place.y, place.z);
            moved.push((marker.at.path.as_str(), "location", text));
        }
        file.set_properties(&moved).map_err(|e| ToolError::new(path, e))?;
        outcome.summary.push(format!("{} markers moved", moved.len()));
    }
    // As `Model::deleteUnusedMarkers` does.
    let is_unused = |m: &&MarkerSpec| !data.names.contains(&m.name);
    let unused: Vec<&MarkerSpec> = system.spec.markers.iter().filter(is_unused).collect();
    if !unused.is_empty() {
        let names: Vec<&str> = unused.iter().map(|m| m.name.as_str()).collect();
        let text = format!("markers of the model that are not in the marker file are removed: {}", names.join(", "));
        outcome.warn(&marker_file, 0, text);
        let paths: Vec<&str> = unused.iter().map(|m| m.at.path.as_str()).collect();
        file.remove_components(&paths).map_err(|e| ToolError::new(path, e))?;
    }
    if let Some(output) = placer.file("output_motion_file") {
        let mut pose = Storage::new("static pose", system.state_names());
        pose.push(range[0], system.state_values(&state));
        outcome.files.push(ResultFile { path: output, bytes: pose.text(8).into_bytes(), is_named: true });
    }
    if let Some(output) = placer.file("output_marker_file") {
        outcome.files.push(ResultFile { path: output, bytes: marker_set(&file.spec).into_bytes(), is_named: true });
    }
    if let Some(output) = placer.file("output_model_file") {
        outcome.files.push(ResultFile { path: output, bytes: named(&file, name), is_named: true });
    }
    Ok(())
}
