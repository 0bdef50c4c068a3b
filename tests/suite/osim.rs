//! Reading, editing and writing `.osim` files.

mod against_opensim;
mod editing;
mod implausible;
mod reading;
pub mod small_models;
mod upgrading;

use carpus::osim::{Document, OsimFile, Severity};

use crate::reference::{lab_models, shared, stem};
use crate::validation;

/// Reading and writing a file gives the same bytes.
#[test]
#[cfg_attr(not(has_models), ignore = "needs models (CARPUS_MODELS or CARPUS_SHARED)")]
fn verif_lab_models_are_written_as_they_were_read() {
    let models = lab_models();
    let mut changed = Vec::new();
    for path in &models {
        let original = std::fs::read(path).expect("readable");
        let document = Document::read(path).unwrap_or_else(|error| panic!("{error}"));
        let folder = tempfile::tempdir().expect("temporary folder");
        let copy = folder.path().join("copy.osim");
        document.write(&copy).unwrap_or_else(|error| panic!("{error}"));
        if std::fs::read(copy).expect("written") != original {
            changed.push(stem(path));
        }
    }
    let row =
        validation::counted("reading", "all models", "files read and written: same bytes", models.len(), &changed);
    validation::write("round_trip", std::slice::from_ref(&row));
    validation::assert_passed(&[row]);
}

#[test]
#[cfg_attr(not(has_models), ignore = "needs models (CARPUS_MODELS or CARPUS_SHARED)")]
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
        assert!(spec.muscles.iter().all(|muscle| muscle.path.points.len() >= 2));
    }
}

#[test]
#[cfg_attr(not(has_lab_models), ignore = "needs lab models (CARPUS_SHARED)")]
fn verif_muscles_of_the_mcfarland_model() {
    let path = shared("models/Hand_Wrist_Model_for_development.osim");
    let file = OsimFile::read(path).expect("loads");
    assert_eq!(file.spec.muscles.len(), 43);
}
