//! Units of work that outlive the process: each is stored whole, under a key made of everything that it depends on, so
//! that a run that was killed goes on where it was.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

use cpu_time::ThreadTime;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::diagnostic::{Diagnostic, Failure};
use super::output::OutputFolder;
use super::progress::{Progress, go_on};
use super::provenance::{self, hash};

const SCHEMA: &str = "carpus.unit/2";

/// The file of the program, where it is not that of the process.
static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Says which file the program is, where an interpreter loaded it: units are of this file, and of no other. Only the
/// first call counts.
pub fn set_program(file: PathBuf) {
    PROGRAM.get_or_init(|| file);
}

/// What a unit computes.
pub type Work<'a> = Box<dyn Fn() -> Result<Value, Failure> + Send + Sync + 'a>;

/// A unit of work: a step of one participant, or of one case of one participant.
pub struct Unit<'a> {
    /// Where it is stored: `STEP/PARTICIPANT/CASE`.
    pub place: String,
    /// Options and other inputs of the step, as text.
    pub depends_on: String,
    /// The work.
    pub work: Work<'a>,
}

/// What lies at the place of a unit.
enum Stored {
    /// Nothing, or the result of other inputs.
    Nothing,
    /// A finished unit.
    Finished(Value),
    /// Something that this program did not write so.
    Damaged,
}

/// Units that are finished, on disk and in memory.
#[derive(Debug)]
pub struct UnitStore<'o> {
    out: &'o OutputFolder,
    program: String,
    finished: Mutex<BTreeMap<String, Value>>,
    /// Units that were found finished, and units that were computed.
    counts: [AtomicUsize; 2],
}

impl<'o> UnitStore<'o> {
    /// A store in the folder `units` of an output folder.
    ///
    /// # Errors
    /// The program's own file cannot be read: its hash is part of every key.
    pub fn new(out: &'o OutputFolder) -> Result<UnitStore<'o>, Failure> {
        let unreadable = |e: std::io::Error| Failure::Internal(format!("the program's own file: {e}"));
        let program = PROGRAM.get().cloned().map_or_else(std::env::current_exe, Ok).map_err(unreadable)?;
        let program = provenance::input_file(&program, "carpus", "program")?.sha256;
        let counts = [AtomicUsize::new(0), AtomicUsize::new(0)];
        Ok(UnitStore { out, program, finished: Mutex::new(BTreeMap::new()), counts })
    }

    /// Does the units that are not finished, on as many threads as there are: each unit on one, on more where there are
    /// fewer units than threads. A unit that cannot be done does not keep the others from being done. The reasons of those come back, in the order of the units, after
    /// warnings of what was stored and is damaged: it is computed again.
    ///
    /// - `inputs`: hashes of the files that all of these units depend on
    /// - `progress`: is told which unit was finished, at the given count of steps
    ///
    /// # Errors
    /// A fault of this program; a unit that cannot be stored, after which none is begun; a request to stop, before a
    /// unit.
    pub fn run(
        &self,
        units: &[Unit],
        inputs: &str,
        progress: &dyn Progress,
        [step, steps]: [usize; 2],
    ) -> Result<Vec<Diagnostic>, Failure> {
        let done = |place: &str| progress.at(place, step, steps);
        let mut messages = Vec::new();
        let keys: Vec<String> =
            units.iter().map(|u| hash(&[self.program.as_str(), &u.place, &u.depends_on, inputs])).collect();
        let mut open: Vec<usize> = Vec::new();
        for (i, (unit, key)) in units.iter().zip(&keys).enumerate() {
            match self.stored(&unit.place, key) {
                Stored::Finished(value) => {
                    self.counts[0].fetch_add(1, Ordering::Relaxed);
                    self.finish(&unit.place, value);
                    done(&unit.place);
                }
                Stored::Nothing => open.push(i),
                Stored::Damaged => {
                    let text = "was changed or damaged after it was stored: it is computed again";
                    messages.push(Diagnostic::warning(text).in_file(&self.out.path().join(self.file(&unit.place))));
                    open.push(i);
                }
            }
        }
        let next = AtomicUsize::new(0);
        let failures: Mutex<Vec<(usize, Failure)>> = Mutex::new(Vec::new());
        let not_stored: Mutex<Option<Failure>> = Mutex::new(None);
        let work_on = |i: usize| -> Result<(), Failure> {
            go_on(progress)?;
            let unit = &units[i];
            let started = processor_seconds();
            let value = (unit.work)()?;
            let seconds = processor_seconds() - started;
            if let Err(why) = self.store(&unit.place, &keys[i], value, seconds) {
                lock(&not_stored).get_or_insert(why);
                return Ok(());
            }
            self.counts[1].fetch_add(1, Ordering::Relaxed);
            done(&unit.place);
            Ok(())
        };
        let worker = || {
            while let Some(&i) = open.get(next.fetch_add(1, Ordering::Relaxed)) {
                if lock(&not_stored).is_some() {
                    break;
                }
                if let Err(failure) = work_on(i) {
                    lock(&failures).push((i, failure));
                }
            }
        };
        let threads = rayon::current_num_threads();
        let workers = threads.min(open.len());
        std::thread::scope(|scope| -> Result<(), Failure> {
            for _ in 0..workers {
                // What is parallel inside a unit stays on the unit's own threads, so that its time is its own.
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads / workers).build();
                let pool = pool.map_err(|e| Failure::Internal(format!("cannot start a thread: {e}")))?;
                scope.spawn(move || pool.install(worker));
            }
            Ok(())
        })?;
        if let Some(why) = lock(&not_stored).take() {
            return Err(with_hint(why, "make room, then start again with the same words: what is finished is found"));
        }
        let mut failures = failures.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        failures.sort_by_key(|(i, _)| *i);
        for (_, failure) in failures {
            match failure {
                Failure::Input(more) => messages.extend(more),
                other => return Err(other),
            }
        }
        Ok(messages)
    }

    /// Values of all finished units of a step, in the order of their places.
    ///
    /// # Errors
    /// A value of another form: a fault of this program.
    pub fn finished<T: DeserializeOwned>(&self, step: &str) -> Result<Vec<T>, Failure> {
        let finished = lock(&self.finished);
        let of_step = finished.iter().filter(|(place, _)| place.split('/').next() == Some(step));
        of_step
            .map(|(place, value)| {
                T::deserialize(value).map_err(|e| Failure::Internal(format!("unit {place} cannot be read: {e}")))
            })
            .collect()
    }

    /// A finished unit.
    ///
    /// # Errors
    /// As [`Self::finished`].
    pub fn get<T: DeserializeOwned>(&self, place: &str) -> Result<Option<T>, Failure> {
        let finished = lock(&self.finished);
        let read = |value: &Value| {
            T::deserialize(value).map_err(|e| Failure::Internal(format!("unit {place} cannot be read: {e}")))
        };
        finished.get(place).map(read).transpose()
    }

    /// How many units were found finished, and how many were computed.
    pub fn counts(&self) -> [usize; 2] {
        [0, 1].map(|i| self.counts[i].load(Ordering::Relaxed))
    }

    /// Processor seconds that finished units took when they were computed, by place.
    pub fn seconds(&self) -> BTreeMap<String, f64> {
        let places: Vec<String> = lock(&self.finished).keys().cloned().collect();
        let read = |place: String| {
            let text = carpus_numerics::regular_file::read_text(&self.out.path().join(self.timing(&place))).ok()?;
            Some((place, text.trim().parse().ok()?))
        };
        places.into_iter().filter_map(read).collect()
    }

    fn file(&self, place: &str) -> PathBuf {
        PathBuf::from(format!("units/{place}.json"))
    }

    fn timing(&self, place: &str) -> PathBuf {
        PathBuf::from(format!("timings/{place}.txt"))
    }

    /// What is stored at a place; a value counts if it is of this key and has the checksum it was stored with.
    fn stored(&self, place: &str, key: &str) -> Stored {
        let Ok(bytes) = carpus_numerics::regular_file::read(&self.out.path().join(self.file(place))) else {
            return Stored::Nothing;
        };
        let Ok(mut stored) = serde_json::from_slice::<Value>(&bytes) else { return Stored::Damaged };
        let text_of = |name: &str| stored.get(name).and_then(Value::as_str);
        match (text_of("schema"), text_of("key"), text_of("sha256"), stored.get("value")) {
            (Some(SCHEMA), Some(_), Some(sum), Some(value)) if checksum(value) != sum => Stored::Damaged,
            (Some(SCHEMA), Some(known), Some(_), Some(_)) if known == key => Stored::Finished(stored["value"].take()),
            (Some(SCHEMA), Some(_), Some(_), Some(_)) => Stored::Nothing,
            // Units of other versions of this program are no use, and no damage.
            (Some(other), ..) if other != SCHEMA && other.starts_with("carpus.unit/") => Stored::Nothing,
            _ => Stored::Damaged,
        }
    }

    fn store(&self, place: &str, key: &str, value: Value, seconds: f64) -> Result<(), Failure> {
        let sum = checksum(&value);
        let stored = serde_json::json!({ "schema": SCHEMA, "key": key, "sha256": sum, "value": value });
        let mut text = serde_json::to_string(&stored).map_err(|e| Failure::Internal(e.to_string()))?;
        text.push('\n');
        self.out.put(&self.timing(place), format!("{seconds:.6}\n").as_bytes())?;
        self.out.put(&self.file(place), text.as_bytes())?;
        // What goes on is what a later run will read.
        let mut read: Value = serde_json::from_str(&text).map_err(|e| Failure::Internal(e.to_string()))?;
        self.finish(place, read["value"].take());
        Ok(())
    }

    fn finish(&self, place: &str, value: Value) {
        lock(&self.finished).insert(place.to_owned(), value);
    }
}

/// What the threads of this thread's pool have computed so far [s].
fn processor_seconds() -> f64 {
    rayon::broadcast(|_| ThreadTime::now().as_duration().as_secs_f64()).iter().sum()
}

/// The same failure, whose messages say what to do.
fn with_hint(failure: Failure, hint: &str) -> Failure {
    match failure {
        Failure::Input(messages) => Failure::Input(messages.into_iter().map(|m| m.hint(hint)).collect()),
        other => other,
    }
}

/// Whether a file is a unit of this version as it was stored.
pub(super) fn is_whole(file: &std::path::Path) -> bool {
    let bytes = carpus_numerics::regular_file::read(file).unwrap_or_default();
    let Ok(stored) = serde_json::from_slice::<Value>(&bytes) else { return false };
    let text_of = |name: &str| stored.get(name).and_then(Value::as_str);
    text_of("schema") == Some(SCHEMA) && stored.get("value").map(checksum).as_deref() == text_of("sha256")
}

/// A lock whose holder panicked holds whole values all the same.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Checksum of a unit's value, whatever the white space around it.
fn checksum(value: &Value) -> String {
    hash(&[&value.to_string()])
}

/// A value for a unit, as a later run will read it.
///
/// # Errors
/// A result that JSON cannot hold, a number that is not finite before all: such a unit is not stored, and said to be
/// not done.
pub fn value<T: Serialize + DeserializeOwned>(of: &T) -> Result<Value, Failure> {
    let value = serde_json::to_value(of).map_err(|e| Failure::Internal(e.to_string()))?;
    match T::deserialize(&value) {
        Ok(_) => Ok(value),
        Err(e) => Err(Diagnostic::error(format!("the result cannot be stored, a number is not finite: {e}"))
            .hint("a number of the model or the trials is too large or too small to be computed with")
            .into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn unit<'a>(place: &str, depends_on: &str, count: &'a AtomicUsize) -> Unit<'a> {
        let work = move || {
            count.fetch_add(1, Ordering::Relaxed);
            Ok(serde_json::json!({ "x": 0.1 + 0.2 }))
        };
        Unit { place: place.into(), depends_on: depends_on.into(), work: Box::new(work) }
    }

    #[test]
    fn verif_finished_units_are_not_done_again_unless_their_inputs_change() {
        let folder = tempfile::tempdir().unwrap();
        let out = OutputFolder::create(folder.path(), &[]).unwrap();
        let count = AtomicUsize::new(0);
        let run = |depends_on: &str, inputs: &str| {
            let store = UnitStore::new(&out).unwrap();
            let units = [unit("s/P01/a", depends_on, &count), unit("s/P01/b", depends_on, &count)];
            assert!(store.run(&units, inputs, &Silent, [0, 0]).unwrap().is_empty());
            let values: Vec<Value> = store.finished("s").unwrap();
            assert_eq!(values, vec![serde_json::json!({ "x": 0.1 + 0.2 }); 2]);
            assert_eq!(store.seconds().len(), 2);
            count.load(Ordering::Relaxed)
        };
        assert_eq!(run("o", "i"), 2);
        assert_eq!(run("o", "i"), 2, "nothing is done again");
        assert_eq!(run("o2", "i"), 4);
        assert_eq!(run("o2", "j"), 6);
    }

    #[test]
    fn verif_what_was_changed_or_damaged_is_computed_again_and_said() {
        let folder = tempfile::tempdir().unwrap();
        let out = OutputFolder::create(folder.path(), &[]).unwrap();
        let count = AtomicUsize::new(0);
        let run = || {
            let store = UnitStore::new(&out).unwrap();
            let said = store.run(&[unit("s/P01/a", "", &count)], "", &Silent, [0, 0]).unwrap();
            let values: Vec<Value> = store.finished("s").unwrap();
            assert_eq!(values, vec![serde_json::json!({ "x": 0.1 + 0.2 })], "never what lies there");
            said
        };
        assert!(run().is_empty() && run().is_empty());
        assert_eq!(count.load(Ordering::Relaxed), 1);
        let file = folder.path().join("units/s/P01/a.json");
        let whole = std::fs::read_to_string(&file).unwrap();
        assert!(whole.contains("0.30000000000000004"), "{whole}");
        let damages: [Vec<u8>; 7] = [
            // A flipped digit, half a file as after a crash of the disk, JSON of another form, no text, nothing.
            whole.replace("0.30000000000000004", "0.30000000000000014").into(),
            whole[..whole.len() / 2].into(),
            whole.replace("\"x\"", "\"y\"").into(),
            "[]".into(),
            "{\"schema\": 3}".into(),
            vec![0xff, 0xfe, 0x00],
            Vec::new(),
        ];
        for (i, damage) in damages.iter().enumerate() {
            std::fs::write(&file, damage).unwrap();
            let said = run();
            assert_eq!((said.len(), count.load(Ordering::Relaxed)), (1, i + 2), "{damage:?}");
            assert_eq!(said[0].file.as_deref(), Some(file.as_path()));
            assert!(said[0].text.contains("computed again"), "{}", said[0].text);
            assert!(run().is_empty(), "it is whole again");
        }
        // Other white space is the same value; another version's unit is no damage.
        std::fs::write(&file, whole.replace("\"x\":", "\"x\" : ")).unwrap();
        assert!(run().is_empty());
        assert_eq!(count.load(Ordering::Relaxed), 8);
        std::fs::write(&file, whole.replace("carpus.unit/2", "carpus.unit/1")).unwrap();
        assert!(run().is_empty());
        assert_eq!(count.load(Ordering::Relaxed), 9);
    }

    #[test]
    fn verif_a_result_that_json_cannot_hold_is_not_stored() {
        assert!(value(&vec![1.0]).is_ok());
        assert!(matches!(value(&vec![1.0, f64::NAN]), Err(Failure::Input(_))));
    }

    #[test]
    fn verif_where_a_unit_cannot_be_stored_no_further_one_is_begun() {
        let folder = tempfile::tempdir().unwrap();
        let out = OutputFolder::create(folder.path(), &[]).unwrap();
        std::fs::write(folder.path().join("units"), "a file in place of the folder").unwrap();
        let count = AtomicUsize::new(0);
        let units = ["s/P01/a", "s/P01/b", "s/P02/a"].map(|place| unit(place, "", &count));
        let run = || UnitStore::new(&out).unwrap().run(&units, "", &Silent, [0, 0]);
        let Err(Failure::Input(messages)) =
            rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(run)
        else {
            panic!("it is an error");
        };
        assert_eq!((messages.len(), count.load(Ordering::Relaxed)), (1, 1));
        assert!(messages[0].text.contains("cannot be written"), "{}", messages[0].text);
        assert!(messages[0].hint.as_deref().is_some_and(|hint| hint.contains("what is finished is found")));
    }

    #[test]
    fn verif_a_unit_that_fails_is_named_and_the_others_are_done() {
        let folder = tempfile::tempdir().unwrap();
        let out = OutputFolder::create(folder.path(), &[]).unwrap();
        let store = UnitStore::new(&out).unwrap();
        let count = AtomicUsize::new(0);
        let fails = Unit {
            place: "s/P01/bad".into(),
            depends_on: String::new(),
            work: Box::new(|| Err(Diagnostic::error("no trials").into())),
        };
        let messages = store.run(&[fails, unit("s/P01/good", "", &count)], "", &Silent, [0, 0]).unwrap();
        assert_eq!(messages.len(), 1);
        assert_eq!(messages[0].text, "no trials");
        assert!(store.get::<Value>("s/P01/good").unwrap().is_some());
        assert!(store.get::<Value>("s/P01/bad").unwrap().is_none());
    }
}
