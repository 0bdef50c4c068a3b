//! `carpus evaluate`: every model on every held-out condition, over participants.

use crate::args::{EvaluateArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use crate::table::tables;
use carpus_session::evaluate::Evaluate;

/// Runs the command.
///
/// # Errors
/// The study, its trials, the models, or the output folder.
pub fn run(args: &EvaluateArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "evaluate")?;
    let request = Evaluate { models: args.models.clone(), seed: global.seed };
    let found = study.study.evaluate(&request, &Bars::new(global))?;
    let page = found.write_to(&study.out)?;
    let text = if global.json {
        found.value(&page).to_string()
    } else {
        format!("{}\n\n{}", tables(&found.report.overview), page.display())
    };
    study.print("evaluate", &text, found.failed)
}
