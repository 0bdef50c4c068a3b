//! Screening of a participant's trials, condition by condition.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};

use super::diagnostic::{Diagnostic, Failure};
use super::loading::LoadedParticipant;
use super::progress::{Progress, go_on};
use super::provenance::DEFAULT_SEED;
use carpus_personalization::sensitivity::{
    CohortIndex, FirstOrderEstimator, MorrisConvergence, MorrisResult, MorrisSample, MuscleScreening, Parameter,
    ScreenedProperty, SensitivityError, SobolResult, SobolSample,
};
use carpus_study::study::{Contraction, TrialUse};

/// Contractions whose trials have a moment that muscles make.
const CONTRACTIONS: [Contraction; 3] = [Contraction::Isometric, Contraction::Isotonic, Contraction::Freehand];

/// Starts r of the Morris screening where none are asked for.
pub const DEFAULT_STARTS: usize = 25;
/// Resamples of the bootstrap where none are asked for.
pub const DEFAULT_RESAMPLES: usize = 1000;

/// How hard to screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScreeningOptions {
    /// Starts r of the Morris screening.
    pub starts: usize,
    /// Rows of the Sobol' analysis, if one is wanted.
    pub sobol: Option<usize>,
    /// Resamples of the bootstrap.
    pub resamples: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for ScreeningOptions {
    fn default() -> Self {
        ScreeningOptions { starts: DEFAULT_STARTS, sobol: None, resamples: DEFAULT_RESAMPLES, seed: DEFAULT_SEED }
    }
}

impl ScreeningOptions {
    /// Simulations of so many parameters, without those with halved steps.
    fn runs(&self, parameters: usize) -> usize {
        self.starts * (parameters + 1) + self.sobol.map_or(0, |rows| rows * (parameters + 2))
    }
}

/// A condition: contraction and effort.
pub type Condition = (Contraction, Option<f64>);

/// The analysis of one participant's trials of one condition.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ConditionSensitivity {
    /// The participant.
    pub participant: String,
    /// Kind of contraction.
    pub contraction: Contraction,
    /// Effort [%].
    pub effort_percent: Option<f64>,
    /// Names of the trials.
    pub trials: Vec<String>,
    /// Morris' screening.
    pub morris: MorrisResult,
    /// μ* from the first starts only.
    pub convergence: Vec<MorrisConvergence>,
    /// Sobol' indices.
    pub sobol: Option<SobolResult>,
}

impl ConditionSensitivity {
    /// `isotonic 25 %`.
    pub fn condition(&self) -> String {
        condition_name((self.contraction, self.effort_percent))
    }

    /// μ* of a property, averaged over muscles.
    pub fn mean_mu_star(&self, property: ScreenedProperty) -> f64 {
        let suffix = format!(".{}", property.name());
        let of_property = self.morris.indices.iter().filter(|i| i.name.ends_with(&suffix)).map(|i| i.mu_star);
        let (sum, count) = of_property.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        sum / count
    }

    /// The indices as those of one participant among several; none without an effort.
    pub fn cohort_indices(&self) -> Vec<CohortIndex> {
        let of = |index: &carpus_personalization::sensitivity::MorrisIndices| {
            let (muscle, property) = index.name.rsplit_once('.')?;
            Some(CohortIndex {
                participant: self.participant.clone(),
                contraction: self.contraction,
                effort_percent: self.effort_percent?,
                muscle: muscle.to_owned(),
                property: ScreenedProperty::ALL.into_iter().find(|p| p.name() == property)?,
                mu_star: index.mu_star,
                sigma: index.sigma,
            })
        };
        self.morris.indices.iter().filter_map(of).collect()
    }
}

/// Why a screening cannot be made.
pub fn refused(error: SensitivityError) -> Failure {
    Diagnostic::error(error.to_string()).into()
}

/// The name of a condition.
pub fn condition_name((contraction, effort_percent): Condition) -> String {
    match effort_percent {
        Some(effort) => format!("{} {effort} %", contraction.word()),
        None => contraction.word().to_string(),
    }
}

fn used(run: &LoadedParticipant, i: usize) -> bool {
    let info = &run.trials[i].info;
    info.usage == TrialUse::Train && CONTRACTIONS.contains(&info.contraction)
}

/// The conditions of a participant's training trials.
///
/// # Errors
/// There is none.
pub fn conditions(run: &LoadedParticipant) -> Result<Vec<Condition>, Failure> {
    let mut conditions: Vec<Condition> = Vec::new();
    for i in (0..run.trials.len()).filter(|i| used(run, *i)) {
        let condition = (run.trials[i].info.contraction, run.trials[i].info.effort_percent);
        if !conditions.contains(&condition) {
            conditions.push(condition);
        }
    }
    if conditions.is_empty() {
        let text = format!("participant {}: no trial with use = train to screen", run.participant.name);
        return Err(Diagnostic::error(text).hint("isometric, isotonic and freehand trials are screened").into());
    }
    conditions.sort_by(|a, b| (a.0.cmp(&b.0)).then(a.1.unwrap_or(0.0).total_cmp(&b.1.unwrap_or(0.0))));
    Ok(conditions)
}

/// Screens one condition.
///
/// # Errors
/// A screening of which every run fails; a request to stop.
pub fn screened(
    run: &LoadedParticipant,
    (contraction, effort_percent): Condition,
    options: &ScreeningOptions,
    progress: &dyn Progress,
) -> Result<ConditionSensitivity, Failure> {
    let muscles: Vec<&str> = run.model.muscle_names().collect();
    let parameters = MuscleScreening::parameters(&muscles).map_err(refused)?;
    let nominal = run.model.nominal_parameters();
    let chosen: Vec<usize> = (0..run.trials.len())
        .filter(|&i| used(run, i))
        .filter(|&i| {
            (run.trials[i].info.contraction, run.trials[i].info.effort_percent) == (contraction, effort_percent)
        })
        .collect();
    let trials = chosen.iter().map(|&i| (&run.prepared[i], run.trials[i].moment.as_slice())).collect();
    let screening = MuscleScreening::new(trials, &nominal).map_err(refused)?;
    let what = format!("screening {}, {}", run.participant.name, condition_name((contraction, effort_percent)));
    let (done, runs) = (AtomicUsize::new(0), options.runs(parameters.len()));
    let respond = |fractions: &[f64]| {
        if progress.is_cancelled() {
            return Err("stopped".to_owned());
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress.at(&what, done, runs.max(done));
        screening.response(fractions).map_err(|e| e.to_string())
    };
    let analyzed = analyzed(respond, &parameters, options);
    progress.finished();
    go_on(progress)?;
    let (morris, sobol) = analyzed.map_err(|error| {
        let condition = condition_name((contraction, effort_percent));
        Failure::from(Diagnostic::error(format!("participant {}, {condition}: {error}", run.participant.name)))
    })?;
    Ok(ConditionSensitivity {
        participant: run.participant.name.clone(),
        contraction,
        effort_percent,
        trials: chosen.iter().map(|&i| run.trials[i].info.name.clone()).collect(),
        convergence: morris.convergence(&partial_starts(options.starts)),
        morris,
        sobol,
    })
}

fn analyzed(
    response: impl Fn(&[f64]) -> Result<f64, String> + Sync,
    parameters: &[Parameter],
    options: &ScreeningOptions,
) -> Result<(MorrisResult, Option<SobolResult>), SensitivityError> {
    let m = parameters.len();
    let sample = MorrisSample::radial(m, options.starts, options.seed)?;
    let morris = sample.screen(parameters, &response, options.resamples, options.seed)?;
    let sobol = options.sobol.map(|n| {
        let sample = SobolSample::sobol_sequence(m, n, options.seed)?;
        sample.run(parameters, &response, FirstOrderEstimator::Saltelli, options.resamples, options.seed)
    });
    Ok((morris, sobol.transpose()?))
}

/// Five steps up to all starts.
fn partial_starts(r: usize) -> Vec<usize> {
    let mut steps: Vec<usize> = (1..=5).map(|k| (k * r).div_ceil(5).max(2)).collect();
    steps.dedup();
    steps
}
