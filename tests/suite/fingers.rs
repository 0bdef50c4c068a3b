//! The index finger: moments about one joint, while the posture of another differs from trial to trial.
//!
//! OpenSim simulated the trials of `fixtures/index_finger` with other muscle parameters than the model's and a stiffer
//! capsule of the joint (`truth.json`).

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::osim::OsimFile;
use carpus::simulation::{
    MuscleParameters, MusculoskeletalModel, Options, Recording, Setup, TrialSimulation, simulate_all,
};
use carpus::study::{Contraction, Study, Trial};
use serde_json::Value;

/// Angle at which the capsule of the model has no moment [rad].
const CAPSULE_REST: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Excitation of the relaxed muscles (`make_study.py`).
const REST: f64 = 0.015;
/// White noise of the simulated sensor [N·m] (`make_finger_study.py`).
const WHITE_N_M: f64 = 0.005;

fn root(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn truth() -> Value {
    let text = std::fs::read_to_string(root("fixtures/index_finger/truth.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn carpus(words: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("carpus").unwrap();
    command.timeout(std::time::Duration::from_secs(600)).current_dir(root("")).args(words).assert()
}

/// The finger's study, its model, and the participant's own parameters.
fn finger() -> (Vec<Trial>, MusculoskeletalModel, Vec<MuscleParameters>) {
    let study = Study::read(root("fixtures/index_finger")).unwrap();
    let file = OsimFile::read(&study.participants[0].model).unwrap();
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
    let truth = truth();
    let of = |name: &str, p: MuscleParameters| {
        let value = |property: &str| truth["parameters"][name][property].as_f64().unwrap();
        MuscleParameters {
            max_isometric_force: value("max_isometric_force"),
            optimal_fiber_length: value("optimal_fiber_length"),
            tendon_slack_length: value("tendon_slack_length"),
            ..p
        }
    };
    let own = model.muscle_names().zip(model.nominal_parameters()).map(|(name, p)| of(name, p)).collect();
    (study.load_trials("P01").unwrap(), model, own)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|v| v * v).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Largest root mean square of what the participant's own muscles and capsule leave of passive trials [N·m]. Muscles are
/// excited as OpenSim's were, not as was recorded.
///
/// - `in_posture`: whether trials are simulated in their postures, or all in the model's own
fn left_of_passive_trials(in_posture: bool) -> f64 {
    let (mut trials, model, own) = finger();
    let stiffness = truth()["effects"]["joint_stiffness"]["stiffness_n_m_per_rad"].as_f64().unwrap();
    trials.retain(|t| t.info.contraction == Contraction::Passive);
    for trial in &mut trials {
        trial.excitation.iter_mut().for_each(|e| e.fill(REST));
        if !in_posture {
            trial.info.held.clear();
        }
    }
    let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
    let options = Options { allow_angle_outside_range: true, ..Options::default() };
    let prepared = model.prepare_all(&recordings, &options).unwrap();
    let simulated = simulate_all(&prepared, &own).unwrap();
    let of = |(trial, simulation): (&Trial, &TrialSimulation)| {
        let left = |k: usize| {
            let capsule = -stiffness * (trial.angle[k] - CAPSULE_REST);
            simulation.moment[k] + capsule - trial.moment[k]
        };
        rms((0..trial.len()).map(left))
    };
    trials.iter().zip(&simulated).map(of).fold(0.0, f64::max)
}

#[test]
fn val_opensim_passive_finger_in_five_postures_of_the_wrist() {
    let left = left_of_passive_trials(true);
    println!("passive trials: {left:.4} N.m r.m.s. left");
    // White and slow noise of the sensor, and what noise of the angle makes of the passive moment.
    assert!(left < 1.6 * WHITE_N_M, "{left}");
    // In one posture for all, muscles that cross the wrist are too long or too short.
    assert!(left_of_passive_trials(false) > 4.0 * WHITE_N_M);
}

#[test]
fn verif_a_posture_of_a_trial_is_that_of_a_study_that_has_it_for_all() {
    let (trials, model, own) = finger();
    let study = Study::read(root("fixtures/index_finger")).unwrap();
    let file = OsimFile::read(&study.participants[0].model).unwrap();
    let trial = trials.iter().find(|t| t.info.held_at("wrist_flexion") == Some(40.0)).unwrap();
    let recording = Recording::from(trial);
    let simulate = |model: &MusculoskeletalModel, recording: Recording| {
        let options = Options { allow_angle_outside_range: true, ..Options::default() };
        model.prepare(&recording, &options).unwrap().simulate(&own).unwrap().moment
    };
    let mut setup = Setup::from_settings(&study.settings);
    setup.posture.extend(recording.held.clone());
    let elsewhere = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let same = simulate(&elsewhere, Recording { held: Vec::new(), ..recording.clone() });
    assert_eq!(simulate(&model, recording), same);
}

#[test]
fn regress_the_finger_is_personalized_over_postures_of_the_wrist() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    carpus(&["personalize", "fixtures/index_finger", "--out", folder.to_str().unwrap()]).success();
    let results = json(&folder.join("P01/results.json"));
    let held_out = |model: usize| {
        let errors = results["models"][model]["errors"].as_array().unwrap();
        let of = errors.iter().find(|e| e["use"] == "held_out").unwrap_or_else(|| panic!("{errors:?}"));
        of["errors"]["rmse_n_m"].as_f64().unwrap()
    };
    println!("held out: {:.4} to {:.4} N.m", held_out(0), held_out(1));
    // What is left is the capsule's, which no muscle has.
    assert!(held_out(1) < 0.85 * held_out(0));
    let parameters = results["parameters"].as_array().unwrap();
    let truth = truth();
    let is_inside = |p: &&Value| {
        let value = &truth["parameters"][p["muscle"].as_str().unwrap()][p["property"].as_str().unwrap()];
        let ends = ["lower", "upper"].map(|end| p["interval"][end].as_f64().unwrap());
        (ends[0]..=ends[1]).contains(&value.as_f64().unwrap())
    };
    let inside = parameters.iter().filter(is_inside).count();
    println!("{inside} of {} true values in 90 % intervals", parameters.len());
    assert_eq!(parameters.len(), 3 * 7);
    // Fewer are in one study of forty at most, if intervals hold what they say.
    assert!(inside >= 16, "{inside}");
    let held = &results["trials"].as_array().unwrap()[2]["held"];
    assert_eq!(held[0]["coordinate"], "wrist_flexion", "{held}");
}

#[test]
fn regress_a_stiff_knuckle_is_told_from_muscles_that_cross_it_and_from_a_weight() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    carpus(&["diagnose", "fixtures/index_finger", "--out", folder.to_str().unwrap()]).success();
    let diagnosis = json(&folder.join("P01/diagnosis.json"));
    assert_eq!(diagnosis["verdict"], "identified");
    let explanation = &diagnosis["explanations"][0];
    assert_eq!(explanation["effects"], serde_json::json!(["joint_stiffness"]));
    let ends = &explanation["parameters"]["joint_stiffness.stiffness"]["ci95"];
    let [low, high] = [0, 1].map(|i| ends[i].as_f64().unwrap());
    let stiffness = truth()["effects"]["joint_stiffness"]["stiffness_n_m_per_rad"].as_f64().unwrap();
    println!("stiffness {low:.3} to {high:.3} N.m/rad, true {stiffness}");
    assert!(low < stiffness && stiffness < high && high - low < 0.1, "{low} {high}");
    // The model's finger weighs a fiftieth of a newton metre about the knuckle.
    let gravity = diagnosis["explanations"].as_array().unwrap().iter().any(|e| e["effects"][0] == "gravity");
    assert!(!gravity, "{diagnosis:#}");
}

/// A copy of the study with another list of trials.
fn with_trials(change: impl Fn(&str) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = root("fixtures/index_finger");
    let toml = std::fs::read_to_string(from.join("study.toml")).unwrap();
    let model = root("models/index_finger.osim").display().to_string().replace('\\', "/");
    let recordings = from.display().to_string().replace('\\', "/");
    let toml = toml.replace("../../models/index_finger.osim", &model);
    let toml = toml.replace("[study]", &format!("[study]\nrecordings = \"{recordings}\""));
    std::fs::write(folder.path().join("study.toml"), toml).unwrap();
    std::fs::copy(from.join("participants.csv"), folder.path().join("participants.csv")).unwrap();
    let trials = std::fs::read_to_string(from.join("trials.csv")).unwrap();
    std::fs::write(folder.path().join("trials.csv"), change(&trials)).unwrap();
    folder
}

#[test]
fn verif_a_posture_that_cannot_be_is_an_error_with_its_line() {
    let refused = |change: &dyn Fn(&str) -> String, expected: &[&str]| {
        let study = with_trials(change);
        let out = study.path().join("out");
        let run = carpus(&["compare", study.path().to_str().unwrap(), "--out", out.to_str().unwrap()]).failure();
        let text = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        expected.iter().for_each(|words| assert!(text.contains(words), "{words}: {text}"));
    };
    let column = "posture_wrist_flexion_deg";
    refused(&|t| t.replace(column, "posture_wrist_deg"), &["trials.csv:2", "coordinate `wrist` is not in the model"]);
    refused(&|t| t.replace(column, "posture_mcp_flexion_deg"), &["trials.csv:2", "other than the dynamometer's"]);
    refused(&|t| t.replacen(",60,-40,", ",60,-140,", 1), &["trials.csv:5", "wrist_flexion", "outside its range"]);
    refused(&|t| t.replacen(",60,-40,", ",60,back,", 1), &["trials.csv:5", column, "an angle in degrees", "back"]);
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}
