//! Sobol' indices: shares of the response's variance.

use std::fmt::Display;

use super::bootstrap::interval_95;
use super::error::SensitivityError;
use super::hypercube::latin_hypercube;
use super::parameter::{Parameter, RunFailure, run_all};
use super::sequence::sobol_sequence;

/// Estimator of first-order indices. A and B are the responses at two independent samples, AB_i those at A with
/// parameter i taken from B.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FirstOrderEstimator {
    /// `S_i = mean(B (AB_i − A)) / V`: Saltelli et al. (2010); better for small indices.
    #[default]
    Saltelli,
    /// `S_i = 1 − mean((B − AB_i)²) / 2V`: Jansen (1999); better for large indices.
    Jansen,
}

/// Sobol' indices of one parameter.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SobolIndices {
    /// The parameter.
    pub name: String,
    /// S: share of the variance that would go if the parameter alone were known.
    pub first_order: f64,
    /// S_T: share that would stay if all others were known; first order and all interactions.
    pub total_order: f64,
    /// 95 % bootstrap interval of S.
    pub first_order_interval_95: Option<[f64; 2]>,
    /// 95 % bootstrap interval of S_T.
    pub total_order_interval_95: Option<[f64; 2]>,
    /// Rows of the sample whose runs the indices stand on.
    pub n_rows: usize,
}

/// The result of a variance-based analysis.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SobolResult {
    /// Indices of each parameter.
    pub indices: Vec<SobolIndices>,
    /// Mean of the response.
    pub mean: f64,
    /// Variance of the response.
    pub variance: f64,
    /// All runs, n (m + 2).
    pub runs: usize,
    /// Runs that failed. A row is left out for a parameter where A, B or its AB_i failed; no value is put in its place.
    pub failures: Vec<RunFailure>,
}

/// The points of Saltelli's design: two samples A and B of n rows and m hybrids.
#[derive(Clone, Debug, PartialEq)]
pub struct SobolSample {
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
}

impl SobolSample {
    /// A and B as the two halves of the columns of one Latin hypercube of 2 m dimensions.
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]: no parameter, or fewer than two rows.
    pub fn latin_hypercube(n_parameters: usize, n: usize, seed: u64) -> Result<Self, SensitivityError> {
        Self::from_rows(&latin_hypercube(n, 2 * n_parameters, seed), n_parameters)
    }

    /// A and B as the two halves of the columns of a Sobol' sequence of 2 m dimensions ([`sobol_sequence`]), beyond 500
    /// parameters of a Latin hypercube. Best with n a power of two.
    ///
    /// # Errors
    /// As [`Self::latin_hypercube`].
    pub fn sobol_sequence(n_parameters: usize, n: usize, seed: u64) -> Result<Self, SensitivityError> {
        match sobol_sequence(n, 2 * n_parameters, seed) {
            Some(rows) => Self::from_rows(&rows, n_parameters),
            None => Self::latin_hypercube(n_parameters, n, seed),
        }
    }

    /// From any sample of the unit cube of 2 m dimensions; the first m columns are A, the others B.
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]; [`SensitivityError::Length`]: a row of another dimension.
    pub fn from_rows(rows: &[Vec<f64>], n_parameters: usize) -> Result<Self, SensitivityError> {
        for (what, expected, found) in [("parameters", 1, n_parameters), ("rows", 2, rows.len())] {
            if found < expected {
                return Err(SensitivityError::TooFew { what, expected, found });
            }
        }
        if let Some(row) = rows.iter().find(|row| row.len() != 2 * n_parameters) {
            let (expected, found) = (2 * n_parameters, row.len());
            return Err(SensitivityError::Length { what: "values of a row", expected, found });
        }
        let (a, b) = rows.iter().map(|row| (row[..n_parameters].to_vec(), row[n_parameters..].to_vec())).unzip();
        Ok(Self { a, b })
    }

    /// Number of parameters, m.
    pub fn n_parameters(&self) -> usize {
        self.a[0].len()
    }

    /// All points in the unit cube, row after row: A, AB_1 … AB_m, B (SALib's order).
    pub fn points(&self) -> Vec<Vec<f64>> {
        let mut points = Vec::with_capacity(self.a.len() * (self.n_parameters() + 2));
        for (a, b) in self.a.iter().zip(&self.b) {
            points.push(a.clone());
            for i in 0..self.n_parameters() {
                let mut hybrid = a.clone();
                hybrid[i] = b[i];
                points.push(hybrid);
            }
            points.push(b.clone());
        }
        points
    }

    /// Runs the analysis.
    ///
    /// - `response`: of parameter values in the parameters' units; called on several threads
    /// - `resamples`: of the bootstrap; 0 for no intervals
    /// - `seed`: of the bootstrap
    ///
    /// # Errors
    /// [`SensitivityError::Length`], [`SensitivityError::NothingLeft`], [`SensitivityError::NoVariation`].
    pub fn run<E: Display>(
        &self,
        parameters: &[Parameter],
        response: impl Fn(&[f64]) -> Result<f64, E> + Sync,
        estimator: FirstOrderEstimator,
        resamples: usize,
        seed: u64,
    ) -> Result<SobolResult, SensitivityError> {
        if parameters.len() != self.n_parameters() {
            let (expected, found) = (self.n_parameters(), parameters.len());
            return Err(SensitivityError::Length { what: "parameters", expected, found });
        }
        self.analyze(parameters, &run_all(parameters, &self.points(), response), estimator, resamples, seed)
    }

    /// The indices from responses obtained elsewhere, one for each of [`Self::points`].
    ///
    /// ```text
    /// V = Var(A, B)      S_i: see the estimator      S_Ti = mean((A − AB_i)²) / 2V        (Jansen)
    /// ```
    /// Responses are first centred on their mean over all runs, which lowers the variance of Saltelli's estimator.
    ///
    /// # Errors
    /// As [`Self::run`].
    ///
    /// # References
    /// Saltelli et al. (2010), doi:10.1016/j.cpc.2009.09.018; Jansen (1999), doi:10.1016/S0010-4655(98)00154-4
    pub fn analyze(
        &self,
        parameters: &[Parameter],
        values: &[Result<f64, RunFailure>],
        estimator: FirstOrderEstimator,
        resamples: usize,
        seed: u64,
    ) -> Result<SobolResult, SensitivityError> {
        let (m, n) = (self.n_parameters(), self.a.len());
        for (what, expected, found) in [("parameters", m, parameters.len()), ("responses", n * (m + 2), values.len())] {
            if expected != found {
                return Err(SensitivityError::Length { what, expected, found });
            }
        }
        let failures: Vec<RunFailure> = values.iter().filter_map(|v| v.as_ref().err().cloned()).collect();
        let known: Vec<f64> = values.iter().flatten().copied().collect();
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        let at = |row: usize, column: usize| values[row * (m + 2) + column].as_ref().ok().map(|y| y - mean);
        let ends: Vec<(f64, f64)> = (0..n).filter_map(|row| Some((at(row, 0)?, at(row, m + 1)?))).collect();
        let nothing_left = || {
            let first = failures.first().map_or_else(String::new, |failure| failure.reason.clone());
            SensitivityError::NothingLeft { failed: failures.len(), runs: values.len(), first }
        };
        if ends.len() < 2 {
            return Err(nothing_left());
        }
        let variance = variance_of(ends.iter().copied());
        if !(variance > 0.0) {
            return Err(SensitivityError::NoVariation { value: mean });
        }
        let mut indices = Vec::with_capacity(m);
        for (i, parameter) in parameters.iter().enumerate() {
            let rows: Vec<[f64; 3]> =
                (0..n).filter_map(|row| Some([at(row, 0)?, at(row, m + 1)?, at(row, i + 1)?])).collect();
            if rows.len() < 2 {
                return Err(nothing_left());
            }
            let all: Vec<usize> = (0..rows.len()).collect();
            let interval = |stream, statistic: &dyn Fn(&[usize]) -> f64| {
                interval_95(rows.len(), resamples, seed, stream, statistic)
            };
            let first = |items: &[usize]| first_order(&rows, items, estimator);
            let total = |items: &[usize]| total_order(&rows, items);
            indices.push(SobolIndices {
                name: parameter.name.clone(),
                first_order: first(&all),
                total_order: total(&all),
                first_order_interval_95: interval(2 * i as u64, &first),
                total_order_interval_95: interval(2 * i as u64 + 1, &total),
                n_rows: rows.len(),
            });
        }
        Ok(SobolResult { indices, mean, variance, runs: values.len(), failures })
    }
}

/// Variance of A and B together, with 1/(2 n).
fn variance_of(ends: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let count = 2.0 * ends.clone().count() as f64;
    let mean = ends.clone().map(|(a, b)| a + b).sum::<f64>() / count;
    ends.map(|(a, b)| (a - mean).powi(2) + (b - mean).powi(2)).sum::<f64>() / count
}

/// - `rows`: A, B, AB_i
fn first_order(rows: &[[f64; 3]], items: &[usize], estimator: FirstOrderEstimator) -> f64 {
    let n = items.len() as f64;
    let chosen = || items.iter().map(|&i| rows[i]);
    let variance = variance_of(chosen().map(|[a, b, _]| (a, b)));
    match estimator {
        FirstOrderEstimator::Saltelli => chosen().map(|[a, b, ab]| b * (ab - a)).sum::<f64>() / n / variance,
        FirstOrderEstimator::Jansen => {
            1.0 - chosen().map(|[_, b, ab]| (b - ab).powi(2)).sum::<f64>() / (2.0 * n) / variance
        }
    }
}

fn total_order(rows: &[[f64; 3]], items: &[usize]) -> f64 {
    let chosen = || items.iter().map(|&i| rows[i]);
    let variance = variance_of(chosen().map(|[a, b, _]| (a, b)));
    chosen().map(|[a, _, ab]| (a - ab).powi(2)).sum::<f64>() / (2.0 * items.len() as f64) / variance
}
