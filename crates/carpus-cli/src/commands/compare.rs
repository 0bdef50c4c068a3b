//! `carpus compare`: simulated against measured moments, errors per trial and per condition.

use crate::args::{Global, StudyWithEffects};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::next_steps;
use crate::study_run::StudyRun;
use crate::table::tables;
use carpus_session::compare::Compare;
use carpus_session::loading::Purpose;
use carpus_session::result_files::{summaries, write_errors_of_all};
use carpus_session::text_tables::{of_errors, where_it_fails};

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &StudyWithEffects, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, &args.effects, "compare")?;
    let outcomes = study.each("comparing", Purpose::Simulation, &Bars::new(global), |session, folder| {
        let comparison = session.compare(&Compare { seed: global.seed })?;
        comparison.write_to(&study.out, folder)?;
        Ok(comparison.results)
    })?;
    let done = &outcomes.done;
    write_errors_of_all(&study.out, done)?;
    if global.json {
        return study.print("compare", &summaries(done), outcomes.failed);
    }
    let failing: Vec<_> = done.iter().filter_map(where_it_fails).collect();
    let mut text = tables(&[of_errors(done)]);
    if !failing.is_empty() {
        text.push_str(&format!("\n\n{}", tables(&failing)));
    }
    text.push_str("\n\n");
    for results in done {
        text.push_str(&format!("{}\n", study.report_of(&results.participant.id)));
    }
    let text = text.trim_end().to_owned() + &next_steps::in_words(done, study.out.path());
    study.print("compare", &text, outcomes.failed)
}
