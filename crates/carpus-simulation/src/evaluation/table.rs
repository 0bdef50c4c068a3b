//! Errors of many trials: per trial, per condition and overall, training and held-out trials always apart.

use serde::{Deserialize, Serialize};

use super::measures::{ErrorMeasures, EvaluationError, Measure, Undefined, error_measures, sum};
use carpus_study::study::{Contraction, Direction, TrialInfo, TrialUse};

/// Errors of one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialErrors {
    /// Name of the participant.
    pub participant: String,
    /// The trial's file as `trials.csv` writes it.
    pub file: String,
    /// What the trial is for.
    #[serde(rename = "use")]
    pub usage: TrialUse,
    /// Its condition.
    pub condition: Condition,
    /// Number of the repetition, as the lab counts.
    pub repetition: Option<u32>,
    /// The errors.
    pub errors: ErrorMeasures,
}

impl TrialErrors {
    /// Compares simulated with measured moment [N·m] of a trial.
    ///
    /// # Errors
    /// See [`error_measures`].
    pub fn calc(info: &TrialInfo, measured: &[f64], simulated: &[f64]) -> Result<Self, EvaluationError> {
        Ok(Self {
            participant: info.participant.clone(),
            file: info.file_as_written.clone(),
            usage: info.usage,
            condition: Condition::of(info),
            repetition: info.repetition,
            errors: error_measures(measured, simulated)?,
        })
    }
}

/// A condition: contraction × effort × direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// Kind of contraction.
    pub contraction: Contraction,
    /// Effort asked for [% of the maximum voluntary effort].
    pub effort_percent: Option<f64>,
    /// Direction of the effort.
    pub direction: Direction,
}

impl Condition {
    /// The condition of a trial.
    pub fn of(info: &TrialInfo) -> Self {
        Self { contraction: info.contraction, effort_percent: info.effort_percent, direction: info.direction }
    }

    /// A label for tables and figures, e.g. `isotonic 25 % flexion`.
    pub fn label(&self) -> String {
        let mut label = self.contraction.word().to_owned();
        if let Some(effort) = self.effort_percent {
            label += &format!(" {effort} %");
        }
        if self.direction != Direction::None {
            label += &format!(" {}", self.direction.word());
        }
        label
    }

    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let effort = |c: &Self| c.effort_percent.unwrap_or(-1.0);
        self.contraction
            .cmp(&other.contraction)
            .then(effort(self).total_cmp(&effort(other)))
            .then(self.direction.cmp(&other.direction))
    }
}

/// Mean and spread of one measure over trials; every trial counts the same, whatever its length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Arithmetic mean over the trials that have a value.
    pub mean: Measure,
    /// Standard deviation over those trials (n − 1).
    pub standard_deviation: Measure,
    /// Greatest value.
    pub max: Measure,
    /// Trials that have a value.
    pub trials: usize,
    /// Trials that have none.
    pub undefined_trials: usize,
}

impl Spread {
    /// Summarizes values in their order.
    pub fn over(values: impl IntoIterator<Item = Measure>) -> Self {
        let all: Vec<Measure> = values.into_iter().collect();
        let defined: Vec<f64> = all.iter().filter_map(|m| m.value()).collect();
        let n = defined.len();
        let mean = sum(defined.iter().copied()) / n as f64;
        let squares = sum(defined.iter().map(|v| (v - mean).powi(2)));
        let or = |reason, enough: bool, value: f64| match (enough, value.is_finite()) {
            (false, _) => Measure::Undefined(reason),
            (true, false) => Measure::Undefined(Undefined::OutOfFloatRange),
            (true, true) => Measure::Defined(value),
        };
        Self {
            mean: or(Undefined::NoTrial, n > 0, mean),
            standard_deviation: or(Undefined::TooFewTrials, n > 1, (squares / (n.max(2) - 1) as f64).sqrt()),
            max: or(Undefined::NoTrial, n > 0, defined.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            trials: n,
            undefined_trials: all.len() - n,
        }
    }
}

/// Each measure of [`ErrorMeasures`] over a group of trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorSummary {
    /// Number of trials.
    pub trials: usize,
    /// Equation 3.1 \[1\].
    pub nrmse: Spread,
    /// Equation 3.2 \[1\].
    pub max_error: Spread,
    /// Equation 3.3 \[1\].
    pub xcorr: Spread,
    /// Equation 3.4 \[1\].
    pub objective: Spread,
    /// Root mean square of the error [N·m].
    pub rmse_n_m: Spread,
    /// Root mean square of the error over max|τ_exp| \[1\].
    pub rmse_over_max_moment: Spread,
    /// Mean of τ_sim − τ_exp [N·m].
    pub mean_error_n_m: Spread,
    /// Pearson's r \[1\].
    pub pearson_r: Spread,
    /// Coefficient of determination \[1\].
    pub r_squared: Spread,
}

impl ErrorSummary {
    fn over(trials: &[&TrialErrors]) -> Self {
        let spread =
            |measure: fn(&ErrorMeasures) -> Measure| Spread::over(trials.iter().map(|trial| measure(&trial.errors)));
        Self {
            trials: trials.len(),
            nrmse: spread(|e| e.nrmse),
            max_error: spread(|e| e.max_error),
            xcorr: spread(|e| e.xcorr),
            objective: spread(|e| e.objective),
            rmse_n_m: spread(|e| e.rmse_n_m),
            rmse_over_max_moment: spread(|e| e.rmse_over_max_moment),
            mean_error_n_m: spread(|e| e.mean_error_n_m),
            pearson_r: spread(|e| e.pearson_r),
            r_squared: spread(|e| e.r_squared),
        }
    }
}

/// Errors over the trials of one condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConditionErrors {
    /// The condition.
    pub condition: Condition,
    /// Its errors.
    pub errors: ErrorSummary,
}

/// Errors over the trials of one use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetErrors {
    /// Over all trials of the set.
    pub overall: ErrorSummary,
    /// Per condition: contraction, then effort, then direction.
    pub conditions: Vec<ConditionErrors>,
}

/// Errors of a model on a study. Training and held-out trials are never mixed; maximum voluntary contractions are
/// neither.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorTable {
    /// Every trial, in the order given.
    pub trials: Vec<TrialErrors>,
    /// Trials of use `train`; absent if there are none.
    pub train: Option<SetErrors>,
    /// Trials of use `test`; absent if there are none.
    pub held_out: Option<SetErrors>,
    /// Trials of use `mvc`; absent if there are none.
    pub mvc: Option<SetErrors>,
}

impl ErrorTable {
    /// Groups the errors of trials. Trials of use `ignore` are listed and belong to no set.
    pub fn from_trials(trials: Vec<TrialErrors>) -> Self {
        Self {
            train: set(&trials, TrialUse::Train),
            held_out: set(&trials, TrialUse::Test),
            mvc: set(&trials, TrialUse::Mvc),
            trials,
        }
    }
}

fn set(trials: &[TrialErrors], usage: TrialUse) -> Option<SetErrors> {
    let members: Vec<&TrialErrors> = trials.iter().filter(|t| t.usage == usage).collect();
    if members.is_empty() {
        return None;
    }
    let mut conditions: Vec<Condition> = Vec::new();
    for trial in &members {
        if !conditions.contains(&trial.condition) {
            conditions.push(trial.condition);
        }
    }
    conditions.sort_by(Condition::order);
    let conditions = conditions
        .into_iter()
        .map(|condition| {
            let of_condition: Vec<&TrialErrors> =
                members.iter().copied().filter(|t| t.condition == condition).collect();
            ConditionErrors { condition, errors: ErrorSummary::over(&of_condition) }
        })
        .collect();
    Some(SetErrors { overall: ErrorSummary::over(&members), conditions })
}
