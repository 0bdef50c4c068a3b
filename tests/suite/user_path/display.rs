//! How names and numbers are shown: units, deceptive characters, cells of tables.

use predicates::prelude::*;
use predicates::str::contains;

use super::{StudyCopy, carpus, model};

/// The bundled model with a muscle renamed, in a folder.
fn renamed(name: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("renamed.osim");
    let text = std::fs::read_to_string(model()).unwrap();
    std::fs::write(&file, text.replace("name=\"ECRL\"", &format!("name=\"{name}\""))).unwrap();
    (folder, file)
}

#[test]
fn verif_deceptive_names_of_a_model_are_written_out() {
    let (folder, file) = renamed("EC\u{202e}RL\u{feff}");
    let shown = carpus().arg("info").arg(&file).assert().success();
    shown.stdout(contains("EC\\u{202e}RL\\u{feff}").and(contains("\u{202e}").not()));
    let json = carpus().arg("info").arg(&file).arg("--json").assert().success().get_output().stdout.clone();
    assert!(!String::from_utf8(json.clone()).unwrap().contains('\u{202e}'));
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["muscles"][0]["name"], "EC\u{202e}RL\u{feff}");
    let sweep = ["--sweep", "flexion=-10:10:10deg"];
    carpus().arg("paths").arg(&file).args(sweep).arg("--out").arg(folder.path()).assert().success();
    for result in ["paths.csv", "paths.html"] {
        let text = std::fs::read_to_string(folder.path().join(result)).unwrap();
        assert!(text.contains("EC\\u{202e}RL") && !text.contains('\u{202e}'), "{result}");
    }
}

#[test]
fn verif_a_name_of_several_lines_is_refused() {
    for (name, found) in
        [("EC&#10;RL", "EC\\u{a}RL\": expected a name in one line, found U+000A"), ("EC&#9;RL", "U+0009")]
    {
        let (_folder, file) = renamed(name);
        let refused = carpus().arg("info").arg(&file).assert().code(1).stdout("");
        refused.stderr(contains("renamed.osim:329: /forceset").and(contains(found)).and(contains("hint: OpenSim 4.6")));
    }
}

#[test]
fn verif_what_is_no_model_is_called_what_it_is() {
    let study = StudyCopy::new();
    for (path, what, hint) in [
        ("study.toml", "this is a study, not a model", "carpus compare"),
        ("", "this is the folder of a study, not a model", "carpus compare"),
        ("trials.csv", "this is a table, not a model", "a model (.osim)"),
    ] {
        let refused = carpus().arg("info").arg(study.path(path)).assert().code(1).stdout("");
        refused.stderr(contains(what).and(contains(hint)).and(contains("root element").not()));
    }
}

#[cfg(unix)]
#[test]
fn verif_pipes_that_nobody_writes_into_are_refused() {
    let study = StudyCopy::new();
    let pipe = study.path("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for option in ["--effects", "--own-effect"] {
        let mut command = carpus();
        command.timeout(std::time::Duration::from_secs(60)).arg("simulate").arg(study.path("study.toml"));
        command.arg(option).arg(&pipe).arg("--out").arg(study.path("out"));
        command.assert().code(1).stderr(contains("it is a pipe, not a file"));
    }
    let mut command = carpus();
    command.timeout(std::time::Duration::from_secs(60)).arg("priors").arg(&pipe).arg("--out").arg(study.path("x.csv"));
    command.assert().code(1).stderr(contains("it is a pipe, not a file"));
}

#[test]
fn verif_cells_that_a_spreadsheet_would_execute_are_text() {
    let (folder, file) = renamed("=cmd|' /C calc'!A0");
    let out = folder.path().join("rest.csv");
    carpus().arg("equilibrium").arg(&file).arg("--csv").arg(&out).assert().success();
    let table = std::fs::read_to_string(&out).unwrap();
    assert!(table.lines().any(|line| line.starts_with("'=cmd|")), "{table}");
    assert!(!table.lines().any(|line| line.starts_with('=')), "{table}");
}

#[test]
fn verif_series_for_opensim_say_what_their_angles_are_in() {
    let study = StudyCopy::new();
    let out = study.path("out");
    carpus().arg("simulate").arg(study.path("study.toml")).arg("--out").arg(&out).assert().success();
    let mut found = Vec::new();
    for entry in walk(&out) {
        if entry.extension().is_some_and(|e| e == "sto") {
            found.push(std::fs::read_to_string(entry).unwrap());
        }
    }
    assert_eq!(found.len(), 2);
    for text in found {
        assert!(text.contains("\ninDegrees=yes\n") && text.contains("\ntime\tflexion\t"), "{}", &text[..300]);
        let first = text.lines().nth(7).unwrap().split('\t').nth(1).unwrap().parse::<f64>().unwrap();
        assert!(first.abs() > 10.0, "degrees: the movement begins near 35°, found {first}");
    }
}

fn walk(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { files.extend(walk(&path)) } else { files.push(path) }
    }
    files
}

#[test]
fn verif_tables_of_errors_are_in_percent_as_the_console_is() {
    let study = StudyCopy::new();
    let out = study.path("out");
    let shown = carpus().arg("compare").arg(study.path("study.toml")).arg("--out").arg(&out).assert().success();
    let table = walk(&out).into_iter().find(|f| f.ends_with("errors_per_trial.csv")).expect("a table");
    let mut reader = csv::Reader::from_path(table).unwrap();
    let header = reader.headers().unwrap().clone();
    let place = header.iter().position(|h| h == "nrmse_percent").expect("a column with its unit");
    assert!(header.iter().any(|h| h == "max_error_percent"), "{header:?}");
    let of_test = reader.records().map(Result::unwrap).find(|row| &row[2] == "test").expect("a held-out trial");
    let percent: f64 = of_test[place].parse().unwrap();
    let console = String::from_utf8(shown.get_output().stdout.clone()).unwrap();
    assert!(console.contains(&format!("{percent:.2}")), "{percent} in\n{console}");
}

#[test]
fn verif_coupled_angles_are_shown_in_degrees() {
    // An angle that turns the joint by half of itself is coupled to OpenSim, and an angle all the same.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("coupled.osim");
    let text = crate::osim::small_models::FORMAT_40000.replace("<coefficients>1 0", "<coefficients>0.5 0");
    std::fs::write(&file, text).unwrap();
    let json = carpus().arg("info").arg(&file).arg("--json").assert().success().get_output().stdout.clone();
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let coordinate = &json["coordinates"][0];
    assert_eq!((coordinate["motion_type"].as_str(), coordinate["unit"].as_str()), (Some("coupled"), Some("deg")));
    assert!((coordinate["range"][1].as_f64().unwrap() - 2.5f64.to_degrees()).abs() < 1e-9);
}

#[test]
fn verif_a_disabled_muscle_exerts_nothing_and_absurd_ones_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(model()).unwrap();
    let start = "<Millard2012EquilibriumMuscle name=\"FCU\">";
    assert!(text.contains(start));
    let file = folder.path().join("disabled.osim");
    std::fs::write(&file, text.replace(start, &format!("{start}<appliesForce>false</appliesForce>"))).unwrap();
    let out = carpus().arg("equilibrium").arg(&file).args(["--activation", "0.5", "--json"]).assert().success();
    let found: serde_json::Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    let of = |name: &str| found["muscles"].as_array().unwrap().iter().find(|m| m["muscle"] == name).unwrap().clone();
    assert_eq!(
        (of("FCU")["tendon_force_n"].as_f64(), of("FCU")["status"].as_str()),
        (Some(0.0), Some("applies_no_force"))
    );
    assert!(of("FCR")["tendon_force_n"].as_f64().unwrap() > 1.0);
    let damping = text.find("<fiber_damping>").map(|at| &text[at..at + text[at..].find("</").unwrap()]).unwrap();
    let absurd = text.replace(damping, "<fiber_damping>1e308");
    std::fs::write(&file, absurd).unwrap();
    let failed = carpus().arg("equilibrium").arg(&file).assert().code(1);
    failed.stderr(contains("not finite")).stdout(contains("NaN").not());
}
