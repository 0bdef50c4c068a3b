//! The ledger: every step that was taken, and which one is the current one.
//!
//! It is `live/ledger.json` in the folder of the steps. Steps are only ever added; walking back makes an earlier step
//! the current one, and the next step then has that one as its parent.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use carpus_session::diagnostic::{Diagnostic, Failure};
use carpus_session::json;
use carpus_session::output::OutputFolder;

/// Name and version of the form.
const SCHEMA: &str = "carpus.live/1";
/// The ledger in the folder of the steps.
pub(crate) const FILE: &str = "live/ledger.json";

/// Steps of work on a study.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Ledger {
    /// Name and version of the form.
    pub schema: String,
    /// The study as the commands name it.
    pub study: String,
    /// The study's file, wherever the commands were run.
    pub study_file: String,
    /// The current step; 0: the study as it is, before any step.
    pub current: usize,
    /// The steps, in the order in which they were taken; the first is step 1.
    pub steps: Vec<Step>,
}

/// A step: a command and what came of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Step {
    /// Its number, from 1.
    pub id: usize,
    /// The step that was the current one; 0: none.
    pub parent: usize,
    /// The command and what was chosen, in a few words.
    pub label: String,
    /// The command that wrote into the folder, as results name it (`effect`, not `effect add`).
    pub writer: String,
    /// What is read: words of the command for model, effects beside it, and participants.
    pub reads: Vec<String>,
    /// The step whose folder was copied before the command went on in it.
    pub copy_of: Option<usize>,
    /// The folder that the command was run in: paths in its words are relative to it.
    pub run_in: String,
    /// What gives the same folder, a line for a shell each.
    pub commands: Vec<String>,
    /// Its folder among the steps.
    pub folder: String,
    /// What came of it.
    pub outcome: Outcome,
    /// Its pages, by their paths among the steps.
    pub pages: Vec<String>,
    /// The models of the participants after this step, by participant.
    pub models: BTreeMap<String, StepModel>,
    /// What the command printed.
    pub said: String,
    /// Its messages.
    pub messages: Vec<String>,
}

/// A participant's model after a step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StepModel {
    /// The model file, by its path among the steps.
    pub model: String,
    /// Effects beside it.
    pub effects: Option<String>,
}

/// What came of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Outcome {
    /// It is under way.
    #[default]
    Running,
    /// All was done.
    Done,
    /// Some participants could not be done, or a part of the work.
    Partly,
    /// Nothing could be done.
    Failed,
    /// A person stopped it, or the server ended.
    Cancelled,
}

impl Outcome {
    /// Whether there are results to go on with.
    pub fn has_results(self) -> bool {
        matches!(self, Outcome::Done | Outcome::Partly)
    }
}

impl Ledger {
    /// The ledger in a folder, or an empty one. A step that was under way when the server ended was stopped.
    ///
    /// - `study`: as commands name it
    /// - `out`: the folder of the steps
    ///
    /// # Errors
    /// A ledger of another study, or one that cannot be read; a folder that holds other files.
    pub fn open(study: &str, study_file: &Path, out: &Path) -> Result<Ledger, Failure> {
        let study_file = study_file.canonicalize().unwrap_or_else(|_| study_file.to_owned()).display().to_string();
        let file = out.join(FILE);
        if !file.exists() {
            if !is_empty(out) {
                let text = "holds files that are not of carpus live";
                return Err(Diagnostic::error(text).in_file(out).hint("choose another folder with --out").into());
            }
            let (schema, study) = (SCHEMA.to_owned(), study.to_owned());
            return Ok(Ledger { schema, study, study_file, current: 0, steps: Vec::new() });
        }
        let unreadable = |text: String| Diagnostic::error(text).in_file(&file);
        let text = carpus_numerics::regular_file::read_text(&file)
            .map_err(|e| Failure::from(unreadable(format!("cannot be read: {e}"))))?;
        let mut ledger: Ledger = serde_json::from_str(&text)
            .map_err(|e| unreadable(format!("expected a ledger of carpus live: {e}")).at_line(e.line()))?;
        if ledger.schema != SCHEMA {
            return Err(unreadable(format!("expected the schema {SCHEMA}, found {}", ledger.schema)).into());
        }
        if ledger.study_file != study_file {
            let text = format!("is the ledger of another study, {}", ledger.study_file);
            return Err(unreadable(text).hint("choose another folder with --out").into());
        }
        if ledger.current > ledger.steps.len() || ledger.steps.iter().enumerate().any(|(i, s)| s.id != i + 1) {
            return Err(unreadable("expected steps numbered from 1 and one of them as current".to_owned()).into());
        }
        ledger.study = study.to_owned();
        for step in ledger.steps.iter_mut().filter(|step| step.outcome == Outcome::Running) {
            step.outcome = Outcome::Cancelled;
        }
        Ok(ledger)
    }

    /// Whether a folder of steps has a ledger.
    pub fn is_in(out: &Path) -> bool {
        out.join(FILE).exists()
    }

    /// A step by its number.
    pub fn step(&self, id: usize) -> Option<&Step> {
        self.steps.get(id.checked_sub(1)?)
    }

    /// The current step; `None`: the study as it is.
    pub fn now(&self) -> Option<&Step> {
        self.step(self.current)
    }

    /// Writes it.
    ///
    /// # Errors
    /// The disk.
    pub fn write(&self, out: &Path) -> Result<(), Failure> {
        let text = json::readable(self)? + "\n";
        OutputFolder::create(out, &[])?.put(FILE.as_ref(), text.as_bytes())?;
        Ok(())
    }
}

/// Whether a folder holds nothing. A file in its place, or a folder that cannot be read, is told when it is written to.
fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).map_or(true, |mut entries| entries.next().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reason(failure: &Failure) -> String {
        failure.to_string()
    }

    #[test]
    fn verif_a_ledger_is_read_again_and_belongs_to_one_study() {
        let place = tempfile::tempdir().unwrap();
        let (out, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::write(&study, "").unwrap();
        let mut ledger = Ledger::open("study.toml", &study, &out).unwrap();
        ledger.steps.push(Step { id: 1, outcome: Outcome::Running, ..Step::default() });
        ledger.steps.push(Step { id: 2, parent: 1, outcome: Outcome::Done, ..Step::default() });
        ledger.current = 2;
        ledger.write(&out).unwrap();
        let again = Ledger::open("study.toml", &study, &out).unwrap();
        assert_eq!(again.step(1).unwrap().outcome, Outcome::Cancelled, "the server ended meanwhile");
        assert_eq!(again.now().unwrap().parent, 1);
        let other = Ledger::open("other.toml", &place.path().join("other.toml"), &out).unwrap_err();
        assert!(reason(&other).contains("another study"), "{other}");
    }

    #[test]
    fn verif_other_files_and_broken_ledgers_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let (out, study) = (place.path().join("out"), place.path().join("study.toml"));
        std::fs::create_dir_all(out.join("live")).unwrap();
        std::fs::write(out.join("thesis.txt"), "mine").unwrap();
        let foreign = Ledger::open("study.toml", &study, &out).unwrap_err();
        assert!(reason(&foreign).contains("not of carpus live"), "{foreign}");
        std::fs::write(out.join(FILE), "{ \"schema\": 3").unwrap();
        let broken = Ledger::open("study.toml", &study, &out).unwrap_err();
        assert!(reason(&broken).contains("ledger.json:1"), "{broken}");
    }
}
