//! Lengths and moment arms of every muscle of the shared models against OpenSim, at random poses.
//!
//! The reference numbers come from `fixtures/scripts/paths_reference.py`, which is run when OpenSim is available (its
//! output is kept under the target folder until the model or the script changes). The result is written as JSON to
//! `target/validation/paths.json`.

use crate::reference::{opensim_python, shared};
use carpus::multibody::Model;
use carpus::osim::OsimFile;
use carpus::osim::spec::CoordinateIndex;
use carpus::paths::{Path, PathGeometry};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::path::PathBuf;
use std::process::Command;

/// Format 4.x models of the shared folder.
const MODELS: [&str; 10] = [
    "Hand_Wrist_Model_for_development",
    "MOBL_ARMS_41",
    "MOBL_ARMS_fixed_41",
    "Rajagopal2016",
    "arm26",
    "das4_v4",
    "double_pendulum",
    "gait10dof18musc",
    "gait2392_millard2012muscle",
    "wrist",
];
/// Accepted difference of a length at the 99th percentile [m].
const LENGTH_TOLERANCE: f64 = 1e-6;
/// Accepted difference of a moment arm at the 99th percentile [m].
const MOMENT_ARM_TOLERANCE: f64 = 1e-5;

/// One compared number.
struct Residual {
    muscle: String,
    /// The coordinate, for a moment arm.
    coordinate: Option<String>,
    pose: usize,
    ours: f64,
    opensim: Option<f64>,
}

impl Residual {
    /// Absolute difference; infinite where one of the two is not a number.
    fn difference(&self) -> f64 {
        match self.opensim {
            Some(opensim) if self.ours.is_finite() => (self.ours - opensim).abs(),
            _ => f64::INFINITY,
        }
    }

    fn json(&self) -> Value {
        let difference = self.difference();
        json!({
            "muscle": self.muscle, "coordinate": self.coordinate, "pose": self.pose, "ours": self.ours,
            "opensim": self.opensim, "difference": difference.is_finite().then_some(difference),
            "explanation": self.opensim.is_none().then_some(
                "OpenSim's result is not a number: a ray that samples the curve over an ellipsoid misses the surface",
            ),
        })
    }
}

fn sha256(path: &std::path::Path) -> String {
    let bytes = std::fs::read(path).expect("readable file");
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// OpenSim's numbers for a model, computed now unless they are at hand; `None` if OpenSim is not available.
fn opensim_numbers(model: &std::path::Path) -> Option<Value> {
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/scripts/paths_reference.py");
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("paths_reference");
    let stem = model.file_stem()?.to_string_lossy().into_owned();
    let key = &sha256(&script)[..16];
    let file = folder.join(format!("{stem}-{}-{key}.json", &sha256(model)[..16]));
    if !file.exists() {
        let Some(python) = opensim_python() else {
            eprintln!("SKIPPED: OpenSim is not available for {stem}");
            return None;
        };
        std::fs::create_dir_all(&folder).expect("a writable target folder");
        let partial = file.with_extension("partial");
        let status = Command::new(python).arg(script).arg(model).arg(&partial).status().expect("python starts");
        assert!(status.success(), "the reference script failed for {stem}");
        std::fs::rename(partial, &file).expect("a writable target folder");
    }
    let text = std::fs::read_to_string(file).expect("the script's output");
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// Lengths and moment arms of all muscles at the reference's poses, beside OpenSim's.
fn compare(file: &std::path::Path, reference: &Value) -> [Vec<Residual>; 2] {
    let osim = OsimFile::read(file).unwrap_or_else(|error| panic!("{error}"));
    let model = Model::compile(&osim.spec).unwrap_or_else(|error| panic!("{error}"));
    let names = reference["coordinates"].as_array().expect("coordinates");
    let coordinates: Vec<CoordinateIndex> = names
        .iter()
        .map(|name| model.coordinate(name.as_str().expect("a name")).expect("the model has the coordinate"))
        .collect();
    let numbers =
        |value: &Value| -> Vec<Option<f64>> { value.as_array().expect("an array").iter().map(Value::as_f64).collect() };
    let poses: Vec<Vec<f64>> = reference["poses"]
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
    for muscle in reference["muscles"].as_array().expect("muscles") {
        let spec = osim.spec.muscles.iter().find(|m| m.name == muscle["name"]).expect("the model has the muscle");
        let path = Path::compile(&spec.path, &osim.spec, &model).unwrap_or_else(|error| panic!("{error}"));
        let geometry = path.new_geometry();
        paths.push((muscle, path, geometry));
    }
    let (mut lengths, mut arms) = (Vec::new(), Vec::new());
    for (pose, q) in poses.iter().enumerate() {
        model.update_positions(q, &mut cache);
        for (muscle, path, geometry) in &mut paths {
            path.update(q, &cache, geometry);
            let mut fresh = path.new_geometry();
            path.update(q, &cache, &mut fresh);
            assert_eq!(fresh.length().to_bits(), geometry.length().to_bits(), "the buffer's history must not matter");
            lengths.push(Residual {
                muscle: muscle["name"].as_str().unwrap_or_default().to_owned(),
                coordinate: None,
                pose,
                ours: geometry.length(),
                opensim: muscle["length"][pose].as_f64(),
            });
        }
        for (&coordinate, name) in coordinates.iter().zip(names) {
            model.update_unit_motion(q, coordinate, &mut cache);
            for (muscle, path, geometry) in &paths {
                let Some(values) = muscle["moment_arms"].get(name.as_str().expect("a name")) else { continue };
                arms.push(Residual {
                    muscle: muscle["name"].as_str().unwrap_or_default().to_owned(),
                    coordinate: name.as_str().map(str::to_owned),
                    pose,
                    ours: path.moment_arm(q, &cache, geometry),
                    opensim: values[pose].as_f64(),
                });
            }
        }
    }
    [lengths, arms]
}

/// Summary of one quantity of one model, and whether its 99th percentile is within `tolerance`.
fn summarize(model: &str, quantity: &str, tolerance: f64, residuals: &[Residual]) -> (Value, bool) {
    let mut sorted: Vec<&Residual> = residuals.iter().collect();
    sorted.sort_by(|a, b| a.difference().total_cmp(&b.difference()));
    let at = |fraction: f64| {
        let rank = ((fraction * sorted.len() as f64).ceil() as usize).clamp(1, sorted.len());
        sorted[rank - 1].difference()
    };
    let outliers: Vec<&Residual> = sorted.iter().rev().copied().filter(|r| r.difference() > tolerance).collect();
    let Some(worst) = sorted.last() else {
        return (json!({"model": model, "quantity": quantity, "count": 0}), true);
    };
    let (median, q99) = (at(0.5), at(0.99));
    println!(
        "{model:36} {quantity:10} n {:6}  median {median:.1e}  q99 {q99:.1e}  max {:.1e}  outliers {}",
        sorted.len(),
        worst.difference(),
        outliers.len()
    );
    for outlier in outliers.iter().take(40) {
        println!(
            "    {} {} pose {}: ours {} OpenSim {:?}",
            outlier.muscle,
            outlier.coordinate.as_deref().unwrap_or(""),
            outlier.pose,
            outlier.ours,
            outlier.opensim
        );
    }
    let summary = json!({
        "model": model, "quantity": quantity, "unit": "m", "count": sorted.len(), "median": median, "q99": q99,
        "max": worst.difference().is_finite().then(|| worst.difference()), "tolerance": tolerance,
        "worst_case": worst.json(), "n_outliers": outliers.len(),
        "outliers": outliers.iter().map(|r| r.json()).collect::<Vec<_>>(),
    });
    (summary, q99 <= tolerance)
}

/// Lengths within 1e-6 m and moment arms within 1e-5 m of OpenSim's at the 99th percentile, for every muscle of every
/// shared model of format 4.x at 100 poses.
#[test]
fn val_opensim_lengths_and_moment_arms_of_shared_models() {
    let mut summaries = Vec::new();
    let mut failures = Vec::new();
    let mut program = Value::Null;
    for name in MODELS {
        let Some(file) = shared(&format!("models/{name}.osim")) else { continue };
        let Some(reference) = opensim_numbers(&file) else { continue };
        program = reference["program"].clone();
        let history = reference["muscles"]
            .as_array()
            .expect("muscles")
            .iter()
            .filter_map(|muscle| muscle["history_difference"].as_f64())
            .fold(0.0, f64::max);
        let [lengths, arms] = compare(&file, &reference);
        for (quantity, tolerance, residuals) in
            [("length", LENGTH_TOLERANCE, lengths), ("moment_arm", MOMENT_ARM_TOLERANCE, arms)]
        {
            let (mut summary, within) = summarize(name, quantity, tolerance, &residuals);
            summary["opensim_history_difference"] = json!(history);
            summaries.push(summary);
            if !within {
                failures.push(format!("{name}: {quantity}"));
            }
        }
    }
    if summaries.is_empty() {
        return;
    }
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("../validation");
    std::fs::create_dir_all(&folder).expect("a writable target folder");
    let result = json!({
        "test": "val_opensim_lengths_and_moment_arms_of_shared_models", "program": program, "poses": 100,
        "results": summaries,
    });
    let text = serde_json::to_string_pretty(&result).expect("JSON") + "\n";
    std::fs::write(folder.join("paths.json"), text).expect("a writable target folder");
    assert!(failures.is_empty(), "beyond tolerance at the 99th percentile: {failures:?}");
}
