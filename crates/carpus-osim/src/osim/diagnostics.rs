//! What was made of a file: understood, approximated, ignored, unsupported, by line and object path.
//!
//! Three things are kept apart: *unknown* (OpenSim does not know it either; a warning), *unsupported* (OpenSim would
//! compute with it, this program does not) and *invalid* (an [`super::error::Problem`], which stops reading).

use std::collections::BTreeMap;

use serde::Serialize;

/// What happened to a part of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Used in another way than OpenSim does, or changed as OpenSim changes it on reading.
    Approximated,
    /// Kept in the file, without influence on motion, forces or moments (appearance, probes, credits).
    Ignored,
    /// Would change motion or forces in OpenSim; not computed here.
    Unsupported,
    /// Probably not what the author meant.
    Warning,
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// What happened.
    pub severity: Severity,
    /// Line in the file, counted from 1.
    pub line: usize,
    /// Absolute path of the component.
    pub path: String,
    /// What was found.
    pub message: String,
    /// What to do about it.
    pub hint: Option<String>,
    /// Further lines where the same was found (ignored elements are listed once per tag).
    pub also_at: Vec<usize>,
}

/// All findings of one file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Diagnostics {
    /// Number of components understood, by OpenSim class.
    pub understood: BTreeMap<String, usize>,
    /// Findings in the order of the file.
    pub items: Vec<Diagnostic>,
}

impl Diagnostics {
    /// Findings of one severity.
    pub fn of(&self, severity: Severity) -> impl Iterator<Item = &Diagnostic> {
        self.items.iter().filter(move |item| item.severity == severity)
    }

    /// Whether something was found that OpenSim would compute with and this program does not.
    pub fn has_unsupported(&self) -> bool {
        self.of(Severity::Unsupported).next().is_some()
    }

    pub(super) fn understood(&mut self, class: &str) {
        *self.understood.entry(class.to_owned()).or_default() += 1;
    }

    pub(super) fn sort(&mut self) {
        self.items.sort_by_key(|item| item.line);
    }
}
