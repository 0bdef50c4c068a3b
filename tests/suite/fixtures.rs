//! The shipped reference outputs are the ones their manifests describe, and the demo study is a complete, readable
//! study.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use carpus::study::{Study, TrialUse};
use serde_json::Value;
use sha2::{Digest, Sha256};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn sha256(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn manifest(relative: &str) -> (PathBuf, Value) {
    let path = root().join(relative);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    (path, value)
}

/// Stems of the manifests in fixtures/prescribed_motion.
const PRESCRIBED_MOTIONS: [&str; 5] =
    ["wrist", "wrist_undamped", "wrist_rigid_tendon", "wrist_no_activation_dynamics", "wrist_weight_and_inertia"];

/// Every file under "outputs" has the digest the manifest gives; returns how many there are.
fn check_outputs(relative: &str) -> usize {
    let (path, manifest) = manifest(relative);
    let folder = path.parent().expect("a manifest lies in a folder");
    let outputs = manifest["outputs"].as_object().expect("outputs: file → sha256");
    for (file, digest) in outputs {
        assert_eq!(digest.as_str(), Some(sha256(&folder.join(file)).as_str()), "{relative}: {file} was changed");
    }
    outputs.len()
}

#[test]
fn regress_reference_outputs_match_their_manifests() {
    for case in PRESCRIBED_MOTIONS {
        assert_eq!(check_outputs(&format!("fixtures/prescribed_motion/{case}.manifest.json")), 1);
    }
    for subject in ["signals", "emg", "dynamometer", "statistics", "sensitivity", "cohort"] {
        assert_eq!(check_outputs(&format!("fixtures/{subject}/manifest.json")), 1);
    }
    assert_eq!(check_outputs("fixtures/muscle_laws/manifest.json"), 2 * 6);
    assert_eq!(check_outputs("fixtures/path_tables/manifest.json"), 5);
    assert_eq!(check_outputs("fixtures/other_paths/manifest.json"), 2 * 5);
    assert_eq!(check_outputs("fixtures/demo_study/manifest.json"), 28 + 4);
    assert_eq!(check_outputs("fixtures/two_axes/manifest.json"), 17 + 4);
    assert_eq!(check_outputs("fixtures/index_finger/manifest.json"), 35 + 4);
    assert_eq!(check_outputs("fixtures/hidden_effects/manifest.json"), 7 * (19 + 4));
    assert_eq!(check_outputs("fixtures/laboratory/manifest.json"), 3 * (14 + 4));
}

/// Numbers that stand alone in a text, not part of a longer number nor behind a decimal point; without underscores.
fn whole_numbers(text: &str) -> impl Iterator<Item = u64> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != '.')
        .filter_map(|word| word.trim_end_matches('.').replace('_', "").parse().ok())
}

/// Every file below a folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let paths = entries.map(|entry| entry.expect("a readable folder").path());
    paths.flat_map(|path| if path.is_dir() { files_below(&path) } else { vec![path] }).collect()
}

#[test]
fn regress_no_source_names_a_final_participant_of_the_laboratory() {
    let reserved = (930_000 + 1)..932_000;
    let generator = root().join("fixtures/scripts/laboratory.py");
    let generated = std::fs::read_to_string(&generator).expect("the laboratory's generator");
    let seeds = whole_numbers(&generated).filter(|number| reserved.contains(number)).count();
    assert!(seeds >= 5, "the generator's final participants and studies are in the reserved range, found {seeds}");
    let folders = ["src", "crates", "tests", "benches", "fixtures/scripts"].map(|folder| root().join(folder));
    let sources = folders.iter().flat_map(|folder| files_below(folder)).filter(|path| *path != generator);
    for path in sources {
        let text = String::from_utf8_lossy(&std::fs::read(&path).expect("a readable file")).into_owned();
        let named: Vec<u64> = whole_numbers(&text).filter(|number| reserved.contains(number)).collect();
        assert!(named.is_empty(), "{named:?} in {}: nothing may be tuned on the final laboratory", path.display());
    }
}

#[test]
fn regress_references_belong_to_the_shipped_model() {
    let model = sha256(&root().join("models/wrist.osim"));
    for case in PRESCRIBED_MOTIONS {
        let (_, motion) = manifest(&format!("fixtures/prescribed_motion/{case}.manifest.json"));
        assert_eq!(
            motion["model"]["sha256"].as_str(),
            Some(model.as_str()),
            "run the script that {case}.manifest.json names again"
        );
    }
    let (_, study) = manifest("fixtures/demo_study/manifest.json");
    assert_eq!(
        study["inputs"]["wrist.osim"].as_str(),
        Some(model.as_str()),
        "run fixtures/scripts/make_study.py again"
    );
}

#[test]
fn regress_demo_study_reads_and_holds_out_every_condition() {
    let study = Study::read(root().join("fixtures/demo_study/study.toml")).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(study.warnings, [], "the demo study is clean");
    let conditions = |usage: TrialUse| -> BTreeSet<String> {
        let of_use = study.trials.iter().filter(|trial| trial.usage == usage);
        of_use.map(|t| format!("{:?} {:?} {:?}", t.contraction, t.effort_percent, t.direction)).collect()
    };
    assert_eq!(conditions(TrialUse::Train), conditions(TrialUse::Test));
    assert_eq!(conditions(TrialUse::Train).len(), 9, "isometric and isotonic, two efforts, two directions; passive");
    let trials = study.load_trials("P01").unwrap_or_else(|errors| panic!("{errors}"));
    let peak = |name: &str| trials.iter().find(|t| t.info.name == name).map(|t| t.max_abs_moment());
    // A plausible person: flexion and extension strength within the spread of Delp et al. 1996.
    assert!(matches!(peak("mvc_flexion"), Some(m) if (5.0..19.0).contains(&m)), "{:?}", peak("mvc_flexion"));
    assert!(matches!(peak("mvc_extension"), Some(m) if (3.0..15.0).contains(&m)), "{:?}", peak("mvc_extension"));
}

#[test]
fn verif_the_book_holds_the_table_of_the_laboratory() {
    let read = |relative: &str| std::fs::read_to_string(root().join(relative)).unwrap();
    let (page, table) = (read("docs/src/evidence/diagnosis.md"), read("fixtures/laboratory/table.md"));
    let begin = page.find("<!-- laboratory:begin -->").expect("where the table begins");
    let end = page.find("<!-- laboratory:end -->").expect("where the table ends");
    let rows: Vec<&str> = table.lines().filter(|l| l.starts_with('|')).collect();
    assert!(rows.len() > 4);
    for row in rows {
        assert!(page[begin..end].contains(row), "not in the page: {row}");
    }
}
