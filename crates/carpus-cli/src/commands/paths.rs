//! `carpus paths`: muscle lengths and moment arms over a coordinate.

use crate::args::{Global, PathsArgs};
use crate::failure::{self, Diagnostic, Failure};
use crate::{print_result, provenance};
use carpus_osim::osim::spec::MotionType;
use carpus_report::sweep::{SweepFigure, SweepMuscle};
use carpus_session::account::{csv_text, warning_result};
use carpus_session::model::{self, Needs};
use carpus_session::output::OutputFolder;
use carpus_session::path_check;

/// Runs the command.
///
/// # Errors
/// The model, a coordinate, a muscle, or the output folder.
pub fn run(args: &PathsArgs, global: &Global) -> Result<(), Failure> {
    let path = &args.model.model;
    let out = args.out.as_ref().map(|dir| OutputFolder::create(dir, std::slice::from_ref(path))).transpose()?;
    let out = out.map(|out| Ok::<_, Failure>(out.only_of("paths")?.with_results_of(path))).transpose()?;
    let mut messages = Vec::new();
    let loaded = model::load(path, Needs::Motion, args.model.allow_unsupported, &mut messages)?;
    let moved = loaded.check_settable(&args.sweep.coordinate, args.sweep.first())?;
    messages.extend(loaded.ambiguous(moved));
    let muscles = loaded.muscles(&args.muscles)?;
    let posture = loaded.posture(&args.set, &mut messages)?;
    let values = args.sweep.values();
    for end in [values.first(), values.last()].into_iter().flatten() {
        if !loaded.model.coordinates[moved.0].in_range(args.sweep.si(*end)) {
            messages.push(loaded.outside_range(moved, args.sweep.si(*end)));
        }
    }
    let si: Vec<f64> = values.iter().map(|v| args.sweep.si(*v)).collect();
    let translation = loaded.model.coordinates[moved.0].motion_type == MotionType::Translational;
    let samples = path_check::samples(&loaded, &muscles, moved, &posture, &si)?;
    messages.extend(muscles.iter().zip(&samples).flat_map(|(m, s)| path_check::swept(&loaded, *m, moved, s)));
    let swept = muscles.iter().zip(&samples).map(|(m, samples)| SweepMuscle {
        name: loaded.file.spec.muscles[m.0].name.clone(),
        length_m: samples.iter().map(|s| s.length).collect(),
        moment_arm_m: samples.iter().map(|s| s.moment_arm).collect(),
    });
    let figure = SweepFigure {
        model: loaded.model.name.clone(),
        coordinate: args.sweep.coordinate.clone(),
        unit: if translation { "m" } else { "deg" },
        values: if translation { si.clone() } else { si.iter().map(|v| v.to_degrees()).collect() },
        held: args.set.iter().map(ToString::to_string).collect(),
        muscles: swept.collect(),
        warnings: messages.iter().map(warning_result).collect(),
        provenance: provenance::provenance(
            global,
            vec![carpus_session::provenance::input_file(path, &path.display().to_string(), "model")?],
        ),
    };
    failure::print(&messages);
    if let Some(out) = &out {
        let table = out.write("paths.csv", csv(&figure)?.as_bytes())?;
        let page = out.write("paths.html", carpus_report::render_sweep(&figure).as_bytes())?;
        failure::print(&out.close("paths", &[])?);
        let muscles = figure.muscles.len();
        failure::say(&format!("{muscles} muscles at {} values of {}", figure.values.len(), figure.coordinate));
        if !global.json {
            return print_result(&format!("{}\n{}\n", table.display(), page.display()));
        }
    }
    print_result(&if global.json { json(&figure, &messages) } else { csv(&figure)? })
}

/// One row per value: the coordinate, all lengths, all moment arms.
fn csv(figure: &SweepFigure) -> Result<String, Failure> {
    let names = figure.muscles.iter().map(|m| &m.name);
    // About a translation the moment arm has no unit.
    let arm = if figure.unit == "deg" { "moment_arm_m" } else { "moment_arm" };
    let header: Vec<String> = std::iter::once(format!("{}_{}", figure.coordinate, figure.unit))
        .chain(names.clone().map(|n| format!("{n}_length_m")))
        .chain(names.map(|n| format!("{n}_{arm}")))
        .collect();
    let rows = figure.values.iter().enumerate().map(|(i, value)| {
        let lengths = figure.muscles.iter().map(|m| m.length_m[i]);
        let arms = figure.muscles.iter().map(|m| m.moment_arm_m[i]);
        let numbers = lengths.chain(arms).map(|v| format!("{v:.9}"));
        std::iter::once(carpus_report::results::rounded(*value, 12).to_string()).chain(numbers).collect()
    });
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    csv_text(header.iter(), rows)
}

fn json(figure: &SweepFigure, warnings: &[Diagnostic]) -> String {
    let warnings: Vec<_> = warnings.iter().map(warning_result).collect();
    let muscles: Vec<_> = figure
        .muscles
        .iter()
        .map(|m| serde_json::json!({ "name": m.name, "length_m": m.length_m, "moment_arm_m": m.moment_arm_m }))
        .collect();
    let key = format!("values_{}", figure.unit);
    serde_json::json!({
        "schema": "carpus.paths/1",
        "model": figure.model,
        "coordinate": figure.coordinate,
        key: figure.values,
        "held": figure.held,
        "muscles": muscles,
        "warnings": warnings,
        "provenance": figure.provenance,
    })
    .to_string()
}
