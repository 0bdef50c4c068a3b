//! The index finger: moments about one joint, while the posture of another differs from trial to trial.
//!
//! OpenSim simulated the trials of `fixtures/index_finger` with other muscle parameters than the model's and a stiffer
//! capsule of the joint (`truth.json`).

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use carpus::osim::OsimFile;
use carpus::simulation::{
    HeldCoordinate, MuscleParameters, MusculoskeletalModel, Options, Recording, Setup, simulate_all,
};
use carpus::study::{Contraction, Study, Trial, TrialUse};
use serde_json::Value;

/// Angle at which the capsule of the model has no moment [rad].
const CAPSULE_REST: f64 = 25.0 * std::f64::consts::PI / 180.0;
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

/// Largest root mean square of what the participant's own muscles and capsule leave of passive trials [N·m].
///
/// - `held`: coordinates that a trial holds otherwise than the study
fn left_of_passive_trials(held: impl Fn(&Trial) -> Vec<HeldCoordinate>) -> f64 {
    let (trials, model, own) = finger();
    let stiffness = truth()["effects"]["joint_stiffness"]["stiffness_n_m_per_rad"].as_f64().unwrap();
    let trials: Vec<&Trial> = trials.iter().filter(|t| t.info.contraction == Contraction::Passive).collect();
    let recordings: Vec<Recording> =
        trials.iter().map(|t| Recording { held: held(t), ..Recording::from(*t) }).collect();
    let options = Options { allow_angle_outside_range: true, ..Options::default() };
    let prepared = model.prepare_all(&recordings, &options).unwrap();
    let simulated = simulate_all(&prepared, &own).unwrap();
    let of = |(trial, simulation): (&&Trial, &carpus::simulation::TrialSimulation)| {
        rms((0..trial.len()).map(|k| {
            let capsule = -stiffness * (trial.angle[k] - CAPSULE_REST);
            simulation.moment[k] + capsule - trial.moment[k]
        }))
    };
    trials.iter().zip(&simulated).map(of).fold(0.0, f64::max)
}

#[test]
fn val_opensim_passive_finger_in_five_postures_of_the_wrist() {
    let own = |t: &Trial| t.info.held.iter().map(HeldCoordinate::from).collect();
    let left = left_of_passive_trials(own);
    println!("passive trials: {left:.4} N.m r.m.s. left");
    // Noise of the sensor, of the recorded EMG at rest and of the angle.
    assert!(left < 2.0 * WHITE_N_M, "{left}");
    // In one posture for all, the flexors and extensors that cross the wrist are as long as nowhere.
    assert!(left_of_passive_trials(|_| Vec::new()) > 4.0 * WHITE_N_M);
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
    let text = std::fs::read_to_string(folder.join("P01/results.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    let held_out = |model: usize| {
        let errors = results["models"][model]["errors"].as_array().unwrap();
        let of = errors.iter().find(|e| e["use"] == "test").unwrap_or_else(|| panic!("{errors:?}"));
        of["errors"]["nrmse_percent"].as_f64().unwrap()
    };
    println!("held out: {:.2} to {:.2} %", held_out(0), held_out(1));
    assert!(held_out(1) < 0.7 * held_out(0));
    assert!(study_is_read().iter().any(|t| t.info.usage == TrialUse::Test));
}

fn study_is_read() -> Vec<Trial> {
    finger().0
}
