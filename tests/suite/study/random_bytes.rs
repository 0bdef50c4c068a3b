//! Whatever the bytes, reading returns: it never panics, and an error always names a problem.

use carpus::study::Severity;
use proptest::prelude::*;

use super::folder::Folder;
use crate::mutations::mutations_of;

/// Reads a study of which one file holds these bytes.
fn survives(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    let folder = Folder::good();
    folder.write(name, bytes);
    match folder.read() {
        Ok(study) => prop_assert!(study.warnings.iter().all(|p| p.severity == Severity::Warning)),
        Err(errors) => {
            prop_assert!(!errors.errors.is_empty());
            prop_assert!(!errors.to_string().is_empty());
        }
    }
    Ok(())
}

const ULTRASOUND: &str = "participant,muscle,muscle_belly_length_m\nP01,FCR,0.16\nP01,ECRL,0.12\n";
const FILES: [&str; 5] = ["study.toml", "participants.csv", "trials.csv", "ultrasound.csv", "data/iso.csv"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn verif_random_bytes_never_panic(file in 0..FILES.len(), bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        survives(FILES[file], &bytes)?;
    }
}

#[test]
fn verif_mutations_of_settings_and_tables_never_panic() {
    for name in FILES {
        let mut text = std::fs::read(Folder::good().path(name)).unwrap_or_else(|_| ULTRASOUND.into());
        // Of a trial of fifty rows a few, so that changes meet its header.
        if name.starts_with("data") {
            text = text.split_inclusive(|byte| *byte == b'\n').take(11).flatten().copied().collect();
        }
        mutations_of(&text, name, 64, |bytes| survives(name, &bytes).expect("an error that names a problem"));
    }
}
