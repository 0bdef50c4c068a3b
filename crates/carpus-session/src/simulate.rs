//! Simulation of every trial: moments, fibre lengths and forces over time.

use std::path::Path;

use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use super::participant::Session;
use super::provenance::DEFAULT_SEED;
use super::result_files::{account, write_results, write_series};
use carpus_report::results::{Kind, Results};
use carpus_simulation::simulation::TrialSimulation;

/// A simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simulate {
    /// Written into the results; nothing in a simulation is random.
    pub seed: u64,
}

impl Default for Simulate {
    fn default() -> Self {
        Simulate { seed: DEFAULT_SEED }
    }
}

/// Simulated trials.
#[derive(Debug)]
pub struct Simulated<'a> {
    session: &'a Session<'a>,
    /// What is written as `results.json`.
    pub results: Results,
    /// Every trial over time, in the order of the session.
    pub trials: Vec<TrialSimulation>,
}

impl Session<'_> {
    /// Simulates every trial with the model as it is.
    ///
    /// # Errors
    /// A muscle whose forces cannot be balanced.
    pub fn simulate(&self, request: &Simulate) -> Result<Simulated<'_>, Failure> {
        self.progress()?;
        let run = &self.data;
        let trials = run.simulate_model()?;
        let model = run.model_run("model", "Simulated", run.loaded.path.display().to_string(), &trials);
        let results = account(Kind::Simulation, self, request, request.seed, &[model])?;
        Ok(Simulated { session: self, results, trials })
    }
}

impl Simulated<'_> {
    /// Writes `results.json`, its report and the series of every trial.
    ///
    /// - `folder`: the participant's, in the folder of the results
    ///
    /// # Errors
    /// The disk.
    pub fn write_to(&self, out: &OutputFolder, folder: &Path) -> Result<(), Failure> {
        let coordinate = &self.session.study.tables.settings.dynamometer.coordinate;
        write_series(out, folder, coordinate, &self.session.data, &self.trials)?;
        write_results(out, folder, &self.results)
    }

    /// Writes the files of `carpus simulate` into a folder of results. Returns what a person should know about files of
    /// earlier runs.
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of this study and command.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<Vec<Diagnostic>, Failure> {
        self.session.write_results(path.as_ref(), "simulate", |out, folder| self.write_to(out, folder))
    }
}
