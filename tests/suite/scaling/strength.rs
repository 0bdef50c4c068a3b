//! Strength scaling: factors by definition, through the program, and the written model in OpenSim.

use std::path::{Path, PathBuf};

use crate::reference::{opensim_python, run_script, shared_if_here};
use assert_cmd::Command;
use carpus::osim::OsimFile;
use serde_json::Value;

/// The moment of a group in OpenSim against the maximum voluntary moment [share of it]: equilibria agree to 1e-8 Fmax.
const OPENSIM_TOLERANCE: f64 = 1e-6;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn strength_scale(study: &Path, out: &Path) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("carpus").expect("the program");
    command.arg("strength-scale").arg(study).arg("--out").arg(out).arg("--json").assert()
}

fn groups(out: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(out.join("strength.json")).expect("results");
    let results: Value = serde_json::from_str(&text).expect("JSON");
    results["participants"][0]["groups"].as_array().expect("groups").clone()
}

/// A study of one participant that only says what strength scaling needs.
fn study(folder: &Path, model: &Path, muscles: &[&str], posture: &str, rest: &str, participants: &str) -> PathBuf {
    std::fs::create_dir_all(folder).expect("folder");
    std::fs::copy(model, folder.join("model.osim")).expect("model");
    let toml = format!(
        "[study]\nname = \"strength\"\nmodel = \"model.osim\"\n[dynamometer]\ncoordinate \
         = \"flexion\"\n[posture_deg]\n{posture}\n[muscles]\nactive = {muscles:?}\n{rest}"
    );
    std::fs::write(folder.join("study.toml"), toml).expect("study.toml");
    std::fs::write(folder.join("participants.csv"), participants).expect("participants.csv");
    std::fs::write(
        folder.join("trials.csv"),
        "participant,file,contraction,effort_percent,direction\nP01,mvc_flexion.csv,mvc,100,flexion\nP01,\
         mvc_extension.csv,mvc,100,extension\n",
    )
    .expect("trials.csv");
    for (name, sign) in [("mvc_flexion", 1.0), ("mvc_extension", -1.0)] {
        let mut text = "time_s,angle_deg,moment_n_m".to_owned();
        muscles.iter().for_each(|m| text.push_str(&format!(",emg_{m}")));
        for i in 0..200 {
            let t = 0.01 * f64::from(i);
            // A plateau of half a second, and a spike that is no strength.
            let moment = if (50..=100).contains(&i) { 7.5 } else { 2.0 } + if i == 150 { 30.0 } else { 0.0 };
            text.push_str(&format!("\n{t},{},{}{}", 12.0, sign * moment, ",0.5".repeat(muscles.len())));
        }
        std::fs::write(folder.join(format!("{name}.csv")), text + "\n").expect("trial");
    }
    folder.join("study.toml")
}

const MUSCLES: [&str; 5] = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];
const WRIST_POSTURE: &str = "elbow_flexion = 90\npro_sup = 0";

#[test]
fn verif_strength_of_the_bundled_study_is_that_of_its_participant() {
    let out = tempfile::tempdir().unwrap();
    strength_scale(&root("fixtures/demo_study/study.toml"), out.path()).success();
    let found = groups(out.path());
    let names = |g: &Value| -> Vec<String> {
        g["muscles"].as_array().unwrap().iter().map(|m| m["muscle"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names(&found[0]), ["FCR", "FCU"]);
    assert_eq!(names(&found[1]), ["ECRL", "ECRB", "ECU"]);
    for (group, target) in found.iter().zip([10.89, 7.04]) {
        assert_eq!(group["target_n_m"], target);
        // The definition, from the table's own numbers.
        let moment: f64 = group["muscles"]
            .as_array()
            .unwrap()
            .iter()
            .map(|m| m["moment_arm_m"].as_f64().unwrap() * m["tendon_force_before_n"].as_f64().unwrap())
            .sum();
        let factor = group["factor"].as_f64().unwrap();
        assert!((moment.abs() * factor - target).abs() < 1e-12 * target, "{group}");
    }
    // Exactly the lines of the five forces differ.
    let before = std::fs::read_to_string(root("models/wrist.osim")).unwrap();
    let after = std::fs::read_to_string(out.path().join("P01/model.osim")).unwrap();
    let changed: Vec<&str> = before.lines().zip(after.lines()).filter(|(a, b)| a != b).map(|(_, b)| b).collect();
    assert_eq!(before.lines().count(), after.lines().count());
    assert_eq!(changed.len(), 5);
    assert!(changed.iter().all(|line| line.contains("<max_isometric_force>")), "{changed:?}");
}

#[test]
fn verif_strength_comes_from_mvc_trials_where_the_table_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), &root("models/wrist.osim"), &MUSCLES, WRIST_POSTURE, "", "participant\nP01\n");
    let out = folder.path().join("out");
    strength_scale(&study, &out).success();
    for group in groups(&out) {
        // The plateau, not the spike; at the angle of the trial.
        assert!((group["target_n_m"].as_f64().unwrap() - 7.5).abs() < 1e-9, "{group}");
        assert!((group["angle_deg"].as_f64().unwrap() - 12.0).abs() < 1e-9, "{group}");
        assert!(group["source"]["trial"].as_str().unwrap().starts_with("mvc_"), "{group}");
    }
    // A written model that is scaled again has nothing left to scale.
    let again = folder.path().join("again");
    std::fs::copy(out.join("P01/model.osim"), folder.path().join("model.osim")).unwrap();
    strength_scale(&study, &again).success();
    for group in groups(&again) {
        assert!((group["factor"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{group}");
    }
}

#[test]
fn verif_bad_strength_settings_are_explained() {
    let refused = |rest: &str, participants: &str, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let model = root("models/wrist.osim");
        let study = study(folder.path(), &model, &MUSCLES, WRIST_POSTURE, rest, participants);
        let failed = strength_scale(&study, &folder.path().join("out")).code(1);
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        for word in words {
            assert!(text.contains(word), "expected `{word}` in:\n{text}");
        }
    };
    let people = "participant\nP01\n";
    refused("[strength_scaling]\nflexors = [\"FCX\"]\n", people, &["study.toml:12", "`FCX`", "[muscles] active"]);
    refused("[strength_scaling]\nposture = 3\n", people, &["study.toml:12", "posture_deg"]);
    refused("[strength_scaling]\nflexion = \"negative\"\n", people, &["mvc_flexion.csv", "other direction", "hint"]);
    refused("[strength_scaling]\nposture_deg = 300\n", people, &["flexion", "outside its range"]);
    refused("[strength_scaling]\nflexors = [\"ECU\"]\n", people, &["flexion group", "no factor turns it round"]);
    refused("", "participant,mvc_flexion_n_m\nP01,-3\n", &["participants.csv:2", "positive moment"]);
}

/// The written model in OpenSim: the group's moment, fully active in the posture, is the maximum voluntary moment.
#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_strength_scaled_model_reaches_the_maximum_moments() {
    let python = opensim_python();
    let mut cases =
        vec![(root("models/wrist.osim"), MUSCLES.to_vec(), WRIST_POSTURE, vec!["elbow_flexion=90", "pro_sup=0"])];
    if let Some(model) = shared_if_here("models/Hand_Wrist_Model_for_development.osim") {
        cases.push((model, MUSCLES.to_vec(), "deviation = 3", vec!["deviation=3"]));
    }
    for (model, muscles, posture, held) in cases {
        let folder = tempfile::tempdir().unwrap();
        let participants = "participant,mvc_flexion_n_m,mvc_extension_n_m\nP01,11.3,8.1\n";
        let study = study(folder.path(), &model, &muscles, posture, "", participants);
        let out = folder.path().join("out");
        strength_scale(&study, &out).success();
        let written = out.join("P01/model.osim");
        OsimFile::read(&written).expect("a model");
        for group in groups(&out) {
            let reference = folder.path().join("reference.json");
            let names: Vec<&str> =
                group["muscles"].as_array().unwrap().iter().map(|m| m["muscle"].as_str().unwrap()).collect();
            let names = names.join(",");
            let mut set: Vec<String> = held.iter().map(|item| (*item).to_owned()).collect();
            set.push(format!("flexion={}", group["angle_deg"]));
            let mut arguments: Vec<&std::ffi::OsStr> =
                vec![written.as_os_str(), reference.as_os_str(), "--about".as_ref(), "flexion".as_ref()];
            arguments.extend(["--muscles".as_ref(), names.as_ref(), "--set-deg".as_ref()] as [&std::ffi::OsStr; 3]);
            arguments.extend(set.iter().map(|item| item.as_ref() as &std::ffi::OsStr));
            run_script(&python, "scripts/group_moment.py", &arguments);
            let text = std::fs::read_to_string(&reference).unwrap();
            let reference: Value = serde_json::from_str(&text).unwrap();
            let moments = reference["moments"].as_object().unwrap();
            let sum: f64 = moments.values().map(|v| v.as_f64().unwrap()).sum();
            let target = group["target_n_m"].as_f64().unwrap();
            let difference = (sum.abs() - target).abs() / target;
            println!("{}: {} {sum} N·m in OpenSim, {target} asked for", model.display(), group["direction"]);
            assert!(difference < OPENSIM_TOLERANCE, "{group}: OpenSim {sum}");
        }
    }
}
