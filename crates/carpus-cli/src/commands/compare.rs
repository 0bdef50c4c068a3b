//! `carpus compare`: simulated against measured moments, errors per trial and per condition.

use std::path::Path;

use crate::args::{CompareArgs, Global};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::next_steps;
use crate::residuals::where_it_fails;
use crate::study_run::StudyRun;
use crate::table::{fixed, table};
use carpus_report::results::{Errors, Results};
use carpus_session::compare::Compare;
use carpus_session::errors::ErrorOverview;
use carpus_session::result_files::{summary, write_errors};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &CompareArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "compare")?;
    let bars = Bars::new(global);
    let outcomes = study.each("comparing", &bars, |participant| {
        let session = participant.load()?;
        failure::print(&session.data.warnings);
        let comparison = session.compare(&Compare { seed: global.seed })?;
        comparison.write_to(&study.out, Path::new(&participant.about().name))?;
        Ok(comparison.results)
    })?;
    let done = &outcomes.done;
    if done.len() > 1 {
        write_errors(&study.out, Path::new(""), &done.iter().collect::<Vec<_>>())?;
    }
    if global.json {
        let text = serde_json::Value::Array(done.iter().map(summary).collect()).to_string();
        return study.print("compare", &text, outcomes.failed);
    }
    let mut text = error_table(done);
    done.iter().for_each(|results| text.push_str(&where_it_fails(results)));
    text.push_str("\n\n");
    for results in done {
        let report = study.out.path().join(&results.participant.id).join("report.html");
        text.push_str(&format!("{}\n", report.display()));
    }
    let text = text.trim_end().to_owned() + &next_steps::in_words(done, study.out.path());
    study.print("compare", &text, outcomes.failed)
}

/// Errors of every participant, use and model, for a terminal.
pub fn error_table(outcomes: &[Results]) -> String {
    let header = ["participant", "trials", "model", "n", "NRMSE %", "max. error %", "XCorr", "sum", "RMSE N·m", "r"];
    let mut rows = Vec::new();
    for results in outcomes {
        for found in ErrorOverview::of(results).rows {
            let mut row = vec![results.participant.id.clone(), found.use_label.to_string(), found.model];
            row.push(found.trials.to_string());
            row.extend(cells(&found.errors));
            rows.push(row);
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
