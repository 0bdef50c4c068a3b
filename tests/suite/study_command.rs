//! `carpus study`, `evaluate` and `sensitivity` as a user types them: resumable, the same bytes, bad input.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;

/// Two participants with four training and four held-out trials each, made of the bundled study.
pub fn small_study() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study");
    std::fs::create_dir(folder.path().join("data")).unwrap();
    let text = std::fs::read_to_string(source.join("study.toml")).unwrap();
    std::fs::write(folder.path().join("study.toml"), text.replace("../../models/wrist.osim", "wrist.osim")).unwrap();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/wrist.osim");
    std::fs::copy(model, folder.path().join("wrist.osim")).unwrap();
    let mut rows = String::from("participant,file,contraction,effort_percent,direction,posture_deg,repetition,use\n");
    for (participant, effort) in [("P01", 25), ("P02", 50)] {
        for direction in ["flexion", "extension"] {
            for (contraction, at) in [("isometric", "_+0deg"), ("isotonic", "")] {
                for (repetition, usage) in [(1, "train"), (2, "test")] {
                    let wanted = format!("data/P01/{contraction}_{effort}_{direction}{at}_{repetition}.csv");
                    // Not every posture was repeated: the first repetition serves then.
                    let found = if source.join(&wanted).exists() { wanted } else { wanted.replace("_2.csv", "_1.csv") };
                    let name = format!("data/{participant}_{contraction}_{direction}_{repetition}.csv");
                    let text = std::fs::read_to_string(source.join(found)).unwrap();
                    let thinned = text.lines().enumerate().filter(|(i, _)| *i == 0 || i % 4 == 1);
                    let text: String = thinned.map(|(_, line)| format!("{line}\n")).collect();
                    std::fs::write(folder.path().join(&name), text).unwrap();
                    // Both participants have the same conditions, as a study has.
                    rows += &format!("{participant},{name},{contraction},25,{direction},,{repetition},{usage}\n");
                }
            }
        }
    }
    std::fs::write(folder.path().join("trials.csv"), rows).unwrap();
    std::fs::write(folder.path().join("participants.csv"), "participant\nP01\nP02\n").unwrap();
    let images = "participant,muscle,posture_deg,muscle_belly_length_m,external_tendon_length_m,\
                  cross_sectional_area_m2\n\
                  P01,ECRB,0,0.150,0.130,2.1e-4\nP01,FCR,30,0.160,0.150,1.6e-4\nP02,ECRB,-30,0.155,0.128,1.9e-4\n";
    std::fs::write(folder.path().join("ultrasound.csv"), images).unwrap();
    folder
}

const EFFORT: [&str; 10] =
    ["--starts", "2", "--bayesian-evaluations", "11", "--sqp-iterations", "1", "--draws", "40", "--threads", "2"];

fn arguments(study: &Path) -> Vec<String> {
    let mut words = vec!["study".to_string(), study.join("study.toml").display().to_string()];
    words.extend(["--out", "done"].map(String::from));
    words.extend(EFFORT.map(String::from));
    words
}

/// Every file below a folder but the timings.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(here) = open.pop() {
        for entry in std::fs::read_dir(&here).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_path_buf();
            if name.starts_with("timings") || name == Path::new("timings.csv") {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                found.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// Files that are not the same in two folders.
pub fn differing(one: &BTreeMap<PathBuf, Vec<u8>>, other: &BTreeMap<PathBuf, Vec<u8>>) -> Vec<PathBuf> {
    let names: std::collections::BTreeSet<&PathBuf> = one.keys().chain(other.keys()).collect();
    names.into_iter().filter(|name| one.get(*name) != other.get(*name)).cloned().collect()
}

fn rows(files: &BTreeMap<PathBuf, Vec<u8>>, name: &str) -> usize {
    String::from_utf8_lossy(&files[Path::new(name)]).lines().count() - 1
}

/// Units that are finished. Only names are asked for: while a study runs, files go over from one name to another.
pub fn units(folder: &Path) -> usize {
    let in_folder = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_unit = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.ends_with(".json") && !name.starts_with('.')
    };
    let mut open = vec![folder.join("done/units")];
    let mut count = 0;
    while let Some(here) = open.pop() {
        for path in in_folder(&here) {
            count += usize::from(is_unit(&path));
            open.extend(path.is_dir().then_some(path));
        }
    }
    count
}

#[test]
fn verif_a_killed_study_goes_on_and_gives_the_same_bytes() {
    let study = small_study();
    let [whole, killed] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let mut command = Command::cargo_bin("carpus").unwrap();
    let done = command.current_dir(whole.path()).args(arguments(study.path())).assert().success();
    let printed = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    assert!(printed.contains("0 units were finished before"), "{printed}");
    let all = units(whole.path());
    let each = "scaling, two screenings, eight fits, an evaluation, intervals and images a participant";
    assert_eq!(all, 2 * (1 + 2 + 8 + 1 + 1 + 1), "{each}");

    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("carpus"))
        .current_dir(killed.path())
        .args(arguments(study.path()))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while units(killed.path()) < 4 && child.try_wait().unwrap().is_none() {
        assert!(started.elapsed() < Duration::from_secs(300), "the study gets nowhere");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let finished = units(killed.path());
    assert!(finished >= 4, "{finished} units were finished when it was killed");
    assert!(!killed.path().join("done/report.html").exists() || finished == all);

    let mut command = Command::cargo_bin("carpus").unwrap();
    let resumed = command.current_dir(killed.path()).args(arguments(study.path())).assert().success();
    let printed = String::from_utf8(resumed.get_output().stdout.clone()).unwrap();
    assert!(
        printed.contains(&format!("{finished} units were finished before, {} were computed", all - finished)),
        "{printed}"
    );
    // Files that the killed process was about to write are hidden and are not results.
    let visible = |folder: &Path| {
        let mut found = contents(&folder.join("done"));
        found.retain(|name, _| !name.file_name().is_some_and(|n| n.to_string_lossy().starts_with(".carpus-")));
        found
    };
    let (first, second) = (visible(whole.path()), visible(killed.path()));
    assert_eq!(first.keys().collect::<Vec<_>>(), second.keys().collect::<Vec<_>>());
    for (name, bytes) in &first {
        assert!(second[name] == *bytes, "{} differs", name.display());
    }
    let page = String::from_utf8(first[Path::new("report.html")].clone()).unwrap();
    for words in ["Table 2.2", "Figure 2.3", "Table 3.3", "Table 3.4", "Figure 3.3", "Figure 3.4b", "Figure 3.5"] {
        assert!(page.contains(words), "{words}");
    }
    for words in ["Table 4.2", "Table 4.3", "Figure 4.3", "Which trial next?", "Not run: the study has no [processing]"]
    {
        assert!(page.contains(words), "{words}");
    }
    assert_eq!(rows(&first, "ultrasound_measurements.csv"), 5 * 3 * 3, "five models, three images, three quantities");
    assert_eq!(rows(&first, "identify_intervals.csv"), 2 * 15);
    assert!(first.contains_key(Path::new("identify/P02/report.html")));
    evaluate_reads_the_models(study.path(), whole.path());
}

/// `evaluate` on the models that the study wrote gives the study's own errors.
fn evaluate_reads_the_models(study: &Path, done: &Path) {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.current_dir(done).args(["evaluate", &study.join("study.toml").display().to_string()]);
    command.args(["--models", "done/models", "--out", "evaluated"]).assert().success();
    let read = |file: &str| {
        let text = std::fs::read_to_string(done.join(file)).unwrap();
        let mut lines: Vec<String> = text.lines().map(String::from).collect();
        lines.sort();
        lines
    };
    assert_eq!(read("done/evaluation_errors.csv"), read("evaluated/evaluation_errors.csv"));
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.current_dir(done).args(["evaluate", &study.join("study.toml").display().to_string()]);
    let missing = command.args(["--models", "nowhere", "--out", "evaluated"]).assert().code(1);
    missing.stderr(contains("nowhere").and(contains("P01")).and(contains("hint")));
}

#[test]
fn verif_unknown_steps_and_missing_arguments_are_refused() {
    let study = small_study();
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.args(arguments(study.path())).current_dir(study.path()).args(["--steps", "sensitivty"]);
    command.assert().code(1).stderr(contains("no step `sensitivty`").and(contains("did you mean `sensitivity`?")));
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.args(["evaluate", "study.toml", "--out", "x"]).assert().code(1).stderr(contains("--models"));
}

/// A node that is killed, a damaged unit, tasks of other options, and the bytes of one machine.
#[test]
fn verif_tasks_of_several_machines_are_merged_to_the_bytes_of_one() {
    let study = small_study();
    let [whole, shared] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let file = study.path().join("study.toml").display().to_string();
    let words = |more: &[&str]| -> Vec<String> {
        let some = ["study", file.as_str(), "--out", "done", "--steps", "sensitivity,evaluate,ultrasound"];
        some.into_iter().chain(["--starts", "2"]).chain(more.iter().copied()).map(str::to_owned).collect()
    };
    let run = |folder: &Path, words: &[String]| {
        let mut command = Command::cargo_bin("carpus").unwrap();
        command.current_dir(folder).args(words).assert()
    };
    let text = |words: &[&str]| words.iter().map(|w| (*w).to_owned()).collect::<Vec<String>>();
    run(whole.path(), &words(&[])).success();

    run(shared.path(), &words(&["--task", "3/2"])).failure().stderr(contains("expected I/N"));
    run(shared.path(), &text(&["units", "done"])).failure().stderr(contains("no units of a study and no tasks"));
    run(shared.path(), &words(&["--task", "2/2", "--threads", "1"])).success().stdout(contains("carpus merge done"));
    assert!(!shared.path().join("done/report.html").exists());
    // A record without an end, of a process that is not there any more.
    let record = shared.path().join("done/tasks/2-of-2.json");
    let ended = std::fs::read_to_string(&record).unwrap();
    let mut killed: serde_json::Value = serde_json::from_str(&ended).unwrap();
    (killed["task"], killed["state"], killed["process"]) = ("1/2".into(), "begun".into(), 4_000_000_000_u32.into());
    let units: Vec<String> = serde_json::from_value(killed["units"].clone()).unwrap();
    killed["units"] = units.iter().map(|u| u.replace("P02", "P01")).collect::<Vec<_>>().into();
    std::fs::write(record.with_file_name("1-of-2.json"), killed.to_string()).unwrap();
    let unit = shared.path().join("done/units").join(format!("{}.json", units[0]));
    std::fs::write(&unit, "{").unwrap();
    let shown = run(shared.path(), &text(&["units", "done", "--json"])).success();
    let shown: serde_json::Value = serde_json::from_slice(&shown.get_output().stdout).unwrap();
    let states: Vec<(&str, bool)> =
        shown["tasks"].as_array().unwrap().iter().map(|t| (t["state"].as_str().unwrap(), t["gone"] == true)).collect();
    assert_eq!(states, [("begun", cfg!(target_os = "linux")), ("finished", false)]);
    let sum = |participant: &str, key: &str| -> u64 {
        let steps = shown["units"].as_object().unwrap().values();
        steps.filter_map(|s| s[participant][key].as_u64()).sum()
    };
    assert_eq!((sum("P01", "missing"), sum("P02", "damaged")), (units.len() as u64, 1), "{shown}");
    assert_eq!(sum("P02", "finished"), units.len() as u64 - 1);

    // What is missing or damaged is computed; all else is found.
    let merged = run(shared.path(), &text(&["merge", "done"])).success().stderr(contains("computed again"));
    let said = String::from_utf8(merged.get_output().stdout.clone()).unwrap();
    assert!(said.contains(&format!("{} units were finished before", units.len() - 1)), "{said}");
    let of = |folder: &Path| {
        let mut found = contents(&folder.join("done"));
        found.retain(|name, _| !name.starts_with("tasks"));
        found
    };
    let (one, other) = (of(whole.path()), of(shared.path()));
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    for (name, bytes) in &one {
        assert!(other[name] == *bytes, "{}", name.display());
    }

    // Tasks that were asked something else are no parts of it.
    run(shared.path(), &[words(&["--task", "1/2"]), text(&["--seed", "9"])].concat()).success();
    run(shared.path(), &text(&["merge", "done"])).failure().stderr(contains("asked different things"));
}
