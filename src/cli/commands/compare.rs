//! `carpus compare`: simulated against measured moments, errors per trial and per condition.

use std::path::{Path, PathBuf};

use super::simulate::{account, summary, write_results, write_series};
use crate::cli::account::{errors_per_condition_csv, errors_per_trial_csv};
use crate::cli::args::{CompareArgs, Global};
use crate::cli::failure::{self, Failure};
use crate::cli::residuals::{residual_result, where_it_fails};
use crate::cli::study_run::{StudyRun, progress};
use crate::cli::table::{fixed, table};
use crate::report::results::{Errors, Kind, Results, Use};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &CompareArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "compare")?;
    let bar = progress(global, study.participants.len() as u64, "comparing");
    let outcomes = study.each(|participant| {
        let run = study.participant(participant)?;
        failure::print(&run.warnings);
        let simulations = run.simulate_model()?;
        let model = run.model_run("model", "Simulated", run.loaded.path.display().to_string(), &simulations);
        let residuals = residual_result(&run, "model", &model.moments);
        let mut results = account(Kind::Comparison, global, &study, &run, &[model])?;
        results.residuals = vec![residuals];
        let folder = PathBuf::from(&participant.name);
        write_series(&study, &folder, &run, &simulations)?;
        write_errors(&study, &folder, &[&results])?;
        write_results(&study, &folder, &results)?;
        bar.inc(1);
        Ok(results)
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    let done = &outcomes.done;
    if done.len() > 1 {
        write_errors(&study, Path::new(""), &done.iter().collect::<Vec<_>>())?;
    }
    if global.json {
        let text = serde_json::Value::Array(done.iter().map(summary).collect()).to_string();
        return outcomes.print(&study, "compare", &text);
    }
    let mut text = error_table(done);
    done.iter().for_each(|results| text.push_str(&where_it_fails(results)));
    text.push_str("\n\n");
    for results in done {
        let report = study.out.path().join(&results.participant.id).join("report.html");
        text.push_str(&format!("{}\n", report.display()));
    }
    outcomes.print(&study, "compare", &text)
}

/// Writes both error tables.
///
/// # Errors
/// The disk.
pub fn write_errors(study: &StudyRun, folder: &Path, results: &[&Results]) -> Result<(), Failure> {
    study.out.write(folder.join("errors_per_trial.csv"), errors_per_trial_csv(results)?.as_bytes())?;
    study.out.write(folder.join("errors_per_condition.csv"), errors_per_condition_csv(results)?.as_bytes())?;
    Ok(())
}

/// Errors of every participant, use and model, for a terminal.
pub fn error_table(outcomes: &[Results]) -> String {
    let header = ["participant", "trials", "model", "n", "NRMSE %", "max. error %", "XCorr", "sum", "RMSE N·m", "r"];
    let uses = [(Use::HeldOut, "held out"), (Use::Train, "training"), (Use::Mvc, "MVC")];
    let mut rows = Vec::new();
    for results in outcomes {
        for (trial_use, title) in uses {
            for model in &results.models {
                let Some(found) = model.errors.iter().find(|e| e.trial_use == trial_use) else { continue };
                let mut row = vec![results.participant.id.clone(), title.to_string(), model.label.clone()];
                row.push(found.trials.to_string());
                row.extend(cells(&found.errors));
                rows.push(row);
            }
        }
    }
    table(&header, 3, rows)
}

fn cells(e: &Errors) -> [String; 6] {
    let number = |v: Option<f64>, factor: f64, decimals| v.map_or("–".to_string(), |v| fixed(factor * v, decimals));
    [
        number(e.nrmse, 100.0, 2),
        number(e.max_error, 100.0, 1),
        number(e.xcorr, 1.0, 4),
        number(e.objective, 1.0, 4),
        number(e.rmse_n_m, 1.0, 3),
        number(e.pearson_r, 1.0, 4),
    ]
}
