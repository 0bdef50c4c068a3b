//! A part of a study's work, for one of several machines that share a folder: each does the participants of its task
//! and stores their units; a run of the whole study then finds them finished.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::diagnostic::{Diagnostic, Failure};
use crate::output::OutputFolder;

/// Folder of the records in that of the results.
pub const FOLDER: &str = "tasks";
pub(super) const SCHEMA: &str = "carpus.task/1";
/// Begins the one argument of a task that no command asked for.
pub(super) const LIBRARY: &str = "library: ";
/// Most tasks that work is divided into.
const MOST_TASKS: usize = 1_000_000;

/// What a program asks of all tasks, in place of the arguments of a command.
pub fn asked_by_program(request: &impl fmt::Debug) -> Vec<String> {
    vec![format!("{LIBRARY}{request:?}")]
}

/// The I-th of N parts of the work: every N-th participant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Task {
    number: usize,
    of: usize,
}

impl FromStr for Task {
    type Err = String;

    fn from_str(text: &str) -> Result<Task, String> {
        let read = |text: &str| text.trim().parse::<usize>().ok();
        let parts = text.split_once('/').and_then(|(number, of)| Some([read(number)?, read(of)?]));
        match parts {
            Some([number, of]) if (1..=of).contains(&number) && of <= MOST_TASKS => Ok(Task { number, of }),
            _ => Err("expected I/N, the I-th of N tasks, such as 2/5".to_owned()),
        }
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl Task {
    /// Tasks of one division stand beside each other, in the order of their numbers.
    pub(super) fn order(self) -> (usize, usize) {
        (self.of, self.number)
    }

    /// Whether it does the participant at a place.
    pub fn has(self, place: usize) -> bool {
        place % self.of == self.number - 1
    }
}

/// How far a task is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskState {
    /// It has begun; whether it still runs only its machine knows.
    Begun,
    /// All its units are finished.
    Finished,
    /// It has ended, and some units could not be done.
    Failed,
}

/// What a task says of itself in the shared folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TaskRecord {
    /// `carpus.task/1`.
    pub schema: String,
    /// I/N.
    pub task: String,
    /// The machine.
    pub host: String,
    /// Its number of the process.
    pub process: u32,
    /// What was asked, without the task: the command whose results these are.
    pub arguments: Vec<String>,
    /// The folder that paths among these are relative to.
    pub directory: PathBuf,
    /// How far it is.
    pub state: TaskState,
    /// Places of its units, as far as they are known.
    pub units: Vec<String>,
    /// Why some could not be done.
    pub failed: Vec<String>,
    /// A process that was at the same task when this one began: `process N on HOST`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<String>,
}

/// What came of a task.
#[derive(Clone, Debug)]
pub struct TaskDone {
    /// As it stands in the folder.
    pub record: TaskRecord,
    /// Units that an earlier run had finished.
    pub units_found_finished: usize,
    /// Units that were computed.
    pub units_computed: usize,
    /// What could not be done.
    pub failed: Vec<Diagnostic>,
}

impl TaskRecord {
    /// The record in a file; `None` if there is none that is whole.
    pub(super) fn read(file: &Path) -> Option<TaskRecord> {
        let text = carpus_numerics::regular_file::read_text(file).ok()?;
        serde_json::from_str::<TaskRecord>(&text).ok().filter(|record| record.schema == SCHEMA)
    }

    /// Whether its process has gone from this machine without an end; of another machine that is not known.
    pub fn is_gone(&self) -> bool {
        self.state == TaskState::Begun && self.host == host() && !is_alive(self.process)
    }

    /// Whether it may be running on another machine, which alone knows.
    pub fn is_elsewhere(&self) -> bool {
        self.state == TaskState::Begun && self.host != host()
    }

    /// The process, if it has begun and is not known to have gone.
    pub fn who_is_at_it(&self) -> Option<String> {
        let is_at_it = self.state == TaskState::Begun && !self.is_gone();
        is_at_it.then(|| format!("process {} on {}", self.process, self.host))
    }
}

/// Keeps the record of a task up to date.
pub struct Recorder<'o> {
    out: &'o OutputFolder,
    file: PathBuf,
    pub(super) record: TaskRecord,
}

impl<'o> Recorder<'o> {
    /// The task has begun.
    ///
    /// # Errors
    /// The disk.
    pub fn begin(out: &'o OutputFolder, task: Task, arguments: &[String]) -> Result<Recorder<'o>, Failure> {
        let file = Path::new(FOLDER).join(format!("{}-of-{}.json", task.number, task.of));
        let record = TaskRecord {
            schema: SCHEMA.to_owned(),
            task: task.to_string(),
            host: host(),
            process: std::process::id(),
            arguments: arguments.to_vec(),
            directory: std::env::current_dir().unwrap_or_default(),
            state: TaskState::Begun,
            units: Vec::new(),
            failed: Vec::new(),
            beside: TaskRecord::read(&out.path().join(&file)).and_then(|earlier| earlier.who_is_at_it()),
        };
        let recorder = Recorder { out, file, record };
        recorder.put()?;
        Ok(recorder)
    }

    /// Further units are known.
    ///
    /// # Errors
    /// The disk.
    pub fn plan<'u>(&mut self, places: impl Iterator<Item = &'u str>) -> Result<(), Failure> {
        self.record.units.extend(places.map(str::to_owned));
        self.put()
    }

    /// The task has ended.
    ///
    /// - `units`: found finished, and computed
    ///
    /// # Errors
    /// The disk.
    pub fn end(self, failures: Vec<Diagnostic>, units: [usize; 2]) -> Result<TaskDone, Failure> {
        let record = self.ended(&failures)?;
        let [units_found_finished, units_computed] = units;
        Ok(TaskDone { record, units_found_finished, units_computed, failed: failures })
    }

    /// The task cannot go on. The reason comes back: where the disk is full, the record may not be written either.
    pub fn fail(self, reason: Failure) -> Failure {
        match &reason {
            Failure::Input(messages) => {
                let _ = self.ended(messages);
            }
            Failure::Cancelled => {
                let _ = self.ended(&[Diagnostic::error("was stopped")]);
            }
            Failure::Internal(text) => {
                let _ = self.ended(&[Diagnostic::error(text.clone())]);
            }
        }
        reason
    }

    fn ended(mut self, failures: &[Diagnostic]) -> Result<TaskRecord, Failure> {
        self.record.failed = failures.iter().map(ToString::to_string).collect();
        self.record.state = if failures.is_empty() { TaskState::Finished } else { TaskState::Failed };
        self.put()?;
        Ok(self.record)
    }

    fn put(&self) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(&self.record).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        self.out.put(&self.file, text.as_bytes()).map(|_| ())
    }
}

/// Name of this machine; empty where it has none.
fn host() -> String {
    let of_kernel = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let of_shell = || std::env::var("HOSTNAME").or_else(|_| std::env::var("COMPUTERNAME")).ok();
    of_kernel.or_else(of_shell).map_or(String::new(), |name| name.trim().to_owned())
}

/// Whether a process of this machine runs.
fn is_alive(process: u32) -> bool {
    // Where processes are not shown as files, it is not known to have gone.
    !Path::new("/proc/self").exists() || Path::new("/proc").join(process.to_string()).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_tasks_divide_participants_without_rest() {
        for of in 1..=4 {
            let tasks: Vec<Task> = (1..=of).map(|i| format!("{i}/{of}").parse().unwrap()).collect();
            for place in 0..9 {
                assert_eq!(tasks.iter().filter(|t| t.has(place)).count(), 1);
            }
        }
        for text in ["", "1", "0/2", "3/2", "a/b", "1/0", "-1/2", "1/2/3", "1/10000000"] {
            assert!(text.parse::<Task>().is_err(), "{text}");
        }
    }
}
