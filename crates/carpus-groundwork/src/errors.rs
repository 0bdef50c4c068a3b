//! Errors of every model of a participant, for each use of the trials.

use std::fmt;

use serde::Serialize;

use carpus_report::results::{Errors, Results, Use};

/// What the trials of each use are called.
const USES: [(Use, &str); 3] = [(Use::HeldOut, "held out"), (Use::Train, "training"), (Use::Mvc, "MVC")];

/// Mean errors of one model over the trials of one use.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelErrors {
    /// What the trials are for.
    pub trial_use: Use,
    /// What people call that.
    pub use_label: &'static str,
    /// What people call the model.
    pub model: String,
    /// Number of trials.
    pub trials: usize,
    /// Mean over the trials.
    pub errors: Errors,
}

/// Errors of every model, the trials that no fit saw first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorOverview {
    /// For each use, the models in the order of the results.
    pub rows: Vec<ModelErrors>,
}

impl ErrorOverview {
    /// The errors in a participant's results.
    pub fn of(results: &Results) -> ErrorOverview {
        let mut rows = Vec::new();
        for (trial_use, use_label) in USES {
            for model in &results.models {
                let Some(found) = model.errors.iter().find(|e| e.trial_use == trial_use) else { continue };
                let (model, trials, errors) = (model.label.clone(), found.trials, found.errors);
                rows.push(ModelErrors { trial_use, use_label, model, trials, errors });
            }
        }
        ErrorOverview { rows }
    }
}

impl fmt::Display for ErrorOverview {
    /// A line for each use and model: number of trials, NRMSE, RMSE and correlation.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.rows.iter().map(|row| row.model.chars().count()).max().unwrap_or(0);
        for (i, row) in self.rows.iter().enumerate() {
            let number = |v: Option<f64>, factor: f64, decimals: usize| {
                v.map_or("–".to_owned(), |v| format!("{:.decimals$}", factor * v))
            };
            let e = &row.errors;
            write!(
                f,
                "{}{:<8}  {:<width$}  {:>2} trials  NRMSE {} %  RMSE {} N·m  r {}",
                if i == 0 { "" } else { "\n" },
                row.use_label,
                row.model,
                row.trials,
                number(e.nrmse, 100.0, 2),
                number(e.rmse_n_m, 1.0, 3),
                number(e.pearson_r, 1.0, 4)
            )?;
        }
        Ok(())
    }
}
