//! `carpus personalize`: fitted muscle parameters, the model that has them, errors before and after.

use std::path::{Path, PathBuf};

use super::compare::{error_table, write_errors};
use super::simulate::{account, summary, write_results, write_series};
use crate::cli::args::{Global, PersonalizeArgs};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::print_result;
use crate::cli::study_run::{ParticipantRun, StudyRun};
use crate::osim::OsimFile;
use crate::report::results::{Kind, ParameterResult, Results, StageResult};
use crate::simulation::MuscleParameters;
use crate::study::{ParameterBounds, Participant, RelativeBounds};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &PersonalizeArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study)?;
    let mut outcomes = Vec::new();
    for participant in &study.participants {
        let folder = PathBuf::from(&participant.name);
        outcomes.push(personalize(&study, participant, &folder, global)?);
    }
    if outcomes.len() > 1 {
        write_errors(&study, Path::new(""), &outcomes.iter().collect::<Vec<_>>())?;
    }
    if global.json {
        return print_result(&json(&outcomes));
    }
    let mut text = readable(&outcomes);
    text.push_str("\n\n");
    for results in &outcomes {
        let folder = study.out.path().join(&results.participant.id);
        text.push_str(&format!("{}\n{}\n", folder.join("model.osim").display(), folder.join("report.html").display()));
    }
    print_result(&text)
}

/// Fits a participant's parameters and writes the model, the results and the report into `folder` of the output.
///
/// # Errors
/// The participant's model and trials, the fit, or the disk.
pub fn personalize(
    study: &StudyRun,
    participant: &Participant,
    folder: &Path,
    global: &Global,
) -> Result<Results, Failure> {
    let run = study.participant(participant)?;
    failure::print(&run.warnings);
    let nominal = run.model.nominal_parameters();
    let before = run.simulate(&nominal)?;
    let (fitted, stages) = fit(study, &run, global)?;
    let (file, written) = personalized_model(&run, &fitted)?;
    // What is reported is what the written file says, digit by digit.
    let after = run.simulate(&written)?;

    let name = folder.join("model.osim");
    let models = [
        run.model_run("before", "Before", run.loaded.path.display().to_string(), &before),
        run.model_run("personalized", "Personalized", name.display().to_string(), &after),
    ];
    let mut results = account(Kind::Personalization, global, study, &run, &models)?;
    let muscles: Vec<&str> = run.model.muscle_names().collect();
    results.parameters = parameters(&muscles, &nominal, &written, &study.study.settings.bounds);
    results.stages = stages;
    study.out.write(&name, file.document.bytes())?;
    write_series(study, folder, &run, &after)?;
    write_errors(study, folder, &[&results])?;
    write_results(study, folder, &results)?;
    Ok(results)
}

/// Fits the active muscles' parameters to the training trials.
fn fit(_: &StudyRun, _: &ParticipantRun, _: &Global) -> Result<(Vec<MuscleParameters>, Vec<StageResult>), Failure> {
    Err(Failure::Internal("personalization is not wired".into()))
}

/// The participant's file with the fitted values in it, and the values as the file now has them.
fn personalized_model(
    run: &ParticipantRun,
    fitted: &[MuscleParameters],
) -> Result<(OsimFile, Vec<MuscleParameters>), Failure> {
    let mut file = run.loaded.file.clone();
    let names: Vec<&str> = run.model.muscle_names().collect();
    let changes: Vec<_> = names
        .iter()
        .zip(fitted)
        .flat_map(|(name, p)| {
            [
                (*name, "max_isometric_force", p.max_isometric_force),
                (*name, "optimal_fiber_length", p.optimal_fiber_length),
                (*name, "tendon_slack_length", p.tendon_slack_length),
            ]
        })
        .collect();
    file.set_muscle_properties(&changes).map_err(|e| {
        let message = Message::error(e.to_string()).in_file(&run.loaded.path);
        Failure::from(e.hint().into_iter().fold(message, Message::hint))
    })?;
    let read_back = |(name, p): (&&str, &MuscleParameters)| {
        let muscle = file.spec.muscles.iter().find(|m| m.name == **name);
        let muscle = muscle.ok_or_else(|| Failure::Internal(format!("{name} is missing in the written model")))?;
        Ok(MuscleParameters {
            max_isometric_force: muscle.max_isometric_force,
            optimal_fiber_length: muscle.optimal_fiber_length,
            tendon_slack_length: muscle.tendon_slack_length,
            ..*p
        })
    };
    let written = names.iter().zip(fitted).map(read_back).collect::<Result<_, Failure>>()?;
    Ok((file, written))
}

/// Parameters before and after, property by property.
fn parameters(
    muscles: &[&str],
    before: &[MuscleParameters],
    after: &[MuscleParameters],
    bounds: &ParameterBounds,
) -> Vec<ParameterResult> {
    type Pick = fn(&MuscleParameters) -> f64;
    let properties: [(&str, &str, Pick, RelativeBounds); 3] = [
        ("optimal_fiber_length", "m", |p| p.optimal_fiber_length, bounds.optimal_fiber_length),
        ("tendon_slack_length", "m", |p| p.tendon_slack_length, bounds.tendon_slack_length),
        ("max_isometric_force", "N", |p| p.max_isometric_force, bounds.max_isometric_force),
    ];
    let of_property = |(property, unit, pick, bounds): (&str, &str, Pick, RelativeBounds)| {
        let row = |(i, muscle): (usize, &&str)| ParameterResult {
            muscle: (*muscle).to_string(),
            property: property.to_string(),
            unit: unit.to_string(),
            before: pick(&before[i]),
            after: pick(&after[i]),
            lower: bounds.lower * pick(&before[i]),
            upper: bounds.upper * pick(&before[i]),
        };
        muscles.iter().enumerate().map(row).collect::<Vec<_>>()
    };
    properties.into_iter().flat_map(of_property).collect()
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
    }
    text
}
