//! `[columns]` of `study.toml`: which column of the trial files is what, in which unit, with which sign.

use std::path::Path;

use super::columns::{AngleUnit, Columns, Conversion, Conversions};
use super::fault::Fault;
use super::problem::Problem;
use super::raw_emg::EmgSignal;
use super::toml_section::{Sections, TomlSection};
use carpus_numerics::plausible::{Measured, NAMED_UNITS, unit_in_name};

/// Warns of columns whose names state other units than their numbers are taken in.
///
/// - `recorder_time`: the time column of a recorder of its own that the EMG is from
pub(super) fn warn_of_units(
    columns: &Columns,
    emg: &EmgSignal,
    recorder_time: Option<&str>,
    lines: &ColumnLines,
    file: &Path,
    problems: &mut Vec<Problem>,
) {
    let (angle, velocity) = match columns.angle_unit {
        AngleUnit::Degrees => ("deg", "deg/s"),
        AngleUnit::Radians => ("rad", "rad/s"),
    };
    let per_degree = match columns.angle_unit {
        AngleUnit::Degrees => 1.0,
        AngleUnit::Radians => 1f64.to_radians(),
    };
    let mut warn = |column: &str, holds: Measured, taken_as: &'static str, line: usize| {
        let Some(unit) = unit_in_name(column, holds) else { return };
        let scale = if matches!(holds, Measured::Angle | Measured::AngularVelocity) { per_degree } else { 1.0 };
        if unit.of == holds && (unit.factor * scale - 1.0).abs() < 1e-9 {
            return;
        }
        let factor = (unit.of == holds).then_some(unit.factor * scale);
        let fault = Fault::UnitInName { column: column.to_owned(), unit, holds, taken_as, factor };
        problems.push(Problem::warning(file, line, fault));
    };
    let [time_stated, angle_stated, velocity_stated, moment_stated] = lines.stated;
    if !time_stated {
        warn(&columns.time, Measured::Time, "s", lines.time);
    }
    // Of names that end so, the trials say more.
    if !angle_stated && !["_deg", "_rad"].iter().any(|end| columns.angle.to_lowercase().ends_with(end)) {
        warn(&columns.angle, Measured::Angle, angle, lines.angle);
    }
    if !velocity_stated {
        warn(&columns.velocity, Measured::AngularVelocity, velocity, lines.velocity);
    }
    if !moment_stated {
        warn(&columns.moment, Measured::Moment, "N·m", lines.moment);
    }
    for further in &columns.further_moments {
        warn(&further.column, Measured::Moment, "N·m", further.line);
    }
    if let Some(time) = recorder_time {
        warn(time, Measured::Time, "s", 0);
    }
    let (holds, taken_as) = match emg {
        EmgSignal::Normalized => (Measured::Part, "parts of 1"),
        EmgSignal::Raw(_) => (Measured::Voltage, "raw EMG"),
    };
    for (i, column) in columns.emg.iter().enumerate().filter(|_| !lines.emg_stated) {
        // Names of muscles end in many letters; of raw channels any unit of voltage will do.
        let is_bracketed = column.ends_with([']', ')']);
        let tells = unit_in_name(column, holds).is_some_and(|unit| match unit.of {
            Measured::Voltage => holds == Measured::Part && (is_bracketed || unit.symbol != "V"),
            Measured::Part => true,
            _ => false,
        });
        if tells && !columns.emg[..i].contains(column) {
            warn(column, holds, taken_as, lines.emg);
        }
    }
}

/// Lines of `study.toml` that name columns, or of their table.
#[derive(Default)]
pub(super) struct ColumnLines {
    time: usize,
    angle: usize,
    velocity: usize,
    moment: usize,
    emg: usize,
    /// Whether units of time, angle, velocity and moment are stated beside the names.
    stated: [bool; 4],
    /// Whether units of EMG are.
    emg_stated: bool,
}

/// How a column is read.
#[derive(Clone, Copy, Default)]
pub(super) struct Read {
    /// From the file's numbers to the study's.
    pub conversion: Conversion,
    /// Whether the unit is stated.
    pub states_unit: bool,
}

/// Keys of a column that is written as a table.
const EXPECTED_COLUMN: &str = "the name of a column, or { column = …, unit = …, sign = …, scale = …, offset = … }";

/// A column: its name, or a table of its name and what its numbers are.
///
/// - `holds`: what is measured in it
pub(super) fn column(section: &mut TomlSection<'_>, key: &str, holds: Measured) -> Option<(String, Read)> {
    if !section.is_table(key) {
        return section.optional_string(key).map(|name| (name, Read::default()));
    }
    section.inner_table(key, "columns", EXPECTED_COLUMN, |table| {
        let name = table.required_string("column", "the name of the column in the files");
        let unit = table.optional_string("unit");
        let known = unit.as_deref().and_then(|unit| unit_in_name(&format!("[{unit}]"), holds));
        let known = known.filter(|unit| unit.of == holds || holds == Measured::Part && unit.of == Measured::Voltage);
        if let Some(unit) = unit.as_deref().filter(|_| known.is_none()) {
            let of_kind = NAMED_UNITS.iter().filter(|unit| unit.of == holds).map(|unit| unit.symbol);
            let expected = format!("a unit of {} ({})", holds.words(), of_kind.collect::<Vec<_>>().join(", "));
            table.bad_value("unit", &expected, &format!("`{unit}`"));
        }
        let is_factor = |v: f64| v != 0.0;
        let sign = table.optional_number("sign", "1 or -1", |v| v.abs() == 1.0).unwrap_or(1.0);
        let scale = table.optional_number("scale", "a number other than 0", is_factor).unwrap_or(1.0);
        let offset = table.optional_number("offset", "a number", |_| true).unwrap_or(0.0);
        // Raw EMG is divided by its level at maximum contraction: volts and microvolts are the same to it.
        let factor = known.filter(|unit| unit.of == holds).map_or(1.0, |unit| unit.factor);
        let conversion = Conversion { factor: sign * scale * factor, offset };
        name.map(|name| (name, Read { conversion, states_unit: known.is_some() }))
    })?
}

/// Reads `[columns]`.
pub(super) fn columns(
    sections: &Sections<'_>,
    active: &[String],
    problems: &mut Vec<Problem>,
) -> (Columns, ColumnLines) {
    let mut section = sections.section("columns");
    let angle_unit = section
        .optional_word("angle_unit", "angle unit", &[("deg", AngleUnit::Degrees), ("rad", AngleUnit::Radians)])
        .unwrap_or_default();
    let (angle, velocity) = match angle_unit {
        AngleUnit::Degrees => ("angle_deg", "velocity_deg_per_s"),
        AngleUnit::Radians => ("angle_rad", "velocity_rad_per_s"),
    };
    let named_velocity = column(&mut section, "velocity", Measured::AngularVelocity);
    let own = |found: Option<(String, Read)>, usual: &str| found.unwrap_or_else(|| (usual.to_owned(), Read::default()));
    let time = own(column(&mut section, "time", Measured::Time), "time_s");
    let velocity_required = named_velocity.is_some();
    let angle = own(column(&mut section, "angle", Measured::Angle), angle);
    let velocity = own(named_velocity, velocity);
    let moment = own(column(&mut section, "moment", Measured::Moment), "moment_n_m");
    let emg = emg_columns(&mut section, active);
    let stated = [&time, &angle, &velocity, &moment].map(|(_, read)| read.states_unit);
    // Units of angles are stated in degrees.
    let per_unit = if angle_unit == AngleUnit::Radians { 1f64.to_radians() } else { 1.0 };
    let turned = |read: Read| {
        let factor = if read.states_unit { per_unit * read.conversion.factor } else { read.conversion.factor };
        Conversion { factor, ..read.conversion }
    };
    let conversions = Conversions {
        time: time.1.conversion,
        angle: turned(angle.1),
        velocity: turned(velocity.1),
        moment: moment.1.conversion,
        emg: emg.iter().map(|(_, read)| read.conversion).collect(),
    };
    let emg_stated = emg.iter().any(|(_, read)| read.states_unit);
    let columns = Columns {
        table: section.optional_string("table"),
        time: time.0,
        angle: angle.0,
        velocity_required,
        velocity: velocity.0,
        further_moments: Vec::new(),
        moment: moment.0,
        emg: emg.into_iter().map(|(name, _)| name).collect(),
        ignore: section.optional_strings("ignore", "list of column names").unwrap_or_default(),
        angle_unit,
        conversions,
    };
    let [time, angle, velocity, moment, emg] =
        ["time", "angle", "velocity", "moment", "emg"].map(|key| section.line_of(key));
    one_quantity_each(&mut section, &columns);
    section.finish(problems);
    (columns, ColumnLines { time, angle, velocity, moment, emg, stated, emg_stated })
}

/// Reports columns that are to hold two quantities; muscles alone may share one, that of their EMG.
fn one_quantity_each(section: &mut TomlSection<'_>, columns: &Columns) {
    let own = [
        ("time", &columns.time),
        ("angle", &columns.angle),
        ("velocity", &columns.velocity),
        ("moment", &columns.moment),
    ];
    let emg = columns.emg.iter().map(|name| ("emg", name));
    let mut known: Vec<(&str, &String)> = Vec::new();
    for (key, name) in own.into_iter().chain(emg) {
        match known.iter().find(|(_, before)| *before == name) {
            Some(("emg", _)) => {}
            Some((other, _)) => section.bad_value(key, "a column of its own", &format!("`{name}`, that of `{other}`")),
            None => known.push((key, name)),
        }
    }
}

/// Column per active muscle: a template with `{muscle}`, or a table muscle → column.
fn emg_columns(section: &mut TomlSection<'_>, active: &[String]) -> Vec<(String, Read)> {
    let expected = "a name that contains {muscle}, or a table of one column per active muscle";
    let from_template = |template: &str, read: Read| {
        active.iter().map(|muscle| (template.replace("{muscle}", muscle), read)).collect::<Vec<_>>()
    };
    if section.is_table("emg") && section.has_inner("emg", "column") {
        let found = column(section, "emg", Measured::Part);
        if found.as_ref().is_some_and(|(name, _)| active.len() > 1 && !name.contains("{muscle}")) {
            section.bad_value("emg", expected, "a column that is the same for every muscle");
        }
        return found.map(|(name, read)| from_template(&name, read)).unwrap_or_default();
    }
    if section.is_table("emg") {
        let each = |table: &mut TomlSection<'_>| {
            let one = |muscle: &String| {
                let found = column(table, muscle, Measured::Part);
                if found.is_none() && !table.keys().contains(muscle) {
                    table.required_string(muscle, expected);
                }
                found.unwrap_or_default()
            };
            active.iter().map(one).collect::<Vec<_>>()
        };
        return section.inner_table("emg", "emg", expected, each).unwrap_or_default();
    }
    match section.optional_string("emg") {
        None => from_template("emg_{muscle}", Read::default()),
        Some(template) => {
            if active.len() > 1 && !template.contains("{muscle}") {
                section.bad_value("emg", expected, &format!("`{template}`"));
            }
            from_template(&template, Read::default())
        }
    }
}
