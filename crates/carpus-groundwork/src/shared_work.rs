//! What lies in a folder of results that several machines share: tasks, units, and what a person should know of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::Serialize;

use crate::diagnostic::{Diagnostic, Failure};
use crate::task::{FOLDER, LIBRARY, Task, TaskRecord, TaskState};
use crate::units::is_whole;

/// Files that a note names before it counts the rest.
const NAMED: usize = 3;
/// A clock may be fast by this much before it is said: machines agree to a second.
const FAST: Duration = Duration::from_secs(60);
/// No unit was stored before this time, 1 January 2020, in seconds after 1970.
const EARLIEST: Duration = Duration::from_secs(1_577_836_800);

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
    /// What went wrong, and what comes of it: a line each.
    pub notes: Vec<String>,
}

/// Files below a folder of units.
#[derive(Debug, Default)]
struct Found {
    /// Places of units.
    places: Vec<String>,
    /// Files that were being written, or that are of a process that was killed then.
    half_written: usize,
    /// Units with a time of change in the future or before there were any.
    of_no_time: usize,
}

impl SharedWork {
    /// Looks into a folder of results.
    ///
    /// # Errors
    /// It holds no units and no tasks.
    pub fn of(folder: &Path) -> Result<SharedWork, Failure> {
        let (records, mut notes) = records(folder);
        let planned: BTreeSet<&str> = records.iter().flat_map(|r| &r.units).map(String::as_str).collect();
        let mut found = Found::default();
        found.look_below(&folder.join("units"), "");
        if records.is_empty() && found.places.is_empty() {
            let text = "holds no units of a study and no tasks";
            let hint = "give the folder that `carpus study --out` or `carpus diagnose --out` writes to";
            return Err(Diagnostic::error(text).in_file(folder).hint(hint).into());
        }
        let mut units: BTreeMap<String, BTreeMap<String, StepUnits>> = BTreeMap::new();
        let mut count = |place: &str, add: fn(&mut StepUnits)| {
            let mut parts = place.split('/').map(str::to_owned);
            if let (Some(step), Some(participant)) = (parts.next(), parts.next()) {
                add(units.entry(step).or_default().entry(participant).or_default());
            }
        };
        let mut damaged = Vec::new();
        for place in &found.places {
            if is_whole(&folder.join("units").join(format!("{place}.json"))) {
                count(place, |u| u.finished += 1);
            } else {
                count(place, |u| u.damaged += 1);
                damaged.push(format!("units/{place}.json"));
            }
        }
        let known: BTreeSet<&str> = found.places.iter().map(String::as_str).collect();
        planned.difference(&known).for_each(|place| count(place, |u| u.missing += 1));
        notes.extend(records.iter().filter_map(note_of));
        notes.extend(found.notes(&damaged));
        let tasks = records.iter().map(|r| TaskShown { record: r.clone(), gone: r.is_gone() }).collect();
        Ok(SharedWork { schema: "carpus.units/1", tasks, units, notes })
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

/// The records of the tasks, in their order, and of which files there is none.
fn records(folder: &Path) -> (Vec<TaskRecord>, Vec<String>) {
    let (mut records, mut notes) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder.join(FOLDER)).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        if is_hidden || path.extension().is_none_or(|e| e != "json") {
            continue;
        }
        match TaskRecord::read(&path) {
            Some(record) => records.push(record),
            None => {
                let name = Path::new(FOLDER).join(entry.file_name());
                notes.push(format!("{} is no whole record of a task: its units are found without it", name.display()));
            }
        }
    }
    records.sort_by_key(|r| r.task.parse::<Task>().map_or((0, 0), |t| t.order()));
    notes.sort();
    (records, notes)
}

/// What a person should know of a task.
fn note_of(record: &TaskRecord) -> Option<String> {
    let TaskRecord { task, host, process, .. } = record;
    let again = match record.arguments.as_slice() {
        [request] if request.starts_with(LIBRARY) => "start it again".to_owned(),
        words => format!("start it again: carpus {} --task {task}", words.join(" ")),
    };
    if record.is_gone() {
        return Some(format!(
            "task {task}: process {process} stopped without recording an end (killed, or its disk was full): what it finished \
             counts; {again}"
        ));
    }
    if let (Some(other), TaskState::Begun) = (&record.beside, record.state) {
        return Some(format!(
            "task {task}: process {process} on {host} began it beside {other}: the same units, each counts once"
        ));
    }
    if record.is_elsewhere() {
        return Some(format!("task {task}: whether process {process} still runs only {host} knows"));
    }
    (record.state == TaskState::Failed).then(|| {
        let rest = record.failed.len().saturating_sub(1);
        let reason = record.failed.first().map_or("", |reason| reason.lines().next().unwrap_or_default());
        let reason = reason.trim_start_matches("error: ");
        let more = if rest > 0 { format!(" (and {rest} more)") } else { String::new() };
        format!("task {task}: failed: {reason}{more}; what it finished counts; {again}")
    })
}

impl Found {
    /// Adds the files below a folder.
    fn look_below(&mut self, folder: &Path, above: &str) {
        let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().collect();
        entries.sort_by_key(std::fs::DirEntry::file_name);
        for entry in entries {
            let name = entry.file_name().to_string_lossy().into_owned();
            let place = if above.is_empty() { name.clone() } else { format!("{above}/{name}") };
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => self.look_below(&entry.path(), &place),
                Ok(kind) if kind.is_file() && name.starts_with('.') => self.half_written += 1,
                Ok(kind) if kind.is_file() => {
                    if let Some(place) = place.strip_suffix(".json") {
                        self.places.push(place.to_owned());
                        self.of_no_time += usize::from(is_of_no_time(&entry));
                    }
                }
                _ => {}
            }
        }
    }

    /// What a person should know of them.
    ///
    /// - `damaged`: files that are no whole unit
    fn notes(&self, damaged: &[String]) -> Vec<String> {
        let mut notes = Vec::new();
        if !damaged.is_empty() {
            let named = damaged.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
            let more = match damaged.len().saturating_sub(NAMED) {
                0 => String::new(),
                rest => format!(" and {rest} more"),
            };
            notes.push(format!("damaged, computed again by the next run: {named}{more}"));
        }
        if self.half_written > 0 {
            let text = "no units: a process is writing them, or was killed while it did";
            notes.push(format!("hidden files below units, {}: {text}", self.half_written));
        }
        if self.of_no_time > 0 {
            let text = "a clock jumped; units count by their content, and times are never looked at";
            notes.push(format!("units changed in the future or before 2020, {}: {text}", self.of_no_time));
        }
        notes
    }
}

/// Whether the time of change of a file cannot be right.
fn is_of_no_time(entry: &std::fs::DirEntry) -> bool {
    let Ok(changed) = entry.metadata().and_then(|about| about.modified()) else { return false };
    let since_1970 = changed.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let is_future = changed.duration_since(SystemTime::now()).is_ok_and(|ahead| ahead > FAST);
    is_future || since_1970 < EARLIEST
}
