//! `carpus simulate`: moments, fibre lengths and forces of every trial over time.

use std::path::Path;

use crate::args::{Global, SimulateArgs};
use crate::bars::Bars;
use crate::failure::{self, Failure};
use crate::study_run::StudyRun;
use carpus_session::result_files::summary;
use carpus_session::simulate::Simulate;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &SimulateArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "simulate")?;
    let bars = Bars::new(global);
    let outcomes = study.each("simulating", &bars, |participant| {
        let session = participant.load()?;
        failure::print(&session.data.warnings);
        let simulated = session.simulate(&Simulate { seed: global.seed })?;
        simulated.write_to(&study.out, Path::new(&participant.about().name))?;
        Ok(simulated.results)
    })?;
    if global.json {
        let text = serde_json::Value::Array(outcomes.done.iter().map(summary).collect()).to_string();
        return study.print("simulate", &text, outcomes.failed);
    }
    let lines = outcomes.done.iter().map(|r| {
        let report = study.out.path().join(&r.participant.id).join("report.html");
        format!("{}: {} trials simulated, {}\n", r.participant.id, r.trials.len(), report.display())
    });
    let text = lines.collect::<String>();
    study.print("simulate", &text, outcomes.failed)
}
