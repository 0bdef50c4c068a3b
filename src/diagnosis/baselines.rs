//! What simpler methods need in order to name a missing effect from the same data: ranking by an information criterion,
//! forward selection by leave-one-trial-out error, sparse regression. The methods themselves are in
//! `fixtures/scripts/diagnosis_baselines.py`; they are what a diagnosis is measured against.

use nalgebra::DMatrix;
use serde::Serialize;

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
    /// - `nuisance`, `precision`: number of leading columns and their prior precision
    /// - `groups`: columns of every effect
    /// - `trials`: columns of every trial, whitened and as they are
    pub fn new(
        nuisance: usize,
        precision: Vec<f64>,
        groups: Vec<Group>,
        trials: &[[DMatrix<f64>; 2]],
    ) -> Ingredients {
        let columns = trials.first().map_or(0, |t| t[0].ncols());
        let trials = trials
            .iter()
            .map(|[whitened, plain]| TrialProducts {
                samples: plain.nrows(),
                whitened: upper_triangle(whitened),
                plain: upper_triangle(plain),
            })
            .collect();
        Ingredients { columns, nuisance, precision, groups, trials }
    }
}

fn upper_triangle(columns: &DMatrix<f64>) -> Vec<f64> {
    let products = columns.tr_mul(columns);
    let n = products.nrows();
    // Seven digits are enough for a baseline.
    let short = |v: f64| format!("{v:.6e}").parse().unwrap_or(v);
    (0..n).flat_map(|i| (i..n).map(move |j| (i, j))).map(|(i, j)| short(products[(i, j)])).collect()
}
