//! What can be wrong with a study.

use std::path::PathBuf;

use super::fault_words::{
    farthest, four_digits, how_resampled, known_list, list_or_none, other_quantity, others, quoted,
};
use super::limits::{LONGEST_STEP, LONGEST_TRIAL, SHORTEST_STEP};
use super::recording_file::error::RecordingFileError;
use crate::dynamometer::AlignmentError;
use carpus_numerics::plausible::{Doubt, Measured, NamedUnit};
use carpus_numerics::printable::number_of;
use carpus_numerics::signals::{Finding, Resampled, SignalError};

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
    /// A recording that is no text cannot be read, or its table cannot be told.
    #[error(transparent)]
    Recording(#[from] RecordingFileError),
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
    #[error("step of {step_s:.6} s before this row, {mean_step_s:.6} s on average: raw EMG needs equal \
             steps{}", others(*more))]
    UnequalSteps {
        /// The step \[s\].
        step_s: f64,
        /// Mean step of the trial \[s\].
        mean_step_s: f64,
        /// How many further such steps there are.
        more: usize,
    },
    /// EMG of a recorder of its own whose file is not named.
    #[error("no file of the EMG is named for this trial")]
    MissingEmgFile,
    /// A column with other times than the first.
    #[error("column `{column}` has other times than column `{first}`")]
    OtherTimes {
        /// The column.
        column: String,
        /// The first that is read.
        first: String,
    },
    /// EMG of another recorder that cannot be brought to the dynamometer's clock.
    #[error("cannot be brought to the clock of {with}: {error}")]
    EmgClock {
        /// The dynamometer's file.
        with: String,
        /// Why not.
        error: AlignmentError,
    },
    /// EMG of another recorder whose delay is uncertain.
    #[error(
        "the delay of {shift_s:.4} s between the recorders is uncertain: what both recorded correlates by \
         {correlation:.3} there and by {runner_up:.3} at another delay"
    )]
    EmgClockDoubtful {
        /// What was added to its clock \[s\].
        shift_s: f64,
        /// Correlation of the quantity that both recorded.
        correlation: f64,
        /// The highest correlation at any other peak.
        runner_up: f64,
    },
    /// Recordings that have hardly a time in common.
    #[error("{common_s:.2} s of the dynamometer's {trial_s:.2} s are in the EMG's file, too")]
    LittleInCommon {
        /// Time in common \[s\].
        common_s: f64,
        /// Duration of the dynamometer's recording \[s\].
        trial_s: f64,
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
    #[error("gap of {gap_s:.4} s before this row; expected at most {allowed_s:.4} s (median step {median_step_s:.4} \
             s){}", others(*more))]
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
        "the effort changes the moment by {effort_n_m:+.3} N·m in a trial of direction `{direction}`; expected the \
         opposite sign"
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
        "{without} of {trials} trials of participant `{participant}` have no `start_time_s`: all are taken by their \
         order"
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
        "the arm is `flipped`, but [dynamometer] include has \"gravity\": the weight of the model's own bodies is not \
         turned"
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
    #[error("column `{column}`: its name states {}{}; its numbers are taken as \
             {taken_as}", .unit.symbol, other_quantity(.unit, *.holds))]
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
        fit_gain.map(|gain| format!(", and exchanged they fit the moment {gain:.1} times as \
                                     well")).unwrap_or_default())]
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
