//! Diagnoses of bundled studies that OpenSim simulated and in which an effect is hidden (fixtures/hidden_effects): what
//! is found must be what was hidden. The table over many more is made by fixtures/scripts/laboratory_table.py.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use carpus::diagnosis::addition::fit_steps;
use carpus::diagnosis::diagnose::{Diagnosis, Request, Verdict, diagnose, rmse, simulate};
use carpus::diagnosis::inference::search::Budget;
use carpus::diagnosis::inference::session::Session;
use carpus::diagnosis::separability::separability;
use carpus::diagnosis::separation::Laboratory;
use carpus::effects::catalogue::CATALOGUE;
use carpus::effects::forward_model::{ForwardModel, Setting};
use carpus::osim::OsimFile;
use carpus::osim::spec::{ForceKind, ModelSpec};
use carpus::signals::{Band, Butterworth, sample_rate};
use carpus::simulation::{MusculoskeletalModel, Setup};
use carpus::study::{Study, Trial, TrialUse};
use nalgebra::DVector;
use serde_json::Value;

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models");

/// Diagnoses a study among a few candidates; also what was hidden.
fn diagnosed(name: &str, candidates: &[&str]) -> (Diagnosis, Value) {
    diagnosed_at(1.0, name, candidates)
}

/// The same, model and participant being so many times as strong.
fn diagnosed_at(strength: f64, name: &str, candidates: &[&str]) -> (Diagnosis, Value) {
    let stronger = |t: &mut Trial| t.moment.iter_mut().for_each(|m| *m *= strength);
    judged(name, asked_of(strength, &folder(name), &stronger, candidates, diagnosis))
}

fn diagnosis(request: &Request) -> Diagnosis {
    diagnose(request, &|_| {}).unwrap().diagnosis
}

/// What was found in a bundled study, and what was hidden.
fn judged(name: &str, found: Diagnosis) -> (Diagnosis, Value) {
    let sets: Vec<_> = found.explanations.iter().map(|e| (&e.effects, e.p_value)).collect();
    println!("{name}: {:?}, p of no effect {:.4}, {sets:?}", found.verdict, found.null_p_value);
    check_lists(&found);
    let truth = std::fs::read_to_string(folder(name).join("truth.json")).unwrap();
    (found, serde_json::from_str(&truth).unwrap())
}

fn folder(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/hidden_effects").join(name)
}

/// A study of a laboratory in which many things are a little wrong at once, and what was hidden in it.
fn of_laboratory(name: &str) -> (Diagnosis, Value) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/laboratory").join(name);
    let found = asked(&folder, &[], diagnosis);
    let effects: Vec<_> = found.effects.iter().map(|e| (&e.group, e.probability, e.share_of_error.train)).collect();
    println!("{name}: {:?} {effects:?} {:?}", found.verdict, found.account);
    let truth = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    (found, serde_json::from_str(&truth).unwrap())
}

/// What is handed over predicts held-out trials no worse than the model as given.
fn assert_never_worse(found: &Diagnosis) {
    let held_out = found.error.held_out.unwrap();
    let handed_over = held_out.with_effect.unwrap_or(held_out.refit_only);
    assert!(handed_over <= 1.02 * held_out.base, "{handed_over} after {}", held_out.base);
    assert!(held_out.refit_only <= 1.02 * held_out.base, "{} after {}", held_out.refit_only, held_out.base);
}

/// What is asked of a study.
fn asked<T>(folder: &Path, candidates: &[&str], ask: impl FnOnce(&Request) -> T) -> T {
    asked_of(1.0, folder, &|_| {}, candidates, ask)
}

/// What is asked of a study whose trials are changed, the model being so many times as strong.
fn asked_of<T>(
    strength: f64,
    folder: &Path,
    change: &dyn Fn(&mut Trial),
    candidates: &[&str],
    ask: impl FnOnce(&Request) -> T,
) -> T {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let mut study = Study::read_tables(folder).unwrap();
    let mut trials = study.load_trials("P01").unwrap();
    let mut spec = OsimFile::read(root.join("models/wrist.osim")).unwrap().spec;
    study.settings.dynamometer.damping *= strength;
    trials.iter_mut().for_each(change);
    strengthen(&mut spec, strength);
    let model = MusculoskeletalModel::compile(&spec, &Setup::from_settings(&study.settings)).unwrap();
    let forward = ForwardModel::for_diagnosis(&spec, &model, &trials).unwrap();
    let known = |id: &&str| CATALOGUE.iter().copied().find(|e| e.description().id == *id).unwrap();
    let request = Request {
        participant: "P01".to_string(),
        forward: &forward,
        laboratory: Some(Laboratory { spec: &spec, model: &model }),
        bounds: study.settings.bounds,
        images: Vec::new(),
        candidates: candidates.iter().map(known).collect(),
        mvc: trials.iter().map(|t| t.max_abs_moment()).fold(0.0, f64::max),
        seed: 1,
    };
    ask(&request)
}

/// A model so many times as strong, in muscles and in what holds the joint.
fn strengthen(spec: &mut ModelSpec, times: f64) {
    spec.muscles.iter_mut().for_each(|m| m.max_isometric_force *= times);
    for force in &mut spec.forces {
        match &mut force.kind {
            ForceKind::SpringGeneralized { stiffness, viscosity, .. } => {
                *stiffness *= times;
                *viscosity *= times;
            }
            ForceKind::CoordinateLimit { upper_stiffness, lower_stiffness, damping, .. } => {
                for of_limit in [upper_stiffness, lower_stiffness, damping] {
                    *of_limit *= times;
                }
            }
            other => panic!("{other:?}"),
        }
    }
}

/// Every candidate is in one list, what is ruled out has a small p-value, and experiments are there where they are
/// called for.
fn check_lists(found: &Diagnosis) {
    let missing = found.effects.iter().map(|e| e.effect);
    let explaining: BTreeSet<&str> =
        found.explanations.iter().flat_map(|e| e.effects.iter().copied()).chain(missing).collect();
    let not = &found.not_listed;
    let lists = [&not.ruled_out, &not.less_likely, &found.not_testable];
    let mut listed: Vec<&str> = explaining.iter().copied().chain(lists.into_iter().flatten().copied()).collect();
    listed.sort_unstable();
    let mut all: Vec<&str> = found.candidates.iter().map(|c| c.effect).collect();
    all.sort_unstable();
    assert_eq!(listed, all);
    let probability = |id: &str| found.candidates.iter().find(|c| c.effect == id).unwrap().probability;
    assert!(not.ruled_out.iter().all(|id| probability(id) < 0.01), "{not:?}");
    assert!(not.less_likely.iter().all(|id| probability(id) >= 0.01), "{not:?}");
    assert_eq!(found.separating_experiments.is_empty(), found.verdict != Verdict::CannotTell);
    for experiment in &found.separating_experiments {
        assert!(experiment.separates.iter().all(|id| explaining.contains(id)), "{experiment:?}");
        assert!(experiment.z_then >= experiment.z_now, "{experiment:?}");
    }
}

/// The estimate of a hidden parameter covers what was hidden, and is right within a share.
fn assert_found(found: &Diagnosis, truth: &Value, effect: &str, parameter: &str, share: f64) {
    let name = format!("{effect}.{parameter}");
    let hidden = truth["effect_parameters"][&name].as_f64().unwrap();
    let explanation = found.explanations.iter().find(|e| e.effects == [effect]).unwrap();
    let estimate = &explanation.parameters[&name];
    println!("{name}: {:.4} {:?}, hidden {hidden}", estimate.value, estimate.ci95);
    assert!((estimate.value - hidden).abs() < share * hidden.abs(), "{name}: {} instead of {hidden}", estimate.value);
    assert!(estimate.ci95[0] < hidden && hidden < estimate.ci95[1], "{name}: {hidden} not in {:?}", estimate.ci95);
}

fn sets(found: &Diagnosis) -> Vec<&[&str]> {
    found.explanations.iter().map(|e| e.effects.as_slice()).collect()
}

#[test]
fn val_opensim_nothing_hidden_nothing_found() {
    let (found, _) = diagnosed("nothing_hidden", &["joint_damping", "torque_drift", "time_shift", "emg_nonlinearity"]);
    assert_eq!(found.verdict, Verdict::NothingDetectable);
}

#[test]
fn val_opensim_a_hidden_delay_is_identified() {
    let candidates = ["electromechanical_delay", "joint_damping", "torque_drift", "joint_stiffness"];
    let (found, truth) = diagnosed("electromechanical_delay", &candidates);
    assert_eq!((found.verdict, sets(&found)), (Verdict::Identified, vec![["electromechanical_delay"].as_slice()]));
    assert_found(&found, &truth, "electromechanical_delay", "delay", 0.2);
    let held_out = found.error.held_out.unwrap();
    assert!(held_out.with_effect.unwrap() < held_out.refit_only);
}

#[test]
fn val_opensim_hidden_stiffness_is_among_the_explanations() {
    let candidates = ["joint_stiffness", "gravity", "torque_drift", "electromechanical_delay"];
    let (found, truth) = diagnosed("joint_stiffness", &candidates);
    assert!(matches!(found.verdict, Verdict::Identified | Verdict::CannotTell), "{:?}", found.verdict);
    assert!(sets(&found).contains(&["joint_stiffness"].as_slice()), "{:?}", sets(&found));
    assert_found(&found, &truth, "joint_stiffness", "stiffness", 0.25);
}

/// Torque that was low-pass filtered, as laboratories do, has no white noise: of its variance nobody knows more than
/// that it is small.
#[test]
fn val_opensim_what_is_missing_is_found_where_the_torque_was_filtered() {
    let filtered = |t: &mut Trial| {
        let filter = Butterworth { order: 2, band: Band::LowPass { cutoff_hz: 6.0 } };
        let filter = filter.design(sample_rate(&t.time).unwrap()).unwrap();
        t.moment = filter.filter_zero_phase(&t.moment).unwrap();
    };
    let candidates = ["joint_stiffness", "gravity", "torque_drift", "electromechanical_delay"];
    let name = "joint_stiffness";
    let (found, truth) = judged(name, asked_of(1.0, &folder(name), &filtered, &candidates, diagnosis));
    assert!(found.noise["moment_white_n_m"] < 0.02, "{:?}", found.noise);
    assert!(sets(&found).contains(&["joint_stiffness"].as_slice()), "{:?}", sets(&found));
    assert_found(&found, &truth, "joint_stiffness", "stiffness", 0.25);
}

/// Sizes in the catalogue are a wrist's; those of stronger joints are in proportion.
#[test]
fn verif_a_joint_twice_as_strong_has_the_same_diagnosis() {
    let candidates = ["joint_stiffness", "gravity", "torque_drift", "electromechanical_delay"];
    let [weak, strong] = [8.0, 16.0].map(|strength| diagnosed_at(strength, "joint_stiffness", &candidates).0);
    assert_eq!((weak.verdict, sets(&weak)), (strong.verdict, sets(&strong)));
    assert!(sets(&weak).contains(&["joint_stiffness"].as_slice()), "{:?}", sets(&weak));
    for (a, b) in weak.explanations.iter().zip(&strong.explanations) {
        assert!((a.p_value - b.p_value).abs() < 0.05, "{:?}: p {} and {}", a.effects, a.p_value, b.p_value);
        for (name, estimate) in &a.parameters {
            let times = if estimate.unit.starts_with("N·m") { 2.0 } else { 1.0 };
            let (low, high) = (times * estimate.ci95[0], times * estimate.ci95[1]);
            let other = b.parameters[name].value;
            assert!((other - times * estimate.value).abs() < 0.1 * (high - low), "{name}: {other} in [{low}, {high}]");
        }
    }
}

/// Friction of a form that is not the catalogue's usual one: its step at reversal is twice as wide, and it breaks away
/// otherwise.
#[test]
fn val_opensim_friction_of_another_form_is_among_the_explanations() {
    let candidates = ["coulomb_friction", "joint_damping", "joint_stiffness", "torque_drift"];
    let (found, truth) = diagnosed("coulomb_friction", &candidates);
    assert_eq!((found.verdict, sets(&found)), (Verdict::Identified, vec![["coulomb_friction"].as_slice()]));
    assert_found(&found, &truth, "coulomb_friction", "friction", 0.2);
    assert_found(&found, &truth, "coulomb_friction", "transition_speed", 0.5);
}

#[test]
fn val_opensim_what_the_catalogue_lacks_is_called_unknown() {
    let candidates = ["joint_stiffness", "end_range_spring", "joint_damping", "torque_drift"];
    let (found, _) = diagnosed("snapping_tendon", &candidates);
    assert_eq!(found.verdict, Verdict::Unknown);
}

/// A sensor that reads half of what is above a level bends the moment nearly as curved EMG does.
#[test]
fn val_opensim_a_sensor_that_does_not_read_in_proportion_is_called_unknown() {
    let candidates = ["emg_nonlinearity", "fatigue", "joint_damping", "torque_drift"];
    let (found, _) = diagnosed("clipped_sensor", &candidates);
    assert_eq!(found.verdict, Verdict::Unknown);
    let axes: Vec<(&str, Option<f64>)> = found.where_it_fails.iter().map(|a| (a.axis, a.p_value)).collect();
    println!("{axes:?}");
    assert_eq!(axes[0].0, "effort");
    assert_eq!(axes.last(), Some(&("frequency", None)));
    let shares: f64 = found.where_it_fails.last().unwrap().curve.iter().map(|band| band[1]).sum();
    assert!((shares - 1.0).abs() < 1e-12, "{shares}");
}

/// Without the effect the muscles go so far to make up for it that its score there is nothing: it is found from the
/// model as given.
#[test]
fn val_opensim_an_effect_that_the_muscles_hide_is_found() {
    let candidates: Vec<&str> = CATALOGUE.iter().map(|e| e.description().id).collect();
    let (found, truth) = diagnosed("emg_nonlinearity", &candidates);
    let [only] = found.effects.as_slice() else { panic!("{:?}", found.effects) };
    let (curvature, hidden) =
        (&only.parameters["curvature"], &truth["effect_parameters"]["emg_nonlinearity.curvature"]);
    println!("{curvature:?}, hidden {hidden}");
    assert!(only.effect == "emg_nonlinearity" && only.dominant && only.evidence > 10.0, "{only:?}");
    assert!(curvature.value < -1.5 && curvature.ci95[1] < -1.0, "{curvature:?}");
    let held_out = found.error.held_out.unwrap();
    assert!(held_out.with_effect.unwrap() < 0.6 * held_out.refit_only, "{held_out:?}");
}

/// Fitted in place of a small effect, rivals stay as far from it as products of signatures say, to first order; and
/// none is farther off than no effect at all, which they all may become.
#[test]
fn val_opensim_how_far_small_effects_are_apart_is_what_their_signatures_say() {
    let candidates = ["joint_damping", "inertia", "joint_stiffness", "gravity", "time_shift"];
    asked(&folder("nothing_hidden"), &candidates, |request| {
        let train = request.forward.trials_for(TrialUse::Train);
        let all = request.candidates.clone();
        let mut session = Session::new(request.forward, train, all, &request.bounds, Budget::none(), request.seed);
        let alone = session.estimate(&[], true, &|_| ()).unwrap();
        let null = session.as_fit(&alone);
        for (id, value) in [("joint_damping", 0.05), ("joint_stiffness", 0.3)] {
            let effect = *request.candidates.iter().find(|e| e.description().id == id).unwrap();
            let mut truth = Setting::absent(effect);
            truth.values[0] = value;
            let found = separability(request, &truth).unwrap();
            let none = found.iter().find(|d| d.rival.is_none()).unwrap().z;
            assert_eq!(found.len(), candidates.len());
            for distance in found.iter().filter(|d| d.rival.is_some()) {
                let rival = distance.rival.unwrap();
                let size = DVector::from_element(1, value / effect.description().parameters[0].scale);
                let expected = session.analysis.pairwise_z(&null, id, &size, rival).unwrap();
                println!(
                    "{id} {value} from {rival}: {:.2}, to first order {expected:.2}; from none {none:.2}",
                    distance.z
                );
                let [z, expected] = [distance.z, expected].map(|z| z * z);
                assert!((z - expected).abs() < 0.2 * expected + 0.1, "{id} from {rival}: squares {z}, {expected}");
                assert!(distance.z < none + 0.01);
            }
        }
    });
}

/// Where all muscles rest their forces hardly matter: they must not grow round by round with what their EMG's noise is
/// taken to be.
#[test]
fn val_opensim_passive_trials_alone_do_not_carry_the_muscles_away() {
    let (from, to) = (folder("snapping_tendon"), tempfile::tempdir().unwrap());
    let list = std::fs::read_to_string(from.join("trials.csv")).unwrap();
    let passive = list.lines().filter(|row| row.starts_with("participant") || row.contains(",passive,"));
    let passive: Vec<String> = passive.map(|row| row.replace(",test", ",train")).collect();
    assert_eq!(passive.len(), 4);
    std::fs::create_dir_all(to.path().join("data/P01")).unwrap();
    for name in ["participants.csv", "data/P01/passive_1.csv", "data/P01/passive_2.csv", "data/P01/passive_3.csv"] {
        std::fs::copy(from.join(name), to.path().join(name)).unwrap();
    }
    let settings = std::fs::read_to_string(from.join("study.toml")).unwrap();
    std::fs::write(to.path().join("study.toml"), settings.replace("../../../models", MODELS)).unwrap();
    std::fs::write(to.path().join("trials.csv"), passive.join("\n")).unwrap();
    let candidates: Vec<&str> = CATALOGUE.iter().map(|e| e.description().id).collect();
    asked(to.path(), &candidates, |request| {
        let forward = request.forward;
        let refitted = fit_steps(request, &[], &|_| ()).unwrap();
        let [given, fitted] = [&forward.nominal_parameters(), &refitted[0].parameters]
            .map(|parameters| rmse(forward, &simulate(forward, parameters, &[], TrialUse::Train).unwrap()).unwrap());
        println!("RMSE as given {given:.3}, muscles refitted {fitted:.3} N·m");
        assert!(fitted < 1.5 * given, "{fitted} instead of {given}");
    });
}

#[test]
fn val_opensim_a_dominant_effect_is_found_where_everything_is_a_little_wrong() {
    let (found, truth) = of_laboratory("one_effect");
    assert!(matches!(found.verdict, Verdict::Dominant | Verdict::Several), "{:?}", found.verdict);
    let hidden = truth["effects"][0].as_str().unwrap();
    let first = &found.effects[0];
    assert!(first.group.contains(&hidden) && first.dominant, "{first:?}");
    assert!(first.probability > 0.9 && first.share_of_error.held_out.unwrap()[0] > 0.0, "{first:?}");
    assert_never_worse(&found);
    // As given, recalibrated, one effect after the other, discrepancy, noise: with all effects the error is less than
    // that of the muscles alone, and the discrepancy takes more.
    let [steps @ .., discrepancy, noise] = found.account.as_slice() else { panic!("{:?}", found.account) };
    assert_eq!(steps.len(), 2 + found.effects.len());
    assert_eq!([discrepancy.step.as_str(), noise.step.as_str()], ["generic_discrepancy", "noise"]);
    let last = steps.last().unwrap();
    assert!(last.train < steps[1].train && steps[1].train <= steps[0].train, "{:?}", found.account);
    assert!(discrepancy.train < last.train, "{:?}", found.account);
}

#[test]
fn val_opensim_two_effects_are_found_where_everything_is_a_little_wrong() {
    let (found, truth) = of_laboratory("two_effects");
    assert!(matches!(found.verdict, Verdict::Dominant | Verdict::Several), "{:?}", found.verdict);
    for hidden in truth["effects"].as_array().unwrap() {
        let hidden = hidden.as_str().unwrap();
        assert!(found.effects.iter().any(|e| e.group.contains(&hidden)), "{hidden}");
    }
    assert_never_worse(&found);
}

#[test]
fn val_opensim_nothing_takes_most_of_the_error_where_everything_is_a_little_wrong() {
    let (found, _) = of_laboratory("no_effect");
    // A third is less than any effect takes that is large beside the small ones.
    assert!(found.effects.iter().all(|e| e.share_of_error.train[0] < 1.0 / 3.0), "{:?}", found.effects);
    assert_never_worse(&found);
}
