//! Whatever a command writes, the next one reads; and an output folder holds what the last run wrote, nothing of
//! another.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::storage::Storage;
use carpus::study::Study;
use predicates::prelude::*;
use predicates::str::contains;

use super::reference::shared;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus(words: &[&str], study: &Path, out: &Path) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("carpus").expect("the program");
    command.timeout(std::time::Duration::from_secs(600));
    command.args(words).arg(study).arg("--out").arg(out).assert()
}

/// Largest relative difference of a number written with nine significant digits in CSV and with ten in `.sto`: half a
/// unit of either last digit.
const ROUNDING: f64 = 5.5e-9;

/// Largest relative difference of an error that is found with the held-out trials alone: lengths of paths are read from
/// tables over the angles of the trials at hand, which interpolate to some 1e-6.
const OTHER_TABLES: f64 = 1e-5;

const SHORT: [&str; 2] = ["data/P01/isotonic_25_flexion_1.csv", "data/P01/isotonic_25_flexion_2.csv"];

/// The bundled study with two trials, in files of these names.
fn study(folder: &Path, files: [&str; 2]) -> PathBuf {
    let source = root("fixtures/demo_study");
    let toml = std::fs::read_to_string(source.join("study.toml")).unwrap();
    std::fs::write(folder.join("study.toml"), toml.replace("../../models/wrist.osim", "wrist.osim")).unwrap();
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    std::fs::copy(source.join("participants.csv"), folder.join("participants.csv")).unwrap();
    let mut table = "participant,file,contraction,effort_percent,direction,posture_deg,repetition,use\n".to_owned();
    for (i, (from, to)) in SHORT.iter().zip(files).enumerate() {
        std::fs::create_dir_all(folder.join(to).parent().unwrap()).unwrap();
        std::fs::copy(source.join(from), folder.join(to)).unwrap();
        let usage = ["train", "test"][i];
        writeln!(table, "P01,{to},isotonic,25,flexion,,{},{usage}", i + 1).unwrap();
    }
    std::fs::write(folder.join("trials.csv"), table).unwrap();
    folder.join("study.toml")
}

/// Files below a folder, by their paths in it.
fn files(folder: &Path) -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(here) = open.pop() {
        for entry in std::fs::read_dir(&here).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.insert(path.strip_prefix(folder).unwrap().to_string_lossy().into_owned(), path);
            }
        }
    }
    found
}

/// Every table below a folder is one that programs read: numbers have no sign or space that only people read.
fn tables_are_for_programs(folder: &Path) -> usize {
    let tables: Vec<(String, PathBuf)> = files(folder).into_iter().filter(|(name, _)| name.ends_with(".csv")).collect();
    for (name, path) in &tables {
        let mut reader = csv::Reader::from_path(path).unwrap();
        for record in reader.records() {
            for cell in record.unwrap_or_else(|e| panic!("{name}: {e}")).iter() {
                let like_a_number = cell.starts_with(['−', '–']) || cell.contains("e−") || cell.contains('\u{202f}');
                assert!(!like_a_number, "{name}: `{cell}`");
            }
        }
    }
    tables.len()
}

#[test]
fn verif_two_trials_of_one_file_name_keep_their_results_apart() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), ["P01/t.csv", "P01/day2/t.csv"]);
    for command in ["simulate", "compare"] {
        let out = folder.path().join(command);
        carpus(&[command], &study, &out).success();
        let series: Vec<String> = files(&out.join("P01/series")).into_keys().collect();
        assert_eq!(series, ["P01_t.csv", "P01_t.sto", "day2_t.csv", "day2_t.sto"]);
        let json = std::fs::read_to_string(out.join("P01/results.json")).unwrap();
        let results = carpus::report::results::Results::parse(&json).unwrap();
        let ids: Vec<&str> = results.trials.iter().map(|t| t.id.as_str()).collect();
        assert_eq!(ids, ["P01_t", "day2_t"]);
        // Each series is that of its own file.
        for (id, file) in ids.iter().zip(["P01/t.csv", "P01/day2/t.csv"]) {
            let first = |path: PathBuf, column: usize| -> f64 {
                let text = std::fs::read_to_string(path).unwrap();
                text.lines().nth(1).unwrap().split(',').nth(column).unwrap().parse().unwrap()
            };
            let written = first(out.join(format!("P01/series/{id}.csv")), 2);
            assert_eq!(written, first(folder.path().join(file), 2), "{id}");
        }
    }
    let errors = std::fs::read_to_string(folder.path().join("compare/P01/errors_per_trial.csv")).unwrap();
    assert!(errors.contains("P01,P01_t,train") && errors.contains("P01,day2_t,test"), "{errors}");
    let json = std::fs::read_to_string(folder.path().join("compare/P01/results.json")).unwrap();
    assert!(json.contains("P01/day2/t.csv"), "the file is told as it is written");
}

#[test]
fn verif_an_output_folder_holds_nothing_of_another_run() {
    let place = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| {
        std::fs::create_dir(place.path().join(name)).unwrap();
        study(&place.path().join(name), SHORT)
    });
    let out = place.path().join("out");
    carpus(&["simulate"], &one, &out).success();
    let there = |file: &str| out.join(file).exists();
    assert!(there("P01/series/isotonic_25_flexion_2.sto") && there("carpus-output.json"));
    // Another study is refused before anything is computed; nothing is touched.
    let before = files(&out).into_keys().collect::<Vec<_>>();
    carpus(&["compare"], &other, &out).code(1).stderr(contains("another study").and(contains("hint: choose another")));
    assert_eq!(files(&out).into_keys().collect::<Vec<_>>(), before);
    // So is another command of the same study, and a folder with files of another hand.
    let refused = carpus(&["compare"], &one, &out).code(1).stdout("");
    refused.stderr(contains("holds results of simulate, not of compare").and(contains("hint: choose another folder")));
    let paths = ["paths", "--sweep", "flexion=-60:60:30deg"];
    carpus(&paths, &root("models/wrist.osim"), &out).code(1).stderr(contains("results of simulate, not of paths"));
    let foreign = place.path().join("foreign");
    std::fs::create_dir(&foreign).unwrap();
    carpus(&["simulate"], &one, &foreign).success();
    std::fs::remove_file(foreign.join("carpus-output.json")).unwrap();
    carpus(&["simulate"], &one, &foreign).code(1).stderr(contains("files that are not of simulate: P01/"));
    assert_eq!(files(&out).into_keys().collect::<Vec<_>>(), before);
    // With one trial less its results go, and it is said.
    carpus(&["simulate"], &one, &out).success().stderr(contains("removed").not());
    let table = std::fs::read_to_string(one.with_file_name("trials.csv")).unwrap();
    std::fs::write(one.with_file_name("trials.csv"), table.lines().take(2).collect::<Vec<_>>().join("\n")).unwrap();
    let run = carpus(&["simulate"], &one, &out).success();
    run.stderr(
        contains("removed what an earlier run of simulate had left here").and(contains("isotonic_25_flexion_2")),
    );
    assert!(!there("P01/series/isotonic_25_flexion_2.sto") && there("P01/series/isotonic_25_flexion_1.sto"));
}

#[test]
fn verif_what_simulation_and_comparison_write_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), SHORT);
    let out = folder.path().join("out");
    carpus(&["compare"], &study, &out).success();
    let sto = Storage::read(out.join("P01/series/isotonic_25_flexion_1.sto")).unwrap_or_else(|e| panic!("{e}"));
    let mut csv = csv::Reader::from_path(out.join("P01/series/isotonic_25_flexion_1.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        csv.records().map(|row| row.unwrap().iter().map(|cell| cell.parse().unwrap()).collect()).collect();
    assert_eq!((sto.len(), sto.labels.len() + 1), (rows.len(), rows[0].len()));
    for (k, row) in rows.iter().enumerate() {
        assert!((sto.time[k] - row[0]).abs() < 1e-9);
        for (a, b) in sto.rows[k].iter().zip(&row[1..]) {
            assert!((a - b).abs() <= ROUNDING * b.abs().max(1e-9), "{k}: {a} {b}");
        }
    }
    // Paths and equilibria, with negative numbers among theirs.
    let sweep = ["paths", "--sweep", "flexion=-60:60:30deg"];
    let swept = out.join("swept");
    carpus(&sweep, &root("models/wrist.osim"), &swept).success();
    let csv = out.join("rest.csv");
    let mut rest = Command::cargo_bin("carpus").unwrap();
    rest.arg("equilibrium").arg(root("models/wrist.osim")).args(["--set", "flexion=-30deg", "--csv"]).arg(&csv);
    rest.assert().success();
    assert!(tables_are_for_programs(&out) >= 6);
}

#[test]
fn verif_a_synthetic_study_is_read_with_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), ["P01/t.csv", "P01/day2/t.csv"]);
    let toml = std::fs::read_to_string(&study).unwrap();
    std::fs::write(&study, toml.replace("Carpus demo", "\\\"−5°\\\" \\u00e9")).unwrap();
    let out = folder.path().join("out");
    carpus(&["synth"], &study, &out).success();
    let given = Study::read(&study).unwrap_or_else(|e| panic!("{e}"));
    let made = Study::read(out.join("study.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(made.settings.name, format!("{}, simulated", given.settings.name));
    let names = |study: &Study| study.trials.iter().map(|t| t.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&made), names(&given));
    assert_eq!(made.settings.dynamometer.include, given.settings.dynamometer.include);
    assert!((made.settings.dynamometer.damping / given.settings.dynamometer.damping - 1.0).abs() < 1e-6);
    assert!(tables_are_for_programs(&out) >= 4);
    // What no command would read is not written.
    let absurd = ["synth", "--effect", "gravity:moment_at_zero=1e300"];
    carpus(&absurd, &study, &folder.path().join("absurd")).code(1).stderr(contains("no study can hold"));
    assert!(!folder.path().join("absurd/study.toml").exists());
}

/// A recording at 100 Hz of a torque with noise, and its EMG at 2 kHz on a second recorder, which shares the EMG
/// itself.
fn two_recorders(folder: &Path) {
    let mut state = 1u64;
    let mut noise = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    };
    let effort = |t: f64| (3.0 * t).sin() + 0.6 * (7.1 * t).cos() + 0.4 * (13.7 * t).sin();
    let mut slow = "time_s,angle_deg,moment_n_m,ulnar_n_m,sync\n".to_owned();
    for i in 0..400 {
        let t = 0.01 * f64::from(i);
        let (m, u) = (-3.0 + 0.5 * effort(t) + 0.1 * noise(), 0.2 + 0.05 * noise());
        writeln!(slow, "{t},{},{m},{u},{}", -30.0 + 0.1 * noise(), effort(t)).unwrap();
    }
    let mut fast = "time_s,emg_FCR\n".to_owned();
    for i in 0..7600 {
        let t = 0.0005 * f64::from(i);
        writeln!(fast, "{t},{}", effort(t + 0.1003)).unwrap();
    }
    std::fs::write(folder.join("a.csv"), slow).unwrap();
    std::fs::write(folder.join("a_emg.csv"), fast).unwrap();
}

#[test]
fn verif_a_processed_study_is_read_whatever_its_study_says() {
    let folder = tempfile::tempdir().unwrap();
    two_recorders(folder.path());
    std::fs::copy(root("models/wrist.osim"), folder.path().join("wrist.osim")).unwrap();
    // A table above the first header, a negative posture, a start time, an arm turned over, a further moment, Windows'
    // paths.
    let toml = "posture_deg = { elbow_flexion = 90 }\nmuscles.active = [\"FCR\"]\n\n[study]\nname = \"−30°\"\nmodel = \
                '.\\wrist.osim'\n\n\
                [dynamometer]\ncoordinate = \"flexion\"\nfurther_moments = { deviation = \"ulnar_n_m\" }\n\n\
                [emg]\nkind = \"raw\"\n\n[processing]\nremove_drag = true\n[emg_recorder]\n\
                file = \"{trial}_emg.csv\"\nshared = \"emg_FCR\"\nshared_with = \"sync\"\n";
    std::fs::write(folder.path().join("study.toml"), toml).unwrap();
    std::fs::write(folder.path().join("participants.csv"), "participant\nP01\n").unwrap();
    let rows = "participant,file,contraction,effort_percent,direction,posture_deg,repetition,use,start_time_s,arm\n\
                P01,.\\a.csv,isometric,12.5,extension,-30.25,1,mvc,1.5,flipped\n";
    std::fs::write(folder.path().join("trials.csv"), rows).unwrap();
    let out = folder.path().join("out");
    carpus(&["dynamometer"], &folder.path().join("study.toml"), &out).success();
    let given = Study::read_tables(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let made = Study::read(out.join("study.toml")).unwrap_or_else(|e| panic!("{e}"));
    let (a, b) = (&given.trials[0], &made.trials[0]);
    assert!((b.posture.unwrap().to_degrees() + 30.25).abs() < 1e-9, "{:?}", b.posture);
    assert_eq!((a.effort_percent, a.start_time, a.arm_flipped), (b.effort_percent, b.start_time, b.arm_flipped));
    assert_eq!(
        (a.contraction, a.direction, a.repetition, a.usage),
        (b.contraction, b.direction, b.repetition, b.usage)
    );
    assert_eq!((&made.settings.name, &made.settings.emg), (&given.settings.name, &given.settings.emg));
    assert_eq!(made.settings.posture[0].value_deg_or_m, 90.0);
    assert_eq!(made.settings.columns.further_moments[0].column, "ulnar_n_m");
    assert!(tables_are_for_programs(&out) >= 3);

    // EMG at 2 kHz, and a torque of 100 Hz on its grid, which is recognized.
    let trial = made.trial(&made.trials[0]).unwrap_or_else(|e| panic!("{e}"));
    assert!(trial.len() > 7000);
    assert!((trial.rows_per_moment() - 20.0).abs() < 0.1, "{}", trial.rows_per_moment());
    let said = made.warnings.iter().any(|w| w.to_string().contains("the moment was interpolated to 2000 Hz: 100 of"));
    assert!(said, "{:?}", made.warnings);
    // What was recognized is a remark: raw samples, here up to ±2 V, become excitations all the same, 1 at the MVC.
    let [excitation] = trial.excitation.as_slice() else { panic!("one channel") };
    let (least, largest) = excitation.iter().fold((f64::MAX, f64::MIN), |(l, m), e| (l.min(*e), m.max(*e)));
    assert!(least >= 0.0 && (largest - 1.0).abs() < 1e-12, "{least} to {largest}");
    // Uniform noise of ±0.1 N·m has a standard deviation of 0.058 N·m.
    let compared = folder.path().join("compared");
    carpus(&["compare"], &out.join("study.toml"), &compared).success();
    let json = std::fs::read_to_string(compared.join("P01/results.json")).unwrap();
    let results = carpus::report::results::Results::parse(&json).unwrap();
    let found = results.trials[0].moment_noise_n_m.expect("noise");
    assert!((found / 0.0577 - 1.0).abs() < 0.3, "{found}");
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn verif_an_artefact_in_an_mvc_trial_is_found() {
    let study = shared("faults/bug-08-emg-artefact-in-mvc-unnoticed");
    let out = tempfile::tempdir().unwrap();
    carpus(&["emg"], &study, out.path()).success();
    let text = std::fs::read_to_string(out.path().join("emg.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut found = Vec::new();
    for trial in results["participants"][0]["trials"].as_array().unwrap() {
        for channel in trial["channels"].as_array().unwrap() {
            let of = |name: &str| channel[name].as_array().unwrap().clone();
            let name = format!("{} {}", trial["trial"].as_str().unwrap(), channel["column"].as_str().unwrap());
            found.extend(
                of("findings").iter().filter(|f| f.as_str().unwrap().starts_with("artefact")).map(|_| name.clone()),
            );
        }
    }
    assert_eq!(found, ["mvc_flexion emg_FCR"]);
    assert_eq!(tables_are_for_programs(out.path()), 4);
    let simulated = carpus(&["simulate"], &study, &out.path().join("simulated")).success();
    simulated.stderr(contains("mvc_flexion.csv: column `emg_FCR`: artefact").and(contains("sets the level")));
}

#[test]
#[cfg_attr(not(has_shared_data), ignore = "needs shared recordings and setups (CARPUS_SHARED)")]
fn verif_a_study_with_backslashes_is_read() {
    let folder = shared("faults/bug-21-backslash-in-trials-csv");
    let study = Study::read_tables(folder.join("study")).unwrap_or_else(|e| panic!("{e}"));
    assert!(!study.trials.is_empty() && study.trials.iter().all(|trial| trial.file.is_file()));
}

#[test]
fn verif_a_number_of_the_model_that_overflows_is_the_users_and_has_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), SHORT);
    let text = std::fs::read_to_string(root("models/wrist.osim")).unwrap();
    let at = text.find("<max_isometric_force>").unwrap();
    let end = at + text[at..].find("</max_isometric_force>").unwrap();
    let spoilt = format!("{}<max_isometric_force>1e308{}", &text[..at], &text[end..]);
    std::fs::write(folder.path().join("wrist.osim"), spoilt).unwrap();
    for command in ["simulate", "compare", "personalize"] {
        let out = folder.path().join(command);
        let failed = carpus(&[command], &study, &out).code(1);
        let said = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        let errors: Vec<&str> = said.lines().filter(|line| line.starts_with("error")).collect();
        assert_eq!(errors.len(), 1, "{said}");
        assert!(errors[0].contains("wrist.osim:") && !said.contains("internal error"), "{said}");
    }
}

/// The study of [`study`], both trials to train on.
fn all_to_train_on(folder: &Path) -> PathBuf {
    let study = study(folder, SHORT);
    let table = std::fs::read_to_string(folder.join("trials.csv")).unwrap();
    std::fs::write(folder.join("trials.csv"), table.replace(",test", ",train")).unwrap();
    study
}

/// The number in a column of a table's only row with these cells.
fn cell(table: &Path, row: &[(&str, &str)], column: &str) -> f64 {
    let mut reader = csv::Reader::from_path(table).unwrap();
    let headers = reader.headers().unwrap().clone();
    let at = |name: &str| headers.iter().position(|header| header == name).unwrap_or_else(|| panic!("{name}"));
    let is_it = |record: &csv::StringRecord| row.iter().all(|(name, value)| &record[at(name)] == *value);
    let found: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).filter(is_it).collect();
    assert_eq!(found.len(), 1, "{row:?}: {found:?}");
    found[0][at(column)].parse().unwrap()
}

#[test]
fn verif_models_that_commands_write_are_evaluated_and_simulated() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), ["P01/t.csv", "P01/day2/t.csv"]);
    let [fitted, compared, evaluated, strong, simulated] =
        ["fitted", "compared", "evaluated", "strong", "simulated"].map(|name| folder.path().join(name));
    carpus(&["personalize", "--no-intervals"], &study, &fitted).success();
    carpus(&["evaluate", "--models", fitted.to_str().unwrap()], &study, &evaluated).success();
    // The trial that was held out, whose file is called as the other's.
    let trial = [("trial", "day2_t"), ("model", "personalized")];
    let fit = cell(&fitted.join("P01/errors_per_trial.csv"), &trial, "rmse_n_m");
    let model = fitted.join("P01/model.osim");
    carpus(&["compare", "--model", model.to_str().unwrap()], &study, &compared).success();
    let trial = [("trial", "day2_t"), ("model", "model")];
    assert_eq!(cell(&compared.join("P01/errors_per_trial.csv"), &trial, "rmse_n_m"), fit);
    let again = cell(&evaluated.join("evaluation_errors.csv"), &[("model", "fitted")], "rmse_n_m");
    assert!((again / fit - 1.0).abs() < OTHER_TABLES, "{again} N·m, {fit} N·m when it was fitted");

    let toml = std::fs::read_to_string(&study).unwrap();
    std::fs::write(&study, toml + "\n[strength_scaling]\nposture_deg = 0\n").unwrap();
    carpus(&["strength-scale"], &study, &strong).success();
    let model = strong.join("P01/model.osim");
    carpus(&["simulate", "--model", model.to_str().unwrap()], &study, &simulated).success();
    let force = |path: &Path, name: &str| {
        let file = carpus::osim::OsimFile::parse(std::fs::read(path).unwrap(), "model.osim").unwrap();
        file.spec.muscles.iter().find(|muscle| muscle.name == name).unwrap().max_isometric_force
    };
    let [a, b] = ["FCR", "FCU"].map(|name| force(&model, name) / force(&folder.path().join("wrist.osim"), name));
    assert!((a / b - 1.0).abs() < 1e-6 && (a - 1.0).abs() > 1e-3, "{a} {b}");
    assert!(tables_are_for_programs(folder.path()) >= 13);
}

/// What a command prints, as JSON.
fn printed(arguments: &[&std::ffi::OsStr]) -> serde_json::Value {
    let mut command = Command::cargo_bin("carpus").expect("the program");
    let run = command.arg("--json").args(arguments).assert().success();
    serde_json::from_slice(&run.get_output().stdout).unwrap()
}

#[test]
fn verif_what_identification_writes_is_read_as_knowledge_of_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let study = all_to_train_on(folder.path());
    let out = folder.path().join("out");
    carpus(&["identify", "--draws", "40"], &study, &out).success();
    assert!(tables_are_for_programs(&out) >= 4 && out.join("carpus-output.json").exists());
    let table = folder.path().join("priors.csv");
    let mut priors = Command::cargo_bin("carpus").unwrap();
    priors.arg("priors").arg(&out).arg("--out").arg(&table).assert().success();
    let known = carpus::study::read_priors(&table).unwrap_or_else(|e| panic!("{e}"));
    assert!(!known.is_empty() && tables_are_for_programs(folder.path()) >= 5);
    // A file that is asked for by its name is alone.
    assert!(!folder.path().join("carpus-output.json").exists());
    let next = folder.path().join("next");
    carpus(&["identify", "--draws", "40", "--priors", table.to_str().unwrap()], &study, &next).success();
    let text = std::fs::read_to_string(next.join("P01/identifiability.json")).unwrap();
    assert!(text.contains("population of 1 earlier fits"), "the table's source is that of the priors");
}

#[test]
fn verif_scaled_and_upgraded_models_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), SHORT);
    let scaled = folder.path().join("scaled");
    carpus(&["scale", "--factor", "hand=1.1"], &root("models/wrist.osim"), &scaled).success();
    let names: Vec<String> = files(&scaled).into_keys().collect();
    assert_eq!(names, ["carpus-output.json", "model.osim", "path_lengths.csv", "scale.json"]);
    assert_eq!(tables_are_for_programs(&scaled), 1);
    let manifest = std::fs::read_to_string(scaled.join("carpus-output.json")).unwrap();
    assert!(manifest.contains("models/wrist.osim") && manifest.contains("\"command\": \"scale\""), "{manifest}");
    // The study runs with the scaled model, whose moment arms differ.
    let model = scaled.join("model.osim");
    let out = folder.path().join("out");
    carpus(&["simulate", "--model", model.to_str().unwrap()], &study, &out).success();
    // Its results are not taken for those of the study, nor the other way round.
    carpus(&["scale", "--factor", "hand=1.2"], &root("models/wrist.osim"), &scaled).success();
    let text = std::fs::read_to_string(scaled.join("scale.json")).unwrap();
    assert!(text.contains("1.2"), "written anew");

    for old in ["arm_20302.osim", "arm_30000.osim"] {
        let [new, again] = ["new", "again"].map(|name| folder.path().join(format!("{name}_{old}")));
        for (from, to) in [(root("fixtures/upgrade").join(old), &new), (new.clone(), &again)] {
            Command::cargo_bin("carpus").unwrap().arg("upgrade").arg(from).arg(to).assert().success();
        }
        assert_eq!(std::fs::read(&new).unwrap(), std::fs::read(&again).unwrap(), "{old}: nothing is left to upgrade");
        let info = printed(&["info".as_ref(), new.as_os_str()]);
        assert!(info["muscles"].as_array().is_some_and(|m| !m.is_empty()), "{info}");
    }
    assert!(!folder.path().join("carpus-output.json").exists(), "beside a file that has its own name nothing appears");
}

/// A body that floats, with a marker of each name.
fn floating(markers: &[&str]) -> String {
    let marker = |(i, name): (usize, &&str)| {
        let place = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]][i];
        format!(
            "<Marker name=\"{name}\"><socket_parent_frame>/bodyset/b</socket_parent_frame><location>{} {} \
             {}</location></Marker>",
            place[0], place[1], place[2]
        )
    };
    format!(
        "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><BodySet><objects><Body \
         name=\"b\"><mass>1</mass><mass_center>0 0 0</mass_center>\
         <inertia>0.1 0.1 0.1 0 0 0</inertia></Body></objects></BodySet><JointSet><objects><FreeJoint name=\"j\">\
         <socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/b</socket_child_frame>\
         </FreeJoint></objects></JointSet>\
         <MarkerSet><objects>{}</objects></MarkerSet></Model></OpenSimDocument>",
        markers.iter().enumerate().map(marker).collect::<String>()
    )
}

#[test]
fn verif_recordings_of_motion_capture_are_read_by_tools_and_studies() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("recorded");
    carpus(&["c3d"], &root("fixtures/motion_capture/float.c3d"), &out).success();
    let names: Vec<String> = files(&out).into_keys().collect();
    assert_eq!(names, ["carpus-output.json", "float_analog.csv", "float_markers.trc"]);
    assert_eq!(tables_are_for_programs(&out), 1);
    // Inverse kinematics with the markers, and inverse dynamics with its motion.
    std::fs::write(folder.path().join("model.osim"), floating(&["RADIUS", "ULNA", "MCP3"])).unwrap();
    let setup = |class: &str, inner: &str| {
        let text = format!(
            "<OpenSimDocument Version=\"40600\"><{class} name=\"t\"><model_file>model.osim</model_file>\
             <results_directory>results</results_directory>{inner}</{class}></OpenSimDocument>"
        );
        let file = folder.path().join(format!("{class}.xml"));
        std::fs::write(&file, text).unwrap();
        Command::cargo_bin("carpus").unwrap().arg("run-tool").arg(file).assert().success();
    };
    setup(
        "InverseKinematicsTool",
        "<marker_file>recorded/float_markers.trc</marker_file><output_motion_file>q.mot</output_motion_file>",
    );
    assert_eq!(Storage::read(folder.path().join("q.mot")).unwrap().len(), 25);
    let dynamics = "<coordinates_file>q.mot</coordinates_file><output_gen_force_file>id.sto</output_gen_force_file>";
    setup("InverseDynamicsTool", dynamics);
    let results = folder.path().join("results");
    assert_eq!(Storage::read(results.join("id.sto")).unwrap().len(), 25);
    // The folder of results says what made them; the motion, which the setup names itself, is alone.
    let manifest = std::fs::read_to_string(results.join("carpus-output.json")).unwrap();
    let made = ["\"id.sto\"", "\"t_ik_marker_errors.sto\"", "InverseDynamicsTool.xml", "\"command\": \"run-tool\""];
    assert!(made.iter().all(|part| manifest.contains(part)), "{manifest}");
    assert!(!folder.path().join("carpus-output.json").exists());
    // What the same setup no longer writes stays, as OpenSim leaves it, and is named.
    let text = std::fs::read_to_string(folder.path().join("InverseDynamicsTool.xml")).unwrap();
    std::fs::write(folder.path().join("InverseDynamicsTool.xml"), text.replace("id.sto", "other.sto")).unwrap();
    let mut again = Command::cargo_bin("carpus").unwrap();
    let again = again.arg("run-tool").arg(folder.path().join("InverseDynamicsTool.xml")).assert().success();
    again.stderr(contains("left here: id.sto").and(contains("not of this run")));

    // The analog channels as a trial of a study; the second channel stands for a goniometer.
    let toml = "[study]\nname = \"c3d\"\nmodel = \"wrist.osim\"\n[dynamometer]\ncoordinate \
                = \"flexion\"\n[muscles]\nactive = [\"ECRL\"]\n\
                [columns]\nangle = \"FCU\"\nmoment = \"Torque\"\nemg = { ECRL = \"ECRL\" }\n[emg]\nkind = \"raw\"\n";
    std::fs::write(folder.path().join("study.toml"), toml).unwrap();
    std::fs::copy(root("models/wrist.osim"), folder.path().join("wrist.osim")).unwrap();
    std::fs::write(folder.path().join("participants.csv"), "participant\nP01\n").unwrap();
    let row = "participant,file,contraction,effort_percent,direction,posture_deg,repetition,use\n\
               P01,recorded/float_analog.csv,isometric,25,flexion,0,1,train\n\
               P01,mvc.csv,mvc,100,flexion,0,1,mvc\n";
    std::fs::copy(out.join("float_analog.csv"), folder.path().join("mvc.csv")).unwrap();
    std::fs::write(folder.path().join("trials.csv"), row).unwrap();
    let made = Study::read_tables(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let trial = made.trial(&made.trials[0]).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(trial.len(), 250);
    assert!((trial.time[249] - 0.249).abs() < 1e-9);
}

#[test]
fn verif_a_step_back_keeps_the_manifest_true() {
    let folder = tempfile::tempdir().unwrap();
    let study = all_to_train_on(folder.path());
    let out = folder.path().join("out");
    let add = || {
        let mut command = Command::cargo_bin("carpus").unwrap();
        command.args(["effect", "add"]).arg(&study).args(["gravity", "--i-choose", "--out"]).arg(&out);
        command.assert().success()
    };
    add();
    let text = std::fs::read_to_string(out.join("carpus-output.json")).unwrap();
    let before: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut remove = Command::cargo_bin("carpus").unwrap();
    remove.args(["effect", "remove"]).arg(out.join("P01")).assert().success();
    assert!(!out.join("P01/carpus-output.json").exists(), "the folder of the study says it");
    let text = std::fs::read_to_string(out.join("carpus-output.json")).unwrap();
    let after: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&before["study"], &before["study_file"]), (&after["study"], &after["study_file"]));
    let of = |manifest: &serde_json::Value, file: &str| manifest["files"][file]["sha256"].as_str().map(str::to_owned);
    assert_ne!(of(&before, "P01/model.osim"), of(&after, "P01/model.osim"), "the model is another");
    assert_eq!(of(&after, "P01/model.osim"), of(&after, "P01/steps/1_refit/model.osim"));
    // A second run finds nothing that it would take for changed by hand.
    add().stderr(contains("changed since then").not());
}

#[test]
fn verif_angles_and_emg_on_a_faster_grid_are_said() {
    let place = tempfile::tempdir().unwrap();
    let study = study(place.path(), SHORT);
    let own = "data/P01/isotonic_25_flexion_1.csv";
    let text = std::fs::read_to_string(place.path().join(own)).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    let said = |held: &[&str], straight: &[&str]| -> Vec<String> {
        // Noise in all columns, so that each row of the given file is a sample of its own; then some columns on a grid
        // ten times as fast.
        let mut state = 7u64;
        let mut noise = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        let noisy: Vec<Vec<f64>> = rows
            .iter()
            .map(|row| row.iter().enumerate().map(|(k, x)| if k == 0 { *x } else { x + 0.01 * noise() }).collect())
            .collect();
        let mut out = header.join(",") + "\n";
        for (i, pair) in noisy.windows(2).enumerate() {
            for j in 0..10 {
                let cells = header.iter().enumerate().map(|(k, name)| {
                    let between = pair[0][k] + 0.1 * f64::from(j) * (pair[1][k] - pair[0][k]);
                    let x = match k {
                        0 => rows[0][0] + (rows[1][0] - rows[0][0]) * (i as f64 + 0.1 * f64::from(j)),
                        _ if held.contains(name) => pair[0][k],
                        _ if straight.contains(name) => between,
                        _ => between + 0.01 * noise(),
                    };
                    format!("{x:.7}")
                });
                out += &(cells.collect::<Vec<_>>().join(",") + "\n");
            }
        }
        std::fs::write(place.path().join(own), out).unwrap();
        let read = Study::read(&study).unwrap_or_else(|e| panic!("{e}"));
        let warnings = read.warnings.iter().map(ToString::to_string);
        warnings.filter(|text| text.contains("of its samples a second are its own")).collect()
    };
    assert!(said(&[], &[]).is_empty(), "{:?}", said(&[], &[]));
    let found = said(&["angle_deg"], &[]);
    assert!(found.len() == 1 && found[0].contains("the angle `angle_deg` was held to"), "{found:?}");
    let found = said(&["emg_FCR"], &["angle_deg"]);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().any(|text| text.contains("the angle `angle_deg` was interpolated to")), "{found:?}");
    assert!(found.iter().any(|text| text.contains("the EMG `emg_FCR` was held to")), "{found:?}");
}
