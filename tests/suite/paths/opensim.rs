//! Lengths and moment arms of every muscle of the lab models against OpenSim, at random poses and at the ends of
//! ranges.
//!
//! The reference numbers come from `fixtures/scripts/paths_reference.py`, which is run when OpenSim is available (its
//! output is kept until the model or the script changes).

use crate::reference::{digest, lab_models, opensim_python, run_script, stem};
use crate::validation::{self, Classes, Differences, Judge};
use carpus::multibody::Model;
use carpus::osim::spec::{CoordinateIndex, PathSpec};
use carpus::osim::{ElementId, OsimFile};
use carpus::paths::{Path, PathGeometry};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Pose sets: name, argument of the reference script.
const POSE_SETS: [(&str, Option<&str>); 2] =
    [("random poses", None), ("poses at ends of ranges", Some("--range-ends"))];
/// Accepted difference of a length at the 99th percentile [m].
const LENGTH_TOLERANCE: f64 = 1e-6;
/// Accepted difference of a moment arm at the 99th percentile [m].
const MOMENT_ARM_TOLERANCE: f64 = 1e-5;

/// No muscle of these models is as long [m].
const ABSURD_LENGTH: f64 = 3.0;
/// Why OpenSim may have no number.
const NOT_A_NUMBER: &str = "OpenSim's result is not a number: it measures the curve over an ellipsoid with rays from a \
    point outside of it, which miss the far side; Carpus takes rays from the centre of the section there";

/// Adds one comparison; a missing number of OpenSim's counts as infinitely far.
fn push(to: &mut Differences, ours: f64, opensim: Option<f64>, case: impl Fn() -> String) {
    let theirs = opensim.map_or("not a number".to_owned(), |x| x.to_string());
    let describe = || format!("{}: {ours} instead of {theirs}", case());
    to.push_explained(ours - opensim.unwrap_or(f64::NAN), describe, opensim.is_none().then_some(NOT_A_NUMBER));
}

/// OpenSim's numbers for a model, computed now unless they are at hand.
fn opensim_numbers(model: &std::path::Path, poses: Option<&str>) -> Value {
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/scripts/paths_reference.py");
    let key = format!("{}{}-{}-{}", stem(model), poses.unwrap_or(""), digest(model), digest(&script));
    let file = validation::reference_folder("paths").join(key + ".json");
    if !file.exists() {
        let python = opensim_python();
        let partial = file.with_extension("partial");
        let mut arguments = vec![model.as_os_str(), partial.as_os_str()];
        arguments.extend(poses.map(std::ffi::OsStr::new));
        run_script(&python, "scripts/paths_reference.py", &arguments);
        std::fs::rename(partial, &file).expect("a writable folder");
    }
    let text = std::fs::read_to_string(file).expect("the script's output");
    serde_json::from_str(&text).expect("JSON")
}

/// Lengths and moment arms of all muscles at the reference's poses, beside OpenSim's.
///
/// - `classes`: lengths by what a path meets
fn compare(file: &std::path::Path, reference: &Value, poses: &str, classes: &mut Classes) -> [Differences; 2] {
    let osim = OsimFile::read(file).unwrap_or_else(|error| panic!("{error}"));
    let model = Model::compile(&osim.spec).unwrap_or_else(|error| panic!("{error}"));
    let names = reference["coordinates"].as_array().expect("coordinates");
    let coordinates: Vec<CoordinateIndex> = names
        .iter()
        .map(|name| model.coordinate(name.as_str().expect("a name")).expect("the model has the coordinate"))
        .collect();
    let numbers =
        |value: &Value| -> Vec<Option<f64>> { value.as_array().expect("an array").iter().map(Value::as_f64).collect() };
    let pose_values: Vec<Vec<f64>> = reference["poses"]
        .as_array()
        .expect("poses")
        .iter()
        .map(|pose| {
            let mut q = model.default_coordinates();
            for (&coordinate, value) in coordinates.iter().zip(numbers(pose)) {
                q[coordinate.0] = value.expect("a number");
            }
            q
        })
        .collect();
    let mut cache = model.new_cache();
    let mut paths: Vec<(&Value, Path, PathGeometry)> = Vec::new();
    let mut met = Vec::new();
    for muscle in reference["muscles"].as_array().expect("muscles") {
        let spec = osim.spec.muscles.iter().find(|m| m.name == muscle["name"]).expect("the model has the muscle");
        let path = Path::compile(&spec.path, &osim.spec, &model).unwrap_or_else(|error| panic!("{error}"));
        let geometry = path.new_geometry();
        paths.push((muscle, path, geometry));
        met.push(classes_of(&osim, &spec.path));
    }
    let mut lengths = Differences::listing_above(format!("length, {poses}"), "m", LENGTH_TOLERANCE);
    let mut arms = Differences::listing_above(format!("moment arm, {poses}"), "m", MOMENT_ARM_TOLERANCE);
    for (pose, q) in pose_values.iter().enumerate() {
        model.update_positions(q, &mut cache);
        for ((muscle, path, geometry), met) in paths.iter_mut().zip(&met) {
            path.update(q, &cache, geometry);
            let mut fresh = path.new_geometry();
            path.update(q, &cache, &mut fresh);
            assert_eq!(fresh.length().to_bits(), geometry.length().to_bits(), "the buffer's history must not matter");
            let opensim = muscle["length"][pose].as_f64();
            push(&mut lengths, geometry.length(), opensim, || format!("{} at pose {pose}", muscle["name"]));
            for class in met {
                let case = || format!("{}: {} at pose {pose}", stem(file), muscle["name"]);
                classes.push(class, geometry.length() - opensim.unwrap_or(f64::NAN), case);
            }
        }
        for (&coordinate, name) in coordinates.iter().zip(names) {
            model.update_unit_motion(q, coordinate, &mut cache);
            for (muscle, path, geometry) in &paths {
                let Some(values) = muscle["moment_arms"].get(name.as_str().expect("a name")) else { continue };
                let ours = path.moment_arm(q, &cache, geometry);
                let case = || format!("{} about {name} at pose {pose}", muscle["name"]);
                push(&mut arms, ours, values[pose].as_f64(), case);
            }
        }
    }
    [lengths, arms]
}

/// Classes of the points and surfaces of a path; `PathPoint` only where there is nothing else.
fn classes_of(osim: &OsimFile, path: &PathSpec) -> BTreeSet<String> {
    let points = path.points.iter().map(|point| &point.at);
    let wraps = path.wraps.iter().map(|wrap| &osim.spec.wrap_objects[wrap.wrap_object.0].at);
    let elements = points.chain(wraps).filter_map(|at| at.element);
    let mut found: BTreeSet<String> = elements.map(|e| osim.document.tag(ElementId(e)).to_owned()).collect();
    if found.len() > 1 {
        found.remove("PathPoint");
    }
    found
}

/// Lengths within 1e-6 m and moment arms within 1e-5 m of OpenSim's at the 99th percentile, for every muscle of every
/// model at 100 poses of each set.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_lengths_and_moment_arms_of_lab_models() {
    let mut rows = Vec::new();
    let mut classes = Classes::new("length of paths", "m", LENGTH_TOLERANCE, Judge::Q99);
    for file in lab_models() {
        for (set, argument) in POSE_SETS {
            let reference = opensim_numbers(&file, argument);
            let muscles = reference["muscles"].as_array().expect("muscles");
            if muscles.is_empty() {
                continue;
            }
            let history = muscles.iter().filter_map(|muscle| muscle["history_difference"].as_f64()).fold(0.0, f64::max);
            let [mut lengths, arms] = compare(&file, &reference, set, &mut classes);
            let absurd = muscles.iter().flat_map(|muscle| muscle["length"].as_array().into_iter().flatten());
            let absurd = absurd.filter(|length| length.as_f64().is_some_and(|length| length > ABSURD_LENGTH)).count();
            if absurd > 0 {
                lengths.remark(format!(
                    "{set}: {absurd} lengths above {ABSURD_LENGTH} m, which are OpenSim's (a path that winds many \
                     times around a wrap surface), and are reproduced"
                ));
            }
            if history > 0.1 * LENGTH_TOLERANCE {
                lengths.remark(format!(
                    "OpenSim's own lengths differ by up to {history:.1e} m with the order in which poses are asked for"
                ));
            }
            rows.push(lengths.row("paths", &stem(&file), LENGTH_TOLERANCE, Judge::Q99));
            rows.push(arms.row("paths", &stem(&file), MOMENT_ARM_TOLERANCE, Judge::Q99));
        }
    }
    rows.extend(classes.rows("lab models"));
    validation::write("paths", &rows);
    validation::assert_passed(&rows);
}
