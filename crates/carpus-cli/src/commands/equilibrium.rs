//! `carpus equilibrium`: fibre and tendon lengths, forces and moments of muscles at rest in a posture.

use serde::Serialize;

use crate::args::{EquilibriumArgs, Global};
use crate::failure::{self, Diagnostic, Failure};
use crate::print_result;
use crate::table::{fixed, table};
use carpus_multibody::muscles::{EquilibriumStatus, Millard2012};
use carpus_numerics::printable::{number, visible};
use carpus_osim::osim::spec::{CoordinateIndex, MuscleIndex, MuscleKind};
use carpus_session::account::csv_text;
use carpus_session::account::warning_result;
use carpus_session::model::{self, LoadedModel, Needs};
use carpus_session::output::OutputFolder;
use carpus_session::path_check;

/// One muscle at rest.
#[derive(Debug, Serialize)]
struct Row {
    muscle: String,
    path_length_m: f64,
    fiber_length_m: f64,
    normalized_fiber_length: f64,
    tendon_length_m: f64,
    active_fiber_force_n: f64,
    passive_fiber_force_n: f64,
    pennation_angle_deg: f64,
    tendon_force_n: f64,
    status: &'static str,
    moments: Vec<Moment>,
}

/// What a muscle exerts about a coordinate.
#[derive(Debug, Serialize)]
struct Moment {
    coordinate: String,
    moment_arm_m: f64,
    moment_n_m: f64,
}

/// A path at the posture.
struct PathLength {
    muscle: MuscleIndex,
    length: f64,
    polyline: f64,
}

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a muscle, or the output file.
pub fn run(args: &EquilibriumArgs, global: &Global) -> Result<(), Failure> {
    let mut messages = Vec::new();
    let inputs = std::slice::from_ref(&args.model.model);
    let csv_file = args.csv.as_ref().map(|file| csv_target(file, inputs)).transpose()?;
    let loaded = model::load(&args.model.model, Needs::Motion, args.model.allow_unsupported, &mut messages)?;
    let muscles = computed_muscles(&loaded, args, &mut messages)?;
    let posture = loaded.posture(&args.set, &mut messages)?;
    let about = coordinates(&loaded, args)?;
    if !args.moment_about.is_empty() {
        messages.extend(about.iter().filter_map(|coordinate| loaded.ambiguous(*coordinate)));
    }
    let mut paths = Vec::new();
    let rows = rows(&loaded, &muscles, &posture, &about, args.activation, &mut paths)?;
    let set: Vec<String> = args.set.iter().map(ToString::to_string).collect();
    let pose = if set.is_empty() { "the default posture".to_string() } else { set.join(", ") };
    messages.extend(paths.iter().filter_map(|p| match path_check::wound_too_far(p.length, p.polyline) {
        true => Some(path_check::wound_message(&loaded, p.muscle, p.length, p.polyline, &pose, None)),
        false => path_check::overstretched(&loaded, p.muscle, p.length),
    }));
    failure::print(&messages);
    if let Some((folder, name)) = &csv_file {
        folder.write(name, csv(&rows)?.as_bytes())?;
    }
    if global.json {
        let warnings: Vec<_> = messages.iter().map(warning_result).collect();
        let result = serde_json::json!({
            "schema": "carpus.equilibrium/1", "model": loaded.model.name, "activation": args.activation,
            "posture": set, "muscles": rows, "warnings": warnings,
        });
        return print_result(&result.to_string());
    }
    print_result(&readable(&rows))
}

/// The folder and name of the CSV file, found to be writable.
fn csv_target(file: &std::path::Path, inputs: &[std::path::PathBuf]) -> Result<(OutputFolder, String), Failure> {
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(std::path::Path::new("."));
    let name = file.file_name().and_then(|n| n.to_str());
    let name = name.ok_or_else(|| Diagnostic::error("--csv: expected the name of a file").in_file(file))?;
    let folder = OutputFolder::create(folder, inputs)?;
    folder.refuse_input(file)?;
    Ok((folder, name.to_string()))
}

/// The muscles asked for whose force is computed. Others are errors, or warnings if allowed.
fn computed_muscles(
    loaded: &LoadedModel,
    args: &EquilibriumArgs,
    messages: &mut Vec<Diagnostic>,
) -> Result<Vec<MuscleIndex>, Failure> {
    let mut computed = Vec::new();
    let mut others = Vec::new();
    for index in loaded.muscles(&args.muscles)? {
        let muscle = &loaded.file.spec.muscles[index.0];
        match &muscle.kind {
            MuscleKind::Millard2012Equilibrium(_) => computed.push(index),
            MuscleKind::PathOnly { class, .. } => {
                let text = format!("{}: {class} is not computed, only Millard2012EquilibriumMuscle is", muscle.at.path);
                let message =
                    if args.model.allow_unsupported { Diagnostic::warning(text) } else { Diagnostic::error(text) };
                let message = message.in_file(&loaded.path).at_line(muscle.at.line);
                others.push(message.hint("--allow-unsupported leaves such muscles out; --muscles picks some"));
            }
        }
    }
    if args.model.allow_unsupported {
        messages.append(&mut others);
    }
    if others.is_empty() { Ok(computed) } else { Err(others.into()) }
}

/// The coordinates about which moments are given.
fn coordinates(loaded: &LoadedModel, args: &EquilibriumArgs) -> Result<Vec<CoordinateIndex>, Failure> {
    if !args.moment_about.is_empty() {
        return args.moment_about.iter().map(|name| loaded.coordinate(name)).collect();
    }
    args.set.iter().map(|a| loaded.coordinate(&a.coordinate)).collect()
}

fn rows(
    loaded: &LoadedModel,
    muscles: &[MuscleIndex],
    posture: &[f64],
    about: &[CoordinateIndex],
    activation: f64,
    lengths: &mut Vec<PathLength>,
) -> Result<Vec<Row>, Failure> {
    let model = &loaded.model;
    let mut cache = model.new_cache();
    model.update_positions(posture, &mut cache);
    let mut paths = loaded.muscle_paths(muscles)?;
    let mut rows = Vec::with_capacity(muscles.len());
    for (index, (path, geometry)) in muscles.iter().zip(&mut paths) {
        path.update(posture, &cache, geometry);
        let (length, polyline) = (geometry.length(), path.polyline_length(posture, &cache));
        lengths.push(PathLength { muscle: *index, length, polyline });
        rows.push(at_rest(loaded, *index, length, activation)?);
    }
    for coordinate in about {
        model.update_unit_motion(posture, *coordinate, &mut cache);
        for ((path, geometry), row) in paths.iter().zip(&mut rows) {
            let moment_arm_m = path.moment_arm(posture, &cache, geometry);
            row.moments.push(Moment {
                coordinate: model.coordinates[coordinate.0].name.clone(),
                moment_arm_m,
                moment_n_m: moment_arm_m * row.tendon_force_n,
            });
        }
    }
    Ok(rows)
}

/// A muscle at rest, without its moments.
fn at_rest(loaded: &LoadedModel, index: MuscleIndex, path_length: f64, activation: f64) -> Result<Row, Failure> {
    let spec = &loaded.file.spec.muscles[index.0];
    let unusable = |text: String| Diagnostic::error(text).in_file(&loaded.path).at_line(spec.at.line);
    let muscle = Millard2012::from_spec(spec).map_err(|e| unusable(e.to_string()))?;
    let found = muscle.equilibrium(path_length, activation).map_err(|e| unusable(e.to_string()))?;
    let state = muscle.dynamics(found.fiber_length, activation, path_length, 0.0);
    let numbers = [state.fiber_length, state.tendon_length, state.active_fiber_force, state.passive_fiber_force];
    if !numbers.iter().chain([&state.pennation_angle, &found.tendon_force]).all(|v| v.is_finite()) {
        let path_length = number(path_length);
        let text = format!("{}: forces at a path of {path_length} m are not finite: a property is absurd", spec.name);
        return Err(unusable(text).into());
    }
    let acts = if spec.applies_force { 1.0 } else { 0.0 };
    Ok(Row {
        muscle: visible(&spec.name).into_owned(),
        path_length_m: path_length,
        fiber_length_m: state.fiber_length,
        normalized_fiber_length: state.normalized_fiber_length,
        tendon_length_m: state.tendon_length,
        active_fiber_force_n: acts * state.active_fiber_force,
        passive_fiber_force_n: acts * state.passive_fiber_force,
        pennation_angle_deg: state.pennation_angle.to_degrees(),
        tendon_force_n: acts * found.tendon_force,
        status: match found.status {
            _ if !spec.applies_force => "applies_no_force",
            EquilibriumStatus::Converged => "converged",
            EquilibriumStatus::WeaklyDetermined => "weakly_determined",
            EquilibriumStatus::FiberAtLowerBound => "fiber_at_lower_bound",
            EquilibriumStatus::RigidTendon => "rigid_tendon",
        },
        moments: Vec::new(),
    })
}

fn readable(rows: &[Row]) -> String {
    let mut header: Vec<String> = [
        "muscle",
        "path mm",
        "fibre mm",
        "l/l_opt",
        "tendon mm",
        "pennation °",
        "active N",
        "passive N",
        "tendon force N",
    ]
    .map(String::from)
    .to_vec();
    if let Some(first) = rows.first() {
        header.extend(
            first
                .moments
                .iter()
                .flat_map(|m| [format!("arm({}) mm", m.coordinate), format!("moment({}) N·m", m.coordinate)]),
        );
    }
    header.push("note".to_string());
    let body = rows.iter().map(|r| {
        let mut cells = vec![
            r.muscle.clone(),
            fixed(1e3 * r.path_length_m, 1),
            fixed(1e3 * r.fiber_length_m, 2),
            fixed(r.normalized_fiber_length, 3),
            fixed(1e3 * r.tendon_length_m, 1),
            fixed(r.pennation_angle_deg, 1),
            fixed(r.active_fiber_force_n, 2),
            fixed(r.passive_fiber_force_n, 2),
            fixed(r.tendon_force_n, 2),
        ];
        for m in &r.moments {
            cells.extend([fixed(1e3 * m.moment_arm_m, 2), fixed(m.moment_n_m, 4)]);
        }
        cells.push(if r.status == "converged" { String::new() } else { r.status.replace('_', " ") });
        cells
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(&header, 1, body)
}

fn csv(rows: &[Row]) -> Result<String, Failure> {
    let mut header: Vec<String> = [
        "muscle",
        "path_length_m",
        "fiber_length_m",
        "normalized_fiber_length",
        "tendon_length_m",
        "active_fiber_force_n",
        "passive_fiber_force_n",
        "pennation_angle_deg",
        "tendon_force_n",
        "status",
    ]
    .map(String::from)
    .to_vec();
    if let Some(first) = rows.first() {
        let names = first.moments.iter().map(|m| &m.coordinate);
        header.extend(names.flat_map(|n| [format!("{n}_moment_arm_m"), format!("{n}_moment_n_m")]));
    }
    let cells = rows.iter().map(|r| {
        let numbers = [
            r.path_length_m,
            r.fiber_length_m,
            r.normalized_fiber_length,
            r.tendon_length_m,
            r.active_fiber_force_n,
            r.passive_fiber_force_n,
            r.pennation_angle_deg,
            r.tendon_force_n,
        ];
        let mut cells = vec![r.muscle.clone()];
        cells.extend(numbers.map(|v| format!("{v:.9}")));
        cells.push(r.status.to_string());
        cells.extend(r.moments.iter().flat_map(|m| [m.moment_arm_m, m.moment_n_m]).map(|v| format!("{v:.9}")));
        cells
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), cells)
}
