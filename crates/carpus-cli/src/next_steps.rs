//! What to do next, at the end of what a command prints.

use std::path::Path;

use carpus_report::next_steps::{NextStep, next_steps};
use carpus_report::results::Results;

/// Most actions that are printed.
const MOST: usize = 3;

/// The actions of all participants, each once.
///
/// - `out`: the command's output folder
pub fn in_words<'r>(results: impl IntoIterator<Item = &'r Results>, out: &Path) -> String {
    let mut steps: Vec<NextStep> = Vec::new();
    for results in results {
        let folder = format!("{}{}", out.join(&results.participant.id).display(), std::path::MAIN_SEPARATOR);
        let new: Vec<NextStep> =
            next_steps(results, &folder).into_iter().filter(|step| !steps.contains(step)).collect();
        steps.extend(new);
    }
    if steps.is_empty() {
        return String::new();
    }
    let line = |(i, step): (usize, &NextStep)| {
        let command = step.command.as_ref().map(|c| format!("\n   {c}")).unwrap_or_default();
        format!("\n{}. {}{command}", i + 1, step.what)
    };
    let lines: String = steps.iter().take(MOST).enumerate().map(line).collect();
    format!("\n\nDo this next{lines}")
}
