//! What to do next, at the end of what a command prints.

use std::path::Path;

use carpus_report::next_steps::{NextStep, next_steps_of_all};
use carpus_report::results::Results;

/// The actions of all participants, each once.
///
/// - `out`: the command's output folder
pub fn in_words<'r>(results: impl IntoIterator<Item = &'r Results>, out: &Path) -> String {
    listed(&next_steps_of_all(results, out))
}

/// Actions, below what was printed before; nothing of none.
pub fn listed(steps: &[NextStep]) -> String {
    let line = |(i, step): (usize, &NextStep)| {
        let command = step.command.as_ref().map(|c| format!("\n   {c}")).unwrap_or_default();
        format!("\n{}. {}{command}", i + 1, step.what)
    };
    let lines: String = steps.iter().enumerate().map(line).collect();
    if lines.is_empty() { lines } else { format!("\n\nDo this next{lines}") }
}
