//! `carpus dynamometer-drag`: the machine's own damping from runs at constant velocity without a participant.

use std::path::{Path, PathBuf};

use crate::args::{DynamometerDragArgs, Global};
use crate::failure::{Diagnostic, Failure};
use crate::print_result;
use crate::provenance::provenance;
use crate::table::{fixed, table};
use carpus_report::results::rounded;
use carpus_report::significant;
use carpus_session::provenance::input_file;
use carpus_study::dynamometer::{DragError, DragEstimate, MachineRun, estimate_drag};
use carpus_study::study::{AngleUnit, Recorded, Study, named_file};

/// A machine's recording, in radians.
struct Run {
    time: Vec<f64>,
    angle: Vec<f64>,
    velocity: Option<Vec<f64>>,
    moment: Vec<f64>,
}

/// Names of columns.
struct Names {
    time: String,
    angle: String,
    velocity: String,
    moment: String,
    unit: AngleUnit,
}

/// Runs the command.
///
/// # Errors
/// The files, or runs that do not tell the drag.
pub fn run(args: &DynamometerDragArgs, global: &Global) -> Result<(), Failure> {
    let (files, names) = files(args)?;
    let drag = estimated(&files, &names)?;
    let per_degree = 1f64.to_radians();
    if global.json {
        let shown = |file: &PathBuf| input_file(file, &file.display().to_string(), "machine run");
        let inputs = files.iter().map(shown).collect::<Result<Vec<_>, _>>()?;
        let phases: Vec<_> = drag
            .phases
            .iter()
            .map(|p| {
                serde_json::json!({
                    "file": files[p.run].display().to_string(), "start_s": p.time[0], "end_s": p.time[1],
                    "velocity_deg_per_s": p.velocity.to_degrees(), "mean_moment_n_m": p.moment,
                })
            })
            .collect();
        let result = serde_json::json!({
            "schema": "carpus.dynamometer_drag/1",
            "damping_n_m_s_per_deg": drag.damping * per_degree,
            "interval_95_n_m_s_per_deg": drag.interval.map(|v| v * per_degree),
            "friction_n_m": drag.friction.map(|f| f.0),
            "friction_interval_95_n_m": drag.friction.map(|f| f.1),
            "offset_n_m": drag.offset,
            "weight_cos_sin_n_m": drag.weight,
            "residual_n_m": drag.residual,
            "phases": phases,
            "provenance": provenance(global, inputs),
        });
        return print_result(&result.to_string());
    }
    print_result(&readable(&drag, &files))
}

/// The drag from the recordings that a study names; `None` if it names none.
///
/// # Errors
/// The files, or runs that do not tell the drag.
pub fn of_study(study: &Study) -> Result<Option<DragEstimate>, Failure> {
    let (files, names) = named_by(study);
    if files.is_empty() { Ok(None) } else { estimated(&files, &names).map(Some) }
}

fn estimated(files: &[PathBuf], names: &Names) -> Result<DragEstimate, Failure> {
    let runs = files.iter().map(|file| read(file, names)).collect::<Result<Vec<_>, _>>()?;
    let machine: Vec<MachineRun<'_>> = runs
        .iter()
        .map(|r| MachineRun { time: &r.time, angle: &r.angle, velocity: r.velocity.as_deref(), moment: &r.moment })
        .collect();
    estimate_drag(&machine).map_err(|e| {
        let message = Diagnostic::error(e.to_string());
        Failure::from(match e {
            DragError::OneVelocity { .. } => message.hint("add runs at other velocities, or in the other direction"),
            DragError::Regression(_) => message.hint("at least two phases of constant velocity are needed"),
            _ => message,
        })
    })
}

/// The machine's recordings that a study names, and how their columns are called.
fn named_by(study: &Study) -> (Vec<PathBuf>, Names) {
    let columns = study.settings.columns.clone();
    let files = study.settings.processing.drag_runs.iter().map(|file| named_file(&study.folder, file)).collect();
    let names = Names {
        time: columns.time,
        angle: columns.angle,
        velocity: columns.velocity,
        moment: columns.moment,
        unit: columns.angle_unit,
    };
    (files, names)
}

/// The recordings and how their columns are called.
fn files(args: &DynamometerDragArgs) -> Result<(Vec<PathBuf>, Names), Failure> {
    let is_study = |path: &PathBuf| path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if let [only] = &args.input[..]
        && is_study(only)
    {
        let study = Study::read_tables(only)?;
        let (files, names) = named_by(&study);
        if files.is_empty() {
            let message = Diagnostic::error("the study names no recordings of the machine alone").in_file(&study.file);
            return Err(message.hint("[processing] drag_runs = [\"machine/run_1.csv\", …]").into());
        }
        return Ok((files, names));
    }
    let text = String::from;
    let names = Names {
        time: text("time_s"),
        angle: text("angle_deg"),
        velocity: text("velocity_deg_per_s"),
        moment: text("moment_n_m"),
        unit: AngleUnit::Degrees,
    };
    Ok((args.input.clone(), names))
}

fn read(file: &Path, names: &Names) -> Result<Run, Failure> {
    let recorded = Recorded::read(file, None, &names.time, &[&names.angle, &names.moment], &[&names.velocity])?;
    let column = |name: &str| recorded.column(name).map(<[f64]>::to_vec);
    let radians = |x: Vec<f64>| x.into_iter().map(|v| names.unit.to_radians(v)).collect::<Vec<f64>>();
    Ok(Run {
        angle: radians(column(&names.angle).unwrap_or_default()),
        velocity: column(&names.velocity).map(radians),
        moment: column(&names.moment).unwrap_or_default(),
        time: recorded.time,
    })
}

fn readable(drag: &DragEstimate, files: &[PathBuf]) -> String {
    let header = ["run", "from s", "to s", "velocity °/s", "mean moment N·m"];
    let rows = drag.phases.iter().map(|p| {
        let name = files[p.run].file_name().unwrap_or_default().to_string_lossy().into_owned();
        vec![name, fixed(p.time[0], 2), fixed(p.time[1], 2), fixed(p.velocity.to_degrees(), 2), fixed(p.moment, 4)]
    });
    let mut text = table(&header, 1, rows);
    let per_degree = 1f64.to_radians();
    let [low, high] = drag.interval.map(|v| significant(v * per_degree, 3));
    text.push_str(&format!("\n\nresidual           {} N·m\n", significant(drag.residual, 3)));
    match drag.friction {
        Some((friction, [low, high])) => text.push_str(&format!(
            "Coulomb friction   {} N·m (95 %: {} to {})\n",
            significant(friction, 3),
            significant(low, 3),
            significant(high, 3)
        )),
        None => text.push_str("Coulomb friction   counted as drag: the runs have one speed or one direction\n"),
    }
    text.push_str(&format!("viscous drag       95 %: {low} to {high} N·m·s/deg\n\nfor study.toml:\n"));
    let damping = rounded(drag.damping * per_degree, 4);
    match damping < 0.0 {
        true => {
            text.push_str("nothing: the drag is negative, so the sign of moment or angle is turned in these runs\n")
        }
        false => text.push_str(&format!("[dynamometer]\ndamping_n_m_s_per_deg = {damping}\n")),
    }
    text
}
