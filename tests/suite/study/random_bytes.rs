//! Whatever the bytes, reading returns: it never panics, and an error always names a problem.

use carpus::study::Severity;
use proptest::prelude::*;

use super::folder::{Folder, PARTICIPANTS, TOML, TRIALS};

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

/// A good text with some bytes overwritten, removed or put in.
fn mutated(text: &str) -> impl Strategy<Value = Vec<u8>> + use<> {
    let text = text.as_bytes().to_vec();
    let edit = (
        any::<prop::sample::Index>(),
        0..3u8,
        prop::sample::select(b"\0\"',;\n\r[]{}=.-+eE019NaN\xff\xc3 #xP".to_vec()),
    );
    prop::collection::vec(edit, 1..12).prop_map(move |edits| {
        let mut bytes = text.clone();
        for (at, kind, byte) in edits {
            let i = at.index(bytes.len());
            match kind {
                0 => bytes[i] = byte,
                1 => bytes.insert(i, byte),
                _ if bytes.len() > 1 => drop(bytes.remove(i)),
                _ => {}
            }
        }
        bytes
    })
}

const FILES: [&str; 5] = ["study.toml", "participants.csv", "trials.csv", "ultrasound.csv", "data/iso.csv"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn verif_random_bytes_never_panic(file in 0..FILES.len(), bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        survives(FILES[file], &bytes)?;
    }

    #[test]
    fn verif_mutated_settings_never_panic(bytes in mutated(TOML)) {
        survives("study.toml", &bytes)?;
    }

    #[test]
    fn verif_mutated_tables_never_panic(participants in mutated(PARTICIPANTS), trials in mutated(TRIALS)) {
        survives("participants.csv", &participants)?;
        survives("trials.csv", &trials)?;
    }

    #[test]
    fn verif_mutated_trials_never_panic(
        bytes in mutated("time_s,angle_deg,moment_n_m,emg_ECRL,emg_FCR\n0,1,2,0,1\n0.1,1,2,0,1\n0.2,1,2,0,1\n0.3,1,2,0,1\n\
                          0.4,1,2,0,1\n0.5,1,2,0,1\n0.6,1,2,0,1\n0.7,1,2,0,1\n0.8,1,2,0,1\n0.9,1,2,0,1\n1,1,2,0,1\n")
    ) {
        survives("data/iso.csv", &bytes)?;
    }
}
