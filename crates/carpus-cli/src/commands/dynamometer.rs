//! `carpus dynamometer`: recordings filtered, corrected, cut and aligned, as a new study.

use std::path::Path;

use crate::args::{Global, StudyArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use crate::table::table;
use carpus_session::dynamometer::{COLUMNS, ParticipantProcessing, Processing, rows};

/// Runs the command.
///
/// # Errors
/// The study, its recordings, or the output folder.
pub fn run(args: &StudyArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(args, "dynamometer")?;
    let request = Processing { seed: global.seed };
    let done = study.study.process_recordings(&request, &study.out, &Bars::new(global))?;
    let text = if global.json { done.value.to_string() } else { readable(&done.participants, study.out.path()) };
    study.print("dynamometer", &text, done.failed)
}

fn readable(outcomes: &[ParticipantProcessing], folder: &Path) -> String {
    let mut text = table(&COLUMNS, 1, rows(outcomes));
    text.push_str(&format!("\n\nprocessed study  {}\n", folder.join("study.toml").display()));
    for outcome in outcomes {
        let report = folder.join("reports").join(format!("{}.html", outcome.participant));
        text.push_str(&format!("report           {}\n", report.display()));
    }
    text
}
