//! `carpus effects`.

use assert_cmd::Command;
use carpus::effects::catalogue::CATALOGUE;

fn carpus(arguments: &[&str]) -> std::process::Output {
    Command::cargo_bin("carpus").unwrap().args(arguments).output().unwrap()
}

#[test]
fn verif_the_catalogue_is_listed_and_every_effect_told() {
    let all = carpus(&["effects"]);
    let text = String::from_utf8_lossy(&all.stdout);
    assert!(all.status.success());
    for effect in CATALOGUE {
        let id = effect.description().id;
        assert!(text.lines().any(|line| line.split_whitespace().next() == Some(id)), "{id} is not listed");
    }
    let one = carpus(&["effects", "coulomb_friction"]);
    let text = String::from_utf8_lossy(&one.stdout);
    assert!(text.contains("Tc") && text.contains("joint_damping") && text.contains("ExpressionBasedCoordinateForce"));
}

#[test]
fn verif_json_has_every_field() {
    let output = carpus(&["effects", "--json"]);
    let catalogue: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let effects = catalogue["effects"].as_array().unwrap();
    assert_eq!(effects.len(), CATALOGUE.len());
    let keys = ["id", "equation", "parameters", "signature", "experiment", "rivals", "osim_form", "unidentifiable"];
    assert!(effects.iter().all(|e| keys.iter().all(|key| e.get(key).is_some())));
}

#[test]
fn verif_an_unknown_effect_is_the_users_error_with_a_hint() {
    let output = carpus(&["effects", "joint_stifness"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("joint_stiffness"));
}
