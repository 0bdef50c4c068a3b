//! What can be wrong with a study, where it stands, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

use super::fault::Fault;

/// How many problems [`StudyErrors`] prints before it only counts the rest: a person mends the first few and asks
/// again.
pub const MAX_LISTED: usize = 10;

/// Whether a study can be used in spite of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The study cannot be used until this is put right.
    Error,
    /// The study can be used; a person should look.
    Warning,
}

/// One finding: where it stands and what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Whether the study can be used in spite of it.
    pub severity: Severity,
    /// The file it stands in.
    pub file: PathBuf,
    /// Line, counted from 1; `None` if it concerns the file as a whole.
    pub line: Option<usize>,
    /// What is wrong.
    pub fault: Fault,
}

impl Problem {
    /// An error at a line of a file.
    pub fn error(file: &Path, line: impl Into<Option<usize>>, fault: Fault) -> Self {
        Self { severity: Severity::Error, file: file.to_owned(), line: line.into(), fault }
    }

    /// A warning at a line of a file.
    pub fn warning(file: &Path, line: impl Into<Option<usize>>, fault: Fault) -> Self {
        Self { severity: Severity::Warning, file: file.to_owned(), line: line.into(), fault }
    }

    /// Says of a file's problems which of its tables they are in.
    pub(crate) fn set_table(problems: &mut [Problem], file: &Path, table: Option<&str>) {
        let Some(table) = table else { return };
        for problem in problems.iter_mut().filter(|problem| problem.file == file) {
            problem.file = PathBuf::from(format!("{} [{table}]", file.display()));
        }
    }

    /// What to do about it, if there is something more to say than the message says.
    pub fn hint(&self) -> Option<String> {
        self.fault.hint()
    }
}

impl fmt::Display for Problem {
    /// `file:line: what` and, on a second line, `  hint: …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        if self.severity == Severity::Warning {
            write!(f, " warning:")?;
        }
        write!(f, " {}", self.fault)?;
        if let Some(hint) = self.hint() {
            write!(f, "\n  hint: {hint}")?;
        }
        Ok(())
    }
}

impl serde::Serialize for Problem {
    /// `{severity, file, line, message, hint}`.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut fields = serializer.serialize_struct("Problem", 5)?;
        fields.serialize_field("severity", &self.severity)?;
        fields.serialize_field("file", &self.file.to_string_lossy())?;
        fields.serialize_field("line", &self.line)?;
        fields.serialize_field("message", &self.fault.to_string())?;
        fields.serialize_field("hint", &self.hint())?;
        fields.end()
    }
}

/// Why a study cannot be used: every error found, and the warnings found on the way.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct StudyErrors {
    /// The errors, in order of file reading; never empty when returned from a reader.
    pub errors: Vec<Problem>,
    /// Warnings found before reading stopped.
    pub warnings: Vec<Problem>,
}

impl StudyErrors {
    /// Splits a list of findings; `Ok(warnings)` if none of them is an error.
    pub(crate) fn settle(problems: Vec<Problem>) -> Result<Vec<Problem>, StudyErrors> {
        let (errors, warnings): (Vec<_>, Vec<_>) = problems.into_iter().partition(|p| p.severity == Severity::Error);
        if errors.is_empty() { Ok(warnings) } else { Err(StudyErrors { errors, warnings }) }
    }
}

impl fmt::Display for StudyErrors {
    /// Up to [`MAX_LISTED`] errors, one below the other, then the count of the others.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.errors.iter().take(MAX_LISTED).enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{problem}")?;
        }
        match self.errors.len().saturating_sub(MAX_LISTED) {
            0 => Ok(()),
            1 => write!(f, "\n… and 1 further error"),
            rest => write!(f, "\n… and {rest} further errors"),
        }
    }
}

impl std::error::Error for StudyErrors {}
