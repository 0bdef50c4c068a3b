//! `carpus personalize`: fitted muscle parameters, the model that has them, errors before and after.

use std::path::Path;

use crate::args::{Global, PersonalizeArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::next_steps;
use crate::study_run::StudyRun;
use crate::table::tables;
use carpus_report::results::Results;
use carpus_session::loading::Purpose;
use carpus_session::participant::Session;
use carpus_session::personalize::{Personalize, remarks};
use carpus_session::result_files::{summaries, write_errors_of_all};
use carpus_session::text_tables::of_errors;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &PersonalizeArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "personalize")?;
    let request = Personalize { seed: global.seed, intervals: !args.no_intervals };
    let bars = Bars::new(global);
    let outcomes = study.each("personalizing", Purpose::Simulation, &bars, |session, folder| {
        personalize(&study, session, folder, &request)
    })?;
    let done = &outcomes.done;
    write_errors_of_all(&study.out, done)?;
    if global.json {
        return study.print("personalize", &summaries(done), outcomes.failed);
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
    session: &Session<'_>,
    folder: &Path,
    request: &Personalize,
) -> Result<Results, Failure> {
    let fit = session.personalize_as(request, &folder.join("model.osim"))?;
    fit.write_to(&study.out, folder)?;
    Ok(fit.results)
}

/// Errors before and after, and what a person should know of the parameters, for a terminal.
pub fn readable(outcomes: &[Results]) -> String {
    let remarks = outcomes.iter().flat_map(remarks);
    std::iter::once(tables(&[of_errors(outcomes)])).chain(remarks).collect::<Vec<_>>().join("\n\n")
}
