//! Linear scaling: every number of the scaled file against OpenSim's, the program's own route, and closed forms.

use std::path::{Path, PathBuf};

use crate::reference::{opensim_python, run_script, shared, stem};
use assert_cmd::Command;
use assert_cmd::assert::Assert;
use carpus::osim::OsimFile;
use carpus::scaling::{ScaleRequest, scale};
use serde_json::{Value, json};

/// Any number of a scaled file against OpenSim's, relative; path lengths over wrap objects are the worst of them.
const OPENSIM_TOLERANCE: f64 = 1e-9;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn carpus_scale(input: &Path, out: &Path, arguments: &[String]) -> Assert {
    let mut command = Command::cargo_bin("carpus").expect("the program");
    command.arg("scale").arg(input).args(arguments).arg("--out").arg(out).arg("--json").assert()
}

/// Different factors for every body, from its number: 0.8 to 1.2.
fn factors(file: &OsimFile, uneven: bool) -> Vec<(String, [f64; 3])> {
    let factor = |i: usize, k: usize| 0.8 + 0.4 * ((i * 7 + k * 3 + 1) as f64 * 0.618_034).fract();
    let of_body = |i: usize| std::array::from_fn(|k| factor(i, if uneven { k } else { 0 }));
    let mut found: Vec<_> =
        file.spec.bodies.iter().enumerate().map(|(i, body)| (body.name.clone(), of_body(i))).collect();
    // Two files of three scale ground too.
    if uneven {
        found.push(("ground".to_owned(), of_body(99)));
    }
    found
}

/// Scales a model by the program and by OpenSim.
fn compare(python: &Path, model: &Path, uneven: bool, preserve: bool, mass: Option<f64>) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = OsimFile::read(model).expect("a model");
    let factors = factors(&file, uneven);
    let mut arguments: Vec<String> = vec!["--allow-unsupported".to_owned()];
    for (body, [x, y, z]) in &factors {
        arguments.extend(["--factor".to_owned(), format!("{body}={x},{y},{z}")]);
    }
    arguments.extend(preserve.then(|| "--preserve-mass-distribution".to_owned()));
    arguments.extend(mass.into_iter().flat_map(|mass| ["--mass".to_owned(), mass.to_string()]));
    carpus_scale(model, folder.path(), &arguments).success();
    let request = folder.path().join("request.json");
    let map: serde_json::Map<String, Value> = factors.into_iter().map(|(body, f)| (body, json!(f))).collect();
    let text = json!({"factors": map, "preserve_mass_distribution": preserve, "final_mass": mass}).to_string();
    std::fs::write(&request, text).unwrap();
    let (ours, output) = (folder.path().join("model.osim"), folder.path().join("found.json"));
    let paths = [model, &ours, &request, &output].map(Path::as_os_str);
    run_script(python, "scripts/scale_reference.py", &paths);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(output).unwrap()).unwrap();
    println!(
        "{}, uneven {uneven}, preserve {preserve}, mass {mass:?}: {} numbers, {} changed, largest {}",
        stem(model),
        found["values"],
        found["changed"],
        found["largest"]
    );
    found
}

fn check(model: &Path, found: &Value) {
    assert_eq!(found["structure"], json!([]), "{}", model.display());
    assert!(found["changed"].as_u64().unwrap() > 0);
    assert_eq!(found["untouched_but_ours_differs"], 0, "{}", model.display());
    assert!(found["largest"][0].as_f64().unwrap() < OPENSIM_TOLERANCE, "{}: {}", model.display(), found["largest"]);
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_scaled_bundled_model() {
    let python = opensim_python();
    let model = root("models/wrist.osim");
    for (uneven, preserve, mass) in [(true, false, None), (false, true, Some(3.1)), (true, true, None)] {
        check(&model, &compare(&python, &model, uneven, preserve, mass));
    }
}

/// Models of labs: custom joints with translations, moving points, wrap objects, ligaments, other muscles.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_lab_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and lab models (CARPUS_SHARED)"
)]
fn val_opensim_scaled_lab_models() {
    let python = opensim_python();
    for (name, preserve, mass) in [
        ("Hand_Wrist_Model_for_development", false, Some(4.2)),
        ("MOBL_ARMS_41", false, None),
        ("arm26", true, Some(80.0)),
        ("gait10dof18musc", false, Some(60.0)),
        ("Rajagopal2016", true, Some(71.5)),
    ] {
        let model = shared(&format!("models/{name}.osim"));
        check(&model, &compare(&python, &model, true, preserve, mass));
    }
}

#[test]
fn val_opensim_scaling_leaves_paths_by_functions() {
    // OpenSim 4.6: Model::scale changes neither the path's length nor the muscle's own lengths.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/other_paths/functions.osim");
    let mut file = OsimFile::read(path).unwrap();
    let before = file.spec.muscles.clone();
    let factors = ["humerus", "ulna", "radius", "hand"].map(|body| (body.to_owned(), [1.2; 3])).to_vec();
    let done = scale(&mut file, &ScaleRequest { factors, ..ScaleRequest::default() }).unwrap();
    for (before, after) in before.iter().zip(&file.spec.muscles) {
        assert_eq!(before.tendon_slack_length, after.tendon_slack_length);
        assert!(done.left.iter().any(|(at, why)| *at == after.at.path && why.contains("FunctionBasedPath")));
    }
    assert!(done.lengths.iter().all(|length| length.ratio() == 1.0));
}

#[test]
fn verif_factors_of_one_change_nothing() {
    let out = tempfile::tempdir().unwrap();
    let model = root("models/wrist.osim");
    carpus_scale(&model, out.path(), &["--factor".to_owned(), "hand=1".to_owned()]).success();
    assert_eq!(std::fs::read(&model).unwrap(), std::fs::read(out.path().join("model.osim")).unwrap());
}

/// All bodies by the same factor: every length of the model grows by it, so every path does.
#[test]
fn verif_uniform_scaling_is_similarity() {
    let mut file = OsimFile::read(root("models/wrist.osim")).unwrap();
    let before = file.spec.clone();
    let mut factors: Vec<_> = before.bodies.iter().map(|body| (body.name.clone(), [1.25; 3])).collect();
    factors.push(("ground".to_owned(), [1.25; 3]));
    let scaling = scale(&mut file, &ScaleRequest { factors, ..ScaleRequest::default() }).unwrap();
    for length in &scaling.lengths {
        assert!((length.ratio() - 1.25).abs() < 1e-12, "{length:?}");
    }
    for (a, b) in before.muscles.iter().zip(&file.spec.muscles) {
        assert!((b.tendon_slack_length / a.tendon_slack_length - 1.25).abs() < 1e-12);
        assert!((b.optimal_fiber_length / a.optimal_fiber_length - 1.25).abs() < 1e-12);
        assert_eq!(a.max_isometric_force, b.max_isometric_force);
    }
    for (a, b) in before.bodies.iter().zip(&file.spec.bodies) {
        assert!((b.mass - a.mass * 1.25f64.powi(3)).abs() <= 1e-12 * a.mass);
        assert!((b.inertia - a.inertia * 1.25f64.powi(5)).norm() <= 1e-12 * a.inertia.norm());
    }
}

/// A study with the bundled model that scales the forearm and the hand.
fn study(folder: &Path, scaling: &str, participants: &str) -> PathBuf {
    std::fs::copy(root("models/wrist.osim"), folder.join("wrist.osim")).unwrap();
    let source = std::fs::read_to_string(root("fixtures/demo_study/study.toml")).unwrap();
    let toml = source.replace("../../models/wrist.osim", "wrist.osim");
    std::fs::write(folder.join("study.toml"), format!("{toml}\n{scaling}")).unwrap();
    std::fs::write(folder.join("participants.csv"), participants).unwrap();
    std::fs::write(
        folder.join("trials.csv"),
        "participant,file,contraction,effort_percent,direction\nP01,none.csv,mvc,100,flexion\n",
    )
    .unwrap();
    folder.join("study.toml")
}

const SCALING: &str = "[scaling]\nreference_mass_kg = 70\n[scaling.segments.hand]\nbodies = [\"hand\"]\nmodel_length_m \
                       = 0.2\naxes = [\"y\", \"z\"]\n";

#[test]
fn verif_a_study_scales_by_lengths_of_segments() {
    let folder = tempfile::tempdir().unwrap();
    let people = "participant,mass_kg,hand_length_m\nP01,84,0.23\nP02,70,0.2\n";
    let study = study(folder.path(), SCALING, people);
    let out = folder.path().join("out");
    carpus_scale(&study, &out, &[]).success();
    let text = std::fs::read_to_string(out.join("scale.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    let first = &results["models"][0];
    let found = first["bodies"][0]["factors"].as_array().unwrap();
    for (found, expected) in found.iter().zip([1.0, 1.15, 1.15]) {
        assert!((found.as_f64().unwrap() - expected).abs() < 1e-12, "{first}");
    }
    let ratio = first["mass_kg"].as_f64().unwrap() / first["mass_before_kg"].as_f64().unwrap();
    assert!((ratio - 84.0 / 70.0).abs() < 1e-12, "{first}");
    // With strength scaling after it, nothing but the forces differs.
    let strong = folder.path().join("strong");
    let text = std::fs::read_to_string(folder.path().join("participants.csv")).unwrap();
    let with_moments: Vec<String> =
        text.lines().zip([",mvc_flexion_n_m", ",12", ",9"]).map(|(a, b)| format!("{a}{b}\n")).collect();
    std::fs::write(folder.path().join("participants.csv"), with_moments.concat()).unwrap();
    let toml = std::fs::read_to_string(&study).unwrap();
    std::fs::write(&study, format!("{toml}[strength_scaling]\nposture_deg = 5\n")).unwrap();
    let mut command = Command::cargo_bin("carpus").expect("the program");
    command.arg("strength-scale").arg(&study).arg("--linear").arg("--out").arg(&strong).assert().success();
    let [a, b] = [&out, &strong].map(|folder| std::fs::read_to_string(folder.join("P01/model.osim")).unwrap());
    let changed: Vec<&str> = a.lines().zip(b.lines()).filter(|(a, b)| a != b).map(|(_, b)| b.trim()).collect();
    assert_eq!(changed.len(), 2, "{changed:?}");
    assert!(changed.iter().all(|line| line.starts_with("<max_isometric_force>")), "{changed:?}");
    // The second participant is the model.
    let same = OsimFile::read(out.join("P02/model.osim")).unwrap();
    let model = OsimFile::read(root("models/wrist.osim")).unwrap();
    for (a, b) in same.spec.muscles.iter().zip(&model.spec.muscles) {
        assert!((a.tendon_slack_length - b.tendon_slack_length).abs() < 1e-15);
    }
}

#[test]
fn verif_implausible_scaling_is_warned_of() {
    let said = |arguments: &[&str]| {
        let out = tempfile::tempdir().unwrap();
        let arguments: Vec<String> = arguments.iter().map(|a| (*a).to_owned()).collect();
        let done = carpus_scale(&root("models/wrist.osim"), out.path(), &arguments).success();
        String::from_utf8(done.get_output().stderr.clone()).unwrap()
    };
    let percent = said(&["--factor", "hand=105"]);
    assert!(percent.contains("scale factor of `hand`: 105 is not plausible (expected 0.25 to 3)"), "{percent}");
    assert!(percent.contains("is it in %? 105 % are 1.05"), "{percent}");
    let axis = said(&["--factor", "hand=1,0.01,1"]);
    assert!(axis.contains("scale factor of `hand`: 0.01 is not plausible"), "{axis}");
    let heavy = said(&["--factor", "hand=1", "--mass", "1e300"]);
    assert!(heavy.contains("mass of the scaled model: 1e300 is not plausible in kg"), "{heavy}");
    let fine = said(&["--factor", "hand=1.05", "--factor", "radius=1,0.5,2", "--mass", "3.9"]);
    assert!(!fine.contains("plausible"), "{fine}");
}

#[test]
fn verif_bad_scaling_is_explained() {
    let people = "participant,mass_kg,hand_length_m\nP01,84,0.23\n";
    let refused = |scaling: &str, people: &str, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let study = study(folder.path(), scaling, people);
        let failed = carpus_scale(&study, &folder.path().join("out"), &[]).code(1);
        let text = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        for word in words {
            assert!(text.contains(word), "expected `{word}` in:\n{text}");
        }
    };
    refused("", people, &["[scaling] is missing", "[scaling.segments.forearm]"]);
    refused(SCALING, "participant\nP01\n", &["P01", "hand_length_m"]);
    refused(SCALING, "participant,hand_length_m\nP01,0.2\n", &["P01", "mass_kg"]);
    refused(
        &SCALING.replace("[\"hand\"]", "[\"hnd\"]"),
        people,
        &["study.toml:", "no body `hnd`", "did you mean `hand`?"],
    );
    refused(&SCALING.replace("model_length_m = 0.2", ""), people, &["study.toml:", "0 of them", "joints"]);
    refused(&SCALING.replace("bodies", "body"), people, &["unknown", "`body`", "bodies"]);
    refused(&SCALING.replace("\"z\"", "\"w\""), people, &["axis", "w"]);
    refused(&SCALING.replace("reference_mass_kg = 70", "whole_body = 3"), people, &["true or false", "found 3"]);
    refused(
        &SCALING.replace("model_length_m = 0.2", "joints = [\"wrist\", \"nowhere\"]"),
        people,
        &["no joint", "study.toml:"],
    );
    let out = tempfile::tempdir().unwrap();
    let model = root("models/wrist.osim");
    let stderr = |arguments: &[&str]| {
        let arguments: Vec<String> = arguments.iter().map(|a| (*a).to_owned()).collect();
        let failed = carpus_scale(&model, out.path(), &arguments).code(1);
        String::from_utf8(failed.get_output().stderr.clone()).unwrap()
    };
    assert!(stderr(&["--factor", "hend=1.1"]).contains("did you mean `hand`?"));
    assert!(stderr(&["--factor", "hand=-1.1"]).contains("BODY=FACTOR"));
    assert!(stderr(&["--factor", "hand=1,2"]).contains("BODY=FACTOR"));
    assert!(stderr(&[]).contains("nothing to scale by"));
    assert!(stderr(&["--participant", "P01", "--factor", "hand=2"]).contains("go with a study"));
}
