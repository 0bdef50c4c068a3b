//! What a model leaves of the training trials, put as short formulas of what was recorded ([`super::proposals`]).

use nalgebra::{Cholesky, DMatrix, Dyn};
use serde::Serialize;

use super::fit::{block_means, block_starts, whiten};
use super::proposals::{TrialTable, propose};
use carpus_effects::forward_model::ForwardModel;

/// A formula for what remains.
#[derive(Clone, Debug, Serialize)]
pub struct ProposedFormula {
    /// A moment [N·m] that the model lacks: `0.41*sin(14*q)`.
    pub formula: String,
    /// Share of the mean square of what remains that it takes in trials that were left out, the noise whitened.
    pub share_of_error: f64,
    /// The text of an effect's file (`carpus effects check --help`), to be given with `--own-effect`.
    pub definition: String,
}

/// Formulas for what remains, the most telling first; none where it is like noise.
///
/// - `moments`: of the training trials, simulated [N·m]: place among all trials, and samples
/// - `factors`: of the covariance of each one's noise, averaged over blocks
/// - `beside`: of each one, columns that are fitted beside the formulas, averaged over blocks and the noise whitened
/// - `seed`: of the draws that the formulas are tried on
pub(super) fn formulas(
    forward: &ForwardModel,
    moments: &[(usize, Vec<f64>)],
    factors: &[Cholesky<f64, Dyn>],
    beside: &[DMatrix<f64>],
    seed: u64,
) -> Vec<ProposedFormula> {
    if factors.len() != moments.len() || beside.len() != moments.len() {
        return Vec::new();
    }
    let activations: Vec<Vec<Vec<f64>>> = moments
        .iter()
        .map(|(g, _)| forward.base(*g).kinematics().muscles.iter().map(|m| m.activation.clone()).collect())
        .collect();
    let residuals: Vec<Vec<f64>> = moments
        .iter()
        .map(|(g, moment)| forward.trials[*g].moment.iter().zip(moment).map(|(y, m)| y - m).collect())
        .collect();
    let table = |i: usize| {
        let g = moments[i].0;
        let (record, kinematics) = (&forward.trials[g], forward.base(g).kinematics());
        TrialTable {
            residual: &residuals[i],
            time: &record.time,
            session: record.session,
            angle: &kinematics.angle,
            speed: &kinematics.speed,
            acceleration: &kinematics.acceleration,
            activation: &activations[i],
            beside: Some(&beside[i]),
        }
    };
    let tables: Vec<TrialTable> = (0..moments.len()).map(table).collect();
    let names: Vec<String> = forward.muscles.iter().map(|m| m.name.clone()).collect();
    let starts: Vec<Vec<usize>> = moments.iter().map(|(g, _)| block_starts(&forward.trials[*g].time)).collect();
    let whitened = |i: usize, series: &[f64]| {
        let means = block_means(series, &starts[i]);
        let column = DMatrix::from_column_slice(means.len(), 1, means.as_slice());
        whiten(&factors[i], &column).as_slice().to_vec()
    };
    let found = propose(&tables, &names, &whitened, seed);
    let number = |i: usize| format!("proposal_{}", i + 1);
    found
        .iter()
        .enumerate()
        .map(|(i, p)| ProposedFormula {
            formula: p.formula.clone(),
            share_of_error: p.share,
            definition: p.to_toml(&number(i)),
        })
        .collect()
}
