//! Writing a processed study: a folder like the one that was read, without anything left to process.

use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, InlineTable, Item, Table, Value};

use super::account::csv_text;
use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use carpus_report::results::rounded;
use carpus_study::study::{
    AngleUnit, Conversion, Conversions, MomentPart, Participant, ProcessedTrial, Study, TrialInfo, TrialUse,
    held_coordinates, posture_column,
};

/// Significant digits of a posture: what was read in degrees comes back as it was written, without the rounding of
/// radians.
const POSTURE_DIGITS: i32 = 12;

/// A trial of the new study.
pub struct NewTrial<'a> {
    /// Its file, relative to the study.
    pub file: String,
    /// What it is.
    pub trial: &'a ProcessedTrial,
}

/// Name of a trial's file in the new study.
pub fn trial_file(trial: &ProcessedTrial) -> String {
    let info = &trial.info;
    let name = match trial.repetition {
        Some(repetition) => format!("{}_{repetition}", info.name),
        None => info.name.clone(),
    };
    format!("data/{}/{name}.csv", info.participant)
}

/// Writes the samples of a trial under the study's own column names.
///
/// # Errors
/// The disk.
pub fn write_trial(study: &Study, out: &OutputFolder, new: &NewTrial<'_>) -> Result<(), Failure> {
    let columns = &study.settings.columns;
    let trial = new.trial;
    let unit = |v: f64| match columns.angle_unit {
        AngleUnit::Degrees => v.to_degrees(),
        AngleUnit::Radians => v,
    };
    let mut header = vec![columns.time.as_str(), &columns.angle, &columns.velocity, &columns.moment];
    let further = || trial.further_moments.iter().chain(&trial.emg);
    header.extend(further().map(|(name, _)| name.as_str()));
    let rows = (0..trial.time.len()).map(|i| {
        let mut row = [trial.time[i], unit(trial.angle[i]), unit(trial.velocity[i]), trial.moment[i]]
            .map(|v| v.to_string())
            .to_vec();
        row.extend(further().map(|(_, samples)| samples[i].to_string()));
        row
    });
    out.write(&new.file, csv_text(header.iter(), rows)?.as_bytes())?;
    Ok(())
}

/// Writes `study.toml`, the tables and the models of the new study.
///
/// # Errors
/// The disk; two models of the same name.
pub fn write_tables(
    study: &Study,
    out: &OutputFolder,
    participants: &[Participant],
    trials: &[NewTrial<'_>],
) -> Result<(), Failure> {
    if let Some(missing) = participants.iter().find(|p| !p.model.is_file()) {
        let text = format!("model of participant {} not found", missing.name);
        return Err(Diagnostic::error(text).in_file(&missing.model).hint("the new study gets a copy of it").into());
    }
    let mut models: Vec<(PathBuf, String)> = Vec::new();
    let all = participants.iter().map(|p| &p.model).chain(std::iter::once(&study.settings.model));
    for model in all {
        if models.iter().any(|(known, _)| known == model) || !model.is_file() {
            continue;
        }
        let name = model.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // Participants may each have a model.osim.
        let taken = |name: &str| models.iter().any(|(_, known)| known == &format!("models/{name}"));
        let name = (1..).map(|i| if i == 1 { name.clone() } else { format!("{i}_{name}") }).find(|n| !taken(n));
        let relative = format!("models/{}", name.unwrap_or_default());
        let bytes = carpus_numerics::regular_file::read(model)
            .map_err(|e| Failure::from(Diagnostic::error(format!("cannot be read: {e}")).in_file(model)))?;
        out.write(&relative, &bytes)?;
        models.push((model.clone(), relative));
    }
    let relative = |model: &Path| models.iter().find(|(known, _)| known == model).map(|(_, name)| name.clone());
    let text = carpus_numerics::regular_file::read_text(&study.file)
        .map_err(|e| Failure::from(Diagnostic::error(format!("cannot be read: {e}")).in_file(&study.file)))?;
    out.write("study.toml", new_toml(study, &text, &relative(&study.settings.model).unwrap_or_default()).as_bytes())?;
    out.write("participants.csv", participants_csv(study, participants, &relative)?.as_bytes())?;
    out.write("trials.csv", trials_csv(trials, study)?.as_bytes())?;
    let ultrasound = study.folder.join("ultrasound.csv");
    if let Ok(bytes) = carpus_numerics::regular_file::read(&ultrasound) {
        out.write("ultrasound.csv", &bytes)?;
    }
    Ok(())
}

/// The text of study.toml with `[study]` and `[dynamometer]` written anew and `[processing]` left out; all other tables
/// stay as they are, with their comments.
fn new_toml(study: &Study, text: &str, model: &str) -> String {
    let settings = &study.settings;
    let words = [
        (MomentPart::Muscles, "muscles"),
        (MomentPart::Passive, "passive"),
        (MomentPart::Gravity, "gravity"),
        (MomentPart::Inertia, "inertia"),
    ];
    // What was subtracted from the measured moment has no place in the simulated one.
    let subtracted = |part: MomentPart| {
        settings.processing.passive_order.is_some() && matches!(part, MomentPart::Passive | MomentPart::Gravity)
    };
    let include = words.into_iter().filter(|(part, _)| settings.dynamometer.includes(*part) && !subtracted(*part));
    let damping = if settings.processing.remove_drag { 0.0 } else { settings.dynamometer.damping * 1f64.to_radians() };
    let named: [(&str, Value); 2] = [("name", settings.name.as_str().into()), ("model", model.into())];
    let mut dynamometer: Vec<(&str, Value)> = vec![
        ("coordinate", settings.dynamometer.coordinate.as_str().into()),
        ("damping_n_m_s_per_deg", damping.into()),
        ("include", include.map(|(_, word)| word).collect()),
    ];
    let further = &settings.columns.further_moments;
    if !further.is_empty() {
        let columns: InlineTable = further.iter().map(|f| (f.coordinate.as_str(), f.column.as_str())).collect();
        dynamometer.push(("further_moments", columns.into()));
    }
    with_sections(text, named.into_iter().collect(), dynamometer.into_iter().collect(), converted_columns(study))
}

/// `[columns]` of files whose numbers are in the study's units under the names of the recordings; `None` where those
/// were in these units.
fn converted_columns(study: &Study) -> Option<Table> {
    let columns = &study.settings.columns;
    let Conversions { time, angle, velocity, moment, emg } = &columns.conversions;
    let mut all = [time, angle, velocity, moment].into_iter().chain(emg);
    // New files have one table each.
    (all.any(|conversion| *conversion != Conversion::default()) || columns.table.is_some()).then_some(())?;
    let angle_unit = match columns.angle_unit {
        AngleUnit::Degrees => "deg",
        AngleUnit::Radians => "rad",
    };
    let per_second = format!("{angle_unit}/s");
    let own = [
        ("time", &columns.time, "s"),
        ("angle", &columns.angle, angle_unit),
        ("velocity", &columns.velocity, per_second.as_str()),
        ("moment", &columns.moment, "N·m"),
    ];
    let mut table = Table::new();
    table.insert("angle_unit", Item::Value(angle_unit.into()));
    for (key, name, unit) in own {
        let column: InlineTable = [("column", name.as_str()), ("unit", unit)].into_iter().collect();
        table.insert(key, Item::Value(column.into()));
    }
    let muscles = study.settings.active_muscles.iter().map(String::as_str);
    let channels: InlineTable = muscles.zip(columns.emg.iter().map(String::as_str)).collect();
    table.insert("emg", Item::Value(channels.into()));
    Some(table)
}

/// A study.toml with these sections in place of its own, and without what is done with: `[processing]` and
/// `[emg_recorder]`.
fn with_sections(text: &str, mut study: Table, mut dynamometer: Table, columns: Option<Table>) -> String {
    // A study that was read is valid TOML.
    let mut document: DocumentMut = text.trim_start_matches('\u{feff}').parse().unwrap_or_default();
    let done = ["study", "dynamometer", "processing", "emg_recorder"].into_iter();
    done.chain(columns.as_ref().map(|_| "columns")).for_each(|section| drop(document.remove(section)));
    // Other sections follow the two, however they stood; keys above the first header become sections.
    study.set_position(Some(0));
    dynamometer.set_position(Some(0));
    for (_, item) in document.iter_mut() {
        if let Some(table) = item.as_inline_table() {
            *item = Item::Table(table.clone().into_table());
        }
    }
    document.insert("study", Item::Table(study));
    document.insert("dynamometer", Item::Table(dynamometer));
    if let Some(columns) = columns {
        document.insert("columns", Item::Table(columns));
    }
    document.to_string().trim_start().to_owned()
}

fn participants_csv(
    study: &Study,
    participants: &[Participant],
    relative: &impl Fn(&Path) -> Option<String>,
) -> Result<String, Failure> {
    let path = study.folder.join("participants.csv");
    let broken = |e: csv::Error| Failure::from(Diagnostic::error(e.to_string()).in_file(&path));
    let file = carpus_numerics::regular_file::open(&path).map_err(|e| broken(e.into()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(file);
    let header: Vec<String> = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
    let at = |name: &str| header.iter().position(|column| column.trim_start_matches('\u{feff}') == name);
    let (name, model) = (at("participant"), at("model"));
    let mut rows = Vec::new();
    for record in reader.records() {
        let mut row: Vec<String> = record.map_err(broken)?.iter().map(str::to_owned).collect();
        let of_row = |p: &&Participant| name.and_then(|i| row.get(i)).is_some_and(|found| *found == p.name);
        let Some(participant) = participants.iter().find(of_row) else { continue };
        if let Some(cell) = model.filter(|_| participant.own_model).and_then(|i| row.get_mut(i)) {
            *cell = relative(&participant.model).unwrap_or_default();
        }
        rows.push(row);
    }
    let header: Vec<&str> = header.iter().map(|column| column.trim_start_matches('\u{feff}')).collect();
    csv_text(header.iter(), rows.into_iter())
}

fn trials_csv(trials: &[NewTrial<'_>], study: &Study) -> Result<String, Failure> {
    let timed = trials.iter().any(|new| new.trial.info.start_time.is_some());
    let mut header =
        vec!["participant", "file", "contraction", "effort_percent", "direction", "posture_deg", "repetition", "use"];
    header.extend(timed.then_some("start_time_s"));
    let turned = trials.iter().any(|new| new.trial.info.arm_flipped);
    header.extend(turned.then_some("arm"));
    let held = held_coordinates(trials.iter().map(|new| &new.trial.info));
    let columns: Vec<String> = held.iter().map(|coordinate| posture_column(coordinate)).collect();
    header.extend(columns.iter().map(String::as_str));
    let subtracted = study.settings.processing.passive_order.is_some();
    let rows = trials.iter().map(|new| {
        let info: &TrialInfo = &new.trial.info;
        // With the relaxed limb's moment subtracted a passive trial is nothing but noise.
        let nothing_left = subtracted && info.contraction == carpus_study::study::Contraction::Passive;
        let usage = if nothing_left { TrialUse::Ignore } else { info.usage };
        let mut row = vec![
            info.participant.clone(),
            new.file.clone(),
            info.contraction.word().to_owned(),
            info.effort_percent.map(|v| v.to_string()).unwrap_or_default(),
            info.direction.word().to_owned(),
            info.posture.map(|v| rounded(v.to_degrees(), POSTURE_DIGITS).to_string()).unwrap_or_default(),
            new.trial.repetition.or(info.repetition).map(|v| v.to_string()).unwrap_or_default(),
            usage.word().to_owned(),
        ];
        if timed {
            // A repetition begins later than its recording.
            let start =
                info.start_time.map(|t| t + new.trial.time[0] * f64::from(new.trial.repetition.is_some() as u8));
            row.push(start.map(|v| v.to_string()).unwrap_or_default());
        }
        row.extend(turned.then(|| info.arm_word().to_owned()));
        row.extend(held.iter().map(|coordinate| info.held_at(coordinate).map(|v| v.to_string()).unwrap_or_default()));
        row
    });
    csv_text(header.iter(), rows)
}

#[cfg(test)]
mod tests {
    use toml_edit::{Table, Value};

    use super::with_sections;

    fn written(text: &str) -> String {
        let table = |key, value: &str| Table::from_iter([(key, Value::from(value))]);
        with_sections(text, table("name", "new"), table("coordinate", "flexion"), None)
    }

    #[test]
    fn verif_other_sections_keep_their_comments() {
        let kept = "\n# how\n[emg] # raw\nkind = \"raw\"\n";
        let checks = "\n[checks]\nmax_gap_s = 1 # pause\n";
        let gone = "[processing]\nfilter_hz = 6\n\n[processing.repetitions]\nmost = 3\n";
        let plain = format!("# of the lab\n[study]\nname = \"x\"\n{kept}{gone}{checks}");
        let begun = "[study]\nname = \"new\"\n\n[dynamometer]\ncoordinate = \"flexion\"\n";
        let expected = format!("{begun}{kept}{checks}");
        assert_eq!(written(&plain), expected);
    }

    #[test]
    fn verif_other_sections_are_copied_however_they_are_written() {
        // A table above the first header, a text that looks like a header, a quoted name, keys with dots.
        let odd = "posture_deg = { elbow_flexion = 90 }\nstudy.name = \"\"\"\n[emg]\n\"\"\"\n\
                   processing.filter_hz = 6\n                   muscles.active = [\"A\"]\n[\"columns\"]\n\
                   ignore = [\n  \"a\",\n  \"b\",\n]\n";
        let text = written(odd);
        let copied: toml::Table = text.parse().unwrap();
        let mut sections: Vec<&str> = copied.keys().map(String::as_str).collect();
        sections.sort_unstable();
        assert_eq!(sections, ["columns", "dynamometer", "muscles", "posture_deg", "study"], "{text}");
        assert_eq!(copied["posture_deg"]["elbow_flexion"].as_integer(), Some(90));
        assert_eq!(copied["columns"]["ignore"].as_array().map(Vec::len), Some(2));
        assert_eq!(copied["muscles"]["active"].as_array().map(Vec::len), Some(1));
        assert_eq!(copied["study"]["name"].as_str(), Some("new"));
    }
}
