//! From a folder of exported files to a study: `carpus init`, `check` and `compare` on what four laboratories export.
//!
//! The files are those of `examples/lab_exports.rs`: OpenSim's trials of the bundled study in the layouts of Biodex,
//! HUMAC, Delsys and Noraxon, in one file with decimal commas, and as a workbook with a MATLAB file. So it is known what
//! has to come out.

#[allow(dead_code)]
#[path = "../../examples/lab_exports.rs"]
mod lab_exports;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use assert_cmd::Command;
use carpus::study::{Contraction, Direction, Study, Trial, TrialUse};
use serde_json::Value;

/// Largest difference of a moment to the bundled study's that rounding and noise of the exports make [N·m].
const MOMENT_DIFFERENCE_N_M: f64 = 0.02;
/// Largest root-mean-square difference of an excitation to the bundled study's: a window of 0.1 s of raw EMG in the
/// band holds some forty independent samples, which leave a tenth of the level.
const EXCITATION_DIFFERENCE: f64 = 0.12;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus(words: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.timeout(std::time::Duration::from_secs(600)).env_remove("RUST_LOG").args(words).assert()
}

/// The four folders, written once, and beside each its proposed study.
fn exports() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        lab_exports::write(folder.path()).unwrap();
        folder
    });
    folder.path()
}

/// Proposes a study of a folder into a temporary one.
fn proposed(laboratory: &str) -> (tempfile::TempDir, Value) {
    let out = tempfile::tempdir().unwrap();
    let study = out.path().join("study");
    let folder = exports().join(laboratory);
    let words = ["init", folder.to_str().unwrap(), "--model", "models/wrist.osim", "--yes", "--json", "--out"];
    let words: Vec<&str> = words.into_iter().chain([study.to_str().unwrap()]).collect();
    let mut command = Command::cargo_bin("carpus").unwrap();
    let run = command.current_dir(root("")).args(words).assert().success();
    let proposal = serde_json::from_slice(&run.get_output().stdout).unwrap();
    (out, proposal)
}

/// Trials of the proposed study beside those of the bundled one that they were made of.
fn compared(laboratory: &str) {
    let (out, proposal) = proposed(laboratory);
    let study = Study::read(out.path().join("study")).unwrap_or_else(|e| panic!("{laboratory}: {e}"));
    let original = Study::read(root("fixtures/demo_study")).unwrap();
    assert_eq!(study.settings.active_muscles.len(), 5, "{laboratory}");
    assert_eq!(study.settings.dynamometer.coordinate, "flexion", "{laboratory}: {proposal:#}");
    assert_eq!(study.trials.len(), 18, "{laboratory}");
    let truth = original.load_trials("P01").unwrap();
    let trials = study.load_trials(&study.participants[0].name).unwrap();
    let mut largest: f64 = 0.0;
    for trial in &trials {
        let same = |t: &&Trial| {
            t.info.contraction == trial.info.contraction
                && t.info.direction == trial.info.direction
                && t.info.effort_percent == trial.info.effort_percent
                && t.info.repetition == trial.info.repetition
                && (t.info.contraction != Contraction::Isometric || t.info.posture == trial.info.posture)
        };
        let made_of: Vec<&Trial> = truth.iter().filter(same).collect();
        let [of] = made_of[..] else { panic!("{laboratory}: {} has {} originals", trial.info.name, made_of.len()) };
        assert_eq!(trial.info.usage, of.info.usage, "{laboratory}: {}", trial.info.name);
        for (m, muscle) in study.settings.active_muscles.iter().enumerate() {
            let its = original.settings.active_muscles.iter().position(|known| known == muscle).unwrap();
            let (mut square, mut n) = (0.0, 0);
            for k in 10..trial.len() - 10 {
                let i = of.time.partition_point(|t| *t < trial.time[k] - 1e-9).min(of.len() - 1);
                if (of.time[i] - trial.time[k]).abs() > 0.006 {
                    continue;
                }
                if m == 0 {
                    let slope = of.moment[i.min(of.len() - 2) + 1] - of.moment[i.min(of.len() - 2)];
                    let allowed = MOMENT_DIFFERENCE_N_M + slope.abs();
                    let difference = (trial.moment[k] - of.moment[i]).abs();
                    assert!(difference < allowed + 0.2 * averaged(laboratory), "{laboratory} {} {k}", trial.info.name);
                    let turned = (trial.angle[k] - of.angle[i]).to_degrees().abs();
                    assert!(turned < 1.0, "{laboratory} {} {k}: {turned}", trial.info.name);
                }
                square += (trial.excitation[m][k] - of.excitation[its][i]).powi(2);
                n += 1;
            }
            let rms = (square / f64::from(n)).sqrt();
            largest = largest.max(rms);
            assert!(rms < EXCITATION_DIFFERENCE, "{laboratory}: {} {muscle}: {rms:.3}", trial.info.name);
        }
    }
    println!("{laboratory}: excitations differ by {largest:.3} rms at most");
    // Repetitions are held out, and no file of the laboratory was changed.
    assert!(study.trials.iter().any(|t| t.usage == TrialUse::Test && t.direction == Direction::Flexion));
}

/// Moments of files at 1 kHz are averaged, whose own noise is less than that of the bundled study's samples.
fn averaged(laboratory: &str) -> f64 {
    f64::from(u8::from(laboratory == "one_file"))
}

fn checked(laboratory: &str) {
    let (out, _) = proposed(laboratory);
    let study = out.path().join("study");
    let run = carpus(&["check", study.to_str().unwrap(), "--json"]).success();
    let found: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    assert_ne!(found["level"], "red", "{found:#}");
    assert_eq!(found["conditions"].as_array().map(Vec::len), Some(7), "{found:#}");
    // The muscle's force follows its EMG: the clocks are right.
    let findings = found["findings"].as_array().unwrap();
    let leads = |f: &&Value| f["text"].as_str().unwrap().contains("leads the moment");
    let lead = findings.iter().find(leads).unwrap_or_else(|| panic!("{found:#}"));
    assert_eq!(lead["level"], "green", "{lead}");
}

#[test]
fn val_opensim_biodex_and_delsys_on_one_trigger_become_the_study_that_they_were_made_of() {
    compared("biodex_delsys");
}

#[test]
fn val_opensim_humac_in_foot_pounds_reversed_and_noraxon_become_the_study_that_they_were_made_of() {
    compared("humac_noraxon");
    let (out, proposal) = proposed("humac_noraxon");
    let text = std::fs::read_to_string(out.path().join("study/study.toml")).unwrap();
    assert!(text.contains("unit = \"ft·lb\", sign = -1") && text.contains("shared = \"Torque,V\""), "{text}");
    let assumed = proposal["assumed"].to_string();
    assert!(assumed.contains("positive in extension"), "{assumed}");
}

#[test]
fn val_opensim_one_file_with_decimal_commas_becomes_the_study_that_it_was_made_of() {
    compared("one_file");
}

#[test]
fn val_opensim_a_workbook_and_a_matlab_file_become_the_study_that_they_were_made_of() {
    compared("workbook_matlab");
    let (out, _) = proposed("workbook_matlab");
    let table = std::fs::read_to_string(out.path().join("study/trials.csv")).unwrap();
    let row = "P04_dynamometer.xlsx,isometric,50,flexion,-30,1,train,P04_emg.mat,isom flexion 50 n30deg 1,\
               isom_flexion_50_n30deg_1";
    assert!(table.contains(row), "{table}");
    // As a newcomer goes on, to the personalized model.
    let study = out.path().join("study/study.toml");
    let personalized = out.path().join("personalized");
    carpus(&["personalize", study.to_str().unwrap(), "--out", personalized.to_str().unwrap()]).success();
    let text = std::fs::read_to_string(personalized.join("P04/results.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    let nrmse = |id: &str| {
        let model = results["models"].as_array().and_then(|all| all.iter().find(|model| model["id"] == id));
        let errors = model.and_then(|model| model["errors"].as_array()).unwrap_or_else(|| panic!("{id}"));
        let of = errors.iter().find(|errors| errors["use"] == "held_out");
        of.and_then(|errors| errors["errors"]["nrmse"].as_f64()).unwrap_or_else(|| panic!("{errors:#?}"))
    };
    let [before, after] = ["before", "personalized"].map(nrmse);
    println!("held out: {:.2} % before, {:.2} % personalized", 100.0 * before, 100.0 * after);
    assert!(after < 0.7 * before);
    assert!(personalized.join("P04/model.osim").is_file() && personalized.join("P04/report.html").is_file());
}

#[test]
fn verif_a_table_that_is_not_there_and_a_damaged_file_are_told_by_check() {
    let (out, _) = proposed("workbook_matlab");
    let file = out.path().join("study/trials.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let told = || {
        let run = carpus(&["check", out.path().join("study").to_str().unwrap()]).failure().code(1);
        String::from_utf8_lossy(&run.get_output().stdout).split_whitespace().collect::<Vec<_>>().join(" ")
    };
    std::fs::write(&file, text.replace(",passive 1,", ",pasive 1,")).unwrap();
    let said = told();
    assert!(said.contains("no table `pasive 1`") && said.contains("did you mean `passive 1`"), "{said}");
    // A row without a table: which of 18 sheets?
    std::fs::write(&file, text.replace(",passive 1,", ",,")).unwrap();
    let said = told();
    assert!(said.contains("several tables have the columns") && said.contains("column table of trials.csv"), "{said}");
}

#[test]
fn verif_a_folder_with_files_that_are_not_read_is_told_why() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["version73.mat", "recording.xlsx"] {
        std::fs::copy(root("fixtures/recordings").join(file), folder.path().join(file)).unwrap();
    }
    let study = folder.path().join("study");
    let words = ["init", folder.path().to_str().unwrap(), "--model", "models/wrist.osim", "--yes", "--json", "--out"];
    let words: Vec<&str> = words.into_iter().chain([study.to_str().unwrap()]).collect();
    let mut command = Command::cargo_bin("carpus").unwrap();
    let run = command.current_dir(root("")).args(words).assert().success();
    let proposal: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let unknown = proposal["unknown"].to_string();
    assert!(unknown.contains("version 7.3 (HDF5)") && unknown.contains("-v7"), "{proposal:#}");
    let trial = &proposal["trials"][0];
    assert_eq!((&trial["table"], &trial["emg_table"]), (&"Dynamometer".into(), &"EMG".into()), "{proposal:#}");
    assert_eq!(trial["file"], trial["emg_file"]);
}

#[test]
fn verif_no_proposed_study_has_a_red_finding() {
    for laboratory in ["biodex_delsys", "humac_noraxon", "one_file", "workbook_matlab"] {
        checked(laboratory);
    }
}

#[test]
fn verif_a_study_that_is_there_is_not_overwritten_and_a_wrong_folder_is_told() {
    let (out, _) = proposed("one_file");
    let study = out.path().join("study");
    let folder = exports().join("one_file");
    let again = |folder: &Path| {
        let words = ["init", folder.to_str().unwrap(), "--model", "models/wrist.osim", "--yes", "--out"];
        let words: Vec<&str> = words.into_iter().chain([study.to_str().unwrap()]).collect();
        Command::cargo_bin("carpus").unwrap().current_dir(root("")).args(words).assert().failure().code(1)
    };
    let run = again(&folder);
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains("there is a study here already"));
    std::fs::remove_file(study.join("study.toml")).unwrap();
    let empty = tempfile::tempdir().unwrap();
    let run = again(empty.path());
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains("no file with a time, an angle and a torque"));
}

#[test]
fn verif_check_is_red_where_the_clocks_signs_or_units_are_wrong() {
    let (out, _) = proposed("humac_noraxon");
    let file = out.path().join("study/study.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    let spoilt = |from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        std::fs::write(&file, text.replace(from, to)).unwrap();
        let mut command = Command::cargo_bin("carpus").unwrap();
        let run = command.args(["check", file.to_str().unwrap(), "--json"]).assert();
        let found: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
        (run.get_output().status.code(), found)
    };
    let (code, found) = spoilt(", sign = -1", "");
    assert_eq!((code, found["level"].as_str()), (Some(1), Some("red")), "{found:#}");
    // Without the shared channel the clocks of recorders that were started by hand are off by some tenths of a second.
    let shared = text.lines().find(|line| line.starts_with("shared = ")).unwrap();
    let with = text.lines().find(|line| line.starts_with("shared_with = ")).unwrap();
    let (code, found) = spoilt(&format!("{shared}\n{with}\nmax_delay_s = 2"), "delay_s = 0");
    let findings = found["findings"].as_array().unwrap();
    let is_told = |f: &Value| f["level"] == "amber" && f["text"].as_str().unwrap().contains("leads the moment");
    assert!(code == Some(0) && findings.iter().any(is_told), "{found:#}");
}
