//! `carpus ultrasound`: OpenSim's resting muscles, SciPy's statistics, and bad input.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use predicates::str::contains;
use serde_json::Value;

/// OpenSim's own equilibrium is good to 1e-8 of the force; lengths follow within [m].
const LENGTH_TOLERANCE: f64 = 1e-7;
/// Statistics of the same numbers, beyond the rounding of results to 8 digits; relative to 1 or the value.
const STATISTICS_TOLERANCE: f64 = 2e-5;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus() -> Command {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.timeout(std::time::Duration::from_secs(300)).env_remove("RUST_LOG");
    command
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn val_opensim_resting_muscles_and_scipy_tables() {
    let out = tempfile::tempdir().unwrap();
    let study = root("fixtures/imaging/study.toml");
    carpus().arg("ultrasound").arg(&study).arg("--out").arg(out.path()).assert().success().stdout(contains("as given"));
    let found = json(&out.path().join("ultrasound.json"));
    let reference = json(&root("fixtures/imaging/reference.json"));
    let case = &found["cases"][0];
    let mut worst = 0.0_f64;
    for quantity in case["quantities"].as_array().unwrap() {
        let name = quantity["quantity"].as_str().unwrap();
        let (key, scale) = match name {
            "belly_length" | "fascicle_length" => ("fiber_length", 100.0),
            "tendon_length" => ("tendon_length", 100.0),
            "pennation" => ("pennation_deg", 1.0),
            _ => ("", 1.0),
        };
        for point in quantity["points"].as_array().unwrap().iter().filter(|_| !key.is_empty()) {
            let posture = point["posture_deg"].as_f64().unwrap();
            let of = &reference["base"][format!("{posture}")][point["muscle"].as_str().unwrap()];
            let residual = (point["model"].as_f64().unwrap() / scale - of[key].as_f64().unwrap()).abs();
            // Degrees are coarser than metres by about their size.
            worst = worst.max(if key == "pennation_deg" { residual / 1e3 } else { residual });
        }
        let expected = &reference["statistics"][name];
        let (model, measured) = match name {
            "force" => (1.0, 1e4),
            "pennation" => (1f64.to_degrees(), 1f64.to_degrees()),
            _ => (100.0, 100.0),
        };
        for (key, scale) in [
            ("r", 1.0),
            ("p", 1.0),
            ("slope", model / measured),
            ("intercept", model),
            ("bias", model),
            ("limit", model),
        ] {
            let (ours, theirs) = (quantity[key].as_f64().unwrap(), scale * expected[key].as_f64().unwrap());
            assert!(
                (ours - theirs).abs() < STATISTICS_TOLERANCE * theirs.abs().max(1.0),
                "{name} {key}: {ours} {theirs}"
            );
        }
        assert_eq!(quantity["n"], 30);
    }
    println!("largest residual of lengths {worst:.1e} m");
    assert!(worst < LENGTH_TOLERANCE, "{worst}");
    for file in ["correlations.csv", "agreement.csv", "measurements.csv", "report.html"] {
        assert!(out.path().join(file).metadata().unwrap().len() > 100, "{file}");
    }
}

/// A copy of the study with the model beside it.
fn copy() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["study.toml", "participants.csv", "trials.csv", "ultrasound.csv"] {
        let text = std::fs::read_to_string(root("fixtures/imaging").join(name)).unwrap();
        std::fs::write(folder.path().join(name), text.replace("../../models/wrist.osim", "wrist.osim")).unwrap();
    }
    std::fs::copy(root("models/wrist.osim"), folder.path().join("wrist.osim")).unwrap();
    folder
}

fn edit(folder: &Path, name: &str, from: &str, to: &str) {
    let path = folder.join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(from));
    std::fs::write(path, text.replace(from, to)).unwrap();
}

#[test]
fn verif_a_model_case_is_compared_beside_the_model_as_given() {
    let study = copy();
    // A case in which every participant has the true strength of P01's FCR.
    for i in 1..=5 {
        let text = std::fs::read_to_string(root("models/wrist.osim")).unwrap();
        let folder = study.path().join(format!("own/P{i:02}"));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("model.osim"), text.replace("<max_isometric_force>257", "<max_isometric_force>357"))
            .unwrap();
    }
    let out = study.path().join("out");
    let pattern = format!("own={}/own/{{participant}}/model.osim", study.path().display());
    carpus().arg("ultrasound").arg(study.path()).args(["--case", &pattern]).arg("--out").arg(&out).assert().success();
    let found = json(&out.join("ultrasound.json"));
    let bias = |case: usize| found["cases"][case]["quantities"][2]["bias"].as_f64().unwrap();
    assert_eq!(found["cases"][1]["case"], "own");
    // A third of the muscles became 100 N stronger.
    assert!((bias(1) - bias(0) - 100.0 / 3.0).abs() < 1e-4, "{} {}", bias(0), bias(1));
}

#[test]
fn verif_bad_imaging_input_is_answered() {
    let answers = |folder: &Path, text: &str| {
        let out = folder.join("out");
        carpus()
            .arg("ultrasound")
            .arg(folder)
            .arg("--out")
            .arg(out)
            .assert()
            .code(1)
            .stderr(contains(text.to_string()));
    };
    let study = copy();
    edit(study.path(), "study.toml", "specific_tension_n_per_cm2", "specific_tension");
    answers(study.path(), "specific_tension_n_per_cm2");
    let study = copy();
    edit(study.path(), "study.toml", "ECRB = 0.4,", "ECRB = 4,");
    answers(study.path(), "more than 0 and at most 1");
    let study = copy();
    edit(study.path(), "study.toml", "ECRB = 0.4,", "ECRX = 0.4,");
    answers(study.path(), "ECRX");
    let study = copy();
    edit(study.path(), "ultrasound.csv", "P01,ECRB,0,", "P01,ECRB,200,");
    answers(study.path(), "outside its range");
    let study = copy();
    edit(study.path(), "ultrasound.csv", "P01,ECRB,0,", "P01,ECRB,,");
    answers(study.path(), "no posture_deg");
    let study = copy();
    std::fs::remove_file(study.path().join("ultrasound.csv")).unwrap();
    answers(study.path(), "no measurements");
    let study = copy();
    let out = study.path().join("out");
    carpus().arg("ultrasound").arg(study.path()).args(["--case", "nothing"]).arg("--out").arg(out).assert().code(1);
}

#[test]
fn verif_without_ratios_there_is_no_agreement_and_a_warning() {
    let study = copy();
    let text = std::fs::read_to_string(study.path().join("study.toml")).unwrap();
    let kept: String = text.lines().filter(|l| !l.contains("_length = {")).map(|l| format!("{l}\n")).collect();
    std::fs::write(study.path().join("study.toml"), kept).unwrap();
    let out = study.path().join("out");
    let run = carpus().arg("ultrasound").arg(study.path()).arg("--out").arg(&out).assert().success();
    run.stderr(contains("fiber_to_belly_length")).stderr(contains("external_to_total_tendon_length"));
    let found = json(&out.join("ultrasound.json"));
    let quantities = &found["cases"][0]["quantities"];
    assert!(quantities[0]["bias"].is_null() && quantities[0]["unconverted"] == 30);
    assert!(quantities[2]["bias"].is_number());
}

/// Fascicle lengths as data: the resting fibres of the personalized model come nearer to them than without.
#[test]
fn verif_fascicle_lengths_can_inform_the_fit() {
    let folder = tempfile::tempdir().unwrap();
    let source = root("fixtures/demo_study");
    std::fs::create_dir_all(folder.path().join("data/P01")).unwrap();
    std::fs::copy(root("models/wrist.osim"), folder.path().join("wrist.osim")).unwrap();
    let kept = ["isotonic_50_flexion_1", "isotonic_50_extension_1", "isometric_50_extension_+0deg_1"];
    for name in kept {
        let file = format!("data/P01/{name}.csv");
        std::fs::copy(source.join(&file), folder.path().join(&file)).unwrap();
    }
    let toml = std::fs::read_to_string(source.join("study.toml")).unwrap();
    let toml = toml.replace("../../models/wrist.osim", "wrist.osim");
    let rows = std::fs::read_to_string(source.join("trials.csv")).unwrap();
    let wanted = |l: &&str| l.starts_with("participant") || kept.iter().any(|k| l.contains(k));
    let rows: String = rows.lines().filter(wanted).map(|l| format!("{l}\n")).collect();
    std::fs::write(folder.path().join("trials.csv"), rows).unwrap();
    std::fs::write(folder.path().join("participants.csv"), "participant\nP01\n").unwrap();
    // ECRB's fascicles are longer and FCR's shorter than those of the model at rest.
    let images = "participant,muscle,posture_deg,fascicle_length_m\nP01,ECRB,0,0.066\nP01,FCR,0,0.056\n";
    std::fs::write(folder.path().join("ultrasound.csv"), images).unwrap();
    let off = |section: &str, out: &str| -> f64 {
        std::fs::write(folder.path().join("study.toml"), format!("{toml}\n{section}")).unwrap();
        let fitted = folder.path().join(out);
        carpus().arg("personalize").arg(folder.path()).arg("--out").arg(&fitted).assert().success();
        let case = format!("fitted={}/{{participant}}/model.osim", fitted.display());
        let compared = folder.path().join(format!("{out}_imaged"));
        carpus()
            .arg("ultrasound")
            .arg(folder.path())
            .args(["--case", &case])
            .arg("--out")
            .arg(&compared)
            .assert()
            .success();
        let found = json(&compared.join("ultrasound.json"));
        let points = found["cases"][1]["quantities"][0]["points"].as_array().unwrap().clone();
        points.iter().map(|p| (p["model"].as_f64().unwrap() / p["measured"].as_f64().unwrap()).ln().powi(2)).sum()
    };
    let check = off("", "check");
    let fit = off("[ultrasound]\nfascicles = \"fit\"\nfascicle_error_percent = 2\n", "fit");
    println!("squared log ratios of fibre to fascicle length: {check:.2e} as a check, {fit:.2e} as data");
    assert!(fit < 0.5 * check, "{check} {fit}");
}
