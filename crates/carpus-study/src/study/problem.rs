//! What can be wrong with a study, where it stands, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

use super::trial::{LONGEST_STEP, LONGEST_TRIAL, SHORTEST_STEP};
use carpus_numerics::plausible::{Doubt, Measured, NamedUnit, moment_unit_of_ratio};
use carpus_numerics::printable::number_of;
use carpus_numerics::signals::{Finding, Resampled, SignalError};

/// How many problems [`StudyErrors`] prints before it only counts the rest: a person mends the first few and asks again.
pub const MAX_LISTED: usize = 10;

/// Whether a study can be used in spite of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The study cannot be used until this is put right.
    Error,
    /// The study can be used; a person should look.
    Warning,
}

/// One finding: where it stands and what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Whether the study can be used in spite of it.
    pub severity: Severity,
    /// The file it stands in.
    pub file: PathBuf,
    /// Line, counted from 1; `None` if it concerns the file as a whole.
    pub line: Option<usize>,
    /// What is wrong.
    pub fault: Fault,
}

impl Problem {
    /// An error at a line of a file.
    pub fn error(file: &Path, line: impl Into<Option<usize>>, fault: Fault) -> Self {
        Self { severity: Severity::Error, file: file.to_owned(), line: line.into(), fault }
    }

    /// A warning at a line of a file.
    pub fn warning(file: &Path, line: impl Into<Option<usize>>, fault: Fault) -> Self {
        Self { severity: Severity::Warning, file: file.to_owned(), line: line.into(), fault }
    }

    /// What to do about it, if there is something more to say than the message says.
    pub fn hint(&self) -> Option<String> {
        self.fault.hint()
    }
}

impl fmt::Display for Problem {
    /// `file:line: what` and, on a second line, `  hint: …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        if self.severity == Severity::Warning {
            write!(f, " warning:")?;
        }
        write!(f, " {}", self.fault)?;
        if let Some(hint) = self.hint() {
            write!(f, "\n  hint: {hint}")?;
        }
        Ok(())
    }
}

impl serde::Serialize for Problem {
    /// `{severity, file, line, message, hint}`.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut fields = serializer.serialize_struct("Problem", 5)?;
        fields.serialize_field("severity", &self.severity)?;
        fields.serialize_field("file", &self.file.to_string_lossy())?;
        fields.serialize_field("line", &self.line)?;
        fields.serialize_field("message", &self.fault.to_string())?;
        fields.serialize_field("hint", &self.hint())?;
        fields.end()
    }
}

/// Why a study cannot be used: every error found, and the warnings found on the way.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct StudyErrors {
    /// The errors, in order of file reading; never empty when returned from a reader.
    pub errors: Vec<Problem>,
    /// Warnings found before reading stopped.
    pub warnings: Vec<Problem>,
}

impl StudyErrors {
    /// Splits a list of findings; `Ok(warnings)` if none of them is an error.
    pub(crate) fn settle(problems: Vec<Problem>) -> Result<Vec<Problem>, StudyErrors> {
        let (errors, warnings): (Vec<_>, Vec<_>) = problems.into_iter().partition(|p| p.severity == Severity::Error);
        if errors.is_empty() { Ok(warnings) } else { Err(StudyErrors { errors, warnings }) }
    }
}

impl fmt::Display for StudyErrors {
    /// Up to [`MAX_LISTED`] errors, one below the other, then the count of the others.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.errors.iter().take(MAX_LISTED).enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{problem}")?;
        }
        match self.errors.len().saturating_sub(MAX_LISTED) {
            0 => Ok(()),
            1 => write!(f, "\n… and 1 further error"),
            rest => write!(f, "\n… and {rest} further errors"),
        }
    }
}

impl std::error::Error for StudyErrors {}

/// What is wrong. Numbers are in the unit that the field's name or the message states.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A file that is named does not exist.
    #[error("{what} not found")]
    MissingFile {
        /// What the file would be: `trial file`, `model`, …
        what: &'static str,
        /// `file:line` that names it, if another file does.
        named_at: Option<String>,
    },
    /// The operating system refused to read a file.
    #[error("cannot read {what}: {reason}")]
    Unreadable {
        /// What the file is.
        what: &'static str,
        /// The system's words.
        reason: String,
    },
    /// The bytes are not UTF-8 text.
    #[error("not UTF-8 text")]
    NotText,
    /// Broken TOML.
    #[error("not valid TOML: {message}")]
    TomlSyntax {
        /// The parser's words.
        message: String,
    },
    /// A file of another kind where a study is expected.
    #[error("this is {found}; expected a study: its study.toml, or the folder that it is in")]
    NotAStudy {
        /// What it is, with its article.
        found: &'static str,
        /// What to give instead, or the command that takes such a file.
        hint: &'static str,
    },
    /// Broken CSV.
    #[error("not valid CSV: {message}")]
    CsvSyntax {
        /// The parser's words.
        message: String,
    },
    /// A key that the format does not have.
    #[error("unknown key `{key}` in [{section}]{}", known_list("known keys", known))]
    UnknownKey {
        /// The key.
        key: String,
        /// Its table.
        section: String,
        /// The keys that exist there.
        known: Vec<String>,
        /// The known key that looks most like it.
        nearest: Option<String>,
    },
    /// A section that the format does not have.
    #[error("unknown section [{section}]{}", known_list("known sections", known))]
    UnknownSection {
        /// The section.
        section: String,
        /// The sections that exist.
        known: Vec<String>,
        /// The known section that looks most like it.
        nearest: Option<String>,
    },
    /// A required key is absent.
    #[error("[{section}] has no `{key}` ({expected})")]
    MissingKey {
        /// Table in which it is expected.
        section: String,
        /// The key.
        key: String,
        /// What it should hold.
        expected: String,
    },
    /// A value of the wrong type or outside its domain.
    #[error("`{key}`: expected {expected}, found {found}")]
    BadValue {
        /// Key or column.
        key: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A value that cannot be used, with what to do about it.
    #[error("`{key}`: expected {expected}, found {found}")]
    Refused {
        /// Key or column.
        key: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
        /// What to do.
        hint: String,
    },
    /// A word that is not one of a closed list.
    #[error("`{key}`: unknown {what} `{found}` (one of: {})", known.join(", "))]
    UnknownWord {
        /// Key or column.
        key: String,
        /// What the word names.
        what: &'static str,
        /// The word.
        found: String,
        /// The words that exist.
        known: Vec<String>,
        /// The known word that looks most like it.
        nearest: Option<String>,
    },
    /// The same thing is stated twice.
    #[error("{what} `{value}` stands here again; it stands already on line {first_line}")]
    Duplicate {
        /// What is repeated.
        what: &'static str,
        /// The repeated value.
        value: String,
        /// Line of the first.
        first_line: usize,
    },
    /// Two trials with the same participant, condition and repetition.
    #[error("same participant, condition and repetition as the trial on line {first_line}")]
    DuplicateCondition {
        /// Line of the first.
        first_line: usize,
    },
    /// Raw EMG that cannot become an excitation.
    #[error("column `{column}`, raw EMG: {error}")]
    RawEmg {
        /// The column.
        column: String,
        /// Why not.
        error: SignalError,
    },
    /// Something doubtful about a raw EMG channel.
    #[error("column `{column}`: {finding}")]
    EmgChannel {
        /// The column.
        column: String,
        /// What was found.
        finding: Finding,
    },
    /// Raw EMG without a trial that says what a maximum is.
    #[error("participant `{participant}` has no trial of contraction or use `mvc`, which raw EMG is normalized by")]
    NoMvcTrial {
        /// The participant.
        participant: String,
    },
    /// A raw recording whose steps differ.
    #[error("step of {step_s:.6} s before this row, {mean_step_s:.6} s on average: raw EMG needs equal steps{}", others(*more))]
    UnequalSteps {
        /// The step \[s\].
        step_s: f64,
        /// Mean step of the trial \[s\].
        mean_step_s: f64,
        /// How many further such steps there are.
        more: usize,
    },
    /// A required column is absent.
    #[error("no column `{column}` ({meaning}); columns present: {}", list_or_none(present))]
    MissingColumn {
        /// The column looked for.
        column: String,
        /// What it holds.
        meaning: String,
        /// The columns of the file.
        present: Vec<String>,
        /// The column present that looks most like it.
        nearest: Option<String>,
    },
    /// A column that nothing reads.
    #[error("unknown column `{column}`{}", known_list("known columns", known))]
    UnknownColumn {
        /// The column.
        column: String,
        /// The columns that exist.
        known: Vec<String>,
        /// The known column that looks most like it.
        nearest: Option<String>,
        /// Whether this is a trial file, where `[columns] ignore` may list it.
        in_trial: bool,
    },
    /// Two columns of one name.
    #[error("column `{column}` stands twice in the header")]
    DuplicateColumn {
        /// The column.
        column: String,
    },
    /// The file has no header line or no rows.
    #[error("{what} is empty")]
    Empty {
        /// What the file is.
        what: &'static str,
    },
    /// A row with more or fewer fields than the header.
    #[error("row has {found} fields, the header has {expected}{}", others(*more))]
    FieldCount {
        /// Fields in the header.
        expected: usize,
        /// Fields in the row.
        found: usize,
        /// How many further such rows there are.
        more: usize,
    },
    /// A file of another format stands where a table is read.
    #[error("{found}; expected a table with columns separated by commas ({what})")]
    NotATable {
        /// What it is: `this is XML, as a model or a setup`.
        found: &'static str,
        /// What is read here: `trial file`.
        what: &'static str,
    },
    /// The header is one field that contains another separator.
    #[error("columns are separated by {found}; expected commas")]
    Separator {
        /// What separates them.
        found: &'static str,
    },
    /// A cell that should hold a number.
    #[error("column `{column}`: expected {expected}, found {}{}", quoted(found), others(*more))]
    BadNumber {
        /// The column.
        column: String,
        /// What was expected.
        expected: &'static str,
        /// The cell's text; may be empty.
        found: String,
        /// How many further cells of this column are bad.
        more: usize,
    },
    /// Fewer samples than anything can be computed from.
    #[error("only {found} samples; expected at least {expected}")]
    TooFewSamples {
        /// Samples in the file.
        found: usize,
        /// Least number.
        expected: usize,
    },
    /// More samples than memory should be given to.
    #[error("more than {limit} samples in one trial")]
    TooManySamples {
        /// The limit.
        limit: usize,
    },
    /// Time does not increase.
    #[error("time does not increase: {time_s} s after {before_s} s{}", others(*more))]
    TimeNotIncreasing {
        /// Time of this row \[s\].
        time_s: f64,
        /// Time of the row before \[s\].
        before_s: f64,
        /// How many further such rows there are.
        more: usize,
    },
    /// The same time twice.
    #[error("time {time_s} s stands twice{}", others(*more))]
    TimeRepeated {
        /// The time \[s\].
        time_s: f64,
        /// How many further such rows there are.
        more: usize,
    },
    /// Samples are missing.
    #[error("gap of {gap_s:.4} s before this row; expected at most {allowed_s:.4} s (median step {median_step_s:.4} s){}", others(*more))]
    Gap {
        /// Size of the gap \[s\].
        gap_s: f64,
        /// Largest step allowed \[s\].
        allowed_s: f64,
        /// Median step of the trial \[s\].
        median_step_s: f64,
        /// How many further gaps there are.
        more: usize,
    },
    /// Time in another unit than seconds.
    #[error(
        "median time step {median_step_s} s, duration {duration_s} s; expected steps of {SHORTEST_STEP} s to \
         {LONGEST_STEP} s and a trial of at most {LONGEST_TRIAL} s",
        median_step_s = four_digits(*median_step_s), duration_s = four_digits(*duration_s)
    )]
    ImplausibleTime {
        /// Median step \[s\].
        median_step_s: f64,
        /// From the first to the last sample \[s\].
        duration_s: f64,
    },
    /// The sampling is too coarse for muscle dynamics.
    #[error("median time step is {median_step_s:.4} s; expected at most {expected_s} s")]
    CoarseSampling {
        /// Median step \[s\].
        median_step_s: f64,
        /// Expected at most \[s\].
        expected_s: f64,
    },
    /// Excitations outside 0..1.
    #[error("column `{column}`: {count} of {samples} samples are {}, {} {extreme:.4}; expected 0 to 1 (part of MVC){}",
        if *above { "above 1" } else { "below 0" }, if *above { "highest" } else { "lowest" },
        if *clamped { "; clamped" } else { "" })]
    EmgOutOfRange {
        /// The column.
        column: String,
        /// Above 1 (else: below 0).
        above: bool,
        /// How many samples.
        count: usize,
        /// Of how many.
        samples: usize,
        /// The farthest.
        extreme: f64,
        /// Small enough to be noise: the samples were clamped to the range.
        clamped: bool,
    },
    /// EMG that never changes.
    #[error("column `{column}` is {value} in every sample: not a recording of a muscle")]
    ConstantEmg {
        /// The column.
        column: String,
        /// Its value.
        value: f64,
    },
    /// Angle outside the coordinate's range.
    #[error(
        "{count} of {samples} samples have {} outside the range of coordinate `{coordinate}`, {}",
        if *is_translation { "a position" } else { "an angle" },
        farthest(*extreme, [*lower, *upper], *is_translation)
    )]
    AngleOutOfRange {
        /// OpenSim coordinate.
        coordinate: String,
        /// Whether the coordinate is a translation.
        is_translation: bool,
        /// Least value [rad or m].
        lower: f64,
        /// Greatest value [rad or m].
        upper: f64,
        /// The farthest value recorded [rad or m].
        extreme: f64,
        /// How many samples.
        count: usize,
        /// Of how many.
        samples: usize,
    },
    /// Numbers in a degrees column that look like radians.
    #[error("`{name}` looks like radians: {evidence}; degrees are expected")]
    LooksLikeRadians {
        /// Column or key.
        name: String,
        /// What makes it look so.
        evidence: String,
    },
    /// Numbers in a radians column that look like degrees.
    #[error("`{name}` looks like degrees: {evidence}; radians are expected")]
    LooksLikeDegrees {
        /// Column or key.
        name: String,
        /// What makes it look so.
        evidence: String,
    },
    /// An isometric trial whose angle is not the posture stated.
    #[error("mean angle is {mean_deg:.1}°, but trials.csv states a posture of {stated_deg:.1}°")]
    PostureMismatch {
        /// Mean measured angle \[deg\].
        mean_deg: f64,
        /// Posture stated \[deg\].
        stated_deg: f64,
    },
    /// An isometric trial in which the joint moved.
    #[error("the angle moves by {travel_deg:.1}° in an isometric trial")]
    IsometricMoves {
        /// Largest minus smallest angle \[deg\].
        travel_deg: f64,
    },
    /// The velocity column is not the derivative of the angle.
    #[error("`{column}` is {ratio:.4} times the derivative of the angle; expected 1")]
    VelocityDisagrees {
        /// The column.
        column: String,
        /// Least-squares ratio.
        ratio: f64,
    },
    /// A moment of an unlikely size.
    #[error("largest moment is {max_abs_n_m:.4} N·m; {expected}")]
    MomentScale {
        /// Largest absolute moment [N·m].
        max_abs_n_m: f64,
        /// What was expected.
        expected: String,
    },
    /// A moment that was put on a faster grid than it was recorded on.
    #[error(
        "the moment {}", how_resampled(*how, *own_rate_hz, *rate_hz)
    )]
    MomentResampled {
        /// What was done to it.
        how: Resampled,
        /// Its own samples a second [Hz].
        own_rate_hz: f64,
        /// Rows of the file a second [Hz].
        rate_hz: f64,
    },
    /// An angle or EMG that was put on a faster grid than it was recorded on.
    #[error(
        "the {quantity} `{column}` {}", how_resampled(*how, *own_rate_hz, *rate_hz)
    )]
    ColumnResampled {
        /// `angle`, `raw EMG` or `EMG`.
        quantity: &'static str,
        /// The column.
        column: String,
        /// What was done to it.
        how: Resampled,
        /// Its own samples a second [Hz].
        own_rate_hz: f64,
        /// Rows of the file a second [Hz].
        rate_hz: f64,
    },
    /// Moments of the wrong sign.
    #[error(
        "the effort changes the moment by {effort_n_m:+.3} N·m in a trial of direction `{direction}`; expected the opposite sign"
    )]
    MomentSign {
        /// Moment of the effort, above that of the relaxed limb [N·m].
        effort_n_m: f64,
        /// Direction stated.
        direction: &'static str,
    },
    /// The model has no component of that name.
    #[error("{what} `{name}` is not in the model {}", model.display())]
    NotInModel {
        /// `coordinate` or `muscle`.
        what: &'static str,
        /// The name.
        name: String,
        /// The model's file.
        model: PathBuf,
        /// The name in the model that looks most like it.
        nearest: Option<String>,
    },
    /// Trials of a participant do not stand in the order of recording.
    #[error("trial starts at {start_s} s, before the one on line {before_line}; rows stand in the order of recording")]
    StartOrder {
        /// Start of this trial \[s\].
        start_s: f64,
        /// Line of the trial above it that starts later.
        before_line: usize,
    },
    /// Start times of a participant's trials, but not of all.
    #[error(
        "{without} of {trials} trials of participant `{participant}` have no `start_time_s`: all are taken by their order"
    )]
    SomeStartTimes {
        /// The participant.
        participant: String,
        /// Trials without a start time.
        without: usize,
        /// Trials that are used.
        trials: usize,
    },
    /// An arm turned over in a study whose model has weight.
    #[error(
        "the arm is `flipped`, but [dynamometer] include has \"gravity\": the weight of the model's own bodies is not turned"
    )]
    OwnGravityNotTurned,
    /// A participant without trials.
    #[error("participant `{participant}` has no trial in trials.csv")]
    NoTrials {
        /// The participant.
        participant: String,
    },
    /// No trial that a fit could use.
    #[error("no trial has use `train`: nothing can be fitted")]
    NothingToTrain,
    /// A value that no person has, or that a slip of unit explains.
    #[error("{name}: {doubt}")]
    Implausible {
        /// Where it stands: "column `mass_kg`".
        name: String,
        /// The value, its range and the likely slip.
        doubt: Doubt,
    },
    /// A mass that does not suit the height.
    #[error("column `mass_kg`: {mass_kg} kg at a height of {height_m} m: mass over height² {doubt}")]
    ImplausibleBuild {
        /// Mass \[kg\].
        mass_kg: f64,
        /// Height \[m\].
        height_m: f64,
        /// Mass over height², its range and the likely slip.
        doubt: Doubt,
    },
    /// A column whose name states another unit than its numbers are taken in.
    #[error("column `{column}`: its name states {}{}; its numbers are taken as {taken_as}", .unit.symbol, other_quantity(.unit, *.holds))]
    UnitInName {
        /// The column.
        column: String,
        /// The unit of the name.
        unit: &'static NamedUnit,
        /// What the column is to hold.
        holds: Measured,
        /// Unit that the numbers are taken in.
        taken_as: &'static str,
        /// One of `unit` in that unit, if the quantity is the same.
        factor: Option<f64>,
    },
    /// A maximum voluntary moment that the MVC trials do not show.
    #[error(
        "column `{column}`: {stated_n_m} N·m, but the largest moment of the MVC trial {trial} is {measured_n_m:.2} N·m"
    )]
    MvcDisagrees {
        /// Column of `participants.csv`.
        column: &'static str,
        /// Moment stated [N·m].
        stated_n_m: f64,
        /// Largest moment in the direction over the MVC trials [N·m].
        measured_n_m: f64,
        /// The trial that has it, as `trials.csv` writes it.
        trial: String,
    },
    /// The moment of every trial points against the direction of its effort.
    #[error(
        "the moment is reversed: in all {trials} trials whose effort has a direction it points the other way ({})",
        participants.join(", ")
    )]
    MomentReversed {
        /// Column of the moment.
        column: String,
        /// How many trials were judged.
        trials: usize,
        /// Participants of whom this is so.
        participants: Vec<String>,
    },
    /// Two EMG channels that are each most active where their muscle is not.
    #[error("the EMG of {first} and {second} looks exchanged: each is most active in the other's direction{}",
        fit_gain.map(|gain| format!(", and exchanged they fit the moment {gain:.1} times as well")).unwrap_or_default())]
    ChannelsExchanged {
        /// A muscle.
        first: String,
        /// A muscle of the other side.
        second: String,
        /// RMS error of the moment by EMG and moment arms as recorded, over that with the channels exchanged, if it
        /// falls.
        fit_gain: Option<f64>,
    },
    /// A character in a name that does not show as what it is.
    #[error("{place} has the character {}, which does not show as it is", number_of(*character))]
    DeceptiveCharacter {
        /// What has it: "column `participant`", "a name in the header".
        place: String,
        /// The character.
        character: char,
    },
    /// A trial's file that is not below the study's folder.
    #[error("column `file`: `{found}` is outside the study's folder")]
    OutsideStudy {
        /// The path as written.
        found: String,
    },
    /// A folder, device or pipe in place of a file.
    #[error("{what} is no regular file")]
    NotRegular {
        /// What the file should be.
        what: &'static str,
    },
}

impl Fault {
    /// What to do about it, if there is something more to say than the message says.
    pub fn hint(&self) -> Option<String> {
        use Fault::*;
        let text = match self {
            MissingFile { named_at: Some(at), .. } => {
                format!("it is named at {at}; paths are relative to the folder of study.toml")
            }
            UnknownKey { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            NotInModel { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            UnknownSection { nearest: Some(n), .. } => format!("did you mean [{n}]?"),
            UnknownWord { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            MissingColumn { nearest: Some(n), .. } => {
                format!("did you mean `{n}`? Column names are set in [columns] of study.toml")
            }
            UnknownColumn { in_trial: true, nearest, .. } => format!(
                "{}a column that is not needed goes into [columns] ignore = [\"…\"] of study.toml",
                nearest.as_ref().map(|n| format!("did you mean `{n}`? Else: ")).unwrap_or_default()
            ),
            UnknownColumn { nearest: Some(n), .. } => format!("did you mean `{n}`?"),
            RawEmg { error: SignalError::Cutoff { .. }, .. } => {
                "set [emg] band_pass_hz to a band below half the sample rate; an envelope recorded at a low rate is not raw EMG"
                    .to_owned()
            }
            RawEmg { error: SignalError::NoMvc { .. }, .. } => {
                "the channel is silent in every MVC trial: check electrode and column".to_owned()
            }
            EmgChannel { finding: Finding::AboveMvc { .. }, .. } => {
                "excitation is held at 1 there; record MVC trials that reach the maximum of every muscle".to_owned()
            }
            EmgChannel { finding: Finding::Artefact { .. }, .. } => {
                "put the mean of its neighbours there, or leave the trial out; in an MVC trial it sets the level by which the channel is divided in all trials"
                    .to_owned()
            }
            EmgChannel { finding: Finding::MainsHum { .. }, .. } => {
                "raise the lower edge of [emg] band_pass_hz above the mains frequency, or record again".to_owned()
            }
            UnequalSteps { .. } => "resample the recording at equal steps".to_owned(),
            NotAStudy { hint, .. } => (*hint).to_owned(),
            Refused { hint, .. } => hint.clone(),
            TomlSyntax { message } if message.contains("escape") => {
                "between double quotes a backslash is written twice; between folders write /".to_owned()
            }
            NotText => "save the file as UTF-8".to_owned(),
            NotATable { .. } => "give the table's path here; models are named by `model` in study.toml".to_owned(),
            Separator { .. } => "export with commas between columns and points as decimal marks".to_owned(),
            BadNumber { found, .. } if found.contains(['−', '–']) => "use a hyphen, -, as minus sign".to_owned(),
            BadNumber { found, .. } if found.contains(',') => "use a point as decimal mark".to_owned(),
            BadNumber { found, .. } if found.is_empty() || found.eq_ignore_ascii_case("nan") => {
                "cut the samples off or fill them in; carpus does not guess missing samples".to_owned()
            }
            TimeNotIncreasing { .. } => "sort the rows by time, or split the file into two trials".to_owned(),
            TimeRepeated { .. } => "delete one of the two rows, or give time more decimals".to_owned(),
            ImplausibleTime { median_step_s, .. } => match time_unit(*median_step_s) {
                Some(unit) => format!("are these {unit}? carpus reads seconds"),
                None => "time is read in seconds; cut a long recording into trials".to_owned(),
            },
            TooManySamples { .. } => "cut it into trials, or average it to fewer samples per second".to_owned(),
            Gap { .. } => "split the trial there, fill the samples in, or set [checks] max_gap_s".to_owned(),
            EmgOutOfRange { above: true, clamped: false, .. } => {
                "is it in percent or mV, or was the MVC too small? Divide by the highest envelope of the session"
                    .to_owned()
            }
            EmgOutOfRange { above: false, clamped: false, .. } => {
                "an envelope is never negative: was the signal rectified?".to_owned()
            }
            AngleOutOfRange { .. } => {
                "check the zero and the sign of the angle, or widen the coordinate's range in the model".to_owned()
            }
            LooksLikeRadians { .. } => "multiply by 180/π, or set [columns] angle_unit = \"rad\"".to_owned(),
            LooksLikeDegrees { .. } => "set [columns] angle_unit = \"deg\"".to_owned(),
            VelocityDisagrees { ratio, .. } if *ratio < 0.0 => "its sign is turned".to_owned(),
            VelocityDisagrees { ratio, .. } if (0.008..0.035).contains(ratio) => "is it in rad/s?".to_owned(),
            VelocityDisagrees { .. } => "leave the column out and the derivative is used".to_owned(),
            MomentSign { .. } => {
                "the moment is the one the person exerts, positive in the coordinate's positive direction".to_owned()
            }
            MomentScale { .. } => "is it in N·m?".to_owned(),
            SomeStartTimes { .. } => {
                "state `start_time_s` in every row of the participant, or leave the column out".to_owned()
            }
            OwnGravityNotTurned => {
                "leave \"gravity\" out of include: the effect `gravity` of carpus diagnose is turned with the arm".to_owned()
            }
            ColumnResampled { quantity: "angle", .. } => {
                "its speed jumps from one to the next: give the angle at its own rate, or the velocity as a column".to_owned()
            }
            ColumnResampled { quantity: "raw EMG", .. } => {
                "what the muscle did between them is lost, and filters of EMG see steps: give the channel at the rate of its recorder"
                    .to_owned()
            }
            ColumnResampled { .. } => {
                "rows between them say nothing of its noise; for an envelope that is slower than they are nothing is lost".to_owned()
            }
            MomentResampled { .. } => {
                "its noise is estimated from its own samples alone; nothing else needs to be done".to_owned()
            }
            PostureMismatch { .. } => "check the zero and the sign of the angle".to_owned(),
            Implausible { doubt, .. } => doubt.hint(),
            ImplausibleBuild { mass_kg, height_m, doubt } => match doubt.slip() {
                Some(slip) => {
                    let kg = mass_kg * slip.factor;
                    format!("check the unit: is the mass in {}? {mass_kg} {0} are {kg:.1} kg", slip.unit)
                }
                None => format!("check mass ({mass_kg} kg) and height ({height_m} m)"),
            },
            UnitInName { unit, taken_as, factor: Some(factor), .. } => {
                let scaled = format!("1 {} is {} {taken_as}: multiply the column, and give it a name without the unit", unit.symbol, seven_digits(*factor));
                match (unit.symbol, *taken_as) {
                    ("rad", "deg") => format!("{scaled}; or set [columns] angle_unit = \"rad\""),
                    ("deg", "rad") => format!("{scaled}; or set [columns] angle_unit = \"deg\""),
                    _ => scaled,
                }
            }
            UnitInName { unit, holds, .. } => match (unit.of, holds) {
                (Measured::Voltage, Measured::Part) => {
                    "raw EMG is declared by [emg] kind = \"raw\"; envelopes are divided by the maximum voluntary contraction".to_owned()
                }
                (Measured::Voltage, _) => "is it the recorder's voltage? multiply it by the calibration factor first".to_owned(),
                (Measured::MomentPerMass, _) => "multiply it by the body mass first".to_owned(),
                (Measured::Force, Measured::Moment) => "is it a force? multiply it by its lever arm in metres first".to_owned(),
                _ => "is it the right column? see [columns] in study.toml".to_owned(),
            },
            MvcDisagrees { stated_n_m, measured_n_m, .. } => {
                let otherwise = "the trial was not maximal, or the MVC is of another session or posture";
                // The one or the other is not in N·m; which of the two, only the lab knows.
                match (moment_unit_of_ratio(measured_n_m / stated_n_m), moment_unit_of_ratio(stated_n_m / measured_n_m)) {
                    (Some(unit), _) => {
                        format!("1 {0} is {1:.3} N·m: is the moment of the trials in {0}? Else: {otherwise}", unit.symbol, unit.factor)
                    }
                    (_, Some(unit)) => {
                        format!("1 {0} is {1:.3} N·m: is the MVC in {0}? Else: {otherwise}", unit.symbol, unit.factor)
                    }
                    _ => format!("EMG and strength are scaled by them: {otherwise}"),
                }
            }
            MomentReversed { column, .. } => format!(
                "multiply `{column}` by -1: it is the moment that the person exerts, not the machine's; or exchange flexion and extension in trials.csv"
            ),
            ChannelsExchanged { .. } => {
                "check electrodes and cables, or exchange the two in [columns] emg of study.toml".to_owned()
            }
            DeceptiveCharacter { .. } => {
                "control characters, line breaks, direction marks and byte order marks do not belong in names; write the name anew"
                    .to_owned()
            }
            OutsideStudy { .. } => "it is read; a study that is copied elsewhere lacks it".to_owned(),
            NotRegular { .. } => "tables and trials are read from files, not from devices or pipes".to_owned(),
            _ => return None,
        };
        Some(text)
    }
}

/// Coordinate values beside the range that one of them leaves, as people read them: with as many decimals as tell the value
/// from the ends, at least two of degrees and four of metres.
///
/// - `value`, `range`: [rad or m]
pub(crate) fn value_and_range(value: f64, range: [f64; 2], is_translation: bool) -> (String, [String; 2]) {
    /// Decimals beyond which two numbers of this size do not differ.
    const MOST: usize = 13;
    /// Angles and lengths from here on are no row of digits [rad or m].
    const ABSURD: f64 = 1e9;
    let show = |v: f64, decimals: usize| {
        let (shown, unit) = if is_translation { (v, " m") } else { (v.to_degrees(), "°") };
        if v.abs() >= ABSURD { format!("{shown:.3e}{unit}") } else { format!("{shown:.decimals$}{unit}") }
    };
    let least = if is_translation { 4 } else { 2 };
    let differs =
        |decimals: &usize| range.iter().all(|end| *end == value || show(*end, *decimals) != show(value, *decimals));
    let decimals = (least..MOST).find(differs).unwrap_or(MOST);
    (show(value, decimals), range.map(|end| show(end, decimals)))
}

/// A value and the range that it leaves, in words.
///
/// - `value`, `range`: [rad or m]
pub fn outside_range(value: f64, range: [f64; 2], is_translation: bool) -> String {
    let (value, [lower, upper]) = value_and_range(value, range, is_translation);
    format!("{value}, outside its range of {lower} to {upper}")
}

/// The range of recorded angles or positions, and the farthest of them.
fn farthest(extreme: f64, range: [f64; 2], is_translation: bool) -> String {
    let (extreme, [lower, upper]) = value_and_range(extreme, range, is_translation);
    format!("{lower} to {upper}; farthest: {extreme}")
}

fn known_list(title: &str, known: &[String]) -> String {
    if known.is_empty() { String::new() } else { format!(" ({title}: {})", known.join(", ")) }
}

fn list_or_none(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn quoted(text: &str) -> String {
    if text.is_empty() {
        return "an empty cell".to_owned();
    }
    let short: String = text.chars().take(40).collect();
    if short.len() < text.len() { format!("`{short}…`") } else { format!("`{short}`") }
}

/// What was done to a signal before it stood at so many samples a second, and how many of them are its own.
fn how_resampled(how: Resampled, own_rate_hz: f64, rate_hz: f64) -> String {
    let done = match how {
        Resampled::Held => "held",
        Resampled::Interpolated => "interpolated",
        Resampled::Smoothed => {
            // Independent samples are twice as many a second as the highest frequency.
            let cutoff_hz = own_rate_hz / 2.0;
            return format!(
                "has no noise above about {cutoff_hz:.0} Hz at {rate_hz:.0} Hz: it was low-passed, or interpolated by smooth \
                 curves; about {own_rate_hz:.0} of its samples a second are independent"
            );
        }
    };
    format!("was {done} to {rate_hz:.0} Hz: {own_rate_hz:.0} of its samples a second are its own")
}

/// What a unit measures, where that is not what the column holds.
fn other_quantity(unit: &NamedUnit, holds: Measured) -> String {
    if unit.of == holds { String::new() } else { format!(", {}", unit.of.words()) }
}

/// A conversion factor with the digits that tables give; those of angles with fewer.
fn seven_digits(number: f64) -> f64 {
    if number.fract() == 0.0 || number < 0.1 {
        four_digits(number)
    } else {
        format!("{number:.6}").parse().unwrap_or(number)
    }
}

/// A number to four significant digits.
fn four_digits(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// The unit of time in which a recorder's step of this size is usual, 10 µs to 100 ms; `None` if that is seconds, or no
/// unit.
///
/// - `step`: median step in that unit
fn time_unit(step: f64) -> Option<&'static str> {
    let usual = 1e-5..=0.1;
    let units =
        [("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9), ("minutes", 60.0), ("hours", 3600.0)];
    let unit = units.into_iter().find(|(_, seconds)| usual.contains(&(step * seconds))).map(|(unit, _)| unit);
    unit.filter(|_| !usual.contains(&step))
}

fn others(more: usize) -> String {
    match more {
        0 => String::new(),
        n => format!(" (and {n} more)"),
    }
}

/// The candidate most like `name`, if it is alike enough to be a slip: case, spaces and underscores do not count, and
/// at most a third of the letters differ.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let plain = |text: &str| -> Vec<char> {
        text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).take(80).collect()
    };
    let wanted = plain(name);
    candidates
        .into_iter()
        .map(|candidate| (edit_distance(&wanted, &plain(candidate)), candidate))
        .filter(|(distance, candidate)| *distance * 3 <= plain(candidate).len().max(wanted.len()))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate.to_owned())
}

/// Optimal string alignment distance: insertions, deletions, substitutions, and swaps of neighbours count one each.
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut row = vec![i + 1];
        for (j, y) in b.iter().enumerate() {
            let mut best = (last[j] + usize::from(x != y)).min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && *x == b[j - 1] && a[i - 1] == *y {
                best = best.min(before[j - 1] + 1);
            }
            row.push(best);
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_nearest_name() {
        let names = ["emg", "columns", "max_isometric_force"];
        assert_eq!(nearest("egm", names).as_deref(), Some("emg"));
        assert_eq!(nearest("Max Isometric Force", names).as_deref(), Some("max_isometric_force"));
        assert_eq!(nearest("colums", names).as_deref(), Some("columns"));
        assert_eq!(nearest("trigger", names), None);
        assert_eq!(nearest("", names), None);
    }

    #[test]
    fn verif_a_value_outside_a_range_shows_what_tells_it_from_the_ends() {
        let of_degrees = |value: f64| outside_range(value.to_radians(), [-90.0, 180.0].map(f64::to_radians), false);
        assert_eq!(of_degrees(200.0), "200.00°, outside its range of -90.00° to 180.00°");
        assert_eq!(of_degrees(1e308), "1.000e308°, outside its range of -90.00° to 180.00°");
        assert_eq!(of_degrees(180.0004), "180.0004°, outside its range of -90.0000° to 180.0000°");
        assert_eq!(outside_range(0.12001, [0.0, 0.12], true), "0.12001 m, outside its range of 0.00000 m to 0.12000 m");
    }

    #[test]
    fn verif_edit_distance() {
        let distance = |a: &str, b: &str| edit_distance(&a.chars().collect::<Vec<_>>(), &b.chars().collect::<Vec<_>>());
        for (a, b, expected) in
            [("", "", 0), ("", "abc", 3), ("kitten", "sitting", 3), ("ab", "ba", 1), ("ca", "abc", 3)]
        {
            assert_eq!((distance(a, b), distance(b, a)), (expected, expected), "{a} {b}");
        }
    }
}
