//! Messages on stderr: as `error: file:line: text`, the line they are about, and a hint.

use std::io::{IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};

use carpus_numerics::printable::{visible, visible_lines};
pub use carpus_session::diagnostic::{Diagnostic, Failure, Severity};
use carpus_session::said::Said;

/// The message as it is printed: `error: file:line: text`, the line it is about, and the hint.
fn rendered(diagnostic: &Diagnostic, renderer: &Renderer) -> String {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    // A title is one line: what a lower layer wrote over several lines follows as it is.
    let text = visible_lines(&diagnostic.text);
    let mut lines = text.lines();
    let first = lines.next().unwrap_or_default();
    let title = match diagnostic.place() {
        Some(place) => format!("{}: {first}", visible(&place)),
        None => first.to_string(),
    };
    let source = diagnostic.source_line().map(|line| visible(&line).into_owned());
    let hint = diagnostic.hint.as_deref().map(visible_lines);
    let mut group =
        level.primary_title(title).elements(lines.map(|l| Level::NOTE.no_name().message(l.trim().to_string())));
    if let (Some(source), Some(line)) = (&source, diagnostic.line) {
        let snippet =
            Snippet::source(source.as_str()).line_start(line).annotation(AnnotationKind::Primary.span(0..source.len()));
        group = group.element(snippet);
    }
    if let Some(hint) = &hint {
        group = group.element(Level::HELP.with_name("hint").message(hint.as_ref()));
    }
    renderer.render(&[group])
}

/// How many messages of a kind are printed before the rest is only counted: a person mends the first few and asks
/// again.
const MAX_PRINTED: usize = carpus_study::study::MAX_LISTED;

/// Prints a line to stderr. Where nobody listens, or the disk is full, the work goes on: what was asked for are the
/// results.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Warnings that were printed.
static SAID: Mutex<Said> = Mutex::new(Said::new());

/// A lock whose holder panicked holds whole values all the same.
fn said() -> MutexGuard<'static, Said> {
    SAID.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is printed from now on is about this participant: a warning that differs from an earlier one in the name alone
/// is not printed again.
pub fn about(participant: &str) {
    said().about(Some(participant));
}

/// Says for which participants, too, warnings hold that were printed for the first of them.
pub fn account() {
    let lines = said().account();
    let warnings: Vec<Diagnostic> = lines.into_iter().map(Diagnostic::warning).collect();
    print(&warnings);
}

/// Prints messages to stderr, the gravest last, where the eye is.
pub fn print(messages: &[Diagnostic]) {
    let styled = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let renderer = if styled { Renderer::styled() } else { Renderer::plain() };
    for (severity, name) in [(Severity::Warning, "warning"), (Severity::Error, "error")] {
        let mut of_kind: Vec<&Diagnostic> = Vec::new();
        for message in messages.iter().filter(|m| m.severity == severity) {
            // Participants share tables and models: what is wrong with these is said once.
            let is_new = severity == Severity::Error || said().is_new(message);
            if is_new && !of_kind.contains(&message) {
                of_kind.push(message);
            }
        }
        for message in of_kind.iter().take(MAX_PRINTED) {
            say(&rendered(message, &renderer));
        }
        if let Some(rest) = of_kind.len().checked_sub(MAX_PRINTED).filter(|n| *n > 0) {
            say(&format!("… and {rest} more {name}{}", if rest == 1 { "" } else { "s" }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_message_shows_place_line_and_hint() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.osim");
        std::fs::write(&file, "<a>\n\t<b>nine</b>\n</a>\n").unwrap();
        let message = Diagnostic::error("b is text").in_file(&file).at_line(2).hint("write 9");
        let text = rendered(&message, &Renderer::plain());
        assert!(text.starts_with(&format!("error: {}:2: b is text", file.display())), "{text}");
        assert!(text.contains("2 | <b>nine</b>") && text.contains("hint: write 9"), "{text}");
    }
}
