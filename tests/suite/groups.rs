//! Groups of participants and visits, compared as a user does it.

use std::path::{Path, PathBuf};

use carpus::statistics::paired_t_test;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;

use crate::user_loop::{carpus, root};

const PERSONS: usize = 6;
const BEFORE: [f64; PERSONS] = [5.1, 6.4, 4.2, 7.3, 8.8, 6.1];
const AFTER: [f64; PERSONS] = [5.6, 6.9, 4.1, 8.4, 9.1, 6.9];

/// The demo's study with every person as two participants, before and after; no trial is read.
fn study(folder: &Path) -> PathBuf {
    let demo = |file: &str| std::fs::read_to_string(root("fixtures/demo_study").join(file)).unwrap();
    let trial = demo("data/P01/mvc_flexion.csv");
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    let settings = demo("study.toml").replace("../../models/wrist.osim", "wrist.osim");
    std::fs::write(folder.join("study.toml"), settings).unwrap();
    let mut participants = "participant,person,group,visit\n".to_owned();
    let mut trials = "participant,file,contraction,effort_percent,direction,posture_deg,repetition,use\n".to_owned();
    let mut values = "participant,strength,age\n".to_owned();
    for i in 0..PERSONS {
        let group = if i % 2 == 0 { "controls" } else { "patients" };
        for (visit, strength) in [("before", BEFORE[i]), ("after", AFTER[i])] {
            let name = format!("P{i}_{visit}");
            participants.push_str(&format!("{name},S{i},{group},{visit}\n"));
            let file = format!("{name}.csv");
            std::fs::write(folder.join(&file), &trial).unwrap();
            trials.push_str(&format!("{name},{file},mvc,100,flexion,0,1,mvc\n"));
            values.push_str(&format!("{name},{strength},{}\n", 30 + i));
        }
    }
    std::fs::write(folder.join("participants.csv"), participants).unwrap();
    std::fs::write(folder.join("trials.csv"), trials).unwrap();
    std::fs::write(folder.join("values.csv"), values).unwrap();
    folder.join("study.toml")
}

fn json(file: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

#[test]
fn verif_before_and_after_is_the_paired_test() {
    let place = tempfile::tempdir().unwrap();
    let study = study(place.path());
    // Without groups.
    let participants = std::fs::read_to_string(place.path().join("participants.csv")).unwrap();
    let without = participants.replace(",controls", ",").replace(",patients", ",");
    std::fs::write(place.path().join("participants.csv"), without).unwrap();
    let out = place.path().join("out");
    let mut command = carpus();
    command.arg("groups").arg(&study).arg("--values").arg(place.path().join("values.csv")).arg("--out").arg(&out);
    let left_out = contains("not compared: age: ").and(contains("after − before")).and(contains("groups.html"));
    command.assert().success().stdout(left_out);
    let found = json(&out.join("groups.json"));
    let [strength] = found["differences"].as_array().unwrap().as_slice() else { panic!("{found}") };
    let test = paired_t_test(&AFTER, &BEFORE).unwrap();
    let close = |key: &str, expected: f64, tolerance: f64| {
        let value = strength[key].as_f64().unwrap();
        assert!((value - expected).abs() < tolerance, "{key}: {value}, expected {expected}");
    };
    close("estimate", test.mean_difference, 1e-9);
    close("t", test.t, 1e-6);
    close("df", (PERSONS - 1) as f64, 1e-5);
    close("p_value", test.p_value, 1e-7);
    assert_eq!((&strength["persons"], &strength["measurements"]), (&6.into(), &12.into()));
    assert!(std::fs::read_to_string(out.join("groups.html")).unwrap().contains("after − before"));
}

#[test]
fn verif_muscle_parameters_are_compared_as_ratios() {
    let place = tempfile::tempdir().unwrap();
    let study = study(place.path());
    // What identify writes, with known factors: patients 10 % weaker before, and no longer after.
    let identified = place.path().join("identified");
    let template = {
        let out = place.path().join("one");
        let mut command = carpus();
        command.arg("identify").arg(root("fixtures/demo_study/study.toml")).args(["--draws", "40"]);
        command.arg("--out").arg(&out).assert().success();
        json(&out.join("P01/identifiability.json"))
    };
    for i in 0..PERSONS {
        for visit in ["before", "after"] {
            let name = format!("P{i}_{visit}");
            let mut result = template.clone();
            result["participant"] = name.clone().into();
            let own = 0.01 * (i / 2) as f64 + if visit == "after" { 0.002 * (i / 2 % 2) as f64 } else { 0.0 };
            let weaker: f64 = if i % 2 == 1 && visit == "before" { 0.9 } else { 1.0 };
            for parameter in result["parameters"].as_array_mut().unwrap() {
                let model = parameter["model"].as_f64().unwrap();
                parameter["posterior_median"] = (model * weaker * own.exp()).into();
            }
            let folder = identified.join(&name);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("identifiability.json"), result.to_string()).unwrap();
        }
    }
    let out = place.path().join("out");
    carpus().arg("groups").arg(&study).arg(&identified).arg("--out").arg(&out).assert().success();
    let found = json(&out.join("groups.json"));
    let of = |difference: &str| {
        let is = |d: &&Value| d["difference"] == difference && d["quantity"] == "FCU max_isometric_force";
        found["differences"].as_array().unwrap().iter().find(is).unwrap().clone()
    };
    let change = of("(after − before) in patients − in controls");
    let ratio = change["ratio"].as_f64().unwrap();
    assert!((ratio - 1.0 / 0.9).abs() < 1e-9, "{change}");
    assert!(change["p_holm"].as_f64().unwrap() < 1e-3 && change["p_holm"].as_f64() >= change["p_value"].as_f64());
    let group = of("patients − controls")["ratio"].as_f64().unwrap();
    assert!((group - 0.9_f64.sqrt()).abs() < 1e-9, "{group}");
}

#[test]
fn verif_what_cannot_be_compared_is_said_with_its_place() {
    let place = tempfile::tempdir().unwrap();
    let study = study(place.path());
    let values = place.path().join("values.csv");
    let said = |expected: &str| {
        let mut command = carpus();
        command.arg("groups").arg(&study).arg("--values").arg(&values).arg("--out").arg(place.path().join("out"));
        command.assert().failure().code(1).stderr(contains(expected));
    };
    std::fs::write(&values, "participant,strength\nP0_before,5\nP9_before,6\nP0_before,x\n").unwrap();
    said("the study has no participant `P9_before`");
    said("values.csv:4");
    said("column `strength`: expected a number, found `x`");
    said("participant `P0_before` twice");
    std::fs::write(&values, "name,strength\nP0_before,5\n").unwrap();
    said("expected a column `participant`");
    std::fs::write(&values, "participant,strength\nP0_before,5\nP0_after,6\n").unwrap();
    said("strength: not known of any participant of: patients, before");
    let table = place.path().join("participants.csv");
    let participants = std::fs::read_to_string(&table).unwrap();
    std::fs::write(&table, participants.replacen(",controls", ",", 1)).unwrap();
    said("`group` is empty, and others have one");
    // Without persons visits are those of different ones.
    let unpaired: String = participants
        .lines()
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            format!("{},{}\n", cells[0], cells[3])
        })
        .collect();
    std::fs::write(&table, unpaired).unwrap();
    let all = BEFORE.iter().zip(AFTER).enumerate();
    let rows = all.map(|(i, (before, after))| format!("P{i}_before,{before}\nP{i}_after,{after}\n"));
    std::fs::write(&values, format!("participant,strength\n{}", rows.collect::<String>())).unwrap();
    let mut command = carpus();
    command.arg("groups").arg(&study).arg("--values").arg(&values).arg("--out").arg(place.path().join("unpaired"));
    command.assert().success().stderr(contains("no person came to two visits"));
    let one = participants.replace("patients", "controls").replace(",after", ",before");
    std::fs::write(&table, one).unwrap();
    said("nothing to compare: all participants are of one group and one visit");
}
