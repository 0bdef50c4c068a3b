//! `carpus audit`: a good model has no findings, and every injected fault is found.

use std::path::Path;

use carpus::session::audit::{Audit, AuditModel, Check, Finding, Level};
use carpus::session::progress::Silent;
use serde_json::Value;

use crate::reference::shared;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/wrist.osim");
const FAULTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/audit/faults.json");

fn audit(model: &Path) -> Audit {
    AuditModel::new(model).run(&Silent).unwrap_or_else(|e| panic!("{}: {e}", model.display())).0
}

fn serious(audit: &Audit) -> impl Iterator<Item = &Finding> {
    audit.findings.iter().filter(|finding| finding.level != Level::Note)
}

#[test]
fn verif_the_bundled_model_has_no_errors_and_no_warnings() {
    let audit = audit(Path::new(MODEL));
    assert_eq!((audit.muscles, audit.coordinates.len()), (5, 4));
    let found: Vec<&Finding> = serious(&audit).collect();
    assert!(found.is_empty(), "{found:#?}");
    for note in audit.of(Level::Note) {
        assert!(note.line > 0 && note.path.starts_with('/') && !note.hint.is_empty(), "{note:?}");
    }
}

/// The model with a fault: replacements in its text.
fn faulty(fault: &Value) -> String {
    let mut text = std::fs::read_to_string(MODEL).unwrap();
    let mut edits: Vec<&Value> = fault["edits"].as_array().unwrap().iter().collect();
    edits.sort_by_key(|edit| std::cmp::Reverse(edit["offset"].as_u64()));
    for edit in edits {
        let (from, to) = (edit["from"].as_str().unwrap(), edit["to"].as_str().unwrap());
        let start = usize::try_from(edit["offset"].as_u64().unwrap()).unwrap();
        assert_eq!(&text[start..start + from.len()], from, "inject_faults.py has to be run again");
        text.replace_range(start..start + from.len(), to);
    }
    text
}

#[test]
fn verif_every_injected_fault_is_found() {
    let faults: Value = serde_json::from_str(&std::fs::read_to_string(FAULTS).unwrap()).unwrap();
    let faults = faults.as_array().unwrap();
    assert!(faults.len() >= 20, "{}", faults.len());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("faulty.osim");
    let mut missed = Vec::new();
    for fault in faults {
        std::fs::write(&file, faulty(fault)).unwrap();
        let (name, object) = (fault["fault"].as_str().unwrap(), fault["object"].as_str().unwrap());
        // The clean model has neither errors nor warnings.
        let found = match AuditModel::new(&file).run(&Silent) {
            Ok((audit, _)) => serious(&audit).any(|f| f.path.contains(object) || f.text.contains(object)),
            Err(refused) => refused.to_string().contains(object),
        };
        if !found {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn verif_one_coordinate_can_be_asked_for() {
    let request = AuditModel { coordinates: vec!["flexion".to_owned()], ..AuditModel::new(MODEL) };
    let (audit, _) = request.run(&Silent).unwrap();
    assert_eq!(audit.coordinates, ["flexion"]);
    let unknown = AuditModel { coordinates: vec!["flexoin".to_owned()], ..AuditModel::new(MODEL) };
    assert!(unknown.run(&Silent).unwrap_err().to_string().contains("did you mean `flexion`"));
}

/// Lab models and what was looked at in each: faults that are known, and a model whose paths and fibres have none.
#[test]
#[cfg_attr(not(has_lab_models), ignore = "needs lab models (CARPUS_SHARED)")]
fn regress_known_faults_of_lab_models_are_found() {
    let known = |model: &str, path: &str, check: Check| {
        let audit = audit(&shared(&format!("models/{model}")));
        let mut own = serious(&audit).filter(|f| f.check == check && f.path.starts_with(path));
        assert!(own.any(|f| f.line > 0 && f.value.is_some() && !f.hint.is_empty()), "{model} {path} {check:?}");
    };
    known("MOBL_ARMS_41.osim", "/forceset/ECRL", Check::LongWay);
    known("MOBL_ARMS_41.osim", "/forceset/SUP", Check::PathJump);
    known("MOBL_ARMS_41.osim", "/bodyset/scapula", Check::Inertia);
    known("MOBL_ARMS_fixed_41.osim", "/forceset/EDCM", Check::FiberLength);
    known("Hand_Wrist_Model_for_development.osim", "/bodyset/clavicle", Check::Inertia);
    let good = audit(&shared("models/Hand_Wrist_Model_for_development.osim"));
    let paths = [Check::PathJump, Check::LongWay, Check::FiberLength, Check::SlackTendon, Check::Action];
    let found: Vec<&Finding> = serious(&good).filter(|f| paths.contains(&f.check)).collect();
    assert!(found.is_empty(), "{found:#?}");
}
