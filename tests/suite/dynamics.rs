//! Tests of `dynamics`: mass matrix, inverse and forward dynamics, constraints, against OpenSim and closed forms.

use super::reference;
use super::validation::{self, Differences, Judge, Row};
use carpus::dynamics::{AppliedForces, Constraints, Dynamics};
use carpus::multibody::{BaseIndex, Model};
use carpus::osim::OsimFile;
use carpus::osim::spec::{BodyIndex, ModelSpec};
use carpus::spatial::SpatialForce;
use nalgebra::Vector3;
use serde_json::Value;
use std::path::Path;

/// Largest difference relative to the largest number of its kind at a state, times the condition of the mass matrix.
const TOLERANCE: f64 = 1e-8;

struct Case {
    name: String,
    spec: ModelSpec,
    model: Model,
    /// Whether what the file locks is held.
    locked: bool,
    states: Vec<Value>,
}

fn case(name: &str, file: OsimFile, locked: bool, reference: &Value) -> Case {
    let model = Model::compile(&file.spec).unwrap_or_else(|error| panic!("{name}: {error}"));
    let states = reference["states"].as_array().expect("states").clone();
    Case { name: name.into(), spec: file.spec, model, locked, states }
}

fn fixture_cases() -> Vec<Case> {
    let fixtures = [
        (
            "constraints",
            include_str!("../../fixtures/dynamics/constraints.osim"),
            include_str!("../../fixtures/dynamics/constraints.json"),
        ),
        (
            "weld",
            include_str!("../../fixtures/dynamics/weld.osim"),
            include_str!("../../fixtures/dynamics/weld.json"),
        ),
    ];
    let parse = |(name, osim, json): (&str, &str, &str)| {
        let file = OsimFile::parse(osim.as_bytes(), name).unwrap_or_else(|error| panic!("{name}: {error}"));
        case(name, file, true, &serde_json::from_str(json).expect("JSON"))
    };
    fixtures.into_iter().map(parse).collect()
}

/// All lab models, with reference numbers computed by OpenSim; empty, after saying so, without them.
fn lab_cases(n_states: usize) -> Vec<Case> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scripts/dynamics.py");
    let mut cases = Vec::new();
    for path in reference::lab_models() {
        let name = reference::stem(&path);
        let key = format!("{name}-{n_states}-{}-{}.json", reference::digest(&path), reference::digest(&script));
        let out = validation::reference_folder("dynamics").join(key);
        if !out.exists() {
            let Some(python) = reference::opensim_python() else { return Vec::new() };
            // Two tests may be here at once.
            let scratch = tempfile::tempdir_in(out.parent().expect("folder")).expect("temporary folder");
            let partial = scratch.path().join("reference.json");
            let states = n_states.to_string();
            let arguments = [path.as_os_str(), partial.as_os_str(), "--states".as_ref(), states.as_ref()];
            reference::run_script(&python, "scripts/dynamics.py", &arguments);
            std::fs::rename(partial, &out).expect("a writable folder");
        }
        let file = OsimFile::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let text = std::fs::read_to_string(&out).expect("reference written");
        cases.push(case(&name, file, false, &serde_json::from_str(&text).expect("JSON")));
    }
    cases
}

impl Case {
    fn by_coordinate(&self, values: &Value) -> Vec<f64> {
        let value = |name: &str| values[name].as_f64().unwrap_or_else(|| panic!("{}: no {name}", self.name));
        self.model.coordinates.iter().map(|c| value(&c.name)).collect()
    }

    fn applied(&self, state: &Value) -> AppliedForces {
        let mut applied = AppliedForces::new(&self.model);
        applied.mobility = self.by_coordinate(&state["mobility_force"]);
        for (i, body) in self.model.bodies.iter().enumerate() {
            let f: Vec<f64> = serde_json::from_value(state["body_force"][&body.name].clone()).expect("six numbers");
            applied.bodies[BaseIndex::from(BodyIndex(i)).0] =
                SpatialForce { moment: Vector3::new(f[0], f[1], f[2]), force: Vector3::new(f[3], f[4], f[5]) };
        }
        applied
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(1e-12_f64, |m, v| m.max(v.abs()))
}

/// Relative differences from OpenSim over all states: mass matrix, inverse dynamics, accelerations, bodies.
fn compare(case: &Case) -> [Differences; 4] {
    let mut differences = [
        Differences::new("mass matrix", "its diagonal"),
        Differences::new("inverse-dynamics force", "largest one"),
        Differences::new("acceleration of a coordinate, constraints enforced", "largest one"),
        Differences::new("acceleration of a body", "largest one"),
    ];
    let constraints = Constraints::compile(&case.spec, &case.model, case.locked, case.locked)
        .unwrap_or_else(|error| panic!("{}: {error}", case.name));
    let mut dynamics = Dynamics::new(&case.model, &constraints);
    for (number, state) in case.states.iter().enumerate() {
        let (q, u) = (case.by_coordinate(&state["q"]), case.by_coordinate(&state["u"]));
        let applied = case.applied(state);
        dynamics.update(&q, &u);
        let expected: Vec<f64> = serde_json::from_value(state["mass_matrix"].clone()).expect("numbers");
        let mass = dynamics.mass_matrix().clone();
        let mut k = 0;
        for i in 0..q.len() {
            for j in 0..=i {
                let scale = (mass[(i, i)] * mass[(j, j)]).sqrt().max(1e-9);
                differences[0].push((mass[(i, j)] - expected[k]).abs() / scale, || format!("{i}, {j} at state {number}"));
                k += 1;
            }
        }
        let known = case.by_coordinate(&state["known_udot"]);
        let residual = case.by_coordinate(&state["residual"]);
        let scale = largest(&residual);
        let found = dynamics.inverse_dynamics(&q, &u, &known, &applied);
        for (c, (a, b)) in found.iter().zip(&residual).enumerate() {
            let name = &case.model.coordinates[c].name;
            differences[1].push((a - b).abs() / scale, || format!("{name} at state {number}"));
        }
        if state["udot"].is_null() {
            differences[2].remark(format!("OpenSim has no solution at state {number}: {}", state["error"]));
            continue;
        }
        let expected = case.by_coordinate(&state["udot"]);
        let solution = dynamics.accelerations(0.0, &q, &u, &applied).unwrap_or_else(|e| panic!("{}: {e}", case.name));
        let scale = largest(&expected);
        for (c, (a, b)) in solution.udot.iter().zip(&expected).enumerate() {
            let name = &case.model.coordinates[c].name;
            differences[2].push((a - b).abs() / scale, || format!("{name} at state {number}: {a} instead of {b}"));
        }
        let mut cache = case.model.new_cache();
        case.model.update_positions(&q, &mut cache);
        case.model.update_velocities_of_speeds(&q, &u, &mut cache);
        case.model.update_accelerations_of_speeds(&q, &u, &expected, &mut cache);
        let accelerations: Vec<(usize, [f64; 6], Vec<f64>)> = (0..case.model.bodies.len())
            .map(|i| {
                let values: Vec<f64> =
                    serde_json::from_value(state["bodies"][&case.model.bodies[i].name].clone()).expect("24 numbers");
                let found = cache.A_GB(BodyIndex(i));
                let (w, v) = (found.alpha, found.a);
                (i, [w.x, w.y, w.z, v.x, v.y, v.z], values[18..24].to_vec())
            })
            .collect();
        let scale = accelerations.iter().map(|a| largest(&a.2)).fold(0.0, f64::max);
        for (i, found, expected) in &accelerations {
            for (a, b) in found.iter().zip(expected) {
                let name = &case.model.bodies[*i].name;
                differences[3].push((a - b).abs() / scale, || format!("{name} at state {number}"));
            }
        }
    }
    differences
}

#[test]
fn val_opensim_dynamics_of_mechanisms_with_constraints() {
    for case in fixture_cases() {
        for differences in compare(&case) {
            differences.assert_below(TOLERANCE);
        }
    }
}

#[test]
fn val_opensim_dynamics_of_lab_models() {
    let n_states = if validation::folder().is_some() { 100 } else { 4 };
    let cases = lab_cases(n_states);
    let rows: Vec<Row> = cases
        .iter()
        .flat_map(|case| compare(case).map(|d| d.row("dynamics", &case.name, TOLERANCE, Judge::Q99)))
        .collect();
    validation::write("dynamics", &rows);
    validation::assert_passed(&rows);
}
