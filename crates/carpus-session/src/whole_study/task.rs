//! A part of a study's work, for one of several machines that share a folder: each does the participants of its task
//! and stores their units; a run of the whole study then finds them finished.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::diagnostic::{Diagnostic, Failure};
use crate::output::OutputFolder;
use crate::units::is_whole;

/// Folder of the records in that of the results.
const FOLDER: &str = "tasks";
const SCHEMA: &str = "carpus.task/1";
/// Most tasks that work is divided into.
const MOST_TASKS: usize = 1_000_000;

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
}

/// Keeps the record of a task up to date.
pub(super) struct Recorder<'o> {
    out: &'o OutputFolder,
    file: PathBuf,
    pub(super) record: TaskRecord,
}

impl<'o> Recorder<'o> {
    /// The task has begun.
    ///
    /// # Errors
    /// The disk.
    pub(super) fn begin(out: &'o OutputFolder, task: Task, arguments: &[String]) -> Result<Recorder<'o>, Failure> {
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
        };
        let file = Path::new(FOLDER).join(format!("{}-of-{}.json", task.number, task.of));
        let recorder = Recorder { out, file, record };
        recorder.put()?;
        Ok(recorder)
    }

    /// Further units are known.
    ///
    /// # Errors
    /// The disk.
    pub(super) fn plan<'u>(&mut self, places: impl Iterator<Item = &'u str>) -> Result<(), Failure> {
        self.record.units.extend(places.map(str::to_owned));
        self.put()
    }

    /// The task has ended.
    ///
    /// # Errors
    /// The disk.
    pub(super) fn end(mut self, failures: &[Diagnostic]) -> Result<TaskRecord, Failure> {
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

/// A step of one participant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StepUnits {
    /// Units that are finished.
    pub finished: usize,
    /// Units that a task has planned and that are not.
    pub missing: usize,
    /// Files that are no whole unit: they are computed again.
    pub damaged: usize,
}

/// A task and its process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TaskShown {
    /// What it says of itself.
    #[serde(flatten)]
    pub record: TaskRecord,
    /// Whether its process has gone from this machine without an end.
    pub gone: bool,
}

/// What lies in a folder of results that tasks share.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SharedWork {
    /// `carpus.units/1`.
    pub schema: &'static str,
    /// The tasks.
    pub tasks: Vec<TaskShown>,
    /// Per step and participant.
    pub units: BTreeMap<String, BTreeMap<String, StepUnits>>,
}

impl SharedWork {
    /// Looks into a folder of results.
    ///
    /// # Errors
    /// It holds no units and no tasks.
    pub fn of(folder: &Path) -> Result<SharedWork, Failure> {
        let mut records: Vec<TaskRecord> = Vec::new();
        for entry in std::fs::read_dir(folder.join(FOLDER)).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|e| e == "json") {
                let text = carpus_numerics::regular_file::read_text(&path).unwrap_or_default();
                let record = serde_json::from_str::<TaskRecord>(&text).ok().filter(|r| r.schema == SCHEMA);
                let damaged = || {
                    Diagnostic::error("is no record of a task")
                        .in_file(&path)
                        .hint("delete it: units are found without it")
                };
                records.push(record.ok_or_else(damaged)?);
            }
        }
        records.sort_by_key(|r| r.task.parse::<Task>().map_or((0, 0), |t| (t.of, t.number)));
        let planned: BTreeSet<&str> = records.iter().flat_map(|r| &r.units).map(String::as_str).collect();
        let mut found = Vec::new();
        places_below(&folder.join("units"), "", &mut found);
        if records.is_empty() && found.is_empty() {
            let text = "holds no units of a study and no tasks";
            let hint = "give the folder that `carpus study --out` writes to";
            return Err(Diagnostic::error(text).in_file(folder).hint(hint).into());
        }
        let mut units: BTreeMap<String, BTreeMap<String, StepUnits>> = BTreeMap::new();
        let mut count = |place: &str, add: fn(&mut StepUnits)| {
            let mut parts = place.split('/').map(str::to_owned);
            if let (Some(step), Some(participant)) = (parts.next(), parts.next()) {
                add(units.entry(step).or_default().entry(participant).or_default());
            }
        };
        for place in &found {
            match is_whole(&folder.join("units").join(format!("{place}.json"))) {
                true => count(place, |u| u.finished += 1),
                false => count(place, |u| u.damaged += 1),
            }
        }
        let is_found = |place: &&&str| !found.iter().any(|known| known == **place);
        planned.iter().filter(is_found).for_each(|place| count(place, |u| u.missing += 1));
        let here = host();
        let gone = |r: &TaskRecord| r.state == TaskState::Begun && r.host == here && !is_alive(r.process);
        let tasks = records.iter().map(|r| TaskShown { record: r.clone(), gone: gone(r) }).collect();
        Ok(SharedWork { schema: "carpus.units/1", tasks, units })
    }

    /// A record of what was asked of all tasks; `None` where there are none.
    ///
    /// # Errors
    /// They were asked different things.
    pub fn asked(&self, folder: &Path) -> Result<Option<&TaskRecord>, Failure> {
        let mut records = self.tasks.iter().map(|t| &t.record);
        let Some(first) = records.next() else { return Ok(None) };
        match records.find(|other| other.arguments != first.arguments) {
            Some(other) => {
                let [one, two] = [first, other].map(|r| r.arguments.join(" "));
                let text =
                    format!("tasks {} and {} were asked different things: `{one}`, `{two}`", first.task, other.task);
                let hint = "run the tasks with the same options, or delete the records of those that do not count";
                Err(Diagnostic::error(text).in_file(&folder.join(FOLDER)).hint(hint).into())
            }
            None => Ok(Some(first)),
        }
    }
}

/// Whether a process of this machine runs.
fn is_alive(process: u32) -> bool {
    // Where processes are not shown as files, it is not known to have gone.
    !Path::new("/proc/self").exists() || Path::new("/proc").join(process.to_string()).exists()
}

/// Places of the files below a folder.
fn places_below(folder: &Path, above: &str, found: &mut Vec<String>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        let place = if above.is_empty() { name.clone() } else { format!("{above}/{name}") };
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => places_below(&entry.path(), &place, found),
            Ok(kind) if kind.is_file() && !name.starts_with('.') => {
                found.extend(place.strip_suffix(".json").map(str::to_owned));
            }
            _ => {}
        }
    }
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
