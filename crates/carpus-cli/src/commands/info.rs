//! `carpus info`: what is in a model, and what was made of it.

use crate::args::{Global, InfoArgs};
use crate::failure::Failure;
use crate::print_result;
use crate::table::table;
use carpus_osim::osim::{Diagnostics, Severity as FindingSeverity};
use carpus_session::info::{CoordinateInfo, Info, MuscleInfo};
use carpus_session::model;

/// Runs the command.
///
/// # Errors
/// The file cannot be read as a model.
pub fn run(args: &InfoArgs, global: &Global) -> Result<(), Failure> {
    let (info, reason) = Info::read(&args.model)?;
    if global.json {
        let text = serde_json::to_string_pretty(&info).map_err(|e| Failure::Internal(e.to_string()))?;
        print_result(&text)?;
    } else {
        print_result(&readable(&info, args.all))?;
    }
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
    text.push_str(&findings(&info.diagnostics, &info.file, all));
    text
}

/// Whether a range is one that stands for none: a hundred turns or a kilometre both ways, as OpenSim writes for
/// followers.
fn is_unlimited(c: &CoordinateInfo) -> bool {
    let far = if c.unit == "deg" { 36_000.0 } else { 1000.0 };
    c.range[0] <= -far && c.range[1] >= far
}

fn coordinate_table(coordinates: &[CoordinateInfo]) -> String {
    let rows = coordinates.iter().map(|c| {
        let mut notes = Vec::new();
        notes.extend(c.locked.then(|| "locked".to_string()));
        notes.extend((!c.clamped).then(|| "not clamped".to_string()));
        notes.extend(c.follows.as_ref().map(|f| format!("follows {f}")));
        let number = |v: f64| carpus_report::plain(v).replace('−', "-");
        vec![
            c.name.clone(),
            c.motion_type.to_string(),
            notes.join(", "),
            number(c.default_value),
            if is_unlimited(c) {
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
        let mut notes = Vec::new();
        notes.extend((m.class != "Millard2012EquilibriumMuscle").then(|| m.class.clone()));
        notes.extend((!m.applies_force).then(|| "applies no force".to_string()));
        vec![
            m.name.clone(),
            notes.join(", "),
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
    let mut text = String::new();
    let understood: usize = diagnostics.understood.values().sum();
    text.push_str(&format!("understood: {understood} components"));
    let mut classes: Vec<_> = diagnostics.understood.iter().collect();
    classes.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
    let listed: Vec<_> = classes.iter().map(|(class, n)| format!("{n} {class}")).collect();
    if !listed.is_empty() {
        text.push_str(&format!(" ({})", listed.join(", ")));
    }
    text.push('\n');
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
