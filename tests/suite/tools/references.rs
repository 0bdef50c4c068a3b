//! Setups of a folder of `fixtures` beside what OpenSim's tools wrote for them.

use std::path::{Path, PathBuf};

use carpus::osim::{Document, ElementId};
use carpus::storage::Storage;
use carpus::tools::{Outcome, run_tool};

use crate::validation::{self, Classes, Differences, Judge};

/// What differences are divided by.
const UNIT: &str = "value, at least 1";

/// A folder of setups and OpenSim's results.
pub struct References {
    /// Folder below `fixtures`.
    pub folder: &'static str,
    /// What the rows of the table are about.
    pub about: &'static str,
    /// Files whose forces, joints and constraints are told apart by class.
    pub files: &'static [&'static str],
    /// Muscles of which OpenSim leaves some quantities undefined.
    pub partly_undefined: &'static [&'static str],
}

impl References {
    /// A file of the folder.
    pub fn path(&self, file: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(self.folder).join(file)
    }

    fn run(&self, setup: &str) -> Outcome {
        run_tool(&self.path(setup), None, false).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Runs a setup and compares every file in `results`; differences are relative to what is above 1.
    pub fn compare(&self, setup: &str, results: &str, tolerance: f64) {
        let outcome = self.run(setup);
        let mut rows = Vec::new();
        let names = self.classes_by_name();
        let mut classes = Classes::new("all that analyses report", UNIT, tolerance, Judge::Max);
        let mut paths: Vec<PathBuf> =
            std::fs::read_dir(self.path(results)).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let (theirs, ours) = (Storage::read(&path).unwrap(), written(&outcome, &name));
            assert_eq!(theirs.labels, ours.labels, "{name}");
            assert_eq!(theirs.time, ours.time, "{name}");
            let quantity = format!("{results}: {}", name.trim_start_matches("run_").trim_end_matches(".sto"));
            let mut differences = Differences::listing_above(quantity, UNIT, tolerance);
            let of_label: Vec<Option<&str>> = theirs.labels.iter().map(|label| class_of(label, &names)).collect();
            for (row, (a, b)) in theirs.rows.iter().zip(&ours.rows).enumerate() {
                for (((a, b), label), class) in a.iter().zip(b).zip(&theirs.labels).zip(&of_label) {
                    if a.is_nan() && (b.is_nan() || self.partly_undefined.contains(&label.as_str())) {
                        continue;
                    }
                    let difference = (a - b).abs() / a.abs().max(1.0);
                    differences.push(difference, || format!("{label}, row {row}: {b} instead of {a}"));
                    if let Some(class) = class {
                        classes.push(class, difference, || format!("{name}, {label}, row {row}: {b} instead of {a}"));
                    }
                }
            }
            rows.push(differences.row("components", self.about, tolerance, Judge::Max));
        }
        rows.extend(classes.rows(&format!("fixtures/{}/{setup}", self.folder)));
        validation::write(&format!("{}_{results}", self.folder), &rows);
        validation::assert_passed(&rows);
    }

    /// Simulates forward; every state is that of OpenSim's integrator at an accuracy of 1e-9, within `tolerance`, and
    /// so is what analyses wrote that have a reference.
    ///
    /// - `analyses`: the ends of their files' names
    pub fn compare_forward(&self, name: &str, analyses: &[&str], tolerance: f64) {
        let outcome = self.run(&format!("{name}.xml"));
        let files = std::iter::once(("run_states.sto".to_owned(), format!("{name}.sto"), "states"));
        let of_analyses = analyses.iter().map(|end| {
            let kind = end.rsplit('_').next().unwrap_or(end);
            (format!("run_{end}.sto"), format!("{name}_{kind}.sto"), kind)
        });
        let mut rows = Vec::new();
        for (ours, theirs, quantity) in files.chain(of_analyses) {
            let (ours, theirs) = (written(&outcome, &ours), Storage::read(self.path(&theirs)).unwrap());
            assert_eq!((&ours.labels, &ours.time), (&theirs.labels, &theirs.time));
            let mut differences = Differences::listing_above(format!("{name}: {quantity}"), UNIT, tolerance);
            for (row, (a, b)) in ours.rows.iter().zip(&theirs.rows).enumerate() {
                for ((a, b), label) in a.iter().zip(b).zip(&ours.labels) {
                    let difference = (a - b).abs() / b.abs().max(1.0);
                    differences.push(difference, || format!("{label}, row {row}: {a} instead of {b}"));
                }
            }
            rows.push(differences.row("components", self.about, tolerance, Judge::Max));
        }
        validation::write(&format!("{}_{name}", self.folder), &rows);
        validation::assert_passed(&rows);
    }

    /// Classes of the forces, joints and constraints of the files, by name.
    fn classes_by_name(&self) -> Vec<(String, String)> {
        let of_file = |file: &&str| {
            let document = Document::read(self.path(file)).unwrap();
            let sets = ["ForceSet", "JointSet", "ConstraintSet"];
            let is_in_set = |e: &ElementId| {
                let set = document.parent(*e).filter(|objects| document.tag(*objects) == "objects");
                set.and_then(|objects| document.parent(objects)).is_some_and(|set| sets.contains(&document.tag(set)))
            };
            let named = |e: ElementId| Some((document.attribute(e, "name")?, document.tag(e).to_owned()));
            document.elements().filter(is_in_set).filter_map(named).collect::<Vec<_>>()
        };
        self.files.iter().flat_map(of_file).collect()
    }
}

/// A file that a tool wrote, by its name.
pub fn written(outcome: &Outcome, name: &str) -> Storage {
    let file = outcome.files.iter().find(|f| f.path.file_name().is_some_and(|n| n.to_string_lossy() == name));
    let Some(file) = file else { panic!("OpenSim writes {name}, carpus does not") };
    Storage::parse(&file.bytes, &file.path).unwrap()
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
