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
