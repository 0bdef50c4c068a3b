//! `carpus info`: what is in a model, and what was made of it.

use crate::args::{Global, InfoArgs};
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::table;
use carpus_osim::osim::{Diagnostics, Severity as FindingSeverity};
use carpus_session::info::{CoordinateInfo, Info, MuscleInfo, understood};
use carpus_session::{json, model};

/// Runs the command.
///
/// # Errors
/// The file cannot be read as a model.
pub fn run(args: &InfoArgs, global: &Global) -> Result<(), Failure> {
    let (info, reason) = Info::read(&args.model)?;
    print_result(&if global.json { json::readable(&info)? } else { readable(&info, args.all) })?;
    reason.map_or(Ok(()), |reason| Err(reason.into()))
}

fn readable(info: &Info, all: bool) -> String {
    let mut text = format!("{} (format {}, {})\n", info.model, info.document_version, info.file);
    text.push_str(&format!(
        "{} bodies, {} joints, {} coordinates, {} muscles, {} other forces, {} wrap objects, {} constraints, {} \
         markers\n\n",
        info.bodies,
        info.joints,
        info.coordinates.len(),
        info.muscles.len(),
        info.forces,
        info.wrap_objects,
        info.constraints,
        info.markers
    ));
    text.push_str(&coordinate_table(&info.coordinates));
    text.push_str("\n\n");
    if !info.muscles.is_empty() {
        text.push_str(&muscle_table(&info.muscles));
        text.push_str("\n\n");
    }
    if let Some(study) = &info.study {
        text.push_str(&format!("in a study:\n{}\n\n", indented(&study.lines())));
    }
    text.push_str(&findings(&info.diagnostics, &info.file, all));
    text
}

fn indented(lines: &[String]) -> String {
    lines.iter().map(|line| format!("  {line}")).collect::<Vec<_>>().join("\n")
}

fn coordinate_table(coordinates: &[CoordinateInfo]) -> String {
    let rows = coordinates.iter().map(|c| {
        let number = |v: f64| carpus_report::plain(v).replace('−', "-");
        vec![
            c.name.clone(),
            c.motion_type.to_string(),
            c.notes(),
            number(c.default_value),
            if c.is_unlimited() {
                "unlimited".to_string()
            } else {
                format!("{} to {}", number(c.range[0]), number(c.range[1]))
            },
            c.unit.to_string(),
        ]
    });
    table(&["coordinate", "motion", "notes", "default", "range", "unit"], 3, rows)
}

fn muscle_table(muscles: &[MuscleInfo]) -> String {
    let rows = muscles.iter().map(|m| {
        vec![
            m.name.clone(),
            m.notes(),
            format!("{:.1}", m.max_isometric_force_n),
            format!("{:.2}", 1e3 * m.optimal_fiber_length_m),
            format!("{:.2}", 1e3 * m.tendon_slack_length_m),
            format!("{:.1}", m.pennation_angle_at_optimal_deg),
            m.path_points.to_string(),
            m.wraps.to_string(),
        ]
    });
    table(&["muscle", "notes", "Fmax N", "l_opt mm", "l_slack mm", "pennation °", "points", "wraps"], 2, rows)
}

/// How many lines of one severity are listed before the rest is only counted.
const LISTED: usize = 12;

fn findings(diagnostics: &Diagnostics, file: &str, all: bool) -> String {
    let mut text = format!("understood: {}\n", understood(diagnostics));
    let severities = [
        (FindingSeverity::Unsupported, "unsupported (would change the result in OpenSim)"),
        (FindingSeverity::Approximated, "approximated"),
        (FindingSeverity::Warning, "warnings"),
        (FindingSeverity::Ignored, "ignored (no influence on motion or forces)"),
    ];
    for (severity, title) in severities {
        let found: Vec<_> = diagnostics.of(severity).collect();
        text.push_str(&format!(
            "{title}: {}\n",
            if found.is_empty() { "none".to_string() } else { found.len().to_string() }
        ));
        let shown = if all { found.len() } else { LISTED.min(found.len()) };
        for d in &found[..shown] {
            let more = model::elsewhere(d);
            text.push_str(&format!("  {file}:{}: {}: {}{more}\n", d.line, d.path, d.message));
            if let Some(hint) = &d.hint {
                text.push_str(&format!("    hint: {hint}\n"));
            }
        }
        if shown < found.len() {
            text.push_str(&format!("  … and {} more (--all lists them)\n", found.len() - shown));
        }
    }
    text
}
