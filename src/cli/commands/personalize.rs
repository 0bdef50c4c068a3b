//! `carpus personalize`: fitted muscle parameters, the model that has them, errors before and after.

use std::path::{Path, PathBuf};

use super::compare::{error_table, write_errors};
use super::identify::{INTERVAL_LEVEL, usual_intervals};
use super::simulate::{account, summary, write_results, write_series};
use crate::cli::args::{Global, PersonalizeArgs};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::study_run::{ParticipantRun, StudyRun, progress};
use crate::identifiability::ConfidenceInterval;
use crate::imaging::path_length;
use crate::muscles::Millard2012;
use crate::personalization::{
    FitOptions, FitProblem, FittedParameter, Personalization, Progress, Property, RestingFiber, Stage, TrainingTrial,
    WriteBackError, write_parameters,
};
use crate::report::intervals::{NOT_VALID, holds};
use crate::report::results::{IntervalResult, Kind, ParameterResult, Results, StageResult, rounded};
use crate::simulation::MuscleParameters;
use crate::study::{FascicleUse, Participant, TrialUse};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &PersonalizeArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "personalize")?;
    let outcomes = study.each(|participant| {
        personalize(&study, participant, &PathBuf::from(&participant.name), !args.no_intervals, global)
    })?;
    let done = &outcomes.done;
    if done.len() > 1 {
        write_errors(&study, Path::new(""), &done.iter().collect::<Vec<_>>())?;
    }
    if global.json {
        let text = json(done);
        return outcomes.print(&study, "personalize", &text);
    }
    let mut text = readable(done);
    text.push_str("\n\n");
    for results in done {
        let folder = study.out.path().join(&results.participant.id);
        text.push_str(&format!("{}\n{}\n", folder.join("model.osim").display(), folder.join("report.html").display()));
    }
    outcomes.print(&study, "personalize", &text)
}

/// Fits a participant's parameters and writes the model, the results and the report into `folder` of the output.
///
/// # Errors
/// The participant's model and trials, the fit, or the disk.
pub fn personalize(
    study: &StudyRun,
    participant: &Participant,
    folder: &Path,
    with_intervals: bool,
    global: &Global,
) -> Result<Results, Failure> {
    let run = study.participant(participant)?;
    failure::print(&run.warnings);
    let nominal = run.model.nominal_parameters();
    let before = run.simulate(&nominal)?;
    let fit = fit(study, &run, &nominal, global)?;
    let mut file = run.loaded.file.clone();
    write_parameters(&mut file, &fit.fitted).map_err(|e| writing_failure(&e, &run.loaded.path))?;
    // What is reported is what the written file gives.
    let after = study.simulate_edited(&run, &file.spec)?;

    let name = folder.join("model.osim");
    let models = [
        run.model_run("before", "Before", run.loaded.path.display().to_string(), &before),
        run.model_run("personalized", "Personalized", name.display().to_string(), &after),
    ];
    let mut results = account(Kind::Personalization, global, study, &run, &models)?;
    results.parameters = parameters(&fit.fitted);
    if with_intervals {
        let bar = progress(global, 0, &format!("intervals of {}", run.participant.name));
        let found = usual_intervals(study, &run, global.seed);
        bar.finish_and_clear();
        add_intervals(&mut results.parameters, &found?);
    }
    results.stages = fit.stages.iter().map(stage).collect();
    study.out.write(&name, file.document.bytes())?;
    write_series(study, folder, &run, &after)?;
    write_errors(study, folder, &[&results])?;
    write_results(study, folder, &results)?;
    Ok(results)
}

/// Why fitted parameters cannot be written into a model.
pub fn writing_failure(error: &WriteBackError, model: &Path) -> Failure {
    match error {
        WriteBackError::Edit(edit) => {
            let message = Message::error(error.to_string()).in_file(model);
            Failure::from(edit.hint().into_iter().fold(message, Message::hint))
        }
        WriteBackError::ReadBack { .. } => Failure::Internal(error.to_string()),
    }
}

/// Fits the active muscles' parameters to the training trials; held-out trials are not handed over.
fn fit(
    study: &StudyRun,
    run: &ParticipantRun,
    nominal: &[MuscleParameters],
    global: &Global,
) -> Result<Personalization, Failure> {
    let training = run.trials.iter().zip(&run.prepared).filter(|(trial, _)| trial.info.usage == TrialUse::Train);
    let problem = FitProblem {
        trials: training.map(|(trial, prepared)| TrainingTrial { prepared, measured: &trial.moment }).collect(),
        muscles: run.model.muscle_names().map(String::from).collect(),
        nominal: nominal.to_vec(),
        bounds: study.study.settings.bounds,
        fibers: fibers(study, run)?,
    };
    let bar = progress(global, 0, &format!("fitting {}", run.participant.name));
    let options = FitOptions { seed: global.seed, ..FitOptions::default() };
    let fit = crate::personalization::personalize(&problem, &options, &|p: Progress| {
        bar.set_length(p.expected as u64);
        bar.set_position(p.evaluations as u64);
        bar.set_message(format!("fitting {}: {}", run.participant.name, p.stage));
    });
    bar.finish_and_clear();
    fit.map_err(|e| Message::error(e.to_string()).in_file(&study.study.file).into())
}

/// Fascicle lengths of the participant's images, if the study says that they inform the fit.
fn fibers(study: &StudyRun, run: &ParticipantRun) -> Result<Vec<RestingFiber>, Failure> {
    let imaging = &study.study.settings.imaging;
    if imaging.fascicles == FascicleUse::Check {
        return Ok(Vec::new());
    }
    let table = study.study.folder.join("ultrasound.csv");
    let of_participant = study.study.ultrasound.iter().filter(|m| m.participant == run.participant.name);
    let mut fibers = Vec::new();
    for (image, measured) in of_participant.filter_map(|m| Some((m, m.fascicle_length?))) {
        // A muscle that is not active has nothing to fit.
        let Some(muscle) = run.model.muscle_names().position(|name| name == image.muscle) else { continue };
        let at = |e: String| Failure::from(Message::error(e).in_file(&table).at_line(image.line));
        let (spec, path_length) = path_length(&run.loaded.file.spec, &run.loaded.model, &study.study, image)
            .map_err(|e| at(format!("{} {}: {e}", run.participant.name, image.muscle)))?;
        let millard = Millard2012::from_spec(spec).map_err(|e| at(e.to_string()))?;
        fibers.push(RestingFiber {
            muscle,
            millard,
            path_length,
            activation: imaging.activation,
            measured,
            standard_deviation: imaging.fascicle_error * measured,
        });
    }
    Ok(fibers)
}

/// Fitted parameters, property by property.
fn parameters(fitted: &[FittedParameter]) -> Vec<ParameterResult> {
    let result = |p: &FittedParameter| ParameterResult {
        muscle: p.muscle.clone(),
        property: p.property.name().to_string(),
        unit: p.property.unit().to_string(),
        before: p.before,
        after: p.after,
        lower: p.lower,
        upper: p.upper,
        standard_deviation: p.determination.map(|d| rounded(d.relative_deviation * p.before, 6)),
        share_from_data: p.determination.map(|d| rounded(d.share_from_data, 6)),
        interval: None,
    };
    let of = |property: Property| fitted.iter().filter(move |p| p.property == property).map(result);
    Property::ALL.into_iter().flat_map(of).collect()
}

/// Gives every fitted parameter its interval.
fn add_intervals(fitted: &mut [ParameterResult], found: &[ConfidenceInterval]) {
    for result in fitted {
        let own =
            found.iter().find(|i| i.parameter.owner == result.muscle && i.parameter.property.name() == result.property);
        result.interval = own.map(|i| IntervalResult {
            level: INTERVAL_LEVEL,
            lower: rounded(i.interval[0], 7),
            upper: rounded(i.interval[1], 7),
            end_from_data: i.end_from_data,
        });
    }
}

fn stage(stage: &Stage) -> StageResult {
    StageResult {
        name: stage.name.to_string(),
        evaluations: stage.evaluations,
        objective_before: stage.objective_before,
        objective_after: stage.objective_after,
    }
}

/// What `--json` prints.
pub fn json(outcomes: &[Results]) -> String {
    serde_json::Value::Array(outcomes.iter().map(summary).collect()).to_string()
}

/// Errors before and after, and parameters on a bound, for a terminal.
pub fn readable(outcomes: &[Results]) -> String {
    let mut text = error_table(outcomes);
    for results in outcomes {
        let on_bound: Vec<_> = results.parameters.iter().filter(|p| p.at_bound()).collect();
        if !on_bound.is_empty() {
            let names: Vec<_> = on_bound.iter().map(|p| format!("{} {}", p.muscle, p.property)).collect();
            text.push_str(&format!("\n\n{}: on a bound: {}", results.participant.id, names.join(", ")));
        }
        let open: Vec<_> = results
            .parameters
            .iter()
            .filter(|p| p.interval.as_ref().is_some_and(|i| !i.is_determined()))
            .map(|p| format!("{} {}", p.muscle, p.property))
            .collect();
        let invalid: Vec<_> = results
            .parameters
            .iter()
            .filter(|p| p.interval.as_ref().is_some_and(|i| !holds([i.lower, i.upper], p.after)))
            .map(|p| format!("{} {}", p.muscle, p.property))
            .collect();
        if !invalid.is_empty() {
            text.push_str(&format!("\n\n{}: interval {NOT_VALID}: {}", results.participant.id, invalid.join(", ")));
        }
        if !open.is_empty() {
            text.push_str(&format!(
                "\n\n{}: not determined by these trials: {}",
                results.participant.id,
                open.join(", ")
            ));
        }
    }
    text
}
