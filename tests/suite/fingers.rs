//! The index finger: moments about one joint, while the posture of another differs from trial to trial.
//!
//! OpenSim simulated the trials of `fixtures/index_finger` with other muscle parameters than the model's and a stiffer
//! capsule of the joint (`truth.json`).

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::identifiability::usual_recordings;
use carpus::osim::OsimFile;
use carpus::simulation::{
    MuscleParameters, MusculoskeletalModel, Options, Recording, Setup, TrialSimulation, simulate_all,
};
use carpus::study::{
    Contraction, Direction, Participant, PostureCoordinate, Settings, Study, Trial, TrialInfo, TrialUse,
};
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

/// Names of the trials that are offered after three that hold other joints so: one list for each.
fn offered(model: &MusculoskeletalModel, held: [&[(&str, f64)]; 3]) -> Vec<String> {
    let (mut trials, ..) = finger();
    trials.retain(|t| t.info.usage == TrialUse::Train);
    trials.truncate(3);
    let of = |(coordinate, value): &(&str, f64)| PostureCoordinate {
        coordinate: (*coordinate).to_owned(),
        line: 0,
        value_deg_or_m: *value,
    };
    trials.iter_mut().zip(held).for_each(|(trial, held)| trial.info.held = held.iter().map(of).collect());
    usual_recordings(model, &trials).into_iter().map(|trial| trial.info.name).collect()
}

#[test]
fn verif_offered_trials_have_names_that_tell_their_postures_apart() {
    let study = Study::read(root("fixtures/index_finger")).unwrap();
    let (_, model, _) = finger();
    let of = |names: &[String], ends: &str| names.iter().filter(|name| name.ends_with(ends)).count();
    // Less than a degree apart; the same value of two joints; a joint more.
    let near = offered(&model, [&[("wrist_flexion", 12.4)], &[("wrist_flexion", 12.6)], &[("pip_flexion", 12.4)]]);
    let in_each = near.len() / 3;
    assert!(in_each > 1 && near.len() == 3 * in_each, "{near:?}");
    for ends in [", wrist_flexion 12.4°", ", wrist_flexion 12.6°", ", pip_flexion 12.4°"] {
        assert_eq!(of(&near, ends), in_each, "{ends}: {near:?}");
    }
    // One posture, in whatever order its joints stand.
    let [one, other] =
        [[("wrist_flexion", -5.0), ("pip_flexion", 20.0)], [("pip_flexion", 20.0), ("wrist_flexion", -5.0)]];
    let same = offered(&model, [&one, &other, &one]);
    assert_eq!((same.len(), of(&same, ", wrist_flexion −5°, pip_flexion 20°")), (in_each, in_each), "{same:?}");

    // A joint that slides.
    let text = std::fs::read_to_string(root("models/index_finger.osim")).unwrap();
    let (before, dip) = text.split_once("<PinJoint name=\"dip\">").unwrap();
    let text = format!("{before}<SliderJoint name=\"dip\">{}", dip.replacen("</PinJoint>", "</SliderJoint>", 1));
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sliding.osim"), text).unwrap();
    let file = OsimFile::read(folder.path().join("sliding.osim")).unwrap();
    let mut setup = Setup::from_settings(&study.settings);
    setup.posture.retain(|held| held.coordinate != "dip_flexion");
    let sliding = MusculoskeletalModel::compile(&file.spec, &setup).unwrap();
    let slid = offered(&sliding, [&[("dip_flexion", 0.012)], &[("dip_flexion", 0.0125)], &[]]);
    for ends in [", dip_flexion 0.012\u{202f}m", ", dip_flexion 0.0125\u{202f}m"] {
        assert_eq!(of(&slid, ends), in_each, "{ends}: {slid:?}");
    }
}

#[test]
fn verif_postures_and_turned_arms_of_arrays_are_among_the_inputs() {
    let hashes = |change: &dyn Fn(&mut TrialInfo)| {
        let mut info = TrialInfo::new("P01", "a", Contraction::Isotonic, Direction::Flexion, TrialUse::Train);
        change(&mut info);
        let time: Vec<f64> = (0..50).map(|k| 0.01 * f64::from(k)).collect();
        let angle = time.iter().map(|t| 0.3 * t).collect();
        let trial = Trial::from_samples(info, time.clone(), angle, vec![1.0; 50], vec![vec![0.1; 50]]);
        let settings = Settings::with_defaults("arrays", "flexion", &["FCR"]).unwrap();
        let tables = Study::of_trials(settings, vec![Participant::named("P01")], vec![trial.clone()]).unwrap();
        let model = OsimFile::read(root("models/wrist.osim")).unwrap();
        let study = carpus::session::study::Study::from_memory(tables, model);
        let inputs = study.inputs(&Participant::named("P01"), Path::new("model.osim"), &[trial]).unwrap();
        assert_eq!(inputs.iter().map(|i| i.role.as_str()).collect::<Vec<_>>(), ["model", "trials", "trial"]);
        inputs.into_iter().map(|i| i.sha256).collect::<Vec<_>>()
    };
    let held = |value: f64| {
        hashes(&|info| {
            let coordinate = "elbow_flexion".to_owned();
            info.held = vec![PostureCoordinate { coordinate, line: 0, value_deg_or_m: value }];
        })
    };
    let plain = hashes(&|_| {});
    assert_eq!(plain, hashes(&|_| {}));
    for other in [held(90.0), held(45.0), hashes(&|info| info.arm_flipped = true)] {
        assert!(other != plain && other[0] == plain[0] && other[2] == plain[2]);
    }
    assert_ne!(held(90.0), held(45.0));
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}
