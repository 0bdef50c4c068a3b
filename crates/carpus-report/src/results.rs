//! The results file: what a command found, in a form that a program can read (`results.json`).
//!
//! One schema serves simulation, comparison and personalization. A results file describes one participant, a list of
//! models (before and after personalization, or the one that was compared) and a list of trials in which every model
//! was simulated. Units are part of the key names. Nothing in it depends on the time or the machine of the run, so the
//! same inputs and seed give the same bytes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::diagnosis::DiagnosisResult;
use super::ledger::Ledger;
use super::muscle_use::MuscleUse;
use super::residuals::ResidualResult;

/// Name and version of the schema; the number rises when a reader of the older one would misread the file.
pub const SCHEMA: &str = "carpus.results/1";

/// Everything that a run found out about one participant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Results {
    /// [`SCHEMA`].
    pub schema: String,
    /// What was run.
    pub kind: Kind,
    /// Program, command, seed and inputs.
    pub provenance: Provenance,
    /// What the study says about all its trials.
    pub study: StudyResult,
    /// Whose trials these are.
    pub participant: ParticipantResult,
    /// The models that were simulated, in the order in which they are to be shown.
    pub models: Vec<ModelResult>,
    /// The trials, in the order of the study.
    pub trials: Vec<TrialResult>,
    /// Fitted parameters; empty unless something was fitted.
    #[serde(default)]
    pub parameters: Vec<ParameterResult>,
    /// How far the fitted model is from the model as given (0) to the joint mode (1), as training trials left out one
    /// at a time are predicted best.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_of_the_way: Option<f64>,
    /// How the fit went, stage by stage; empty unless something was fitted.
    #[serde(default)]
    pub stages: Vec<StageResult>,
    /// Residuals of models along axes; empty where nothing is compared.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub residuals: Vec<ResidualResult>,
    /// What muscles did in the trials.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub muscles: Option<MuscleUse>,
    /// Which effects could be missing, if that was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<DiagnosisResult>,
    /// Effects that were added, step by step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ledger: Option<Ledger>,
    /// What the reader must know before trusting the numbers.
    #[serde(default)]
    pub warnings: Vec<WarningResult>,
    /// Model and trials for the part of the report that computes ([`super::live::packed`]); `None`: the report is
    /// static.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live: Option<String>,
}

/// What was run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Simulated moments only.
    Simulation,
    /// Simulated against measured moments.
    Comparison,
    /// A fit, with the errors before and after.
    Personalization,
    /// Which physical effect the model could lack.
    Diagnosis,
    /// The model with effects added.
    Effects,
}

/// Program, command, seed and inputs: what is needed to run it again.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Program name.
    pub program: String,
    /// Program version.
    pub version: String,
    /// The command as it was typed.
    pub command: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Every file that was read.
    pub inputs: Vec<InputFile>,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputFile {
    /// Path as it was given or as the study names it.
    pub path: String,
    /// What it is: `model`, `study`, `participants`, `trials`, `trial`, …
    pub role: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// What holds for all trials of the study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyResult {
    /// Name of the study.
    pub name: String,
    /// Coordinate whose generalized force the dynamometer measures.
    pub coordinate: String,
    /// What the simulated moment sums: `muscles`, `passive`, `gravity`, `inertia`.
    pub moment_includes: Vec<String>,
    /// Muscles that act.
    pub active_muscles: Vec<String>,
    /// Coordinates held for every trial that has no value of its own.
    #[serde(default)]
    pub posture: Vec<HeldCoordinate>,
}

/// A coordinate held at a value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldCoordinate {
    /// Coordinate name.
    pub coordinate: String,
    /// Value, in `unit`.
    pub value: f64,
    /// `deg` or `m`.
    pub unit: String,
}

/// A participant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParticipantResult {
    /// Identifier.
    pub id: String,
    /// Body mass [kg].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Stature [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    /// Sex as the study gives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sex: Option<String>,
    /// Side measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<String>,
}

/// A model that was simulated, and its errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelResult {
    /// Short key under which trials name this model, e.g. `before`.
    pub id: String,
    /// How people call it, e.g. `Before`.
    pub label: String,
    /// Name inside the `.osim` file.
    pub name: String,
    /// The file.
    pub file: String,
    /// Errors over all trials of each use; empty for a simulation.
    #[serde(default)]
    pub errors: Vec<UseErrors>,
    /// Errors of each condition and use; empty for a simulation.
    #[serde(default)]
    pub conditions: Vec<ConditionErrors>,
}

/// What a trial is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Use {
    /// Seen by the fit.
    Train,
    /// Never seen by the fit.
    HeldOut,
    /// A maximum voluntary contraction: neither fitted nor held out.
    Mvc,
}

/// Errors over all trials of one use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UseErrors {
    /// Train or held out.
    #[serde(rename = "use")]
    pub trial_use: Use,
    /// Number of trials.
    pub trials: usize,
    /// Mean over trials.
    pub errors: Errors,
}

/// Errors of one condition and use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConditionErrors {
    /// Contraction × effort × direction.
    pub condition: Condition,
    /// Train or held out.
    #[serde(rename = "use")]
    pub trial_use: Use,
    /// Number of trials.
    pub trials: usize,
    /// Mean over trials.
    pub errors: Errors,
}

/// An experimental condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// `isometric`, `isotonic`, `passive`, `mvc`, `freehand`.
    pub contraction: String,
    /// Effort in percent of the maximal voluntary contraction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effort_percent: Option<f64>,
    /// `flexion`, `extension`, `none`.
    pub direction: String,
}

/// Distance between a measured and a simulated moment; a value is absent where it is not defined (for example a
/// correlation with a constant).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// Mean of |measured − simulated| / max |measured| (equation 3.1).
    pub nrmse: Option<f64>,
    /// max |measured − simulated| / max |measured| (equation 3.2).
    pub max_error: Option<f64>,
    /// One minus the normalized zero-lag cross-correlation (equation 3.3).
    pub xcorr: Option<f64>,
    /// Sum of the three (equation 3.4).
    pub objective: Option<f64>,
    /// Root mean squared error [N·m].
    pub rmse_n_m: Option<f64>,
    /// Pearson's correlation coefficient.
    pub pearson_r: Option<f64>,
    /// Coefficient of determination.
    pub r_squared: Option<f64>,
}

/// A trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialResult {
    /// Short name, unique in the study: the file name without extension.
    pub id: String,
    /// Path of the recording as the study names it.
    pub file: String,
    /// Contraction × effort × direction.
    pub condition: Condition,
    /// Posture of the trial about the dynamometer's coordinate [deg], for isometric trials.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_deg: Option<f64>,
    /// Other coordinates that are held at values of their own in this trial.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<HeldCoordinate>,
    /// Repetition number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repetition: Option<u32>,
    /// Train or held out.
    #[serde(rename = "use")]
    pub trial_use: Use,
    /// Samples recorded.
    pub samples: usize,
    /// Scatter of the measured moment from sample to sample (one standard deviation) [N·m]: no model can do better.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_noise_n_m: Option<f64>,
    /// Errors of each model, by model id; empty for a simulation.
    #[serde(default)]
    pub errors: BTreeMap<String, Errors>,
    /// What is drawn; thinned for long recordings (the series files hold every sample).
    pub series: Series,
}

/// Moments of a trial over time. All columns have the length of `time_s`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Series {
    /// Time [s].
    pub time_s: Vec<f64>,
    /// Angle of the dynamometer's coordinate [deg].
    pub angle_deg: Vec<f64>,
    /// Measured moment [N·m].
    pub measured_n_m: Vec<f64>,
    /// Simulated moment of each model, by model id [N·m].
    pub simulated_n_m: BTreeMap<String, Vec<f64>>,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterResult {
    /// Muscle.
    pub muscle: String,
    /// OpenSim's property name, e.g. `optimal_fiber_length`.
    pub property: String,
    /// `m`, `N`, `rad` or empty.
    pub unit: String,
    /// Value in the model before the fit.
    pub before: f64,
    /// Fitted value.
    pub after: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Standard deviation of the fitted value, in `unit`, if it was estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standard_deviation: Option<f64>,
    /// Share of the variance within the bounds that the data removed: 0, they say nothing about the value; 1, all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_from_data: Option<f64>,
    /// Interval given the training trials, with the bounds as prior, if it was computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<IntervalResult>,
}

/// An interval of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntervalResult {
    /// Its level, e.g. 0.9.
    pub level: f64,
    /// Lower end, in the parameter's unit.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
    /// Whether the trials set each end; `false`: the bounds do.
    pub end_from_data: [bool; 2],
}

impl IntervalResult {
    /// Whether the data determine the parameter: they set both ends.
    pub fn is_determined(&self) -> bool {
        self.end_from_data == [true, true]
    }
}

/// One stage of the fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageResult {
    /// What was fitted, e.g. `lengths, global search`.
    pub name: String,
    /// Parameter sets tried.
    pub evaluations: usize,
    /// Objective before the stage.
    pub objective_before: f64,
    /// Objective after the stage.
    pub objective_after: f64,
}

/// Something the reader must know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WarningResult {
    /// File and line that it is about, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// What is wrong.
    pub message: String,
    /// What to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

/// Why a results file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// Not JSON, or not of this shape.
    #[error("not a results file: {0}")]
    Json(#[from] serde_json::Error),
    /// Written under another schema.
    #[error("schema `{found}`, expected `{SCHEMA}`")]
    Schema {
        /// The schema that the file names.
        found: String,
    },
    /// A series' column has another length than its time column.
    #[error("trial `{trial}`: {column} has {found} samples, time_s has {expected}")]
    SeriesLength {
        /// Trial id.
        trial: String,
        /// Column.
        column: String,
        /// Length of the time column.
        expected: usize,
        /// Length of the column.
        found: usize,
    },
    /// A trial names a model that is not in the list.
    #[error("trial `{trial}` names model `{model}`, which is not in `models`")]
    UnknownModel {
        /// Trial id.
        trial: String,
        /// Model id.
        model: String,
    },
}

impl Results {
    /// Reads a results file and checks that it is consistent.
    ///
    /// # Errors
    /// Not JSON of this schema; columns of unequal length; a model id that is not in the list.
    pub fn parse(json: &str) -> Result<Results, ResultsError> {
        let results: Results = serde_json::from_str(json)?;
        if results.schema != SCHEMA {
            return Err(ResultsError::Schema { found: results.schema });
        }
        results.check()?;
        Ok(results)
    }

    /// The file's text: indented, series on one line each, a newline at the end.
    pub fn to_json(&self) -> String {
        let mut bytes = Vec::new();
        let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, ReadableJson::default());
        self.serialize(&mut serializer).expect("results serialize: string keys, no failing writer");
        bytes.push(b'\n');
        String::from_utf8(bytes).expect("JSON is UTF-8")
    }

    /// The model before anything was changed.
    pub fn first_model(&self) -> Option<&ModelResult> {
        self.models.first()
    }

    /// The model that the results are about: the personalized one, or the one compared.
    pub fn last_model(&self) -> Option<&ModelResult> {
        self.models.last()
    }

    fn check(&self) -> Result<(), ResultsError> {
        for trial in &self.trials {
            let expected = trial.series.time_s.len();
            let columns = [
                ("angle_deg".to_string(), trial.series.angle_deg.len()),
                ("measured_n_m".to_string(), trial.series.measured_n_m.len()),
            ];
            let simulated = trial.series.simulated_n_m.iter().map(|(id, column)| (id.clone(), column.len()));
            for (column, found) in columns.into_iter().chain(simulated) {
                if found != expected {
                    let trial = trial.id.clone();
                    return Err(ResultsError::SeriesLength { trial, column, expected, found });
                }
            }
            for model in trial.series.simulated_n_m.keys().chain(trial.errors.keys()) {
                if !self.models.iter().any(|m| m.id == *model) {
                    return Err(ResultsError::UnknownModel { trial: trial.id.clone(), model: model.clone() });
                }
            }
        }
        Ok(())
    }
}

impl ModelResult {
    /// Errors over all trials of one use.
    pub fn errors_of(&self, trial_use: Use) -> Option<&Errors> {
        self.errors.iter().find(|e| e.trial_use == trial_use).map(|e| &e.errors)
    }
}

impl ParameterResult {
    /// Position between the bounds: 0 at the lower, 1 at the upper.
    pub fn position(&self, value: f64) -> f64 {
        if self.upper > self.lower { (value - self.lower) / (self.upper - self.lower) } else { 0.5 }
    }

    /// Whether the fitted value lies on a bound (within 0.5 % of the width between them).
    pub fn at_bound(&self) -> bool {
        let position = self.position(self.after);
        position <= 0.005 || position >= 0.995
    }
}

/// Picks at most `limit` of `n` samples, evenly and with both ends.
pub fn thinned(n: usize, limit: usize) -> Vec<usize> {
    if n <= limit || limit < 2 {
        return (0..n).collect();
    }
    (0..limit).map(|i| i * (n - 1) / (limit - 1)).collect()
}

/// Rounds to `digits` significant digits, so that a results file stays small and readable.
pub fn rounded(value: f64, digits: i32) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    format!("{:.*e}", (digits - 1).max(0) as usize, value).parse().unwrap_or(value)
}

/// Indented JSON whose arrays of numbers stay on one line.
#[derive(Default)]
struct ReadableJson {
    /// For every open array or object: whether it is an array, and whether anything in it started a new line.
    open: Vec<(bool, bool)>,
}

impl ReadableJson {
    fn new_line<W: ?Sized + std::io::Write>(&self, writer: &mut W) -> std::io::Result<()> {
        writer.write_all(b"\n")?;
        (0..self.open.len()).try_for_each(|_| writer.write_all(b"  "))
    }

    fn close<W: ?Sized + std::io::Write>(&mut self, writer: &mut W, bracket: &[u8]) -> std::io::Result<()> {
        if self.open.pop().is_some_and(|(_, broken)| broken) {
            self.new_line(writer)?;
        }
        writer.write_all(bracket)
    }
}

impl serde_json::ser::Formatter for ReadableJson {
    fn begin_array<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
        self.open.push((true, false));
        writer.write_all(b"[")
    }

    fn end_array<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
        self.close(writer, b"]")
    }

    fn begin_object<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
        if let Some((true, broken)) = self.open.last_mut() {
            *broken = true;
            self.new_line(writer)?;
        }
        self.open.push((false, false));
        writer.write_all(b"{")
    }

    fn end_object<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
        self.close(writer, b"}")
    }

    fn begin_object_key<W: ?Sized + std::io::Write>(&mut self, writer: &mut W, first: bool) -> std::io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        if let Some((_, broken)) = self.open.last_mut() {
            *broken = true;
        }
        self.new_line(writer)
    }

    fn begin_object_value<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
        writer.write_all(b": ")
    }
}
