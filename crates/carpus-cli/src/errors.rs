//! Errors of models, for a terminal.

use super::table::{fixed, table};
use carpus_report::results::{Errors, Results};
use carpus_session::errors::ErrorOverview;

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
