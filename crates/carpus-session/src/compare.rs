//! Simulated against measured moments.

use std::path::Path;

use super::diagnostic::{Diagnostic, Failure};
use super::errors::ErrorOverview;
use super::muscle_use::{Simulated, muscle_use};
use super::output::OutputFolder;
use super::participant::Session;
use super::provenance::DEFAULT_SEED;
use super::residuals::residual_result;
use super::result_files::{account, write_errors, write_results, write_series};
use carpus_report::results::{Kind, Results};
use carpus_simulation::simulation::TrialSimulation;

/// A comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Compare {
    /// Written into the results; nothing in a comparison is random.
    pub seed: u64,
}

impl Default for Compare {
    fn default() -> Self {
        Compare { seed: DEFAULT_SEED }
    }
}

/// Errors of the model as it is, and where they are.
#[derive(Debug)]
pub struct Comparison<'a> {
    session: &'a Session<'a>,
    /// What is written as `results.json`.
    pub results: Results,
    /// Every trial over time, in the order of the session.
    pub trials: Vec<TrialSimulation>,
}

impl Session<'_> {
    /// Simulates every trial with the model as it is and compares the moments with those measured.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn compare(&self, request: &Compare) -> Result<Comparison<'_>, Failure> {
        self.progress()?;
        let run = &self.data;
        let trials = run.simulate_model()?;
        let model = run.model_run("model", "Simulated", run.loaded.path.display().to_string(), &trials);
        let residuals = residual_result(run, "model", &model.moments);
        let mut results = account(Kind::Comparison, self, request, request.seed, &[model])?;
        results.residuals = vec![residuals];
        let simulated = Simulated { id: "model", spec: &run.loaded.file.spec, trials: &trials };
        results.muscles = muscle_use(run, &[simulated])?;
        results.live = self.live_case(request.seed, true, Vec::new())?;
        Ok(Comparison { session: self, results, trials })
    }
}

impl Comparison<'_> {
    /// Errors of the model, for each use of the trials.
    pub fn errors(&self) -> ErrorOverview {
        ErrorOverview::of(&self.results)
    }

    /// Writes `results.json`, its report, tables of errors and the series of every trial.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        let coordinate = &self.session.study.tables.settings.dynamometer.coordinate;
        write_series(out, folder, coordinate, &self.session.data, &self.trials)?;
        write_errors(out, folder, &[&self.results])?;
        write_results(out, folder, &self.results)
    }

    /// Writes the files of `carpus compare` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.session.write_results(path.as_ref(), "compare", |out, folder| self.write_to(out, folder))
    }
}
