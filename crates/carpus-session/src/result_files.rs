//! Files of a participant's results: `results.json` with its report, tables of errors, series of every trial.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::account::{self, ModelRun, Setting, errors_per_condition_csv, errors_per_trial_csv};
use super::diagnostic::Failure;
use super::loading::LoadedParticipant;
use super::output::OutputFolder;
use super::participant::Session;
use super::series::Series;
use carpus_report::results::{Kind, Results};
use carpus_report::{render_report, render_waterfall};
use carpus_simulation::simulation::TrialSimulation;

/// The results of a participant.
///
/// - `request`, `seed`: what was asked
///
/// # Errors
/// None that input can cause.
pub fn account(
    kind: Kind,
    session: &Session<'_>,
    request: &impl std::fmt::Debug,
    seed: u64,
    models: &[ModelRun],
) -> Result<Results, Failure> {
    let run = &session.data;
    let setting = Setting {
        kind,
        provenance: session.study.provenance(request, seed, run.inputs.clone()),
        study: &session.study.tables,
        participant: &run.participant,
        spec: &run.loaded.file.spec,
        warnings: &run.warnings,
    };
    account::results(setting, &run.trials, models)
}

/// Writes the series of every trial.
///
/// - `coordinate`: the dynamometer's
///
/// # Errors
/// The disk.
pub fn write_series(
    out: &OutputFolder,
    folder: &Path,
    coordinate: &str,
    run: &LoadedParticipant,
    simulations: &[TrialSimulation],
) -> Result<(), Failure> {
    let muscles: Vec<String> = run.model.muscle_names().map(String::from).collect();
    let write = |i: usize| {
        let trial = &run.trials[i];
        let with_effects = !run.given.is_empty();
        let series = Series::new(coordinate, &muscles, trial, &run.prepared[i], &simulations[i], with_effects);
        let name = folder.join("series").join(&trial.info.name);
        out.write_with(with_extension(&name, "csv"), |file| series.write_csv(file))?;
        out.write_with(with_extension(&name, "sto"), |file| series.write_sto(file))?;
        Ok(())
    };
    let written: Vec<Result<(), Failure>> = (0..simulations.len()).into_par_iter().map(write).collect();
    written.into_iter().collect()
}

/// Appends an extension; a dot inside the name is not taken for one.
fn with_extension(path: &Path, extension: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(extension);
    name.into()
}

/// Writes `results.json` and its report.
///
/// # Errors
/// The disk.
pub fn write_results(out: &OutputFolder, folder: &Path, results: &Results) -> Result<(), Failure> {
    out.write(folder.join("report.html"), render_report(results).as_bytes())?;
    if let Some(figure) = render_waterfall(results) {
        out.write(folder.join("error.svg"), figure.as_bytes())?;
    }
    out.write(folder.join("results.json"), results.to_json().as_bytes())?;
    Ok(())
}

/// Writes both tables of errors.
///
/// # Errors
/// The disk.
pub fn write_errors(out: &OutputFolder, folder: &Path, results: &[&Results]) -> Result<(), Failure> {
    out.write(folder.join("errors_per_trial.csv"), errors_per_trial_csv(results)?.as_bytes())?;
    out.write(folder.join("errors_per_condition.csv"), errors_per_condition_csv(results)?.as_bytes())?;
    Ok(())
}

/// Writes both tables of errors of several participants; of one they stand with its results.
///
/// # Errors
/// The disk.
pub fn write_errors_of_all(out: &OutputFolder, all: &[Results]) -> Result<(), Failure> {
    if all.len() > 1 { write_errors(out, Path::new(""), &all.iter().collect::<Vec<_>>()) } else { Ok(()) }
}

/// A results file without its series and inputs.
pub fn summary(results: &Results) -> serde_json::Value {
    serde_json::json!({
        "schema": "carpus.summary/1",
        "kind": results.kind,
        "participant": results.participant.id,
        "study": results.study.name,
        "trials": results.trials.len(),
        "models": results.models,
        "parameters": results.parameters,
        "part_of_the_way": results.part_of_the_way,
        "warnings": results.warnings,
    })
}

/// [`summary`] of every participant, in JSON.
pub fn summaries(all: &[Results]) -> String {
    serde_json::Value::Array(all.iter().map(summary).collect()).to_string()
}

/// As [`summaries`], with the ledgers of effects.
pub fn summaries_with_ledgers(all: &[Results]) -> String {
    let one = |results: &Results| {
        let mut value = summary(results);
        value["ledger"] = serde_json::to_value(&results.ledger).unwrap_or_default();
        value
    };
    serde_json::Value::Array(all.iter().map(one).collect()).to_string()
}
