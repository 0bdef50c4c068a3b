//! Morris' screening by elementary effects.

use std::fmt::Display;

use super::bootstrap::interval_95;
use super::error::SensitivityError;
use super::morris_sample::MorrisSample;
use super::parameter::{Parameter, RunFailure, run_all};

/// How often a step that ends in a failed run is halved before its effect is given up.
const HALVINGS: i32 = 3;

/// Sensitivity of the response to one parameter.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MorrisIndices {
    /// The parameter.
    pub name: String,
    /// μ: mean elementary effect.
    pub mu: f64,
    /// μ*: mean absolute elementary effect, the parameter's influence.
    pub mu_star: f64,
    /// σ: standard deviation of the elementary effects; interaction with others, or curvature.
    pub sigma: f64,
    /// 95 % bootstrap interval of μ*; `None` with fewer than two effects.
    pub mu_star_interval_95: Option<[f64; 2]>,
    /// 95 % bootstrap interval of σ.
    pub sigma_interval_95: Option<[f64; 2]>,
    /// Elementary effects the indices stand on: r less those lost to failed runs.
    pub n_effects: usize,
}

/// The result of a screening.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MorrisResult {
    /// Indices of each parameter.
    pub indices: Vec<MorrisIndices>,
    /// Elementary effects, parameter by parameter, one a start; `None` where failed runs left nothing to compare.
    pub effects: Vec<Vec<Option<f64>>>,
    /// Runs of the design, K = r (m + 1).
    pub runs: usize,
    /// Runs added with halved steps.
    pub extra_runs: usize,
    /// Effects that a halved step recovered.
    pub recovered_effects: usize,
    /// Effects given up.
    pub lost_effects: usize,
    /// Runs of the design that failed.
    pub failures: Vec<RunFailure>,
    seed: u64,
    resamples: usize,
}

/// μ* of all parameters from the first starts only.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MorrisConvergence {
    /// Starts used.
    pub r: usize,
    /// μ* of each parameter.
    pub mu_star: Vec<f64>,
    /// Widest 95 % interval of μ* among the parameters, as a fraction of the largest μ*: below 0.05 to 0.1 the indices
    /// have converged (Sarrazin et al. 2016, doi:10.1016/j.envsoft.2016.02.005).
    pub widest_interval: f64,
}

impl MorrisSample {
    /// Runs the screening.
    ///
    /// ```text
    /// EE_i = (Y(x + Δ e_i) − Y(x)) / Δ                          (2.5), x in the unit cube: Δ a fraction of the range
    /// μ_i = Σ EE_i / r     μ*_i = Σ |EE_i| / r                  (2.7, 2.8)
    /// σ_i = √(Σ (EE_i − μ_i)² / (r − 1))                        (2.9, whose root makes it a standard deviation)
    /// ```
    /// A run may fail. If one end of a step failed, the response is tried with half the step from the other end, then
    /// with a quarter and an eighth; the effect is that of the first that succeeds. Else the effect is left out. Both
    /// are counted, and the failures listed.
    ///
    /// - `response`: of parameter values in the parameters' units; called on several threads
    /// - `resamples`: of the bootstrap, 1000 are usual; 0 for no intervals
    /// - `seed`: of the bootstrap
    ///
    /// # Errors
    /// [`SensitivityError::Length`]: not one parameter per dimension; [`SensitivityError::NothingLeft`].
    ///
    /// # References
    /// Morris (1991), doi:10.1080/00401706.1991.10484804; Campolongo et al. (2007), doi:10.1016/j.envsoft.2006.10.004
    pub fn screen<E: Display>(
        &self,
        parameters: &[Parameter],
        response: impl Fn(&[f64]) -> Result<f64, E> + Sync,
        resamples: usize,
        seed: u64,
    ) -> Result<MorrisResult, SensitivityError> {
        if parameters.len() != self.n_parameters() {
            let (expected, found) = (self.n_parameters(), parameters.len());
            return Err(SensitivityError::Length { what: "parameters", expected, found });
        }
        let values = run_all(parameters, &self.points(), &response);
        let (halved, extra_runs) = self.halved_effects(parameters, &values, &response);
        self.result(parameters, &values, &halved, extra_runs, resamples, seed)
    }

    /// The indices from responses obtained elsewhere, one for each of [`Self::points`].
    ///
    /// # Errors
    /// As [`Self::screen`]; failed runs only lose effects, since no steps can be halved here.
    pub fn analyze(
        &self,
        parameters: &[Parameter],
        values: &[Result<f64, RunFailure>],
        resamples: usize,
        seed: u64,
    ) -> Result<MorrisResult, SensitivityError> {
        for (what, expected, found) in [
            ("parameters", self.n_parameters(), parameters.len()),
            ("responses", self.starts().len() * (self.n_parameters() + 1), values.len()),
        ] {
            if expected != found {
                return Err(SensitivityError::Length { what, expected, found });
            }
        }
        self.result(parameters, values, &[], 0, resamples, seed)
    }

    /// Effects of moves of which one end failed, by shorter steps from the other: (start, parameter, effect).
    fn halved_effects<E: Display>(
        &self,
        parameters: &[Parameter],
        values: &[Result<f64, RunFailure>],
        response: &(impl Fn(&[f64]) -> Result<f64, E> + Sync),
    ) -> (Vec<(usize, usize, f64)>, usize) {
        let length = self.n_parameters() + 1;
        let mut open: Vec<(usize, usize, &Vec<f64>, f64, f64)> = Vec::new();
        for (s, start) in self.starts().iter().enumerate() {
            for step in &start.moves {
                let ends = [step.from, step.to].map(|i| (&start.points[i], &values[s * length + i]));
                let (good, bad) = match ends {
                    [(from, Ok(y)), (to, Err(_))] => ((from, *y), to),
                    [(from, Err(_)), (to, Ok(y))] => ((to, *y), from),
                    _ => continue,
                };
                open.push((s, step.parameter, good.0, bad[step.parameter] - good.0[step.parameter], good.1));
            }
        }
        let (mut found, mut extra_runs) = (Vec::new(), 0);
        for halving in 1..=HALVINGS {
            let shorter = |full: f64| full * 0.5f64.powi(halving);
            let points: Vec<Vec<f64>> = open
                .iter()
                .map(|&(_, parameter, base, full, _)| {
                    let mut point = base.clone();
                    point[parameter] += shorter(full);
                    point
                })
                .collect();
            extra_runs += points.len();
            let tried = run_all(parameters, &points, response);
            let mut still_open = Vec::new();
            for (case, result) in open.into_iter().zip(tried) {
                match result {
                    Ok(y) => found.push((case.0, case.1, (y - case.4) / shorter(case.3))),
                    Err(_) => still_open.push(case),
                }
            }
            open = still_open;
        }
        (found, extra_runs)
    }

    fn result(
        &self,
        parameters: &[Parameter],
        values: &[Result<f64, RunFailure>],
        halved: &[(usize, usize, f64)],
        extra_runs: usize,
        resamples: usize,
        seed: u64,
    ) -> Result<MorrisResult, SensitivityError> {
        let length = self.n_parameters() + 1;
        let mut effects = vec![vec![None; self.starts().len()]; self.n_parameters()];
        for (s, start) in self.starts().iter().enumerate() {
            let y = &values[s * length..(s + 1) * length];
            for step in &start.moves {
                let i = step.parameter;
                if let (Ok(before), Ok(after)) = (&y[step.from], &y[step.to]) {
                    effects[i][s] = Some((after - before) / (start.points[step.to][i] - start.points[step.from][i]));
                }
            }
        }
        halved.iter().for_each(|&(s, i, effect)| effects[i][s] = Some(effect));
        let failures: Vec<RunFailure> = values.iter().filter_map(|v| v.as_ref().err().cloned()).collect();
        let lost_effects = effects.iter().flatten().filter(|e| e.is_none()).count();
        if effects.iter().any(|of_one| of_one.iter().flatten().count() == 0) {
            let first = failures.first().map_or_else(String::new, |failure| failure.reason.clone());
            return Err(SensitivityError::NothingLeft { failed: failures.len(), runs: values.len(), first });
        }
        let indices = parameters.iter().zip(&effects).enumerate().map(|(i, (parameter, of_one))| {
            let known: Vec<f64> = of_one.iter().flatten().copied().collect();
            let all: Vec<usize> = (0..known.len()).collect();
            let interval = |stream, statistic: fn(&[f64], &[usize]) -> f64| {
                interval_95(known.len(), resamples, seed, stream, |items| statistic(&known, items))
            };
            MorrisIndices {
                name: parameter.name.clone(),
                mu: mean(&known, &all),
                mu_star: mean_absolute(&known, &all),
                sigma: standard_deviation(&known, &all),
                mu_star_interval_95: interval(2 * i as u64, mean_absolute),
                sigma_interval_95: interval(2 * i as u64 + 1, standard_deviation),
                n_effects: known.len(),
            }
        });
        Ok(MorrisResult {
            indices: indices.collect(),
            effects,
            runs: values.len(),
            extra_runs,
            recovered_effects: halved.len(),
            lost_effects,
            failures,
            seed,
            resamples,
        })
    }
}

impl MorrisResult {
    /// μ* from the first r of the starts, for each r of `starts`: whether more would change it. Numbers below 2 or
    /// above the starts there are are passed over.
    pub fn convergence(&self, starts: &[usize]) -> Vec<MorrisConvergence> {
        let available = self.effects.first().map_or(0, Vec::len);
        let of_first = |r: usize| {
            let mut widths = Vec::new();
            let mut mu_star = Vec::new();
            for (i, effects) in self.effects.iter().enumerate() {
                let known: Vec<f64> = effects[..r].iter().flatten().copied().collect();
                let all: Vec<usize> = (0..known.len()).collect();
                mu_star.push(mean_absolute(&known, &all));
                let interval = interval_95(known.len(), self.resamples, self.seed, 2 * i as u64, |items| {
                    mean_absolute(&known, items)
                });
                widths.push(interval.map_or(f64::INFINITY, |[low, high]| high - low));
            }
            let largest = mu_star.iter().copied().fold(0.0, f64::max);
            let widest_interval = widths.into_iter().fold(0.0, f64::max) / largest;
            MorrisConvergence { r, mu_star, widest_interval }
        };
        starts.iter().copied().filter(|r| (2..=available).contains(r)).map(of_first).collect()
    }
}

fn mean(x: &[f64], items: &[usize]) -> f64 {
    items.iter().map(|&i| x[i]).sum::<f64>() / items.len() as f64
}

fn mean_absolute(x: &[f64], items: &[usize]) -> f64 {
    items.iter().map(|&i| x[i].abs()).sum::<f64>() / items.len() as f64
}

fn standard_deviation(x: &[f64], items: &[usize]) -> f64 {
    let mean = mean(x, items);
    (items.iter().map(|&i| (x[i] - mean).powi(2)).sum::<f64>() / (items.len() as f64 - 1.0)).sqrt()
}
