//! Forces, actuators and muscles of many classes: what OpenSim's tools write for a model of them (`fixtures/components`).

use std::path::{Path, PathBuf};

use carpus::osim::{Document, ElementId};
use carpus::storage::Storage;
use carpus::tools::run_tool;

use crate::validation::{self, Classes, Differences, Judge};

/// Largest difference, relative to what is above 1.
const TOLERANCE: f64 = 1e-9;
/// The same where there are constraints: OpenSim's assembly, which made the states, leaves violations of up to 1e-9, which
/// are removed here before anything is computed.
const CONSTRAINED: f64 = 1e-7;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/components")
}

/// Muscles of which OpenSim leaves some quantities undefined; of Delp's it reports none but the actuation.
const PARTLY_UNDEFINED: [&str; 4] = ["rigid", "schutte", "schutte_passive", "delp"];

/// What the rows of the table are about.
const MODEL: &str = "forces, actuators and muscles of many classes";
/// What differences are divided by.
const UNIT: &str = "value, at least 1";

fn compare(setup: &str, results: &str, tolerance: f64) {
    let outcome = run_tool(&folder().join(setup), None, false).unwrap_or_else(|e| panic!("{e}"));
    let mut rows = Vec::new();
    let names = classes_by_name();
    let mut classes = Classes::new("all that analyses report", UNIT, tolerance, Judge::Max);
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder().join(results)).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let ours = outcome.files.iter().find(|f| f.path.file_name().is_some_and(|n| n.to_string_lossy() == name));
        let Some(ours) = ours else { panic!("OpenSim writes {name}, carpus does not") };
        let scratch = tempfile::tempdir().unwrap();
        let own = scratch.path().join(&name);
        std::fs::write(&own, &ours.bytes).unwrap();
        let (theirs, ours) = (Storage::read(&path).unwrap(), Storage::read(&own).unwrap());
        assert_eq!(theirs.labels, ours.labels, "{name}");
        assert_eq!(theirs.time, ours.time, "{name}");
        let quantity = format!("{results}: {}", name.trim_start_matches("run_").trim_end_matches(".sto"));
        let mut differences = Differences::listing_above(quantity, UNIT, tolerance);
        let of_label: Vec<Option<&str>> = theirs.labels.iter().map(|label| class_of(label, &names)).collect();
        for (row, (a, b)) in theirs.rows.iter().zip(&ours.rows).enumerate() {
            for (((a, b), label), class) in a.iter().zip(b).zip(&theirs.labels).zip(&of_label) {
                if a.is_nan() && (b.is_nan() || PARTLY_UNDEFINED.contains(&label.as_str())) {
                    continue;
                }
                let difference = (a - b).abs() / a.abs().max(1.0);
                differences.push(difference, || format!("{label}, row {row}: {b} instead of {a}"));
                if let Some(class) = class {
                    classes.push(class, difference, || format!("{name}, {label}, row {row}: {b} instead of {a}"));
                }
            }
        }
        rows.push(differences.row("components", MODEL, tolerance, Judge::Max));
    }
    rows.extend(classes.rows(&format!("fixtures/components/{setup}")));
    validation::write(&format!("components_{results}"), &rows);
    validation::assert_passed(&rows);
}

/// Classes of the forces, joints and constraints of the files that the setups use, by name.
fn classes_by_name() -> Vec<(String, String)> {
    let files = ["forces.osim", "extra_actuators.xml", "../dynamics/constraints.osim"];
    let of_file = |file: &str| {
        let document = Document::read(folder().join(file)).unwrap();
        let sets = ["ForceSet", "JointSet", "ConstraintSet"];
        let is_in_set = |e: &ElementId| {
            let set = document.parent(*e).filter(|objects| document.tag(*objects) == "objects");
            set.and_then(|objects| document.parent(objects)).is_some_and(|set| sets.contains(&document.tag(set)))
        };
        let named = |e: ElementId| Some((document.attribute(e, "name")?, document.tag(e).to_owned()));
        document.elements().filter(is_in_set).filter_map(named).collect::<Vec<_>>()
    };
    files.iter().flat_map(|file| of_file(file)).collect()
}

/// The class of what a column is about: its label is the name, begins with it (`slot_a_Fz`), or is a path through it.
fn class_of<'c>(label: &str, names: &'c [(String, String)]) -> Option<&'c str> {
    let is_about = |name: &str| {
        let rest = label.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['_', '.'])) || label.contains(&format!("/{name}/"))
    };
    let found = names.iter().filter(|(name, _)| is_about(name)).max_by_key(|(name, _)| name.len());
    found.map(|(_, class)| class.as_str())
}

#[test]
fn val_opensim_forces_actuators_and_muscles_of_many_classes() {
    compare("analyze.xml", "analyze", TOLERANCE);
}

#[test]
fn val_opensim_actuators_with_defaults_and_controllers_of_many_kinds() {
    compare("controllers.xml", "controllers", TOLERANCE);
}

#[test]
fn val_opensim_equilibrium_of_muscles_of_many_classes() {
    compare("equilibrate.xml", "equilibrate", TOLERANCE);
}

#[test]
fn val_opensim_loads_of_joints_and_forces_of_constraints() {
    compare("constraints.xml", "constraints", CONSTRAINED);
}

/// Simulates forward; every state is that of OpenSim's integrator at an accuracy of 1e-9, within `tolerance`.
fn compare_forward(name: &str, tolerance: f64) {
    let outcome = run_tool(&folder().join(format!("{name}.xml")), None, false).unwrap_or_else(|e| panic!("{e}"));
    let states = outcome.files.iter().find(|f| f.path.ends_with("run_states.sto")).expect("states");
    let ours = Storage::parse(&states.bytes, &states.path).unwrap();
    let theirs = Storage::read(folder().join(format!("{name}.sto"))).unwrap();
    assert_eq!((&ours.labels, &ours.time), (&theirs.labels, &theirs.time));
    let mut differences = Differences::listing_above(format!("{name}: states"), UNIT, tolerance);
    for (row, (a, b)) in ours.rows.iter().zip(&theirs.rows).enumerate() {
        for ((a, b), label) in a.iter().zip(b).zip(&ours.labels) {
            differences.push((a - b).abs() / b.abs().max(1.0), || format!("{label}, row {row}: {a} instead of {b}"));
        }
    }
    let rows = [differences.row("components", MODEL, tolerance, Judge::Max)];
    validation::write(&format!("components_{name}"), &rows);
    validation::assert_passed(&rows);
}

#[test]
fn val_opensim_forward_with_forces_actuators_and_muscles_of_many_classes() {
    compare_forward("forward", 1e-4);
}

#[test]
fn val_opensim_forward_with_constraints_between_bodies() {
    compare_forward("forward_constrained", 1e-4);
}
