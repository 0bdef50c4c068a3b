//! `carpus simulate`: moments, fibre lengths and forces of every trial over time.

use std::path::PathBuf;

use rayon::prelude::*;

use crate::cli::account::{self, ModelRun, Setting};
use crate::cli::args::{Global, SimulateArgs};
use crate::cli::failure::{self, Failure};
use crate::cli::provenance::provenance;
use crate::cli::series::Series;
use crate::cli::study_run::{ParticipantRun, StudyRun, progress};
use crate::report::results::{Kind, Results};
use crate::report::{render_report, render_waterfall};
use crate::simulation::TrialSimulation;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &SimulateArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "simulate")?;
    let bar = progress(global, study.participants.len() as u64, "simulating");
    let outcomes = study.each(|participant| {
        let run = study.participant(participant)?;
        failure::print(&run.warnings);
        let simulations = run.simulate_model()?;
        let model = run.model_run("model", "Simulated", run.loaded.path.display().to_string(), &simulations);
        let results = account(Kind::Simulation, global, &study, &run, &[model])?;
        let folder = PathBuf::from(&participant.name);
        write_series(&study, &folder, &run, &simulations)?;
        write_results(&study, &folder, &results)?;
        bar.inc(1);
        Ok(results)
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    if global.json {
        let text = serde_json::Value::Array(outcomes.done.iter().map(summary).collect()).to_string();
        return outcomes.print(&study, "simulate", &text);
    }
    let lines = outcomes.done.iter().map(|r| {
        let report = study.out.path().join(&r.participant.id).join("report.html");
        format!("{}: {} trials simulated, {}\n", r.participant.id, r.trials.len(), report.display())
    });
    let text = lines.collect::<String>();
    outcomes.print(&study, "simulate", &text)
}

/// The results of a participant.
///
/// # Errors
/// None that input can cause.
pub fn account(
    kind: Kind,
    global: &Global,
    study: &StudyRun,
    run: &ParticipantRun,
    models: &[ModelRun],
) -> Result<Results, Failure> {
    let setting = Setting {
        kind,
        provenance: provenance(global, run.inputs.clone()),
        study: &study.study,
        participant: &run.participant,
        spec: &run.loaded.file.spec,
        warnings: &run.warnings,
    };
    account::results(setting, &run.trials, models)
}

/// Writes the series of every trial.
///
/// # Errors
/// The disk.
pub fn write_series(
    study: &StudyRun,
    folder: &std::path::Path,
    run: &ParticipantRun,
    simulations: &[TrialSimulation],
) -> Result<(), Failure> {
    let coordinate = &study.study.settings.dynamometer.coordinate;
    let muscles: Vec<String> = run.model.muscle_names().map(String::from).collect();
    let write = |i: usize| {
        let trial = &run.trials[i];
        let with_effects = !run.given.is_empty();
        let series = Series::new(coordinate, &muscles, trial, &run.prepared[i], &simulations[i], with_effects);
        let name = folder.join("series").join(&trial.info.name);
        study.out.write_with(with_extension(&name, "csv"), |file| series.write_csv(file))?;
        study.out.write_with(with_extension(&name, "sto"), |file| series.write_sto(file))?;
        Ok(())
    };
    let written: Vec<Result<(), Failure>> = (0..simulations.len()).into_par_iter().map(write).collect();
    written.into_iter().collect()
}

/// Appends an extension; a dot inside the name is not taken for one.
fn with_extension(path: &std::path::Path, extension: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(extension);
    name.into()
}

/// Writes `results.json` and its report.
///
/// # Errors
/// The disk.
pub fn write_results(study: &StudyRun, folder: &std::path::Path, results: &Results) -> Result<(), Failure> {
    study.out.write(folder.join("report.html"), render_report(results).as_bytes())?;
    if let Some(figure) = render_waterfall(results) {
        study.out.write(folder.join("error.svg"), figure.as_bytes())?;
    }
    study.out.write(folder.join("results.json"), results.to_json().as_bytes())?;
    Ok(())
}

/// A results file without its series and inputs, for standard output.
pub fn summary(results: &Results) -> serde_json::Value {
    serde_json::json!({
        "schema": "carpus.summary/1",
        "kind": results.kind,
        "participant": results.participant.id,
        "study": results.study.name,
        "trials": results.trials.len(),
        "models": results.models,
        "parameters": results.parameters,
        "warnings": results.warnings,
    })
}
