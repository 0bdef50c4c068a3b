//! `carpus sensitivity`: which muscle parameters the trials of each condition respond to.

use crate::cli::account::csv_text;
use crate::cli::args::{Global, SensitivityArgs};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::print_result;
use crate::cli::provenance::provenance;
use crate::cli::study_run::{ParticipantRun, StudyRun, progress};
use crate::cli::table::{fixed, table};
use crate::report::results::InputFile;
use crate::sensitivity::{
    FirstOrderEstimator, MorrisConvergence, MorrisResult, MorrisSample, MuscleScreening, Parameter, ScreenedProperty,
    SensitivityError, SobolResult, SobolSample,
};
use crate::statistics::{Effect, Factor, RepeatedMeasures};
use crate::study::{Contraction, TrialUse};

/// Contractions whose trials have a moment that muscles make.
const CONTRACTIONS: [Contraction; 3] = [Contraction::Isometric, Contraction::Isotonic, Contraction::Freehand];

/// The analysis of one participant's trials of one condition.
#[derive(serde::Serialize)]
struct ConditionSensitivity {
    participant: String,
    contraction: Contraction,
    effort_percent: Option<f64>,
    trials: Vec<String>,
    morris: MorrisResult,
    convergence: Vec<MorrisConvergence>,
    sobol: Option<SobolResult>,
}

impl ConditionSensitivity {
    fn condition(&self) -> String {
        condition_name(self.contraction, self.effort_percent)
    }

    /// μ* of a property, averaged over muscles.
    fn mean_mu_star(&self, property: ScreenedProperty) -> f64 {
        let suffix = format!(".{}", property.name());
        let of_property = self.morris.indices.iter().filter(|i| i.name.ends_with(&suffix)).map(|i| i.mu_star);
        let (sum, count) = of_property.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        sum / count
    }
}

/// Analysis of variance of μ*, averaged over muscles, with contraction and effort within participants.
#[derive(serde::Serialize)]
struct PropertyAnova {
    property: ScreenedProperty,
    effects: Vec<Effect>,
}

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, a screening of which every run fails, or the output folder.
pub fn run(args: &SensitivityArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study)?;
    let bar = progress(global, study.participants.len() as u64, "screening");
    let mut outcomes: Vec<ConditionSensitivity> = Vec::new();
    let mut inputs: Vec<InputFile> = Vec::new();
    for participant in &study.participants {
        let run = study.participant(participant)?;
        failure::print(&run.warnings);
        outcomes.extend(screened(&run, args, global)?);
        inputs.extend(run.inputs.iter().filter(|file| !inputs.contains(file)).cloned().collect::<Vec<_>>());
        bar.inc(1);
    }
    bar.finish_and_clear();
    let anova = anova(&outcomes);
    let results = serde_json::json!({
        "schema": "carpus.sensitivity/1",
        "provenance": provenance(global, inputs),
        "starts": args.starts,
        "bounds_fraction_of_model": MuscleScreening::parameters(&["MUSCLE"]).map_err(refused)?,
        "conditions": outcomes,
        "anova": anova,
    });
    let json = serde_json::to_string_pretty(&results).map_err(|e| Failure::Internal(e.to_string()))?;
    study.out.write("sensitivity.json", json.as_bytes())?;
    study.out.write("morris.csv", morris_csv(&outcomes)?.as_bytes())?;
    study.out.write("convergence.csv", convergence_csv(&outcomes)?.as_bytes())?;
    if args.sobol.is_some() {
        study.out.write("sobol.csv", sobol_csv(&outcomes)?.as_bytes())?;
    }
    if !anova.is_empty() {
        study.out.write("anova.csv", anova_csv(&anova)?.as_bytes())?;
    }
    if global.json { print_result(&results.to_string()) } else { print_result(&readable(&outcomes, &anova)) }
}

fn refused(error: SensitivityError) -> Failure {
    Message::error(error.to_string()).into()
}

/// All conditions of a participant.
fn screened(
    run: &ParticipantRun,
    args: &SensitivityArgs,
    global: &Global,
) -> Result<Vec<ConditionSensitivity>, Failure> {
    let muscles: Vec<&str> = run.model.muscle_names().collect();
    let parameters = MuscleScreening::parameters(&muscles).map_err(refused)?;
    let nominal = run.model.nominal_parameters();
    let mut conditions: Vec<(Contraction, Option<f64>)> = Vec::new();
    let used = |i: usize| {
        let info = &run.trials[i].info;
        info.usage == TrialUse::Train && CONTRACTIONS.contains(&info.contraction)
    };
    for i in (0..run.trials.len()).filter(|i| used(*i)) {
        let condition = (run.trials[i].info.contraction, run.trials[i].info.effort_percent);
        if !conditions.contains(&condition) {
            conditions.push(condition);
        }
    }
    if conditions.is_empty() {
        let text = format!("participant {}: no trial with use = train to screen", run.participant.name);
        return Err(Message::error(text).hint("isometric, isotonic and freehand trials are screened").into());
    }
    conditions.sort_by(|a, b| (a.0.cmp(&b.0)).then(a.1.unwrap_or(0.0).total_cmp(&b.1.unwrap_or(0.0))));
    let of_condition = |(contraction, effort_percent): (Contraction, Option<f64>)| {
        let chosen: Vec<usize> = (0..run.trials.len())
            .filter(|&i| used(i))
            .filter(|&i| {
                (run.trials[i].info.contraction, run.trials[i].info.effort_percent) == (contraction, effort_percent)
            })
            .collect();
        let trials = chosen.iter().map(|&i| (&run.prepared[i], run.trials[i].moment.as_slice())).collect();
        let screening = MuscleScreening::new(trials, &nominal).map_err(refused)?;
        let (morris, sobol) = analyzed(&screening, &parameters, args, global.seed).map_err(|error| {
            let condition = condition_name(contraction, effort_percent);
            Failure::from(Message::error(format!("participant {}, {condition}: {error}", run.participant.name)))
        })?;
        Ok(ConditionSensitivity {
            participant: run.participant.name.clone(),
            contraction,
            effort_percent,
            trials: chosen.iter().map(|&i| run.trials[i].info.name()).collect(),
            convergence: morris.convergence(&partial_starts(args.starts as usize)),
            morris,
            sobol,
        })
    };
    conditions.into_iter().map(of_condition).collect()
}

fn analyzed(
    screening: &MuscleScreening,
    parameters: &[Parameter],
    args: &SensitivityArgs,
    seed: u64,
) -> Result<(MorrisResult, Option<SobolResult>), SensitivityError> {
    let response = |fractions: &[f64]| screening.response(fractions);
    let m = parameters.len();
    let sample = MorrisSample::radial(m, args.starts as usize, seed)?;
    let morris = sample.screen(parameters, response, args.resamples, seed)?;
    let sobol = args.sobol.map(|n| {
        let sample = SobolSample::latin_hypercube(m, n as usize, seed)?;
        sample.run(parameters, response, FirstOrderEstimator::Saltelli, args.resamples, seed)
    });
    Ok((morris, sobol.transpose()?))
}

/// Five steps up to all starts.
fn partial_starts(r: usize) -> Vec<usize> {
    let mut steps: Vec<usize> = (1..=5).map(|k| (k * r).div_ceil(5).max(2)).collect();
    steps.dedup();
    steps
}

/// The tests for participants with all conditions of a complete contraction × effort design; none for fewer than two.
fn anova(outcomes: &[ConditionSensitivity]) -> Vec<PropertyAnova> {
    let mut contractions: Vec<Contraction> = outcomes.iter().map(|o| o.contraction).collect();
    let mut efforts: Vec<f64> = outcomes.iter().filter_map(|o| o.effort_percent).collect();
    let mut participants: Vec<&str> = outcomes.iter().map(|o| o.participant.as_str()).collect();
    contractions.sort_unstable();
    contractions.dedup();
    efforts.sort_by(f64::total_cmp);
    efforts.dedup();
    participants.dedup();
    let value = |participant: &str, contraction: Contraction, effort: f64, property| {
        let matches = |o: &&ConditionSensitivity| {
            o.participant == participant && o.contraction == contraction && o.effort_percent == Some(effort)
        };
        outcomes.iter().find(matches).map(|o| o.mean_mu_star(property))
    };
    let factors = || {
        vec![
            Factor::new("contraction", contractions.iter().map(|c| c.word())),
            Factor::new("effort", efforts.iter().map(f64::to_string)),
        ]
    };
    let of_property = |property: ScreenedProperty| {
        let row = |participant: &&str| -> Option<Vec<f64>> {
            let cells = contractions.iter().flat_map(|c| efforts.iter().map(move |e| (*c, *e)));
            cells.map(|(contraction, effort)| value(participant, contraction, effort, property)).collect()
        };
        let rows: Vec<Vec<f64>> = participants.iter().filter_map(row).collect();
        // A study without the full design has no such table; that is no fault of its data.
        let design = RepeatedMeasures::new(factors(), &rows).ok()?;
        Some(PropertyAnova { property, effects: design.anova() })
    };
    ScreenedProperty::ALL.into_iter().filter_map(of_property).collect()
}

fn condition_name(contraction: Contraction, effort_percent: Option<f64>) -> String {
    match effort_percent {
        Some(effort) => format!("{} {effort} %", contraction.word()),
        None => contraction.word().to_string(),
    }
}

/// Participant, contraction, effort, muscle and property: the first cells of a row.
fn key(outcome: &ConditionSensitivity, parameter: &str) -> Vec<String> {
    let (muscle, property) = parameter.rsplit_once('.').unwrap_or((parameter, ""));
    let effort = outcome.effort_percent.map_or(String::new(), |e| e.to_string());
    vec![outcome.participant.clone(), outcome.contraction.word().to_string(), effort, muscle.into(), property.into()]
}

const KEY_COLUMNS: [&str; 5] = ["participant", "contraction", "effort_percent", "muscle", "property"];

fn bounds(interval: Option<[f64; 2]>) -> [String; 2] {
    interval.map_or([String::new(), String::new()], |ends| ends.map(|v| v.to_string()))
}

fn morris_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let columns =
        ["mu", "mu_star", "mu_star_lower_95", "mu_star_upper_95", "sigma", "sigma_lower_95", "sigma_upper_95"];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.morris.indices.iter().map(move |index| {
            let mut row = key(outcome, &index.name);
            row.extend([index.mu.to_string(), index.mu_star.to_string()]);
            row.extend(bounds(index.mu_star_interval_95));
            row.push(index.sigma.to_string());
            row.extend(bounds(index.sigma_interval_95));
            row.push(index.n_effects.to_string());
            row
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&columns).chain(&["n_effects"]), rows)
}

fn sobol_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let columns = [
        "first_order",
        "first_order_lower_95",
        "first_order_upper_95",
        "total_order",
        "total_order_lower_95",
        "total_order_upper_95",
        "n_rows",
    ];
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.sobol.iter().flat_map(|sobol| &sobol.indices).map(move |index| {
            let mut row = key(outcome, &index.name);
            row.push(index.first_order.to_string());
            row.extend(bounds(index.first_order_interval_95));
            row.push(index.total_order.to_string());
            row.extend(bounds(index.total_order_interval_95));
            row.push(index.n_rows.to_string());
            row
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&columns), rows)
}

fn convergence_csv(outcomes: &[ConditionSensitivity]) -> Result<String, Failure> {
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.convergence.iter().flat_map(move |step| {
            outcome.morris.indices.iter().zip(&step.mu_star).map(move |(index, mu_star)| {
                let mut row = key(outcome, &index.name);
                row.extend([step.r.to_string(), mu_star.to_string(), step.widest_interval.to_string()]);
                row
            })
        })
    });
    csv_text(KEY_COLUMNS.iter().chain(&["starts", "mu_star", "widest_interval_of_largest"]), rows)
}

fn anova_csv(anova: &[PropertyAnova]) -> Result<String, Failure> {
    let columns = [
        "property",
        "effect",
        "f",
        "df_effect",
        "df_error",
        "p",
        "greenhouse_geisser_epsilon",
        "p_greenhouse_geisser",
        "partial_eta_squared",
    ];
    let rows = anova.iter().flat_map(|table| {
        table.effects.iter().map(|e| {
            vec![
                table.property.name().to_string(),
                e.name(),
                e.f.to_string(),
                e.df_effect.to_string(),
                e.df_error.to_string(),
                e.p_value.to_string(),
                e.sphericity.greenhouse_geisser.to_string(),
                e.p_greenhouse_geisser.to_string(),
                e.partial_eta_squared.to_string(),
            ]
        })
    });
    csv_text(columns.iter(), rows)
}

/// For a terminal: per condition μ* averaged over muscles, what failed, and the tests.
fn readable(outcomes: &[ConditionSensitivity], anova: &[PropertyAnova]) -> String {
    let mut header = vec!["participant", "condition", "trials", "runs", "failed", "lost effects"];
    header.extend(ScreenedProperty::ALL.map(ScreenedProperty::name));
    let rows = outcomes.iter().map(|o| {
        let mut row = vec![o.participant.clone(), o.condition(), o.trials.len().to_string()];
        row.extend([o.morris.runs, o.morris.failures.len(), o.morris.lost_effects].map(|n| n.to_string()));
        row.extend(ScreenedProperty::ALL.map(|property| fixed(o.mean_mu_star(property), 3)));
        row
    });
    let mut text = format!("μ*, mean over muscles\n{}", table(&header, 2, rows));
    if !anova.is_empty() {
        let header = ["property", "effect", "F", "df", "p", "p (Greenhouse–Geisser)"];
        let rows = anova.iter().flat_map(|of_property| {
            of_property.effects.iter().map(|e| {
                vec![
                    of_property.property.name().to_string(),
                    e.name(),
                    fixed(e.f, 3),
                    format!("{}, {}", e.df_effect, e.df_error),
                    fixed(e.p_value, 4),
                    fixed(e.p_greenhouse_geisser, 4),
                ]
            })
        });
        text.push_str(&format!("\n\n{}", table(&header, 2, rows)));
    }
    text
}
