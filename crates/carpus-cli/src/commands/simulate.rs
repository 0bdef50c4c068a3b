//! `carpus simulate`: moments, fibre lengths and forces of every trial over time.

use crate::args::{Global, StudyWithEffects};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use carpus_session::loading::Purpose;
use carpus_session::result_files::summaries;
use carpus_session::simulate::Simulate;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &StudyWithEffects, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, &args.effects, "simulate")?;
    let outcomes = study.each("simulating", Purpose::Simulation, &Bars::new(global), |session, folder| {
        let simulated = session.simulate(&Simulate { seed: global.seed })?;
        simulated.write_to(&study.out, folder)?;
        Ok(simulated.results)
    })?;
    if global.json {
        return study.print("simulate", &summaries(&outcomes.done), outcomes.failed);
    }
    let lines = outcomes.done.iter().map(|r| {
        format!("{}: {} trials simulated, {}\n", r.participant.id, r.trials.len(), study.report_of(&r.participant.id))
    });
    let text = lines.collect::<String>();
    study.print("simulate", &text, outcomes.failed)
}
