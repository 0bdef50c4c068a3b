//! What went wrong, for people: where, what, and what to do about it.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};

use super::said::Said;
use crate::printable::{visible, visible_lines};

/// Why a command could not do its work.
#[derive(Debug)]
pub enum Failure {
    /// The input is at fault: exit code 1.
    Input(Vec<Message>),
    /// This program is at fault: exit code 2.
    Internal(String),
}

/// How grave a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gravity {
    /// Nothing was done.
    Error,
    /// It was done; a person should look.
    Warning,
}

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// How grave.
    pub gravity: Gravity,
    /// File that it is about.
    pub file: Option<PathBuf>,
    /// Line in the file, counted from 1.
    pub line: Option<usize>,
    /// What is wrong.
    pub text: String,
    /// What to do.
    pub hint: Option<String>,
}

impl Message {
    /// An error that concerns no file.
    pub fn error(text: impl Into<String>) -> Message {
        Message { gravity: Gravity::Error, file: None, line: None, text: text.into(), hint: None }
    }

    /// A warning that concerns no file.
    pub fn warning(text: impl Into<String>) -> Message {
        Message { gravity: Gravity::Warning, ..Message::error(text) }
    }

    /// The same message, about a file.
    pub fn in_file(self, file: &Path) -> Message {
        Message { file: Some(file.to_owned()), ..self }
    }

    /// The same message, about a line; 0 stands for no line.
    pub fn at_line(self, line: impl Into<Option<usize>>) -> Message {
        Message { line: line.into().filter(|l| *l > 0), ..self }
    }

    /// The same message with a hint.
    pub fn hint(self, hint: impl Into<String>) -> Message {
        Message { hint: Some(hint.into()), ..self }
    }

    /// `file:line`, as far as it is known.
    pub fn place(&self) -> Option<String> {
        let file = self.file.as_ref()?.display();
        Some(match self.line {
            Some(line) => format!("{file}:{line}"),
            None => file.to_string(),
        })
    }

    /// The message as it is printed: `error: file:line: text`, the line it is about, and the hint.
    fn rendered(&self, renderer: &Renderer) -> String {
        let level = match self.gravity {
            Gravity::Error => Level::ERROR,
            Gravity::Warning => Level::WARNING,
        };
        // A title is one line: what a lower layer wrote over several lines follows as it is.
        let text = visible_lines(&self.text);
        let mut lines = text.lines();
        let first = lines.next().unwrap_or_default();
        let title = match self.place() {
            Some(place) => format!("{}: {first}", visible(&place)),
            None => first.to_string(),
        };
        let source = self.source_line().map(|line| visible(&line).into_owned());
        let hint = self.hint.as_deref().map(visible_lines);
        let mut group =
            level.primary_title(title).elements(lines.map(|l| Level::NOTE.no_name().message(l.trim().to_string())));
        if let (Some(source), Some(line)) = (&source, self.line) {
            let snippet = Snippet::source(source.as_str())
                .line_start(line)
                .annotation(AnnotationKind::Primary.span(0..source.len()));
            group = group.element(snippet);
        }
        if let Some(hint) = &hint {
            group = group.element(Level::HELP.with_name("hint").message(hint.as_ref()));
        }
        renderer.render(&[group])
    }

    /// The line of an `.osim` file that the message is about, if it is short enough to show.
    fn source_line(&self) -> Option<String> {
        const LONGEST_SHOWN: usize = 160;
        let file = self.file.as_ref()?;
        if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("osim")) {
            return None;
        }
        let text = crate::regular_file::read(file).ok()?;
        let line = text.split(|b| *b == b'\n').nth(self.line?.checked_sub(1)?)?;
        let line = String::from_utf8_lossy(line).replace('\t', "  ");
        let line = line.trim();
        (!line.is_empty() && line.len() <= LONGEST_SHOWN).then(|| line.to_string())
    }
}

impl From<Message> for Failure {
    fn from(message: Message) -> Failure {
        Failure::Input(vec![message])
    }
}

impl From<Vec<Message>> for Failure {
    fn from(messages: Vec<Message>) -> Failure {
        Failure::Input(messages)
    }
}

impl From<&crate::study::Problem> for Message {
    fn from(problem: &crate::study::Problem) -> Message {
        let gravity = match problem.severity {
            crate::study::Severity::Error => Gravity::Error,
            crate::study::Severity::Warning => Gravity::Warning,
        };
        Message {
            gravity,
            file: Some(problem.file.clone()),
            line: problem.line,
            text: problem.fault.to_string(),
            hint: problem.hint(),
        }
    }
}

impl From<crate::study::StudyErrors> for Failure {
    fn from(errors: crate::study::StudyErrors) -> Failure {
        Failure::Input(errors.warnings.iter().chain(&errors.errors).map(Message::from).collect())
    }
}

/// How many messages of a kind are printed before the rest is only counted: a person mends the first few and asks again.
const MAX_PRINTED: usize = crate::study::MAX_LISTED;

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

/// What is printed from now on is about this participant: a warning that differs from an earlier one in the name alone is not
/// printed again.
pub fn about(participant: &str) {
    said().about(Some(participant));
}

/// Says for which participants, too, warnings hold that were printed for the first of them.
pub fn account() {
    let lines = said().account();
    let warnings: Vec<Message> = lines.into_iter().map(Message::warning).collect();
    print(&warnings);
}

/// Prints messages to stderr, the gravest last, where the eye is.
pub fn print(messages: &[Message]) {
    let styled = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let renderer = if styled { Renderer::styled() } else { Renderer::plain() };
    for (gravity, name) in [(Gravity::Warning, "warning"), (Gravity::Error, "error")] {
        let mut of_kind: Vec<&Message> = Vec::new();
        for message in messages.iter().filter(|m| m.gravity == gravity) {
            // Participants share tables and models: what is wrong with these is said once.
            let is_new = gravity == Gravity::Error || said().is_new(message);
            if is_new && !of_kind.contains(&message) {
                of_kind.push(message);
            }
        }
        for message in of_kind.iter().take(MAX_PRINTED) {
            say(&message.rendered(&renderer));
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
        let message = Message::error("b is text").in_file(&file).at_line(2).hint("write 9");
        let text = message.rendered(&Renderer::plain());
        assert!(text.starts_with(&format!("error: {}:2: b is text", file.display())), "{text}");
        assert!(text.contains("2 | <b>nine</b>") && text.contains("hint: write 9"), "{text}");
    }

    #[test]
    fn verif_line_zero_is_no_line() {
        let message = Message::error("x").in_file(Path::new("m.osim")).at_line(0);
        assert_eq!(message.place().as_deref(), Some("m.osim"));
    }
}
