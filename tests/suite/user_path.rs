//! The commands as a user types them, on bundled input; what bad input is answered with is a module of its own.

mod bad_input;
mod display;
mod other_models;

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;

fn carpus() -> Command {
    let mut command = Command::cargo_bin("carpus").unwrap();
    // A command that hangs is a failure, not a wait.
    command.timeout(std::time::Duration::from_secs(600)).env_remove("RUST_LOG");
    command
}

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn model() -> PathBuf {
    root("models/wrist.osim")
}

/// A copy of the bundled study with its model, to be spoilt, with two trials only.
struct StudyCopy {
    folder: tempfile::TempDir,
}

const TRAIN: &str = "data/P01/isotonic_25_flexion_1.csv";
const TEST: &str = "data/P01/isotonic_25_flexion_2.csv";

impl StudyCopy {
    fn new() -> StudyCopy {
        let copy = StudyCopy { folder: tempfile::tempdir().unwrap() };
        let source = root("fixtures/demo_study");
        std::fs::create_dir_all(copy.path("data/P01")).unwrap();
        for name in ["study.toml", "participants.csv", "trials.csv", TRAIN, TEST] {
            std::fs::copy(source.join(name), copy.path(name)).unwrap();
        }
        std::fs::copy(model(), copy.path("wrist.osim")).unwrap();
        copy.edit("study.toml", |text| text.replace("../../models/wrist.osim", "wrist.osim"));
        copy.edit("trials.csv", |text| {
            let kept = |(i, line): &(usize, &str)| *i == 0 || line.contains(TRAIN) || line.contains(TEST);
            text.lines().enumerate().filter(kept).map(|(_, line)| format!("{line}\n")).collect()
        });
        copy
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    fn edit(&self, relative: &str, change: impl Fn(&str) -> String) {
        let text = std::fs::read_to_string(self.path(relative)).unwrap();
        let changed = change(&text);
        assert_ne!(text, changed, "the edit of {relative} does something");
        std::fs::write(self.path(relative), changed).unwrap();
    }

    /// Changes one row of a trial (0 is the header): its fields in place.
    fn edit_row(&self, row: usize, change: impl Fn(&mut Vec<String>)) {
        self.edit(TRAIN, |text| {
            let edited = |(i, line): (usize, &str)| {
                let mut fields: Vec<String> = line.split(',').map(String::from).collect();
                if i == row {
                    change(&mut fields);
                }
                fields.join(",") + "\n"
            };
            text.lines().enumerate().map(edited).collect()
        });
    }

    fn run(&self, command: &str) -> assert_cmd::assert::Assert {
        carpus().arg(command).arg(self.path("study.toml")).arg("--out").arg(self.path("out")).assert()
    }

    /// `compare` refuses the study, names this place and says all of this.
    fn refused(&self, place: &str, says: &[&str]) {
        let failed = self.run("compare").code(1).stdout("");
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        assert!(text.contains("error: "), "{text}");
        assert!(text.contains(place), "expected {place} in:\n{text}");
        for words in says {
            assert!(text.contains(words), "expected `{words}` in:\n{text}");
        }
        assert!(!text.contains("panicked") && !text.contains("internal error"), "{text}");
    }
}

#[test]
fn verif_help_of_every_command_has_an_example() {
    for command in
        ["demo", "info", "paths", "equilibrium", "simulate", "compare", "personalize", "effect", "plan", "synth"]
    {
        let example = format!("Example:\n  carpus {command}");
        carpus().args([command, "--help"]).assert().success().stdout(contains(example)).stderr("");
    }
    carpus().arg("--version").assert().success().stdout(contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn verif_wrong_arguments_are_the_users_fault() {
    carpus().arg("personalise").assert().code(1).stderr(contains("personalize"));
    carpus()
        .arg("paths")
        .arg(model())
        .args(["--sweep", "flexion=-70:70:1"])
        .assert()
        .code(1)
        .stderr(contains("no unit"));
    carpus().arg("equilibrium").arg(model()).args(["--activation", "1.5"]).assert().code(1).stderr(contains("0 to 1"));
    carpus()
        .args(["info", "model.osim", "--threads", "0"])
        .assert()
        .code(1)
        .stderr(contains("expected a whole number from 1 on"));
}

#[test]
fn verif_info_tells_what_is_in_the_model() {
    let shown = carpus().arg("info").arg(model()).assert().success().stderr("");
    shown.stdout(contains("5 muscles").and(contains("ECRL")).and(contains("unsupported")));
    let json = carpus().arg("info").arg(model()).arg("--json").assert().success();
    let info: serde_json::Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    assert_eq!(info["schema"], "carpus.info/1");
    assert_eq!(info["muscles"].as_array().unwrap().len(), 5);
    let flexion = info["coordinates"].as_array().unwrap().iter().find(|c| c["name"] == "flexion").unwrap();
    assert_eq!(flexion["range"][1].as_f64().unwrap().round(), 70.0);
}

#[test]
fn verif_paths_writes_table_and_page() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = ["--sweep", "flexion=-60:60:10deg", "--set", "elbow_flexion=90deg"];
    carpus().arg("paths").arg(model()).args(sweep).arg("--out").arg(folder.path()).assert().success();
    let table = std::fs::read_to_string(folder.path().join("paths.csv")).unwrap();
    assert_eq!(table.lines().count(), 14);
    assert!(table.starts_with("flexion_deg,ECRL_length_m,"));
    let page = std::fs::read_to_string(folder.path().join("paths.html")).unwrap();
    let figures = page.matches("<svg class=\"figure\"").count();
    assert_eq!(figures, 11, "an arm and a length for each of five muscles, and all arms on one pair of axes");
    // Without --out the same table goes to standard output.
    carpus().arg("paths").arg(model()).args(sweep).assert().success().stdout(table);
}

#[test]
fn verif_moment_arm_is_minus_the_slope_of_the_length() {
    let run =
        carpus().arg("paths").arg(model()).args(["--sweep", "flexion=9.99:10.01:0.01deg", "--json"]).assert().success();
    let found: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    for muscle in found["muscles"].as_array().unwrap() {
        let at = |key: &str, i: usize| muscle[key][i].as_f64().unwrap();
        let slope = (at("length_m", 2) - at("length_m", 0)) / 0.02f64.to_radians();
        assert!((slope + at("moment_arm_m", 1)).abs() < 1e-5, "{}: {slope}", muscle["name"]);
    }
}

#[test]
fn verif_equilibrium_balances_tendon_and_fibre() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("rest.csv");
    let posture = ["--set", "flexion=30deg", "--activation", "0.3"];
    carpus()
        .arg("equilibrium")
        .arg(model())
        .args(posture)
        .arg("--csv")
        .arg(&csv)
        .assert()
        .success()
        .stdout(contains("FCU"));
    let mut reader = csv::Reader::from_path(&csv).unwrap();
    let header = reader.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap_or_else(|| panic!("column {name}"));
    let mut rows = 0;
    for row in reader.records() {
        let row = row.unwrap();
        let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
        let fibre = number("active_fiber_force_n") + number("passive_fiber_force_n");
        let along = fibre * number("pennation_angle_deg").to_radians().cos();
        assert!((along - number("tendon_force_n")).abs() < 1e-3, "{row:?}");
        let moment = number("tendon_force_n") * number("flexion_moment_arm_m");
        assert!((moment - number("flexion_moment_n_m")).abs() < 1e-6);
        rows += 1;
    }
    assert_eq!(rows, 5);
}

#[test]
fn verif_names_that_are_nearly_right_get_a_hint() {
    let sweep = |text: &str| carpus().arg("paths").arg(model()).args(["--sweep", text]).assert().code(1);
    sweep("flexon=-70:70:1deg").stderr(contains("no coordinate `flexon`").and(contains("did you mean `flexion`?")));
    sweep("flexion=-7:7:1mm").stderr(contains("is a rotation: expected deg or rad"));
    let muscle = carpus().arg("paths").arg(model()).args(["--sweep", "flexion=0:1:1deg", "--muscles", "ECRK"]).assert();
    muscle.code(1).stderr(contains("did you mean `ECRL`?").or(contains("did you mean `ECRB`?")));
    let study = StudyCopy::new();
    let run = carpus()
        .arg("compare")
        .arg(study.path("study.toml"))
        .args(["--participant", "p1", "--out"])
        .arg(study.path("o"))
        .assert();
    run.code(1).stderr(contains("no participant `p1`").and(contains("did you mean `P01`?")));
}

#[test]
fn verif_simulate_writes_series_that_agree() {
    let study = StudyCopy::new();
    study.run("simulate").success().stdout(contains("P01"));
    let csv = std::fs::read_to_string(study.path("out/P01/series/isotonic_25_flexion_1.csv")).unwrap();
    let sto = std::fs::read_to_string(study.path("out/P01/series/isotonic_25_flexion_1.sto")).unwrap();
    let samples = std::fs::read_to_string(study.path(TRAIN)).unwrap().lines().count() - 1;
    assert_eq!(csv.lines().count(), samples + 1);
    assert!(sto.contains(&format!("nRows={samples}\n")) && sto.contains("endheader\ntime\t"));
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let header = reader.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap_or_else(|| panic!("column {name}"));
    // The moment is the sum of its parts.
    for row in reader.records() {
        let row = row.unwrap();
        let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
        let muscles: f64 =
            ["ECRL", "ECRB", "ECU", "FCR", "FCU"].iter().map(|m| number(&format!("{m}_moment_n_m"))).sum();
        let others =
            number("passive_n_m") + number("gravity_n_m") + number("inertia_n_m") + number("dynamometer_damping_n_m");
        assert!((muscles + others - number("simulated_n_m")).abs() < 1e-6);
    }
    assert!(study.path("out/P01/report.html").exists() && study.path("out/P01/results.json").exists());
}

#[test]
fn verif_compare_writes_errors_and_report() {
    let study = StudyCopy::new();
    study.run("compare").success().stdout(contains("held out").and(contains("training")).and(contains("report.html")));
    let json = std::fs::read_to_string(study.path("out/P01/results.json")).unwrap();
    let results = carpus::report::results::Results::parse(&json).unwrap();
    assert_eq!(results.trials.len(), 2);
    let page = std::fs::read_to_string(study.path("out/P01/report.html")).unwrap();
    assert_eq!(page, carpus::report::render_report(&results), "the report is a function of its results file");
    let per_trial = std::fs::read_to_string(study.path("out/P01/errors_per_trial.csv")).unwrap();
    assert_eq!(per_trial.lines().count(), 3);
    assert!(per_trial.contains("isotonic_25_flexion_2,test,") && per_trial.contains("isotonic_25_flexion_1,train,"));
    assert!(study.path("out/P01/errors_per_condition.csv").exists());
    // Every input is hashed; the hash of the model is the one of its bytes.
    let model = results.provenance.inputs.iter().find(|i| i.role == "model").unwrap();
    use sha2::Digest;
    let hash = sha2::Sha256::digest(std::fs::read(study.path("wrist.osim")).unwrap());
    assert_eq!(model.sha256, hash.iter().map(|b| format!("{b:02x}")).collect::<String>());
    assert_eq!(results.provenance.inputs.len(), 6, "model, study, participants, trials, two recordings");
}

/// Largest place on an axis of the residuals that `compare` writes.
fn reach(study: &StudyCopy, axis: &str) -> f64 {
    study.run("compare").success();
    let json = std::fs::read_to_string(study.path("out/P01/results.json")).unwrap();
    let results = carpus::report::results::Results::parse(&json).unwrap();
    let found = results.residuals[0].axes.iter().find(|a| a.axis == axis).unwrap();
    found.curve.iter().map(|bin| bin.0.abs()).fold(0.0, f64::max)
}

#[test]
fn verif_residuals_are_shown_along_an_angle_without_its_white_noise() {
    let study = StudyCopy::new();
    let clean = ["velocity", "acceleration"].map(|axis| reach(&study, axis));
    for (seed, file) in [TRAIN, TEST].into_iter().enumerate() {
        study.edit(file, |text| {
            let mut state = 1 + seed as u64;
            let mut uniform = || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
            };
            let noisy = |(i, line): (usize, &str)| {
                let mut fields: Vec<String> = line.split(',').map(String::from).collect();
                if i > 0 {
                    // Of standard deviation 0.3 degrees.
                    let angle: f64 = fields[1].parse().unwrap();
                    fields[1] = format!("{:.4}", angle + 0.3 * 12.0_f64.sqrt() * uniform());
                }
                fields.join(",") + "\n"
            };
            text.lines().enumerate().map(noisy).collect()
        });
    }
    // Differentiated as it is, noise of 0.3 degrees at 100 Hz is a speed of 0.5 rad/s and an acceleration of 100
    // rad/s².
    let noisy = ["velocity", "acceleration"].map(|axis| reach(&study, axis));
    for (clean, noisy) in clean.iter().zip(noisy) {
        assert!(noisy < 1.5 * clean, "{noisy} and {clean}");
    }
}

#[test]
fn verif_results_do_not_depend_on_threads() {
    let study = StudyCopy::new();
    let result = |threads: &str| {
        let out = study.path("out");
        let run = carpus()
            .arg("compare")
            .arg(study.path("study.toml"))
            .arg("--out")
            .arg(&out)
            .args(["--threads", threads])
            .assert();
        run.success();
        let text = std::fs::read_to_string(out.join("P01/results.json")).unwrap();
        text.replace(&format!("--threads {threads}"), "")
    };
    assert_eq!(result("1"), result("3"));
}

#[test]
fn verif_json_is_for_programs() {
    let study = StudyCopy::new();
    let run = carpus()
        .arg("compare")
        .arg(study.path("study.toml"))
        .arg("--out")
        .arg(study.path("out"))
        .arg("--json")
        .assert();
    let found: serde_json::Value = serde_json::from_slice(&run.success().get_output().stdout).unwrap();
    assert_eq!(found[0]["participant"], "P01");
    assert!(found[0]["models"][0]["errors"][0]["errors"]["nrmse"].as_f64().unwrap() > 0.0);
}

// The whole path.

#[test]
fn verif_demo_runs_anywhere_and_the_error_falls() {
    let folder = tempfile::tempdir().unwrap();
    let run = carpus().current_dir(folder.path()).arg("demo").assert().success();
    run.stdout(contains("held out").and(contains("carpus-demo/report.html")).and(contains("Personalized")));
    let out = folder.path().join("carpus-demo");
    let results = std::fs::read_to_string(out.join("results.json")).unwrap();
    let results = carpus::report::results::Results::parse(&results).unwrap();
    let held_out = |i: usize| {
        let errors = results.models[i].errors_of(carpus::report::results::Use::HeldOut).unwrap();
        errors.nrmse.unwrap()
    };
    assert!(held_out(1) < 0.5 * held_out(0), "{} → {}", held_out(0), held_out(1));
    assert_eq!(results.parameters.len(), 15);
    assert!(out.join("report.html").exists());
    // The personalized model is the given one with fifteen lines changed.
    let lines = |path: PathBuf| std::fs::read_to_string(path).unwrap().lines().map(String::from).collect::<Vec<_>>();
    let (given, fitted) = (lines(out.join("study/wrist.osim")), lines(out.join("model.osim")));
    assert_eq!(given.len(), fitted.len());
    assert_eq!(given.iter().zip(&fitted).filter(|(a, b)| a != b).count(), 15);
    // The written model, compared anew, gives the errors that were reported.
    let mut compare = carpus();
    compare.arg("compare").arg(out.join("study")).arg("--model").arg(out.join("model.osim"));
    let run = compare.arg("--out").arg(folder.path().join("again")).arg("--json").assert().success();
    let again: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let errors = again[0]["models"][0]["errors"].as_array().unwrap();
    let nrmse = errors.iter().find(|e| e["use"] == "held_out").unwrap()["errors"]["nrmse"].as_f64().unwrap();
    assert!((nrmse - held_out(1)).abs() < 1e-9, "{nrmse} and {}", held_out(1));
}

#[test]
fn verif_personalize_does_not_overwrite_the_labs_model() {
    let study = StudyCopy::new();
    // The lab keeps its model where the result would go.
    std::fs::create_dir_all(study.path("out/P01")).unwrap();
    std::fs::rename(study.path("wrist.osim"), study.path("out/P01/model.osim")).unwrap();
    study.edit("study.toml", |t| t.replace("wrist.osim", "out/P01/model.osim"));
    let given = std::fs::read(study.path("out/P01/model.osim")).unwrap();
    study
        .run("personalize")
        .code(1)
        .stderr(contains("it is not overwritten").and(contains("hint: choose another folder")));
    assert_eq!(std::fs::read(study.path("out/P01/model.osim")).unwrap(), given);
}

#[test]
fn verif_personalize_is_the_same_at_any_number_of_threads() {
    let study = StudyCopy::new();
    let result = |threads: &str| {
        let out = study.path("out");
        let mut command = carpus();
        command.arg("personalize").arg(study.path("study.toml")).arg("--out").arg(&out);
        command.args(["--threads", threads, "--seed", "3"]).assert().success();
        let results = std::fs::read_to_string(out.join("P01/results.json")).unwrap();
        let model = std::fs::read(out.join("P01/model.osim")).unwrap();
        (results.replace(&format!("--threads {threads}"), ""), model)
    };
    assert!(result("1") == result("3"));
}

/// A copy of the bundled model in which ECRL's path does what OpenSim's wrapping does to some models.
fn with_odd_path(folder: &Path, change: impl Fn(&str) -> String) -> PathBuf {
    let text = std::fs::read_to_string(model()).unwrap();
    let changed = change(&text);
    assert_ne!(text, changed, "the edit does something");
    let file = folder.join("wrist.osim");
    std::fs::write(&file, changed).unwrap();
    file
}

/// A point 20 cm away joins the path where flexion exceeds 20°.
fn jumping(text: &str) -> String {
    let far = r#"<ConditionalPathPoint name="far"><socket_parent_frame>/bodyset/radius</socket_parent_frame>
        <location>-0.2 -0.24 0</location><socket_coordinate>/jointset/wrist/flexion</socket_coordinate>
        <range>0.3490658503988659 3</range></ConditionalPathPoint><PathPoint name="ECRL_insertion">"#;
    text.replacen("<PathPoint name=\"ECRL_insertion\">", far, 1)
}

/// The cylinder under ECRL lies on the wrong side of it: the tendon has to go all the way round.
fn wound(text: &str) -> String {
    let start = text.find("<WrapCylinder name=\"carpus_ECRL\">").unwrap();
    let (before, after) = text.split_at(start);
    let after = after.replacen("<translation>0.002 ", "<translation>-0.125 ", 1);
    format!("{before}{}", after.replacen("<radius>0.0045<", "<radius>0.1<", 1))
}

fn json_of(assert: &assert_cmd::assert::Assert) -> serde_json::Value {
    serde_json::from_slice(&assert.get_output().stdout).unwrap()
}

#[test]
fn verif_a_path_that_jumps_is_told_by_paths_and_by_studies() {
    let folder = tempfile::tempdir().unwrap();
    let file = with_odd_path(folder.path(), jumping);
    let sweep = |file: &Path| {
        let mut command = carpus();
        command.arg("paths").arg(file).args(["--sweep", "flexion=-60:60:5deg", "--json"]);
        command.assert().success()
    };
    let told =
        sweep(&file).stderr(contains("the path of ECRL jumps by").and(contains("between flexion = 15.00° and 20.00°")));
    let warnings = json_of(&told)["warnings"].clone();
    assert_eq!(warnings.as_array().map(Vec::len), Some(1), "only ECRL: {warnings}");
    assert!(warnings[0]["message"].as_str().unwrap().contains("ECRL jumps by"), "{warnings}");
    // The bundled model itself is clean, at any step.
    assert_eq!(json_of(&sweep(&model()).stderr(""))["warnings"], serde_json::json!([]));

    let study = StudyCopy::new();
    study.edit("wrist.osim", jumping);
    study.run("compare").success().stderr(contains("the path of ECRL jumps by"));
    let results = std::fs::read_to_string(study.path("out/P01/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&results).unwrap();
    let warnings = results["warnings"].as_array().unwrap();
    let told = |w: &serde_json::Value| w["message"].as_str().unwrap().contains("the path of ECRL jumps by");
    assert_eq!(warnings.iter().filter(|w| told(w)).count(), 1, "{warnings:?}");
}

#[test]
fn verif_a_path_wound_the_long_way_is_told_with_its_pose() {
    let folder = tempfile::tempdir().unwrap();
    let file = with_odd_path(folder.path(), wound);
    let at_rest = |file: &Path| {
        let mut command = carpus();
        command.arg("equilibrium").arg(file).args(["--set", "flexion=10deg", "--activation", "0.1", "--json"]);
        command.assert().success()
    };
    let told = at_rest(&file).stderr(contains("the path of ECRL is").and(contains("m long at flexion = 10 deg")));
    let result = json_of(&told);
    assert_eq!(result["warnings"].as_array().map(Vec::len), Some(1), "{}", result["warnings"]);
    // OpenSim 4.6 winds the edited model's path just so: Muscle::getLength().
    let length = result["muscles"][0]["path_length_m"].as_f64().unwrap();
    assert!((length - 1.1772081282615336).abs() < 1e-9, "{length}");
    assert_eq!(json_of(&at_rest(&model()).stderr(""))["warnings"], serde_json::json!([]));

    let mut command = carpus();
    let sweep = command.arg("paths").arg(&file).args(["--sweep", "flexion=-20:20:5deg", "--muscles", "ECRL"]);
    sweep.assert().success().stderr(contains("the path of ECRL is").and(contains("of 9 values")));
}
