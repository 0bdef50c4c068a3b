//! `trials.csv`: which trials were recorded, under which condition, and what each is for.

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use super::fault::Fault;
use super::nearest::nearest;
use super::participants::Participant;
use super::posture::{POSTURE_EXPECTED, PostureCoordinate, is_posture, radian_evidence};
use super::problem::Problem;
use super::table::{Row, Table, named_file};
use carpus_numerics::plausible;

const COLUMNS: [&str; 13] = [
    "participant",
    "file",
    "contraction",
    "effort_percent",
    "direction",
    "posture_deg",
    "repetition",
    "use",
    "start_time_s",
    "arm",
    "emg_file",
    "table",
    "emg_table",
];
/// What surrounds a coordinate's name in the column of its posture.
const POSTURE_COLUMN: (&str, &str) = ("posture_", "_deg");
const REQUIRED: [(&str, &str); 5] = [
    ("participant", "name of the participant"),
    ("file", "the trial's file, relative to study.toml"),
    ("contraction", "isometric, isotonic, passive, mvc or freehand"),
    ("effort_percent", "percent of the maximum voluntary effort"),
    ("direction", "flexion, extension or none"),
];

/// One row of `trials.csv`.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialInfo {
    /// Position among the study's trials, in the order of recording.
    pub index: usize,
    /// Position among the participant's trials, in the order of recording; ignored ones count.
    pub place: usize,
    /// Line of the row.
    pub line: usize,
    /// Short name that no other trial of the participant has, not even in other case: the file's name without
    /// extension, and its table behind it; where several trials have that, with as many of its folders in front as tell
    /// them apart.
    pub name: String,
    /// Name of the participant.
    pub participant: String,
    /// The trial's file.
    pub file: PathBuf,
    /// The trial's file as `trials.csv` writes it.
    pub file_as_written: String,
    /// Kind of contraction.
    pub contraction: Contraction,
    /// Effort asked for, in percent of the maximum voluntary effort; `None` if none was asked for.
    pub effort_percent: Option<f64>,
    /// Direction of the effort.
    pub direction: Direction,
    /// Posture of the dynamometer's coordinate \[rad\], where one was asked for.
    pub posture: Option<f64>,
    /// Other coordinates that are held at a value of their own in this trial; all further ones are as in `study.toml`.
    pub held: Vec<PostureCoordinate>,
    /// Number of the repetition, as the lab counts.
    pub repetition: Option<u32>,
    /// What the trial is for.
    pub usage: TrialUse,
    /// Time at which the trial began, since the session began \[s\].
    pub start_time: Option<f64>,
    /// Whether the forearm is turned over, so that gravity acts the other way about the dynamometer's axis.
    pub arm_flipped: bool,
    /// The file of its EMG, where a recorder of its own wrote that.
    pub emg_file: Option<PathBuf>,
    /// The table of its file, by title or number, where that has several.
    pub table: Option<String>,
    /// The table of its EMG's file.
    pub emg_table: Option<String>,
}

/// Words of the column `arm`, and whether the forearm is turned over.
pub(crate) const ARM_WORDS: [(&str, bool); 2] = [("upright", false), ("flipped", true)];

impl TrialInfo {
    /// Whether it is a maximum voluntary contraction that scales EMG or strength.
    pub fn is_mvc(&self) -> bool {
        self.usage == TrialUse::Mvc || self.contraction == Contraction::Mvc
    }

    /// The value that a coordinate is held at in this trial, where it has one of its own [degrees, or metres].
    pub fn held_at(&self, coordinate: &str) -> Option<f64> {
        self.held.iter().find(|held| held.coordinate == coordinate).map(|held| held.value_deg_or_m)
    }

    /// The word that stands for the arm's position in `trials.csv`.
    pub fn arm_word(&self) -> &'static str {
        word_of(&ARM_WORDS, self.arm_flipped)
    }
}

/// Kind of contraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Contraction {
    /// The joint is held still.
    Isometric,
    /// The joint moves under effort, against a constant moment or (`isokinetic`) at a constant speed.
    Isotonic,
    /// The machine moves a relaxed joint.
    Passive,
    /// Maximum voluntary contraction.
    Mvc,
    /// The joint moves freely.
    Freehand,
}

impl Contraction {
    pub(crate) const WORDS: [(&'static str, Contraction); 6] = [
        ("isometric", Contraction::Isometric),
        ("isotonic", Contraction::Isotonic),
        ("passive", Contraction::Passive),
        ("mvc", Contraction::Mvc),
        ("freehand", Contraction::Freehand),
        // The machine keeps the speed instead of the moment: the model is moved as recorded in either case.
        ("isokinetic", Contraction::Isotonic),
    ];

    /// The word that stands for it in `trials.csv`.
    pub fn word(self) -> &'static str {
        word_of(&Self::WORDS, self)
    }
}

/// Direction of the effort.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Flexion.
    Flexion,
    /// Extension.
    Extension,
    /// No direction, or both.
    None,
}

impl Direction {
    const WORDS: [(&str, Direction); 3] =
        [("flexion", Direction::Flexion), ("extension", Direction::Extension), ("none", Direction::None)];

    /// The word that stands for it in `trials.csv`.
    pub fn word(self) -> &'static str {
        word_of(&Self::WORDS, self)
    }
}

/// What a trial is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialUse {
    /// Seen by fitting.
    Train,
    /// Held out: never seen by fitting, diagnosis or effect selection; the fall of the error is reported on these.
    Test,
    /// A maximum voluntary contraction that scales EMG or strength.
    Mvc,
    /// Not read at all.
    Ignore,
}

impl TrialUse {
    const WORDS: [(&str, TrialUse); 4] =
        [("train", TrialUse::Train), ("test", TrialUse::Test), ("mvc", TrialUse::Mvc), ("ignore", TrialUse::Ignore)];

    /// The word that stands for it in `trials.csv`.
    pub fn word(self) -> &'static str {
        word_of(&Self::WORDS, self)
    }
}

fn word_of<T: PartialEq>(words: &[(&'static str, T)], value: T) -> &'static str {
    words.iter().find(|(_, v)| *v == value).map_or("", |(word, _)| word)
}

/// Where the files of trials are.
#[derive(Clone, Copy)]
pub(crate) struct Place<'p> {
    /// The study's folder.
    pub folder: &'p Path,
    /// The folder that files are relative to.
    pub recordings: &'p Path,
}

/// Reads `trials.csv`.
pub(crate) fn read(
    path: &Path,
    place: Place<'_>,
    participants: &[Participant],
    problems: &mut Vec<Problem>,
) -> Vec<TrialInfo> {
    let Some(table) = Table::read(path, "trials.csv", None, problems) else { return Vec::new() };
    if !table.check_columns(&REQUIRED, &COLUMNS, |c| COLUMNS.contains(&c) || held_coordinate(c).is_some(), problems) {
        return Vec::new();
    }
    let mut trials: Vec<TrialInfo> = Vec::new();
    let mut files = HashMap::new();
    let mut conditions = HashMap::new();
    let mut places = HashMap::new();
    for row in table.rows() {
        let Some(mut trial) = trial(&row, place, participants, problems) else { continue };
        trial.index = trials.len();
        let order = places.entry(trial.participant.clone()).or_insert(0);
        trial.place = *order;
        *order += 1;
        let recording = (trial.file.clone(), trial.table.clone());
        if let Some(&first_line) = files.get(&recording) {
            let value = match &trial.table {
                Some(table) => format!("{}, {table}", trial.file_as_written),
                None => trial.file_as_written,
            };
            row.error(Fault::Duplicate { what: "trial file", value, first_line }, problems);
            continue;
        }
        files.insert(recording, row.line);
        if let Some(repetition) = trial.repetition {
            let bits = |v: Option<f64>| v.map(f64::to_bits);
            let condition = (
                trial.participant.clone(),
                (trial.contraction, trial.direction, repetition, trial.arm_flipped),
                (bits(trial.effort_percent), bits(trial.posture)),
                trial.held.iter().map(|h| (h.coordinate.clone(), h.value_deg_or_m.to_bits())).collect::<Vec<_>>(),
            );
            let first_line = *conditions.entry(condition).or_insert(row.line);
            if first_line != row.line {
                problems.push(Problem::warning(path, row.line, Fault::DuplicateCondition { first_line }));
            }
        }
        let later = |t: &&TrialInfo| t.participant == trial.participant && t.start_time > trial.start_time;
        if let (Some(start_s), Some(before)) = (trial.start_time, trials.iter().find(later)) {
            row.error(Fault::StartOrder { start_s, before_line: before.line }, problems);
        }
        trials.push(trial);
    }
    name_trials(&mut trials, place.recordings);
    trials
}

/// Gives every trial its name: a trial is a row, and two rows may have files of one name.
fn name_trials(trials: &mut [TrialInfo], folder: &Path) {
    let parts = |trial: &TrialInfo| -> Vec<String> {
        let path = trial.file.strip_prefix(folder).unwrap_or(&trial.file).with_extension("");
        let normal = path.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        let mut parts: Vec<String> = normal.collect();
        if let (Some(last), Some(table)) = (parts.last_mut(), &trial.table) {
            last.push('_');
            last.extend(table.chars().map(|c| if c.is_alphanumeric() || "+-.".contains(c) { c } else { '_' }));
        }
        parts
    };
    let parts: Vec<Vec<String>> = trials.iter().map(parts).collect();
    // How many parts of its path a trial's name has; 0: its path says nothing, the row alone does.
    let mut used = vec![1; trials.len()];
    loop {
        for ((trial, parts), used) in trials.iter_mut().zip(&parts).zip(&used) {
            let row = format!("row_{}", trial.line);
            trial.name = match parts.len() {
                0 => row,
                n if *used > n => format!("{}_{row}", parts.join("_")),
                n => parts[n - used..].join("_"),
            };
        }
        let mut owners: HashMap<(String, String), Vec<usize>> = HashMap::new();
        for (i, trial) in trials.iter().enumerate() {
            owners.entry((trial.participant.clone(), trial.name.to_lowercase())).or_default().push(i);
        }
        let shared: Vec<usize> = owners.into_values().filter(|of| of.len() > 1).flatten().collect();
        // A name with its row in it differs from all others of this kind: nobody takes more than one part beyond its
        // path.
        let longer: Vec<usize> = shared.into_iter().filter(|&i| used[i] <= parts[i].len()).collect();
        if longer.is_empty() {
            return;
        }
        longer.into_iter().for_each(|i| used[i] += 1);
    }
}

fn trial(
    row: &Row<'_>,
    place: Place<'_>,
    participants: &[Participant],
    problems: &mut Vec<Problem>,
) -> Option<TrialInfo> {
    let participant = row.required("participant", "a name", problems);
    let participant = participant.filter(|name| known_participant(row, name, participants, problems));
    let file = row.required("file", "a path", problems);
    row.required("contraction", "isometric, isotonic, passive, mvc or freehand", problems);
    let contraction = row.word("contraction", "contraction", &Contraction::WORDS, problems);
    row.required("direction", "flexion, extension or none", problems);
    let direction = row.word("direction", "direction", &Direction::WORDS, problems);
    let effort_percent = row.number("effort_percent", "0 to 100 percent", |v| (0.0..=100.0).contains(&v), problems);
    if let Some(effort) = effort_percent.filter(|effort| *effort != 0.0) {
        row.warn_of("effort_percent", effort, &plausible::EFFORT_PERCENT, problems);
    }
    if let Some(file) = file.filter(|file| place.folder == place.recordings && is_outside(file, place.folder)) {
        row.warning(Fault::OutsideStudy { found: file.to_owned() }, problems);
    }
    let posture = row.number("posture_deg", "an angle in degrees", |v| v.abs() <= 360.0, problems);
    let held = held(row, problems);
    let repetition =
        row.number("repetition", "0, 1, 2, 3 …", |v| (0.0..=1e6).contains(&v) && v.fract() == 0.0, problems);
    let start_time = row.number("start_time_s", "a time in seconds, 0 or more", |v| v >= 0.0, problems);
    let usage = match row.text("use") {
        Option::None => Some(TrialUse::Train),
        Some(_) => row.word("use", "use", &TrialUse::WORDS, problems),
    };
    let arm = match row.text("arm") {
        Option::None => Some(false),
        Some(_) => row.word("arm", "position of the arm", &ARM_WORDS, problems),
    };
    Some(TrialInfo {
        index: 0,
        place: 0,
        line: row.line,
        name: String::new(),
        participant: participant?.to_owned(),
        file: named_file(place.recordings, file?),
        file_as_written: file?.to_owned(),
        contraction: contraction?,
        effort_percent,
        direction: direction?,
        posture: posture.map(f64::to_radians),
        held,
        repetition: repetition.map(|r| r as u32),
        usage: usage?,
        start_time,
        arm_flipped: arm?,
        emg_file: row.text("emg_file").map(|file| named_file(place.recordings, file)),
        table: row.text("table").map(str::to_owned),
        emg_table: row.text("emg_table").map(str::to_owned),
    })
}

/// The coordinate whose posture a column has.
fn held_coordinate(column: &str) -> Option<&str> {
    let (before, after) = POSTURE_COLUMN;
    column.strip_prefix(before)?.strip_suffix(after).filter(|name| !name.is_empty())
}

/// Coordinates that some of the trials hold at values of their own, in the order in which they come.
pub fn held_coordinates<'t>(trials: impl IntoIterator<Item = &'t TrialInfo>) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for held in trials.into_iter().flat_map(|trial| &trial.held) {
        if !found.contains(&held.coordinate) {
            found.push(held.coordinate.clone());
        }
    }
    found
}

/// Name of the column of a coordinate's posture.
pub fn posture_column(coordinate: &str) -> String {
    let (before, after) = POSTURE_COLUMN;
    format!("{before}{coordinate}{after}")
}

/// Coordinates that a row holds at values of its own, in the order of the columns.
fn held(row: &Row<'_>, problems: &mut Vec<Problem>) -> Vec<PostureCoordinate> {
    let columns = row.header.iter().filter_map(|column| Some((column, held_coordinate(column)?)));
    let of = |(column, coordinate): (&String, &str)| {
        let value_deg_or_m = row.number(column, POSTURE_EXPECTED, is_posture, problems)?;
        if let Some(evidence) = radian_evidence(value_deg_or_m) {
            row.warning(Fault::LooksLikeRadians { name: column.clone(), evidence }, problems);
        }
        Some(PostureCoordinate { coordinate: coordinate.to_owned(), line: row.line, value_deg_or_m })
    };
    columns.filter_map(of).collect()
}

/// Whether a file that is there lies elsewhere than below the study's folder, links followed.
fn is_outside(file: &str, folder: &Path) -> bool {
    let folder_or_here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match (folder.join(file).canonicalize(), folder_or_here.canonicalize()) {
        (Ok(file), Ok(folder)) => !file.starts_with(folder),
        _ => false, // what is not there is reported when it is read
    }
}

fn known_participant(row: &Row<'_>, name: &str, participants: &[Participant], problems: &mut Vec<Problem>) -> bool {
    let known = || participants.iter().map(|p| p.name.as_str());
    let is_known = known().any(|k| k == name);
    // With no participants at all, participants.csv itself is at fault and is reported once.
    if !is_known && !participants.is_empty() {
        let fault = Fault::UnknownWord {
            key: "participant".to_owned(),
            what: "participant",
            found: name.to_owned(),
            known: known().map(str::to_owned).collect(),
            nearest: nearest(name, known()),
        };
        row.error(fault, problems);
    }
    is_known || participants.is_empty()
}
