//! Which trial next: how much further trials would narrow what is known, before they are recorded.
//!
//! ```text
//! C' = (C⁻¹ + XᵀV⁻¹X)⁻¹
//! ```
//! C: covariance of parameters after the data so far; X, V: what the fitted model and noise expect of the new trial.

use super::likelihood::Fit;
use super::problem::Problem;
use super::recorded::RecordedTrial;
use carpus_simulation::simulation::SimulationError;

/// A trial that might be recorded.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// What it is, in words.
    pub name: String,
    /// Motion and excitations as they are expected; measured moments do not matter.
    pub trial: RecordedTrial,
}

/// What a candidate would bring.
#[derive(Clone, Debug, PartialEq)]
pub struct RankedTrial {
    /// What it is.
    pub name: String,
    /// Mean over parameters of the fraction by which the standard deviation of the logarithm falls.
    pub mean_shrinkage: f64,
    /// The same, per parameter.
    pub shrinkage: Vec<f64>,
}

/// Candidates by how much they narrow what is known, the best first.
pub(super) fn rank(
    problem: &Problem,
    fit: &Fit,
    candidates: &[Candidate],
) -> Result<Vec<RankedTrial>, SimulationError> {
    let n = problem.layout.len();
    let mut now = &fit.information / fit.dispersion;
    for (i, p) in problem.layout.free.iter().enumerate() {
        now[(i, i)] += p.prior.log_sd.powi(-2);
    }
    let trials: Vec<RecordedTrial> = candidates.iter().map(|c| c.trial.clone()).collect();
    let gains = problem.expected_information(trials, fit)?;
    let deviations = |information: &nalgebra::DMatrix<f64>| -> Option<Vec<f64>> {
        let covariance = information.clone().cholesky()?.inverse();
        Some((0..n).map(|i| covariance[(i, i)].sqrt()).collect())
    };
    let Some(before) = deviations(&now) else { return Ok(Vec::new()) };
    let mut ranked: Vec<RankedTrial> = candidates
        .iter()
        .zip(&gains)
        .filter_map(|(candidate, gain)| {
            let after = deviations(&(&now + gain / fit.dispersion))?;
            let shrinkage: Vec<f64> = before.iter().zip(&after).map(|(b, a)| 1.0 - a / b).collect();
            let mean_shrinkage = shrinkage.iter().sum::<f64>() / n as f64;
            Some(RankedTrial { name: candidate.name.clone(), mean_shrinkage, shrinkage })
        })
        .collect();
    ranked.sort_by(|a, b| b.mean_shrinkage.total_cmp(&a.mean_shrinkage));
    Ok(ranked)
}
