//! `participants.csv`: who was measured.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::fault::Fault;
use super::problem::Problem;
use super::table::{Row, Table, named_file};
use carpus_numerics::plausible::{self, Plausible};

/// Columns of `participants.csv` besides `<segment>_length_m`.
const COLUMNS: [&str; 12] = [
    "participant",
    "model",
    "mass_kg",
    "height_m",
    "sex",
    "side",
    "<segment>_length_m",
    "mvc_flexion_n_m",
    "mvc_extension_n_m",
    "person",
    "group",
    "visit",
];
const SEGMENT_SUFFIX: &str = "_length_m";

/// One row of `participants.csv`.
#[derive(Clone, Debug, PartialEq)]
pub struct Participant {
    /// Name; also the name of the participant's folder of results.
    pub name: String,
    /// Line of the row.
    pub line: usize,
    /// The model of this participant: an own one, else the study's.
    pub model: PathBuf,
    /// Whether the row names an own model.
    pub own_model: bool,
    /// Body mass \[kg\].
    pub mass: Option<f64>,
    /// Body height \[m\].
    pub height: Option<f64>,
    /// Sex as recorded.
    pub sex: Option<Sex>,
    /// The arm measured.
    pub side: Option<Side>,
    /// Segment lengths \[m\], named by the column without `_length_m`, in the order of the columns.
    pub segment_lengths: Vec<(String, f64)>,
    /// Largest voluntary flexion moment [N·m], positive.
    pub mvc_flexion: Option<f64>,
    /// Largest voluntary extension moment [N·m], positive.
    pub mvc_extension: Option<f64>,
    /// Who was measured, where the same person is several participants (before and after, left and right).
    pub person: Option<String>,
    /// The group that the person belongs to (patients, controls).
    pub group: Option<String>,
    /// When the person was measured (before, after).
    pub visit: Option<String>,
}

/// Sex as recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sex {
    /// Female.
    Female,
    /// Male.
    Male,
    /// Neither, or not told.
    Other,
}

/// The arm measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// Reads `participants.csv`.
pub(crate) fn read(path: &Path, folder: &Path, study_model: &Path, problems: &mut Vec<Problem>) -> Vec<Participant> {
    let Some(table) = Table::read(path, "participants.csv", None, problems) else { return Vec::new() };
    let is_known = |c: &str| COLUMNS.contains(&c) || c.strip_suffix(SEGMENT_SUFFIX).is_some_and(|s| !s.is_empty());
    if !table.check_columns(&[("participant", "name of the participant")], &COLUMNS, is_known, problems) {
        return Vec::new();
    }
    let mut lines = HashMap::new();
    let mut participants = Vec::new();
    for row in table.rows() {
        let Some(participant) = participant(&row, &table.header, folder, study_model, problems) else { continue };
        // Every participant has a folder of results; on some systems names of folders have no case.
        let folder_name = participant.name.to_lowercase();
        if let Some((first_line, first)) = lines.get(&folder_name) {
            let what = if *first == participant.name { "participant" } else { "in other case, participant" };
            row.error(Fault::Duplicate { what, value: participant.name, first_line: *first_line }, problems);
            continue;
        }
        lines.insert(folder_name, (row.line, participant.name.clone()));
        participants.push(participant);
    }
    participants
}

fn participant(
    row: &Row<'_>,
    header: &[String],
    folder: &Path,
    study_model: &Path,
    problems: &mut Vec<Problem>,
) -> Option<Participant> {
    let name = row.required("participant", "a name", problems)?;
    if matches!(name, "." | "..") || name.contains(['/', '\\', ':', '\0']) {
        row.bad("participant", "a name that can name a folder (no / \\ :)", name, problems);
        return None;
    }
    let own_model = row.text("model").map(|model| named_file(folder, model));
    let sexes =
        [("female", Sex::Female), ("male", Sex::Male), ("other", Sex::Other), ("f", Sex::Female), ("m", Sex::Male)];
    let sides = [("left", Side::Left), ("right", Side::Right), ("l", Side::Left), ("r", Side::Right)];
    let segment_lengths = header
        .iter()
        .filter_map(|column| Some((column.as_str(), column.strip_suffix(SEGMENT_SUFFIX)?)))
        .filter_map(|(column, segment)| {
            Some((segment.to_owned(), size(row, column, &plausible::SEGMENT_LENGTH, problems)?))
        })
        .collect();
    let mvc = |column: &str, problems: &mut Vec<Problem>| {
        let moment = row.number(column, "a positive moment in N·m", |v| v > 0.0, problems)?;
        row.warn_of(column, moment, &plausible::MVC_MOMENT, problems);
        Some(moment)
    };
    let mass = size(row, "mass_kg", &plausible::BODY_MASS, problems);
    let height = size(row, "height_m", &plausible::BODY_HEIGHT, problems);
    match (mass, height) {
        (Some(mass_kg), Some(height_m)) => {
            if let Some(doubt) = plausible::BODY_MASS_INDEX.doubt(mass_kg / (height_m * height_m)) {
                row.warning(Fault::ImplausibleBuild { mass_kg, height_m, doubt }, problems);
            }
        }
        (Some(mass), None) => row.warn_of("mass_kg", mass, &plausible::USUAL_BODY_MASS, problems),
        (None, _) => {}
    }
    Some(Participant {
        name: name.to_owned(),
        line: row.line,
        own_model: own_model.is_some(),
        model: own_model.unwrap_or_else(|| study_model.to_owned()),
        mass,
        height,
        sex: row.word("sex", "sex", &sexes, problems),
        side: row.word("side", "side", &sides, problems),
        segment_lengths,
        mvc_flexion: mvc("mvc_flexion_n_m", problems),
        mvc_extension: mvc("mvc_extension_n_m", problems),
        person: row.text("person").map(str::to_owned),
        group: row.text("group").map(str::to_owned),
        visit: row.text("visit").map(str::to_owned),
    })
}

/// A size of a body or a part of it; one that no person has is an error (centimetres, pounds).
pub(crate) fn size(
    row: &Row<'_>,
    column: &str,
    plausible: &'static Plausible,
    problems: &mut Vec<Problem>,
) -> Option<f64> {
    let value = row.number(column, "a positive number", |v| v > 0.0, problems)?;
    if let Some(doubt) = plausible.doubt(value) {
        row.error(Fault::Implausible { name: format!("column `{column}`"), doubt }, problems);
        return None;
    }
    Some(value)
}
