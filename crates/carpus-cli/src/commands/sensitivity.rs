//! `carpus sensitivity`: which muscle parameters the trials of each condition respond to.

use crate::args::{Global, SensitivityArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use crate::table::tables;
use carpus_session::screening::ScreeningOptions;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, a screening of which every run fails, or the output folder.
pub fn run(args: &SensitivityArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(&args.study, "sensitivity")?;
    let request = ScreeningOptions {
        starts: args.starts as usize,
        sobol: args.sobol.map(|n| n as usize),
        resamples: args.resamples as usize,
        seed: global.seed,
    };
    let found = study.study.sensitivity(&request, &Bars::new(global))?;
    let page = found.write_to(&study.out)?;
    let text = match global.json {
        true => found.value.to_string(),
        false => format!("{}\n\n{}", tables(&found.report.overview), page.display()),
    };
    study.print("sensitivity", &text, found.failed)
}
