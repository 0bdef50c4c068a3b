//! What went wrong, for people: where, what, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use carpus_study::study::Severity;

/// Longest line of a file that is shown with a message.
const LONGEST_SHOWN: usize = 160;

/// Why work could not be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The input is at fault: its errors, and warnings found on the way.
    Input(Vec<Diagnostic>),
    /// This program is at fault.
    Internal(String),
    /// The caller asked to stop ([`super::progress::Progress::is_cancelled`]).
    Cancelled,
}

impl fmt::Display for Failure {
    /// One diagnostic below the other.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Input(diagnostics) => {
                for (i, diagnostic) in diagnostics.iter().enumerate() {
                    write!(f, "{}{diagnostic}", if i == 0 { "" } else { "\n" })?;
                }
                Ok(())
            }
            Failure::Internal(what) => write!(f, "internal error: {what}"),
            Failure::Cancelled => f.write_str("stopped on request"),
        }
    }
}

impl std::error::Error for Failure {}

/// One finding for a person: where, what, what to do about it, and whether work goes on in spite of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// Whether the work can be done in spite of it.
    pub severity: Severity,
    /// File that it is about.
    pub file: Option<PathBuf>,
    /// Line in the file, counted from 1.
    pub line: Option<usize>,
    /// What is wrong.
    pub text: String,
    /// What to do.
    pub hint: Option<String>,
}

impl Diagnostic {
    /// An error that concerns no file.
    pub fn error(text: impl Into<String>) -> Diagnostic {
        Diagnostic { severity: Severity::Error, file: None, line: None, text: text.into(), hint: None }
    }

    /// A warning that concerns no file.
    pub fn warning(text: impl Into<String>) -> Diagnostic {
        Diagnostic { severity: Severity::Warning, ..Diagnostic::error(text) }
    }

    /// The same message, about a file.
    pub fn in_file(self, file: &Path) -> Diagnostic {
        Diagnostic { file: Some(file.to_owned()), ..self }
    }

    /// The same message, about a line; 0 stands for no line.
    pub fn at_line(self, line: impl Into<Option<usize>>) -> Diagnostic {
        Diagnostic { line: line.into().filter(|l| *l > 0), ..self }
    }

    /// The same message with a hint.
    pub fn hint(self, hint: impl Into<String>) -> Diagnostic {
        Diagnostic { hint: Some(hint.into()), ..self }
    }

    /// `file:line`, as far as it is known.
    pub fn place(&self) -> Option<String> {
        let file = self.file.as_ref()?.display();
        Some(match self.line {
            Some(line) => format!("{file}:{line}"),
            None => file.to_string(),
        })
    }

    /// The line of an `.osim` file that the message is about, if it is short enough to show.
    pub fn source_line(&self) -> Option<String> {
        let file = self.file.as_ref()?;
        if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("osim")) {
            return None;
        }
        let text = carpus_numerics::regular_file::read(file).ok()?;
        let line = text.split(|b| *b == b'\n').nth(self.line?.checked_sub(1)?)?;
        let line = String::from_utf8_lossy(line).replace('\t', "  ");
        let line = line.trim();
        (!line.is_empty() && line.len() <= LONGEST_SHOWN).then(|| line.to_string())
    }
}

impl fmt::Display for Diagnostic {
    /// `error: file:line: text` and, on a second line, `  hint: …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write!(f, "{severity}: ")?;
        if let Some(place) = self.place() {
            write!(f, "{place}: ")?;
        }
        f.write_str(&self.text)?;
        match &self.hint {
            Some(hint) => write!(f, "\n  hint: {hint}"),
            None => Ok(()),
        }
    }
}

impl From<Diagnostic> for Failure {
    fn from(message: Diagnostic) -> Failure {
        Failure::Input(vec![message])
    }
}

impl From<Vec<Diagnostic>> for Failure {
    fn from(messages: Vec<Diagnostic>) -> Failure {
        Failure::Input(messages)
    }
}

impl From<&carpus_study::study::Problem> for Diagnostic {
    fn from(problem: &carpus_study::study::Problem) -> Diagnostic {
        Diagnostic {
            severity: problem.severity,
            file: Some(problem.file.clone()),
            line: problem.line,
            text: problem.fault.to_string(),
            hint: problem.hint(),
        }
    }
}

impl From<carpus_study::study::StudyErrors> for Failure {
    fn from(errors: carpus_study::study::StudyErrors) -> Failure {
        Failure::Input(errors.warnings.iter().chain(&errors.errors).map(Diagnostic::from).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_line_zero_is_no_line() {
        let diagnostic = Diagnostic::error("x").in_file(Path::new("m.osim")).at_line(0);
        assert_eq!(diagnostic.place().as_deref(), Some("m.osim"));
    }

    #[test]
    fn verif_failure_shows_every_diagnostic_with_place_and_hint() {
        let first = Diagnostic::warning("odd").in_file(Path::new("a.csv")).at_line(3);
        let failure = Failure::from(vec![first, Diagnostic::error("wrong").hint("mend it")]);
        assert_eq!(failure.to_string(), "warning: a.csv:3: odd\nerror: wrong\n  hint: mend it");
    }
}
