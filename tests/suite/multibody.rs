//! Tests of `multibody`: poses, velocities, couplers and accelerations against OpenSim and against finite differences.

mod compile;

use super::reference;
use super::validation::{self, Classes, Differences, Judge, Row};
use carpus::multibody::{BaseIndex, Model};
use carpus::osim::spec::{BodyIndex, CoordinateIndex, JointSpec, ModelSpec};
use carpus::osim::{ElementId, OsimFile};
use carpus::spatial::{SpatialVelocity, Transform};
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;

/// Largest difference in any element of a rotation matrix or position [m]: rounding along a chain of joints.
pub const POSE_TOLERANCE: f64 = 1e-10;
/// Largest difference in any component of a velocity for unit speed [rad/s or m/s]. OpenSim's coupling comes from a
/// least-squares projection here, which costs some digits.
pub const VELOCITY_TOLERANCE: f64 = 1e-9;

/// Our own models that ship with reference numbers.
pub const FIXTURES: [(&str, &str, &str); 2] = [
    (
        "joints",
        include_str!("../../fixtures/multibody/joints.osim"),
        include_str!("../../fixtures/multibody/joints.json"),
    ),
    (
        "forces",
        include_str!("../../fixtures/multibody/forces.osim"),
        include_str!("../../fixtures/multibody/forces.json"),
    ),
];

/// A compiled model with its specification and the reference's poses.
pub struct Case {
    pub name: String,
    pub spec: ModelSpec,
    pub model: Model,
    pub poses: Vec<Value>,
    /// Class of the joint that carries each body.
    joints: HashMap<BaseIndex, String>,
}

pub fn fixture_cases() -> Vec<Case> {
    FIXTURES
        .iter()
        .map(|(name, osim, json)| {
            let file = OsimFile::parse(osim.as_bytes(), name).unwrap_or_else(|error| panic!("{name}: {error}"));
            case(name, file, serde_json::from_str(json).expect("JSON"))
        })
        .collect()
}

fn case(name: &str, file: OsimFile, reference: Value) -> Case {
    let model = Model::compile(&file.spec).unwrap_or_else(|error| panic!("{name}: {error}"));
    let class = |joint: &JointSpec| {
        let tag = joint.at.element.map_or("FreeJoint", |element| file.document.tag(ElementId(element)));
        (model.frame(joint.child_frame).base, tag.to_owned())
    };
    let joints = file.spec.joints.iter().map(class).collect();
    let poses = reference["poses"].as_array().expect("poses").clone();
    Case { name: name.into(), spec: file.spec, model, poses, joints }
}

/// All lab models, with reference numbers computed by OpenSim; empty, after saying so, without them.
pub fn shared_cases(n_poses: usize) -> Vec<Case> {
    let models = reference::lab_models();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scripts/multibody.py");
    let mut cases = Vec::new();
    for path in models {
        let name = path.file_name().expect("file name").to_string_lossy().into_owned();
        let key = format!("{name}-{n_poses}-{}-{}.json", reference::digest(&path), reference::digest(&script));
        let out = validation::reference_folder("multibody").join(key);
        if !out.exists() {
            let python = reference::opensim_python();
            // Two tests may be here at once.
            let scratch = tempfile::tempdir_in(out.parent().expect("folder")).expect("temporary folder");
            let partial = scratch.path().join("reference.json");
            let poses = n_poses.to_string();
            let arguments = [path.as_os_str(), partial.as_os_str(), "--poses".as_ref(), poses.as_ref()];
            reference::run_script(&python, "scripts/multibody.py", &arguments);
            std::fs::rename(partial, &out).expect("a writable folder");
        }
        let file = OsimFile::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let text = std::fs::read_to_string(&out).expect("reference written");
        cases.push(case(&name, file, serde_json::from_str(&text).expect("JSON")));
    }
    cases
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("array").iter().map(|v| v.as_f64().expect("number")).collect()
}

impl Case {
    /// Values that the reference gives per coordinate name, in the order of the model's coordinates.
    pub fn by_coordinate(&self, values: &Value) -> Vec<f64> {
        self.model.coordinates.iter().map(|c| values[&c.name].as_f64().unwrap_or(0.0)).collect()
    }

    pub fn coordinate(&self, name: &str) -> CoordinateIndex {
        self.model.coordinate(name).unwrap_or_else(|| panic!("{}: no coordinate {name}", self.name))
    }
}

fn pose_difference(pose: &Transform, expected: &[f64]) -> f64 {
    let rotation = (0..9).map(|k| (pose.R[(k / 3, k % 3)] - expected[k]).abs());
    let position = (0..3).map(|k| (pose.p[k] - expected[9 + k]).abs());
    rotation.chain(position).fold(0.0, f64::max)
}

fn velocity_difference(velocity: &SpatialVelocity, expected: &[f64]) -> f64 {
    let angular = (0..3).map(|k| (velocity.w[k] - expected[k]).abs());
    let linear = (0..3).map(|k| (velocity.v[k] - expected[3 + k]).abs());
    angular.chain(linear).fold(0.0, f64::max)
}

/// Differences from OpenSim over all poses: body poses, velocities, unit motions, coupling.
///
/// - `classes`: poses and velocities of bodies by the joints that carry them
fn compare_kinematics(case: &Case, classes: &mut Classes) -> [Differences; 4] {
    let model = &case.model;
    let mut cache = model.new_cache();
    let mut differences = [
        Differences::new("rotation matrix or position of a body", "1 or m"),
        Differences::new("velocity of a body", "rad/s or m/s"),
        Differences::new("velocity of a body for unit speed of a coordinate", "1 or m"),
        Differences::new("speed of a coordinate for unit speed of another", "1"),
    ];
    for (number, pose) in case.poses.iter().enumerate() {
        let q = case.by_coordinate(&pose["q"]);
        let mut satisfied = q.clone();
        model.satisfy_couplers(&mut satisfied);
        for (ours, theirs) in satisfied.iter().zip(&q) {
            assert!((ours - theirs).abs() < 1e-12, "{}: couplers differ: {ours} {theirs}", case.name);
        }
        model.update_positions(&q, &mut cache);
        model.update_velocities(&q, &case.by_coordinate(&pose["u"]), &mut cache);
        for (name, expected) in pose["bodies"].as_object().expect("bodies") {
            let body = model.body(name).unwrap_or_else(|| panic!("{}: no body {name}", case.name));
            let expected = numbers(expected);
            let at = || format!("{name} at pose {number}");
            let (pose, velocity) = (
                pose_difference(cache.X_GB(body), &expected[..12]),
                velocity_difference(cache.V_GB(body), &expected[12..]),
            );
            differences[0].push(pose, at);
            differences[1].push(velocity, at);
            if let Some(class) = case.joints.get(&body.into()) {
                classes.push(class, pose.max(velocity), || format!("{}: {}", case.name, at()));
            }
        }
        for (name, unit) in pose["unit"].as_object().expect("unit motions") {
            model.update_unit_motion(&q, case.coordinate(name), &mut cache);
            let expected = case.by_coordinate(&unit["coupling"]);
            for ((ours, theirs), other) in cache.coupling().iter().zip(&expected).zip(&model.coordinates) {
                differences[3].push(ours - theirs, || format!("{} by {name} at pose {number}", other.name));
            }
            for (i, body) in model.bodies.iter().enumerate() {
                let expected = &unit["bodies"][&body.name];
                let expected = if expected.is_null() { vec![0.0; 6] } else { numbers(expected) };
                let velocity = cache.partial_velocity(carpus::osim::spec::BodyIndex(i));
                let at = || format!("{} by {name} at pose {number}", body.name);
                differences[2].push(velocity_difference(velocity, &expected), at);
            }
        }
    }
    differences
}

fn joint_classes() -> Classes {
    Classes::new("pose and velocity of the body behind it", "1, m, rad/s or m/s", VELOCITY_TOLERANCE, Judge::Max)
}

fn kinematics_rows(case: &Case, classes: &mut Classes) -> Vec<Row> {
    let tolerances = [POSE_TOLERANCE, VELOCITY_TOLERANCE, VELOCITY_TOLERANCE, VELOCITY_TOLERANCE];
    let differences = compare_kinematics(case, classes);
    let compared = differences.iter().zip(tolerances).filter(|(differences, _)| differences.count() > 0);
    let name = case.name.trim_end_matches(".osim");
    compared.map(|(differences, tolerance)| differences.row("kinematics", name, tolerance, Judge::Max)).collect()
}

#[test]
fn val_opensim_kinematics_of_every_joint() {
    let mut classes = joint_classes();
    for case in fixture_cases() {
        let rows = kinematics_rows(&case, &mut classes);
        assert_eq!(rows.len(), 4);
        validation::assert_passed(&rows);
    }
    let rows = classes.rows("fixtures/multibody");
    validation::write("joints", &rows);
    validation::assert_passed(&rows);
}

#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_kinematics_of_shared_models() {
    let mut classes = joint_classes();
    let mut rows: Vec<Row> = Vec::new();
    for case in shared_cases(20) {
        rows.extend(kinematics_rows(&case, &mut classes));
    }
    rows.extend(classes.rows("lab models"));
    validation::write("kinematics", &rows);
    validation::assert_passed(&rows);
}

#[test]
fn verif_unit_motion_against_finite_differences() {
    for case in fixture_cases() {
        let model = &case.model;
        let (mut cache, mut ahead, mut behind) = (model.new_cache(), model.new_cache(), model.new_cache());
        let q = case.by_coordinate(&case.poses[1]["q"]);
        model.update_positions(&q, &mut cache);
        for c in (0..model.n_coordinates()).map(CoordinateIndex) {
            if model.is_dependent(c) || ["ball_", "free_r"].iter().any(|p| model.coordinates[c.0].name.starts_with(p)) {
                continue; // not free to move by themselves, or their speeds are no rates
            }
            if case.name == "forces" && ["x", "y", "z"].contains(&model.coordinates[c.0].name.as_str()) {
                continue; // a ball joint, too
            }
            model.update_unit_motion(&q, c, &mut cache);
            let h = 1e-6;
            for (cache, h) in [(&mut ahead, h), (&mut behind, -h)] {
                let mut moved = q.clone();
                moved[c.0] += h;
                model.satisfy_couplers(&mut moved);
                model.update_positions(&moved, cache);
            }
            for body in 0..model.n_bases() {
                let base = carpus::multibody::BaseIndex(body);
                let difference = (ahead.X_GB(base).p - behind.X_GB(base).p) / (2.0 * h);
                assert!((difference - cache.partial_velocity(base).v).norm() < 1e-8);
                let cross = (ahead.X_GB(base).R - behind.X_GB(base).R) / (2.0 * h) * cache.X_GB(base).R.transpose();
                let w = nalgebra::Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)]);
                assert!((w - cache.partial_velocity(base).w).norm() < 1e-8);
            }
        }
    }
}

#[test]
fn verif_accelerations_against_finite_differences() {
    for case in fixture_cases() {
        let model = &case.model;
        // q(t) = q0 + qdot·t + ½·qddot·t² in the independent coordinates
        let q0 = case.by_coordinate(&case.poses[1]["q"]);
        let (qdot0, qddot0) = (case.by_coordinate(&case.poses[2]["q"]), case.by_coordinate(&case.poses[3]["q"]));
        let motion = |t: f64, cache: &mut carpus::multibody::Cache| {
            let mut q: Vec<f64> = (0..q0.len()).map(|i| q0[i] + t * (qdot0[i] + 0.5 * t * qddot0[i])).collect();
            let mut qdot: Vec<f64> = (0..q0.len()).map(|i| qdot0[i] + t * qddot0[i]).collect();
            let mut qddot = qddot0.clone();
            model.satisfy_couplers(&mut q);
            model.follow_couplers(&q, &mut qdot);
            model.follow_couplers_second(&q, &qdot, &mut qddot);
            model.update_positions(&q, cache);
            model.update_velocities(&q, &qdot, cache);
            model.update_accelerations(&q, &qdot, &qddot, cache);
        };
        let (mut cache, mut ahead, mut behind) = (model.new_cache(), model.new_cache(), model.new_cache());
        let h = 1e-6;
        motion(0.0, &mut cache);
        motion(h, &mut ahead);
        motion(-h, &mut behind);
        for base in (0..model.n_bases()).map(carpus::multibody::BaseIndex) {
            let a = (ahead.V_GB(base).v - behind.V_GB(base).v) / (2.0 * h);
            let alpha = (ahead.V_GB(base).w - behind.V_GB(base).w) / (2.0 * h);
            assert!((a - cache.A_GB(base).a).norm() < 1e-7, "{}: {base:?} {a} {}", case.name, cache.A_GB(base).a);
            assert!((alpha - cache.A_GB(base).alpha).norm() < 1e-7, "{}: {base:?}", case.name);
        }
    }
}

#[test]
fn verif_subset_update_equals_full_update() {
    for case in fixture_cases() {
        let model = &case.model;
        let (mut start, end) = (case.by_coordinate(&case.poses[1]["q"]), case.by_coordinate(&case.poses[2]["q"]));
        model.satisfy_couplers(&mut start); // the reference's agree but for the last digit
        // One cache for all coordinates: a new one must not inherit motions of the one before.
        let mut partial = model.new_cache();
        for c in (0..model.n_coordinates()).map(CoordinateIndex).filter(|&c| !model.is_dependent(c)) {
            let moved = model.bodies_moved_by(&[c]);
            let mut full = model.new_cache();
            model.update_positions(&start, &mut partial);
            let mut q = start.clone();
            q[c.0] = end[c.0];
            model.satisfy_couplers(&mut q);
            model.update_positions_in(&moved, &q, &mut partial);
            model.update_unit_motion_in(&moved, &q, c, &mut partial);
            model.update_positions(&q, &mut full);
            model.update_unit_motion(&q, c, &mut full);
            for base in (0..model.n_bases()).map(carpus::multibody::BaseIndex) {
                assert_eq!(partial.X_GB(base), full.X_GB(base));
                assert_eq!(partial.partial_velocity(base), full.partial_velocity(base));
            }
        }
    }
}

/// Two bars that bend; poses only, since OpenSim's velocities of this joint contradict its poses.
#[test]
fn val_opensim_poses_behind_constant_curvature_joints() {
    let osim = include_bytes!("../../fixtures/curvature/spine.osim");
    let case = case(
        "spine",
        OsimFile::parse(osim, "spine.osim").expect("model"),
        serde_json::from_str(include_str!("../../fixtures/curvature/spine.json")).expect("JSON"),
    );
    let mut cache = case.model.new_cache();
    let mut differences = Differences::new("pose behind a ConstantCurvatureJoint", "1 or m");
    for pose in &case.poses {
        case.model.update_positions(&case.by_coordinate(&pose["q"]), &mut cache);
        for (i, body) in case.model.bodies.iter().enumerate() {
            let found = cache.X_GB(BaseIndex::from(BodyIndex(i)));
            let difference = pose_difference(found, &numbers(&pose["bodies"][&body.name]));
            differences.push(difference, || format!("{} at {}", body.name, pose["q"]));
        }
    }
    assert_eq!(differences.count(), 24);
    differences.assert_below(POSE_TOLERANCE);
}
