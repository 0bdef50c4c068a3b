//! `carpus units`: which parts of a study several machines have done.

use crate::args::{Global, UnitsArgs};
use crate::failure::Failure;
use crate::stdout::print_result;
use crate::table::table;
use carpus_session::json;
use carpus_session::shared_work::{SharedWork, StepUnits, TaskShown};
use carpus_session::task::TaskState;

/// Reasons that are shown of a task.
const REASONS: usize = 3;

/// Runs the command.
///
/// # Errors
/// The folder holds no units.
pub fn run(args: &UnitsArgs, global: &Global) -> Result<(), Failure> {
    let found = SharedWork::of(&args.folder)?;
    if global.json {
        return print_result(&json::line(&found)?);
    }
    let mut text = String::new();
    if !found.tasks.is_empty() {
        let header = ["task", "machine", "process", "state", "units", "could not be done"];
        text.push_str(&format!("{}\n\n", table(&header, 2, found.tasks.iter().map(task_row))));
    }
    let of_step = |(step, participants): (&String, &std::collections::BTreeMap<String, StepUnits>)| {
        participants.iter().map(|(participant, u)| step_row(step, participant, u)).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<String>> = found.units.iter().flat_map(of_step).collect();
    text.push_str(&table(&["step", "participant", "finished", "missing", "damaged"], 2, rows));
    text.push_str(&found.notes.iter().map(|note| format!("\n\n{note}")).collect::<String>());
    print_result(&(text + "\n"))
}

fn task_row(shown: &TaskShown) -> Vec<String> {
    let TaskShown { record, gone } = shown;
    let state = match record.state {
        TaskState::Begun if *gone => "killed",
        TaskState::Begun => "begun",
        TaskState::Finished => "finished",
        TaskState::Failed => "failed",
    };
    let mut reasons: Vec<String> = record.failed.iter().take(REASONS).cloned().collect();
    if record.failed.len() > REASONS {
        reasons.push(format!("and {} more", record.failed.len() - REASONS));
    }
    vec![
        record.task.clone(),
        record.host.clone(),
        record.process.to_string(),
        state.to_owned(),
        record.units.len().to_string(),
        reasons.join("\n"),
    ]
}

fn step_row(step: &str, participant: &str, units: &StepUnits) -> Vec<String> {
    let counts = [units.finished, units.missing, units.damaged].map(|n| n.to_string());
    [step.to_owned(), participant.to_owned()].into_iter().chain(counts).collect()
}
