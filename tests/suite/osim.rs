//! Reading, editing and writing `.osim` files.

mod against_opensim;
mod editing;
mod reading;
mod small_models;

use carpus::osim::{Document, OsimFile, Severity};

use crate::reference::{shared, shared_dir};

/// All shared lab models.
fn lab_models() -> Vec<std::path::PathBuf> {
    let Some(dir) = shared_dir() else {
        eprintln!("SKIPPED: shared lab models are not here");
        return Vec::new();
    };
    models_in(&dir.join("models"))
}

/// All models in a folder, by name.
fn models_in(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder of models can be listed");
    let mut models: Vec<_> = entries.map(|entry| entry.expect("entry").path()).collect();
    models.retain(|path| path.extension().is_some_and(|extension| extension == "osim"));
    models.sort();
    models
}

#[test]
fn verif_lab_models_are_written_as_they_were_read() {
    for path in lab_models() {
        let original = std::fs::read(&path).expect("readable");
        let document = Document::read(&path).unwrap_or_else(|error| panic!("{error}"));
        assert!(document.bytes() == original, "{} changed", path.display());
    }
}

#[test]
fn verif_lab_models_load() {
    for path in lab_models() {
        let file = match OsimFile::read(&path) {
            Ok(file) => file,
            Err(error) => {
                for problem in error.problems() {
                    eprintln!("{problem}");
                }
                panic!("{error}");
            }
        };
        let spec = &file.spec;
        eprintln!(
            "{}: {} bodies, {} joints, {} coordinates, {} muscles, {} forces, {} wraps, {} findings",
            path.display(),
            spec.bodies.len(),
            spec.joints.len(),
            spec.coordinates.len(),
            spec.muscles.len(),
            spec.forces.len(),
            spec.wrap_objects.len(),
            file.diagnostics.items.len()
        );
        for item in &file.diagnostics.items {
            if item.severity != Severity::Ignored && !item.message.contains("its path is used") {
                eprintln!("  {}: {:?}: {}: {}", item.line, item.severity, item.path, item.message);
            }
        }
        assert!(!spec.muscles.is_empty() || path.ends_with("double_pendulum.osim"));
        assert!(spec.muscles.iter().all(|muscle| muscle.path.points.len() >= 2));
    }
}

#[test]
fn verif_muscles_of_the_mcfarland_model() {
    let Some(path) = shared("models/Hand_Wrist_Model_for_development.osim") else { return };
    let file = OsimFile::read(path).expect("loads");
    assert_eq!(file.spec.muscles.len(), 43);
}
