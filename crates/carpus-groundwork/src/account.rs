//! The account of a run: from trials and simulated moments to a results file.

use std::collections::BTreeMap;

use super::diagnostic::{Diagnostic, Failure, Severity};
use carpus_numerics::printable;
use carpus_osim::osim::spec::{ModelSpec, MotionType};
use carpus_report::results::{
    Condition, ConditionErrors, Errors, HeldCoordinate, Kind, ModelResult, ParticipantResult, Provenance, Results,
    SCHEMA, Series, StudyResult, TrialResult, Use, UseErrors, WarningResult, rounded, thinned,
};
use carpus_simulation::evaluation::{ErrorMeasures, ErrorSummary, ErrorTable, SetErrors, TrialErrors};
use carpus_study::study::{MomentPart, Participant, PostureCoordinate, Sex, Side, Study, Trial, TrialInfo, TrialUse};

/// Samples of a trial that a results file keeps for drawing.
const DRAWN_SAMPLES: usize = 400;
/// Significant digits of drawn series.
const DRAWN_DIGITS: i32 = 6;

/// A model and the moments it gave.
#[derive(Clone, Debug)]
pub struct ModelRun {
    /// Short key, e.g. `before`.
    pub id: String,
    /// How people call it.
    pub label: String,
    /// Name inside the file.
    pub name: String,
    /// The file.
    pub file: String,
    /// Simulated moment [N·m] of every trial, at the samples of the recording.
    pub moments: Vec<Vec<f64>>,
}

/// What a results file is made of, besides trials and models.
#[derive(Debug)]
pub struct Setting<'a> {
    /// What was run.
    pub kind: Kind,
    /// Program, command, seed, inputs.
    pub provenance: Provenance,
    /// The study.
    pub study: &'a Study,
    /// The participant.
    pub participant: &'a Participant,
    /// The participant's model.
    pub spec: &'a ModelSpec,
    /// What a person should know.
    pub warnings: &'a [Diagnostic],
}

/// Puts a results file together, without fitted parameters.
///
/// # Errors
/// A simulated moment that is not finite: a fault of this program.
pub fn results(setting: Setting, trials: &[Trial], runs: &[ModelRun]) -> Result<Results, Failure> {
    let tables: Vec<ErrorTable> = runs.iter().map(|run| error_table(trials, run)).collect::<Result<_, _>>()?;
    let compared = setting.kind != Kind::Simulation;
    let models = runs.iter().zip(&tables).map(|(run, table)| model_result(run, table, compared)).collect();
    let trial = |i: usize| {
        let errors = runs.iter().zip(&tables).map(|(run, table)| (run.id.clone(), measured(&table.trials[i].errors)));
        let errors: BTreeMap<_, _> = if compared { errors.collect() } else { BTreeMap::new() };
        trial_result(
            &trials[i],
            setting.spec,
            errors,
            runs.iter().map(|run| (run.id.clone(), run.moments[i].as_slice())),
        )
    };
    Ok(Results {
        schema: SCHEMA.to_string(),
        kind: setting.kind,
        provenance: setting.provenance,
        study: study_result(setting.study, setting.spec),
        participant: participant_result(setting.participant),
        models,
        trials: (0..trials.len()).map(trial).collect(),
        parameters: Vec::new(),
        part_of_the_way: None,
        stages: Vec::new(),
        residuals: Vec::new(),
        muscles: None,
        diagnosis: None,
        ledger: None,
        warnings: setting.warnings.iter().map(warning_result).collect(),
        live: None,
    })
}

fn error_table(trials: &[Trial], run: &ModelRun) -> Result<ErrorTable, Failure> {
    let errors = trials.iter().zip(&run.moments).map(|(trial, simulated)| {
        TrialErrors::calc(&trial.info, &trial.moment, simulated)
            .map_err(|e| Failure::Internal(format!("trial {} with model {}: {e}", trial.info.name, run.id)))
    });
    Ok(ErrorTable::from_trials(errors.collect::<Result<_, _>>()?))
}

fn model_result(run: &ModelRun, table: &ErrorTable, compared: bool) -> ModelResult {
    let sets = [(Use::Train, &table.train), (Use::HeldOut, &table.held_out), (Use::Mvc, &table.mvc)];
    let sets: Vec<(Use, &SetErrors)> =
        sets.into_iter().filter(|_| compared).filter_map(|(u, set)| set.as_ref().map(|set| (u, set))).collect();
    let conditions = sets.iter().flat_map(|(trial_use, set)| {
        set.conditions.iter().map(|c| ConditionErrors {
            condition: condition(
                c.condition.contraction.word(),
                c.condition.effort_percent,
                c.condition.direction.word(),
            ),
            trial_use: *trial_use,
            trials: c.errors.trials,
            errors: summarized(&c.errors),
        })
    });
    let errors = sets.iter().map(|(trial_use, set)| UseErrors {
        trial_use: *trial_use,
        trials: set.overall.trials,
        errors: summarized(&set.overall),
    });
    ModelResult {
        id: run.id.clone(),
        label: run.label.clone(),
        name: run.name.clone(),
        file: run.file.clone(),
        errors: errors.collect(),
        conditions: conditions.collect(),
    }
}

fn trial_result<'r>(
    trial: &Trial,
    spec: &ModelSpec,
    errors: BTreeMap<String, Errors>,
    simulated: impl Iterator<Item = (String, &'r [f64])>,
) -> TrialResult {
    let kept = thinned(trial.len(), DRAWN_SAMPLES);
    let pick = |values: &[f64]| kept.iter().map(|i| rounded(values[*i], DRAWN_DIGITS)).collect::<Vec<_>>();
    let degrees: Vec<f64> = trial.angle.iter().map(|a| a.to_degrees()).collect();
    let info = &trial.info;
    TrialResult {
        id: info.name.clone(),
        file: info.file_as_written.clone(),
        condition: condition(info.contraction.word(), info.effort_percent, info.direction.word()),
        posture_deg: info.posture.map(|p| rounded(p.to_degrees(), 12)),
        held: held(&info.held, spec),
        repetition: info.repetition,
        trial_use: usage(info),
        samples: trial.len(),
        moment_noise_n_m: scatter(&trial.own_moment()),
        errors,
        series: Series {
            time_s: kept.iter().map(|i| rounded(trial.time[*i], 9)).collect(),
            angle_deg: pick(&degrees),
            measured_n_m: pick(&trial.moment),
            simulated_n_m: simulated.map(|(id, moment)| (id, pick(moment))).collect(),
        },
    }
}

/// Standard deviation of the noise between neighbouring samples, robust against the signal itself: the median of the
/// absolute second differences over the value that white noise of standard deviation 1 has. `None` where they do not
/// tell: of a signal without noise, or one that was filtered, second differences over two steps are four times those
/// over one.
fn scatter(values: &[f64]) -> Option<f64> {
    /// Median of |N(0, 1)|.
    const MEDIAN_ABSOLUTE_NORMAL: f64 = 0.674_489_750_196_081_7;
    /// Ratio of second differences over two steps to those over one from which these are of the signal: it is 1 of
    /// white noise, 4 of a smooth signal.
    const SMOOTH: f64 = 3.0;
    /// Second differences of a signal as large as 1 that are rounding alone.
    const ROUNDING: f64 = 1e-12;
    let median = |step: usize| {
        let mut seconds: Vec<f64> =
            values.windows(2 * step + 1).map(|w| (w[0] - 2.0 * w[step] + w[2 * step]).abs()).collect();
        seconds.sort_by(f64::total_cmp);
        seconds.get(seconds.len() / 2).copied()
    };
    let found = median(1)?;
    let largest = values.iter().fold(0.0, |max: f64, v| max.max(v.abs()));
    if found <= ROUNDING * largest || median(2).is_some_and(|twice| twice > SMOOTH * found) {
        return None;
    }
    // The second difference of white noise has variance 1 + 4 + 1.
    Some(rounded(found / MEDIAN_ABSOLUTE_NORMAL / 6f64.sqrt(), 4))
}

fn condition(contraction: &str, effort_percent: Option<f64>, direction: &str) -> Condition {
    Condition { contraction: contraction.to_string(), effort_percent, direction: direction.to_string() }
}

fn usage(info: &TrialInfo) -> Use {
    match info.usage {
        TrialUse::Test => Use::HeldOut,
        TrialUse::Mvc => Use::Mvc,
        TrialUse::Train | TrialUse::Ignore => Use::Train,
    }
}

fn measured(e: &ErrorMeasures) -> Errors {
    Errors {
        nrmse: e.nrmse.value(),
        max_error: e.max_error.value(),
        xcorr: e.xcorr.value(),
        objective: e.objective.value(),
        rmse_n_m: e.rmse_n_m.value(),
        pearson_r: e.pearson_r.value(),
        r_squared: e.r_squared.value(),
    }
}

fn summarized(e: &ErrorSummary) -> Errors {
    Errors {
        nrmse: e.nrmse.mean.value(),
        max_error: e.max_error.mean.value(),
        xcorr: e.xcorr.mean.value(),
        objective: e.objective.mean.value(),
        rmse_n_m: e.rmse_n_m.mean.value(),
        pearson_r: e.pearson_r.mean.value(),
        r_squared: e.r_squared.mean.value(),
    }
}

fn held(held: &[PostureCoordinate], spec: &ModelSpec) -> Vec<HeldCoordinate> {
    let of = |p: &PostureCoordinate| {
        let coordinate = spec.coordinates.iter().find(|c| c.name == p.coordinate);
        let translation = coordinate.is_some_and(|c| c.motion_type == MotionType::Translational);
        HeldCoordinate {
            coordinate: p.coordinate.clone(),
            value: p.value_deg_or_m,
            unit: if translation { "m" } else { "deg" }.to_string(),
        }
    };
    held.iter().map(of).collect()
}

fn study_result(study: &Study, spec: &ModelSpec) -> StudyResult {
    let settings = &study.settings;
    let parts = [
        (MomentPart::Muscles, "muscles"),
        (MomentPart::Passive, "passive"),
        (MomentPart::Gravity, "gravity"),
        (MomentPart::Inertia, "inertia"),
    ];
    StudyResult {
        name: settings.name.clone(),
        coordinate: settings.dynamometer.coordinate.clone(),
        moment_includes: parts
            .into_iter()
            .filter(|(part, _)| settings.dynamometer.includes(*part))
            .map(|(_, word)| word.to_string())
            .collect(),
        active_muscles: settings.active_muscles.clone(),
        posture: held(&settings.posture, spec),
    }
}

fn participant_result(participant: &Participant) -> ParticipantResult {
    ParticipantResult {
        id: participant.name.clone(),
        mass_kg: participant.mass,
        height_m: participant.height,
        sex: participant.sex.map(|s| {
            match s {
                Sex::Female => "female",
                Sex::Male => "male",
                Sex::Other => "other",
            }
            .to_string()
        }),
        side: participant.side.map(|s| {
            match s {
                Side::Left => "left",
                Side::Right => "right",
            }
            .to_string()
        }),
    }
}

/// A warning as results have it.
pub fn warning_result(message: &Diagnostic) -> WarningResult {
    debug_assert_eq!(message.severity, Severity::Warning);
    WarningResult { at: message.place(), message: message.text.clone(), hint: message.hint.clone() }
}

/// Errors of every trial and model as CSV.
///
/// # Errors
/// None that input can cause.
pub fn errors_per_trial_csv(results: &[&Results]) -> Result<String, Failure> {
    let header = ["participant", "trial", "use", "contraction", "effort_percent", "direction", "repetition", "model"];
    let rows = results.iter().flat_map(|r| {
        r.trials.iter().flat_map(move |t| {
            r.models.iter().filter_map(move |m| {
                let errors = t.errors.get(&m.id)?;
                let mut row = vec![r.participant.id.clone(), t.id.clone(), use_word(t.trial_use).to_string()];
                row.extend(condition_cells(&t.condition));
                row.push(t.repetition.map(|n| n.to_string()).unwrap_or_default());
                row.push(m.id.clone());
                row.extend(error_cells(errors));
                Some(row)
            })
        })
    });
    csv_text(header.iter().chain(&ERROR_COLUMNS), rows)
}

/// Mean errors of every condition and model as CSV; the condition `all` sums up a use.
///
/// # Errors
/// None that input can cause.
pub fn errors_per_condition_csv(results: &[&Results]) -> Result<String, Failure> {
    let header = ["participant", "use", "contraction", "effort_percent", "direction", "trials", "model"];
    let mut rows = Vec::new();
    for r in results {
        for m in &r.models {
            let mut push = |trial_use: Use, cells: [String; 3], trials: usize, errors: &Errors| {
                let mut row = vec![r.participant.id.clone(), use_word(trial_use).to_string()];
                row.extend(cells);
                row.extend([trials.to_string(), m.id.clone()]);
                row.extend(error_cells(errors));
                rows.push(row);
            };
            m.conditions.iter().for_each(|c| push(c.trial_use, condition_cells(&c.condition), c.trials, &c.errors));
            let all = || ["all".to_string(), String::new(), String::new()];
            m.errors.iter().for_each(|e| push(e.trial_use, all(), e.trials, &e.errors));
        }
    }
    csv_text(header.iter().chain(&ERROR_COLUMNS), rows.into_iter())
}

const ERROR_COLUMNS: [&str; 7] =
    ["nrmse_percent", "max_error_percent", "xcorr", "objective", "rmse_n_m", "pearson_r", "r_squared"];

/// Measures in the order of [`ERROR_COLUMNS`], those that the console shows in percent in percent.
fn error_cells(e: &Errors) -> [String; 7] {
    let percent = |part: Option<f64>| part.map(|part| 100.0 * part);
    let all = [percent(e.nrmse), percent(e.max_error), e.xcorr, e.objective, e.rmse_n_m, e.pearson_r, e.r_squared];
    all.map(|v| v.map(|v| rounded(v, 9).to_string()).unwrap_or_default())
}

fn condition_cells(c: &Condition) -> [String; 3] {
    [c.contraction.clone(), c.effort_percent.map(|e| e.to_string()).unwrap_or_default(), c.direction.clone()]
}

/// The word for a use of trials, as `trials.csv` spells it.
fn use_word(trial_use: Use) -> &'static str {
    match trial_use {
        Use::Train => "train",
        Use::HeldOut => "test",
        Use::Mvc => "mvc",
    }
}

/// A number for a table: nine significant digits.
pub fn digits(value: f64) -> String {
    rounded(value, 9).to_string()
}

/// A number with fixed decimals; what rounds to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= 1e15 {
        return format!("{value:.decimals$e}");
    }
    let text = format!("{value:.decimals$}");
    let zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    if zero { text.trim_start_matches('-').to_string() } else { text }
}

/// A CSV table; cells as [`printable::cell`] makes them safe.
///
/// # Errors
/// None that input can cause.
pub fn csv_text<'h>(
    header: impl Iterator<Item = &'h &'h str>,
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<String, Failure> {
    let broken = |e: csv::Error| Failure::Internal(format!("CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let safe = |text: &str| printable::cell(text).into_owned();
    writer.write_record(header.map(|name| safe(name))).map_err(broken)?;
    for row in rows {
        writer.write_record(row.iter().map(|cell| safe(cell))).map_err(broken)?;
    }
    let bytes = writer.into_inner().map_err(|e| Failure::Internal(e.to_string()))?;
    String::from_utf8(bytes).map_err(|e| Failure::Internal(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::{fixed, scatter};

    #[test]
    fn verif_scatter_sees_noise_and_not_the_signal() {
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        // A sum of twelve uniforms has variance 1.
        let values: Vec<f64> = (0..5000)
            .map(|i| 10.0 * (f64::from(i) * 1e-3).sin() + 0.05 * (0..12).map(|_| uniform()).sum::<f64>())
            .collect();
        let found = scatter(&values).unwrap();
        assert!((found - 0.05).abs() < 0.004, "{found}");
        assert_eq!(scatter(&[1.0, 2.0]), None);
        // Filtered, or without noise: what is between samples is the signal.
        let smooth: Vec<f64> = (0..5000).map(|i| 10.0 * (f64::from(i) * 1e-3).sin()).collect();
        assert_eq!(scatter(&smooth), None);
        assert_eq!(scatter(&(0..5000).map(f64::from).collect::<Vec<_>>()), None, "a straight line");
    }

    #[test]
    fn verif_zero_has_no_sign() {
        assert_eq!(fixed(-1e300, 2), "-1.00e300");
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(-0.01, 2), "-0.01");
    }
}
