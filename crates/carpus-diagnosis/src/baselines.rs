//! What simpler methods need in order to name a missing effect from the same data: ranking by an information criterion,
//! forward selection by leave-one-trial-out error, sparse regression. The methods themselves are in
//! `fixtures/scripts/diagnosis_baselines.py`; they are what a diagnosis is measured against.

use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::Serialize;

use super::fit::{Analysis, Fit, whiten};

/// Directions that belong together.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Effect.
    pub name: String,
    /// Its columns.
    pub columns: Vec<usize>,
}

/// One training trial: products XᵀX of its columns [nuisance | residual | directions], the upper triangle row by row.
#[derive(Clone, Debug, Serialize)]
pub struct TrialProducts {
    /// Samples, averaged over blocks, that the products sum over.
    pub samples: usize,
    /// Whitened by the noise that the refitted model without effects left.
    pub whitened: Vec<f64>,
    /// As they are [(N·m)²].
    pub plain: Vec<f64>,
}

/// All that regression on one-step signatures needs, around the refitted model without effects.
#[derive(Clone, Debug, Serialize)]
pub struct Ingredients {
    /// Number of columns.
    pub columns: usize,
    /// Columns of nuisance: muscle parameters and baselines of EMG channels. The residual is the column after them.
    pub nuisance: usize,
    /// Prior precision of the nuisance.
    pub precision: Vec<f64>,
    /// Directions of every effect, in units of its parameters' scales.
    pub groups: Vec<Group>,
    /// Every training trial.
    pub trials: Vec<TrialProducts>,
}

impl Ingredients {
    /// Those of an analysis, around its fit without effects.
    pub fn of(analysis: &Analysis, null: &Fit) -> Ingredients {
        let p = null.precision.len();
        let groups: Vec<Group> = analysis
            .blocks
            .iter()
            .filter(|b| !b.name.starts_with("axis:"))
            .map(|b| Group { name: b.name.clone(), columns: b.columns.iter().map(|c| c + p + 1).collect() })
            .collect();
        let columns = groups.iter().flat_map(|g| &g.columns).max().map_or(p + 1, |last| last + 1);
        let trials = null
            .whitened
            .par_iter()
            .zip(&*null.directions)
            .zip(&null.factors)
            .map(|((fitted, directions), factor)| {
                let joined = |fitted: DMatrix<f64>, directions: &DMatrix<f64>| {
                    let mut all = fitted.resize_horizontally(columns, 0.0);
                    let width = columns - p - 1;
                    all.columns_mut(p + 1, width).copy_from(&directions.columns(0, width));
                    all
                };
                TrialProducts {
                    samples: fitted.nrows(),
                    whitened: upper_triangle(&joined(fitted.clone(), &whiten(factor, directions))),
                    plain: upper_triangle(&joined(factor.l() * fitted, directions)),
                }
            })
            .collect();
        Ingredients { columns, nuisance: p, precision: null.precision.clone(), groups, trials }
    }
}

fn upper_triangle(columns: &DMatrix<f64>) -> Vec<f64> {
    let products = columns.tr_mul(columns);
    let n = products.nrows();
    // Seven digits are enough for a baseline.
    let short = |v: f64| format!("{v:.6e}").parse().unwrap_or(v);
    (0..n).flat_map(|i| (i..n).map(move |j| (i, j))).map(|(i, j)| short(products[(i, j)])).collect()
}
