//! Studies whose muscles are of other classes than Millard's, as a user runs them.

use std::path::{Path, PathBuf};

use carpus::osim::OsimFile;
use carpus::report::results::{Results, Use};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;

use crate::user_loop::{carpus, root, small_study};

const CLASSES: [&str; 6] = [
    "Thelen2003Muscle",
    "DeGrooteFregly2016Muscle",
    "DeGrooteFregly2016Muscle_rigid",
    "RigidTendonMuscle",
    "Schutte1993Muscle_Deprecated",
    "Delp1990Muscle_Deprecated",
];

/// The bundled study with few trials, its model's muscles of another class.
fn study(folder: &Path, class: &str) -> PathBuf {
    let study = small_study(folder);
    std::fs::copy(root(&format!("fixtures/muscle_laws/{class}.osim")), folder.join("wrist.osim")).unwrap();
    study
}

/// Recorded moments are those of Millard's muscles with EMG noise: of another class, fitted muscles have to explain
/// them better than those of the model, and the written model has to be that class with the fitted values.
#[test]
fn verif_muscles_of_every_class_are_personalized() {
    for class in CLASSES {
        let folder = tempfile::tempdir().unwrap();
        let study = study(folder.path(), class);
        let out = folder.path().join("out");
        carpus().arg("personalize").arg(&study).arg("--out").arg(&out).assert().success();
        let results = Results::parse(&std::fs::read_to_string(out.join("P01/results.json")).unwrap()).unwrap();
        let fitted = &results.parameters;
        assert_eq!(fitted.len(), 15, "{class}");
        let spec = OsimFile::read(out.join("P01/model.osim")).unwrap().spec;
        for parameter in fitted {
            let muscle = spec.muscles.iter().find(|m| m.name == parameter.muscle).unwrap();
            assert!(class.starts_with(muscle.class()), "{class}: {}", muscle.class());
            let written = match parameter.property.as_str() {
                "optimal_fiber_length" => muscle.optimal_fiber_length,
                "tendon_slack_length" => muscle.tendon_slack_length,
                _ => muscle.max_isometric_force,
            };
            assert!((written / parameter.after - 1.0).abs() < 1e-5, "{class} {}: {written}", parameter.muscle);
        }
        let masses = results.warnings.iter().filter(|w| format!("{w:?}").contains("without their mass")).count();
        assert_eq!(masses, usize::from(class == "Delp1990Muscle_Deprecated"), "{class}");
        check_muscle_use(&results, &spec, &out.join("P01/series"), class);
        // Model as given, then personalized.
        let training = |model: usize| {
            let errors = &results.models[model].errors;
            errors.iter().find(|e| e.trial_use == Use::Train).and_then(|e| e.errors.rmse_n_m).unwrap()
        };
        let (before, after) = (training(0), training(results.models.len() - 1));
        println!("{class}: {before:.3} N·m, personalized {after:.3} N·m");
        assert!(after < 0.8 * before, "{class}: {before} {after}");
    }
}

/// Where fibres work, as the report draws it, against the series of every trial.
fn check_muscle_use(results: &Results, spec: &carpus::osim::spec::ModelSpec, series: &Path, class: &str) {
    let used = results.muscles.as_ref().expect("what muscles did");
    assert_eq!(used.muscles.len(), 5, "{class}");
    assert!(used.moment_n_m.len() > 100, "{class}");
    let mut files: Vec<PathBuf> = std::fs::read_dir(series).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|e| e == "csv"));
    assert_eq!(files.len(), results.trials.len());
    for m in &used.muscles {
        assert_eq!(m.excitation.len(), used.moment_n_m.len());
        let mut lengths: Vec<f64> = Vec::new();
        for file in &files {
            let mut reader = csv::Reader::from_path(file).unwrap();
            let column = format!("{}_fiber_length", m.muscle);
            let at = reader.headers().unwrap().iter().position(|name| name.starts_with(&column)).expect("the column");
            lengths.extend(reader.records().map(|row| row.unwrap()[at].parse::<f64>().unwrap()));
        }
        let optimal = spec.muscles.iter().find(|other| other.name == m.muscle).unwrap().optimal_fiber_length;
        lengths.sort_by(f64::total_cmp);
        let percentile = |share: f64| lengths[(share * (lengths.len() - 1) as f64).round() as usize] / optimal;
        let found = m.ranges["personalized"].length;
        for (found, expected) in found.into_iter().zip([percentile(0.01), percentile(0.99)]) {
            assert!((found / expected - 1.0).abs() < 2e-3, "{class} {}: {found} {expected}", m.muscle);
        }
        let top = m.length.iter().zip(&m.active).max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        assert!((top.0 - 1.0).abs() < 0.1 && (top.1 - 1.0).abs() < 0.02, "{class} {}: {top:?}", m.muscle);
        // Schutte's law states a fibre's velocity: no force over velocity.
        assert_eq!(m.force.is_empty(), class == "Schutte1993Muscle_Deprecated", "{class}");
        assert!(m.force.windows(2).all(|pair| pair[1] >= pair[0]), "{class}: more force when lengthening");
    }
}

/// Effects of properties that a class lacks are named, and cannot be added.
#[test]
fn verif_effects_without_their_property_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(folder.path(), "RigidTendonMuscle");
    let mut command = carpus();
    command.args(["effect", "add"]).arg(&study).arg("tendon_compliance").arg("--i-choose");
    command.arg("--out").arg(folder.path().join("out"));
    command.assert().code(1).stderr(contains("tendon_compliance: not testable").and(contains("RigidTendonMuscle")));
}
