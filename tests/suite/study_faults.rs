//! What goes wrong while several machines work on a study: nothing is lost, nothing counts twice, `carpus units` says it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime};

use assert_cmd::Command;
use serde_json::Value;

use crate::study_command::{contents, differing, small_study, units};

/// Of each participant: two screenings, an evaluation, images.
const UNITS: usize = 2 * 4;

/// The study, and a folder in which one undisturbed run wrote `done`.
fn undisturbed() -> &'static [tempfile::TempDir; 2] {
    static WHOLE: OnceLock<[tempfile::TempDir; 2]> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let made = [small_study(), tempfile::tempdir().unwrap()];
        let words = words_of(made[0].path(), &[]);
        Command::cargo_bin("carpus").unwrap().current_dir(made[1].path()).args(words).assert().success();
        assert_eq!(units(made[1].path()), UNITS);
        made
    })
}

fn words_of(study: &Path, more: &[&str]) -> Vec<String> {
    let file = study.join("study.toml").display().to_string();
    let some = ["study", file.as_str(), "--out", "done", "--steps", "sensitivity,evaluate,ultrasound", "--starts", "2"];
    some.into_iter().chain(more.iter().copied()).map(str::to_owned).collect()
}

fn words(more: &[&str]) -> Vec<String> {
    words_of(undisturbed()[0].path(), more)
}

/// A folder in which a run has finished all units.
fn finished() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    run(place.path(), &words(&["--task", "1/1"]));
    place
}

/// What a command prints, on stdout and stderr.
fn run(place: &Path, words: &[String]) -> [String; 2] {
    let done = Command::cargo_bin("carpus").unwrap().current_dir(place).args(words).assert().success();
    [&done.get_output().stdout, &done.get_output().stderr].map(|text| String::from_utf8(text.clone()).unwrap())
}

fn of(words: &[&str]) -> Vec<String> {
    words.iter().map(|w| (*w).to_owned()).collect()
}

fn start(place: &Path, words: &[String]) -> Child {
    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin("carpus"));
    command.current_dir(place).args(words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Lines of `carpus units`, below its tables.
fn notes(place: &Path) -> Vec<String> {
    let [shown, _] = run(place, &of(&["units", "done", "--json"]));
    let shown: Value = serde_json::from_str(&shown).unwrap();
    let notes: Vec<String> = serde_json::from_value(shown["notes"].clone()).unwrap();
    let [text, _] = run(place, &of(&["units", "done"]));
    assert!(notes.iter().all(|note| text.contains(note.as_str())), "{text}");
    notes
}

fn only_note(place: &Path) -> String {
    let notes = notes(place);
    let [note] = notes.as_slice() else { panic!("{notes:#?}") };
    note.clone()
}

/// Merges, and expects the bytes of the undisturbed run. How many units were found and computed.
fn merged(place: &Path) -> [usize; 2] {
    let [said, _] = run(place, &of(&["merge", "done"]));
    assert_same_results(place);
    let line = said.lines().find(|line| line.contains("units were finished before")).unwrap();
    let numbers: Vec<usize> = line.split(' ').filter_map(|word| word.parse().ok()).collect();
    numbers.try_into().unwrap()
}

fn assert_same_results(place: &Path) {
    let results = |place: &Path| -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = contents(&place.join("done"));
        let is_hidden = |name: &Path| name.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        found.retain(|name, _| !name.starts_with("tasks") && !is_hidden(name));
        found
    };
    let [one, other] = [undisturbed()[1].path(), place].map(results);
    assert_eq!(differing(&one, &other), Vec::<PathBuf>::new());
}

/// Files of units.
fn unit_files(place: &Path) -> Vec<PathBuf> {
    let is_unit = |name: &PathBuf| name.starts_with("units");
    contents(&place.join("done")).into_keys().filter(is_unit).map(|name| place.join("done").join(name)).collect()
}

#[test]
fn verif_a_task_that_was_killed_is_named_and_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let mut child = start(place.path(), &words(&["--task", "1/1", "--threads", "1"]));
    let started = Instant::now();
    while units(place.path()) == 0 {
        assert!(started.elapsed() < Duration::from_secs(300) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let left = units(place.path());
    assert!(left < UNITS, "it was killed before its end");
    // What a process was writing when it was killed: half a unit under a name of its own.
    let half = place.path().join("done/units/evaluate/.carpus-half");
    std::fs::create_dir_all(half.parent().unwrap()).unwrap();
    std::fs::write(&half, "{\"schema\": \"carpus.unit/2\", \"val").unwrap();
    let notes = notes(place.path());
    if cfg!(target_os = "linux") {
        let words = "stopped without recording an end (killed, or its disk was full)";
        assert!(notes[0].contains(words) && notes[0].contains("--task 1/1"), "{notes:?}");
    }
    assert!(notes.last().unwrap().starts_with("hidden files below units"), "{notes:?}");
    let [said, _] = run(place.path(), &words(&["--task", "1/1"]));
    let computed = UNITS - left;
    assert!(said.contains(&format!("{left} units were finished before, {computed} were computed")), "{said}");
    std::fs::remove_file(half).unwrap();
    assert_eq!(self::notes(place.path()), Vec::<String>::new());
    assert_eq!(merged(place.path()), [UNITS, 0]);
}

/// A limit on the size of files ends writing in the middle of a file, as a full disk does.
#[cfg(unix)]
#[test]
fn verif_a_full_disk_is_said_and_leaves_nothing_half_written() {
    let place = tempfile::tempdir().unwrap();
    undisturbed();
    let mut command = Command::new("sh");
    let limited = "trap '' XFSZ; ulimit -f 8; exec \"$@\"";
    command.current_dir(place.path()).args(["-c", limited, "sh"]).arg(assert_cmd::cargo::cargo_bin("carpus"));
    let full = command.args(words(&["--task", "1/1", "--threads", "1"])).assert().code(1);
    let said = String::from_utf8(full.get_output().stderr.clone()).unwrap();
    assert!(said.contains("cannot be written: file too large") && said.contains("make room"), "{said}");
    let left = unit_files(place.path());
    assert!(left.len() < UNITS && left.iter().all(|file| !file.ends_with(".json") || is_json(file)), "{left:?}");
    let note = only_note(place.path());
    assert!(note.contains("task 1/1: failed: ") && note.contains("file too large"), "{note}");
    let [found, computed] = merged(place.path());
    assert!(found < UNITS && found + computed == UNITS, "{found} {computed}");
}

fn is_json(file: &Path) -> bool {
    serde_json::from_slice::<Value>(&std::fs::read(file).unwrap()).is_ok()
}

#[test]
fn verif_units_that_are_cut_off_or_changed_are_named_and_computed_again() {
    let place = finished();
    let files = unit_files(place.path());
    assert_eq!(files.len(), UNITS);
    let bytes = |i: usize| std::fs::read(&files[i]).unwrap();
    let mut changed = bytes(1);
    let at = changed.iter().rposition(u8::is_ascii_digit).unwrap();
    changed[at] = if changed[at] == b'7' { b'8' } else { b'7' };
    // Cut off, one digit, zeros as after a loss of power, nothing.
    let damages = [bytes(0)[..bytes(0).len() / 2].to_vec(), changed, vec![0; bytes(2).len()], Vec::new()];
    for (file, damage) in files.iter().zip(&damages) {
        std::fs::write(file, damage).unwrap();
    }
    let note = only_note(place.path());
    assert!(note.starts_with("damaged, computed again by the next run: units/"), "{note}");
    assert!(note.ends_with(" and 1 more"), "{note}");
    // A record that is cut off does not keep anybody from the units.
    let record = place.path().join("done/tasks/1-of-1.json");
    std::fs::copy(&record, record.with_file_name("2-of-2.json")).unwrap();
    std::fs::write(record.with_file_name("2-of-2.json"), "{").unwrap();
    assert!(notes(place.path())[0].contains("2-of-2.json is no whole record of a task"));
    let [_, warned] = run(place.path(), &words(&["--task", "1/1"]));
    assert!(warned.contains("was changed or damaged after it was stored: it is computed again"), "{warned}");
    std::fs::remove_file(record.with_file_name("2-of-2.json")).unwrap();
    assert_eq!(notes(place.path()), Vec::<String>::new());
    assert_eq!(merged(place.path()), [UNITS, 0]);
}

#[test]
fn verif_two_runs_on_one_folder_give_the_bytes_of_one() {
    let [tasks, wholes] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    for (place, more) in [(&tasks, ["--task", "1/1"].as_slice()), (&wholes, &[])] {
        let children = [(); 2].map(|()| start(place.path(), &words(more)));
        for mut child in children {
            assert!(child.wait().unwrap().success());
        }
        assert_eq!(units(place.path()), UNITS, "each unit is there once");
    }
    assert_same_results(wholes.path());
    assert_eq!(merged(tasks.path()), [UNITS, 0]);

    // While both are at it, the later one says so.
    let record = tasks.path().join("done/tasks/1-of-1.json");
    let mut begun: Value = serde_json::from_str(&std::fs::read_to_string(&record).unwrap()).unwrap();
    (begun["state"], begun["process"]) = ("begun".into(), std::process::id().into());
    begun.as_object_mut().unwrap().remove("beside");
    std::fs::write(&record, begun.to_string()).unwrap();
    run(tasks.path(), &words(&["--task", "1/1"]));
    let mut later: Value = serde_json::from_str(&std::fs::read_to_string(&record).unwrap()).unwrap();
    let this = format!("process {} on {}", std::process::id(), begun["host"].as_str().unwrap());
    assert_eq!(later["beside"].as_str(), Some(this.as_str()));
    assert_eq!(notes(tasks.path()), Vec::<String>::new(), "it has ended");
    (later["state"], later["process"]) = ("begun".into(), std::process::id().into());
    std::fs::write(&record, later.to_string()).unwrap();
    let note = only_note(tasks.path());
    assert!(note.contains(&format!("began it beside {this}: the same units, each counts once")), "{note}");
}

#[test]
fn verif_times_of_files_do_not_count() {
    let place = finished();
    let set = |files: &[PathBuf], time: SystemTime| {
        for file in files {
            std::fs::File::options().write(true).open(file).unwrap().set_modified(time).unwrap();
        }
    };
    let century = Duration::from_secs(100 * 365 * 24 * 3600);
    let files = unit_files(place.path());
    set(&files, SystemTime::now() + century);
    set(&files[..3], SystemTime::UNIX_EPOCH + Duration::from_secs(1));
    let note = only_note(place.path());
    assert!(
        note.starts_with(&format!("units changed in the future or before 2020, {UNITS}: a clock jumped")),
        "{note}"
    );
    assert_eq!(merged(place.path()), [UNITS, 0]);
    // Neither do those of results and of the study's tables that were written before.
    let results: Vec<PathBuf> =
        contents(&place.path().join("done")).into_keys().map(|name| place.path().join("done").join(name)).collect();
    set(&results, SystemTime::now() + century);
    assert_eq!(merged(place.path()), [UNITS, 0]);
}
