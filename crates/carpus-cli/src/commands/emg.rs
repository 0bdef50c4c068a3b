//! `carpus emg`: raw EMG to normalized EMG, with checks and plots.

use std::path::Path;

use crate::args::{Global, StudyArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::study_run::StudyRun;
use crate::table::table;
use carpus_session::emg::{COLUMNS, Emg, ParticipantEmg, rows};

/// Runs the command.
///
/// # Errors
/// A study whose EMG is normalized already, its trials, or the output folder.
pub fn run(args: &StudyArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare(args, "emg")?;
    let done = study.study.emg(&Emg { seed: global.seed }, &study.out, &Bars::new(global))?;
    let text = if global.json { done.value.to_string() } else { readable(&done.participants, study.out.path()) };
    study.print("emg", &text, done.failed)
}

fn readable(outcomes: &[ParticipantEmg], folder: &Path) -> String {
    let mut text = table(&COLUMNS, 3, rows(outcomes));
    text.push_str("\n\n");
    for outcome in outcomes {
        text.push_str(&format!("{}\n", folder.join(&outcome.participant).join("report.html").display()));
    }
    text
}
