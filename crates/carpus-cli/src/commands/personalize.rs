//! `carpus personalize`: fitted muscle parameters, the model that has them, errors before and after.

use std::path::Path;

use super::compare::error_table;
use crate::args::{Global, PersonalizeArgs};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::next_steps;
use crate::study_run::StudyRun;
use carpus_report::intervals::{NOT_VALID, holds};
use carpus_report::results::Results;
use carpus_session::participant::StudyParticipant;
use carpus_session::personalize::Personalize;
use carpus_session::result_files::{summary, write_errors};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &PersonalizeArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "personalize")?;
    let request = Personalize { seed: global.seed, intervals: !args.no_intervals };
    let bars = Bars::new(global);
    let outcomes = study.each("personalizing", &bars, |participant| {
        let folder = Path::new(&participant.about().name);
        personalize(&study, &participant, folder, &request, &bars)
    })?;
    let done = &outcomes.done;
    if done.len() > 1 {
        write_errors(&study.out, Path::new(""), &done.iter().collect::<Vec<_>>())?;
    }
    if global.json {
        let text = json(done);
        return study.print("personalize", &text, outcomes.failed);
    }
    let mut text = readable(done);
    text.push_str("\n\n");
    for results in done {
        let folder = study.out.path().join(&results.participant.id);
        text.push_str(&format!("{}\n{}\n", folder.join("model.osim").display(), folder.join("report.html").display()));
    }
    let text = text.trim_end().to_owned() + &next_steps::in_words(done, study.out.path());
    study.print("personalize", &text, outcomes.failed)
}

/// Fits a participant's parameters and writes the model, the results and the report into `folder` of the output.
///
/// # Errors
/// The participant's model and trials, the fit, or the disk.
pub fn personalize(
    study: &StudyRun,
    participant: &StudyParticipant<'_>,
    folder: &Path,
    request: &Personalize,
    bars: &Bars,
) -> Result<Results, Failure> {
    let session = participant.load()?.with_progress(bars);
    failure::print(&session.data.warnings);
    let fit = session.personalize_as(request, &folder.join("model.osim"))?;
    fit.write_to(&study.out, folder)?;
    Ok(fit.results)
}

/// What `--json` prints.
pub fn json(outcomes: &[Results]) -> String {
    serde_json::Value::Array(outcomes.iter().map(summary).collect()).to_string()
}

/// Errors before and after, and parameters on a bound, for a terminal.
pub fn readable(outcomes: &[Results]) -> String {
    let mut text = error_table(outcomes);
    for results in outcomes {
        if let Some(part) = results.part_of_the_way.filter(|part| *part < 1.0) {
            text.push_str(&format!(
                "\n\n{}: {:.0} % of the way from the given model to the fit, as left-out training trials are predicted \
                 best",
                results.participant.id,
                100.0 * part
            ));
        }
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
