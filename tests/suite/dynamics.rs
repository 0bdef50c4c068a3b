//! Tests of `dynamics`: mass matrix, inverse and forward dynamics, constraints, against OpenSim and closed forms.

use super::reference;
use super::validation::{self, Differences, Judge, Row};
use carpus::dynamics::{
    Constraints, Dynamics, ForwardOptions, LaggedActuator, Plant, PlantError, PlantState, Trajectory, simulate_forward,
};
use carpus::forces::{Actuator, AppliedForces};
use carpus::functions::Function;
use carpus::multibody::{BaseIndex, Model};
use carpus::osim::OsimFile;
use carpus::osim::spec::{ActuatorKind, ActuatorSpec, BodyIndex, CoordinateIndex, FunctionSpec, Location, ModelSpec};
use carpus::spatial::SpatialForce;
use nalgebra::Vector3;
use serde_json::Value;
use std::path::Path;

/// Largest difference relative to the largest number of its kind at a state, times the condition of the mass matrix.
const TOLERANCE: f64 = 1e-8;
/// What is known of some models.
const CONTRADICTION: &str = "with the accelerations of OpenSim, which contradict its velocities where one coordinate \
                             turns a CustomJoint about several axes; Carpus's own are held against finite differences";

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
    let model = model.with_accelerations_of_opensim();
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
            "ellipsoids",
            include_str!("../../fixtures/dynamics/ellipsoids.osim"),
            include_str!("../../fixtures/dynamics/ellipsoids.json"),
        ),
        ("weld", include_str!("../../fixtures/dynamics/weld.osim"), include_str!("../../fixtures/dynamics/weld.json")),
    ];
    let parse = |(name, osim, json): (&str, &str, &str)| {
        let file = OsimFile::parse(osim.as_bytes(), name).unwrap_or_else(|error| panic!("{name}: {error}"));
        case(name, file, true, &serde_json::from_str(json).expect("JSON"))
    };
    fixtures.into_iter().map(parse).collect()
}

/// All lab models, with reference numbers computed by OpenSim; empty, after saying so, without them.
///
/// - `extra`: further arguments of the script
fn lab_cases(n_states: usize, extra: &[&str]) -> Vec<Case> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scripts/dynamics.py");
    let mut cases = Vec::new();
    for path in reference::lab_models() {
        let name = reference::stem(&path);
        let key = format!(
            "{name}-{n_states}{}-{}-{}.json",
            extra.concat(),
            reference::digest(&path),
            reference::digest(&script)
        );
        let out = validation::reference_folder("dynamics").join(key);
        if !out.exists() {
            let python = reference::opensim_python();
            // Two tests may be here at once.
            let scratch = tempfile::tempdir_in(out.parent().expect("folder")).expect("temporary folder");
            let partial = scratch.path().join("reference.json");
            let states = n_states.to_string();
            let mut arguments = vec![path.as_os_str(), partial.as_os_str(), "--states".as_ref(), states.as_ref()];
            arguments.extend(extra.iter().map(std::ffi::OsStr::new));
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

/// Relative differences from OpenSim over all states: mass matrix, inverse dynamics, accelerations.
fn compare(case: &Case) -> Vec<Differences> {
    let mut mass = Differences::new("mass matrix", "its diagonal");
    let mut inverse = Differences::new("inverse-dynamics force", "largest one");
    let mut forward =
        Differences::listing_above("acceleration of a coordinate, constraints enforced", "largest one", TOLERANCE);
    let mut bodies = Differences::new("acceleration of a body", "largest one");
    let mut balance =
        Differences::listing_above("force that Carpus's accelerations leave unbalanced", "largest force", TOLERANCE);
    let constraints = Constraints::compile(&case.spec, &case.model, case.locked, case.locked)
        .unwrap_or_else(|error| panic!("{}: {error}", case.name));
    let mut unsolved = 0;
    let mut worst_imbalance: f64 = 0.0;
    let mut dynamics = Dynamics::new(&case.model, &constraints);
    for (number, state) in case.states.iter().enumerate() {
        let (q, u) = (case.by_coordinate(&state["q"]), case.by_coordinate(&state["u"]));
        let applied = case.applied(state);
        dynamics.update(&q, &u);
        let expected: Vec<f64> = serde_json::from_value(state["mass_matrix"].clone()).expect("numbers");
        let found = dynamics.mass_matrix().clone();
        let pairs = (0..q.len()).flat_map(|i| (0..=i).map(move |j| (i, j)));
        for ((i, j), expected) in pairs.zip(&expected) {
            let scale = (found[(i, i)] * found[(j, j)]).sqrt().max(1e-9);
            mass.push((found[(i, j)] - expected) / scale, || format!("{i}, {j} at state {number}"));
        }
        let known = case.by_coordinate(&state["known_udot"]);
        let residual = case.by_coordinate(&state["residual"]);
        let scale = largest(&residual);
        let found = dynamics.inverse_dynamics(&q, &u, &known, &applied);
        for (c, (a, b)) in found.iter().zip(&residual).enumerate() {
            inverse.push((a - b) / scale, || format!("{} at state {number}", case.model.coordinates[c].name));
        }
        let solution = dynamics.accelerations(0.0, &q, &u, &applied);
        let Ok(solution) = solution else {
            assert!(state["udot"].is_null(), "{}: OpenSim has a solution at state {number}", case.name);
            unsolved += 1;
            continue;
        };
        let mut imbalance = |udot: &[f64]| {
            let (force, violation) = dynamics.imbalance(0.0, &q, &u, udot, &applied);
            force.max(violation * 1e-3) / scale
        };
        let ours = imbalance(solution.udot.as_slice());
        if state["udot"].is_null() {
            balance.push(ours, || format!("state {number}"));
            unsolved += 1;
            continue;
        }
        let expected = case.by_coordinate(&state["udot"]);
        let theirs = imbalance(&expected);
        let why =
            format!("Nearly massless bodies: OpenSim's own accelerations leave {theirs:.0e} unbalanced in this state");
        balance.push_explained(ours, || format!("state {number}"), (theirs > ours).then_some(why.as_str()));
        if theirs > TOLERANCE {
            worst_imbalance = worst_imbalance.max(theirs);
            continue;
        }
        let why = format!(
            "Both balance the equations of motion, to {ours:.0e} and {theirs:.0e} (OpenSim) of the largest force: the \
             mass matrix is nearly singular in this direction"
        );
        let scale = largest(&expected);
        for (c, (a, b)) in solution.udot.iter().zip(&expected).enumerate() {
            let name = &case.model.coordinates[c].name;
            let at = || format!("{name} at state {number}: {a} instead of {b}");
            forward.push_explained((a - b) / scale, at, (ours <= TOLERANCE).then_some(why.as_str()));
        }
        compare_bodies(case, number, state, (&q, &u, &expected), &mut bodies);
    }
    if case.model.contradictory_joints().next().is_some() {
        inverse.remark(CONTRADICTION);
    }
    if worst_imbalance > 0.0 {
        forward.remark(format!(
            "states left out where OpenSim's own accelerations leave forces unbalanced, by up to {worst_imbalance:.0e} \
             of the largest: nearly massless bodies"
        ));
    } else if unsolved > 0 {
        forward.remark(format!("{unsolved} states left out where massless bodies make accelerations undetermined"));
    }
    let mut all = vec![mass, inverse, balance, forward, bodies];
    all.retain(|d| d.count() > 0);
    all
}

fn compare_bodies(
    case: &Case,
    number: usize,
    state: &Value,
    (q, u, udot): (&[f64], &[f64], &[f64]),
    bodies: &mut Differences,
) {
    let mut cache = case.model.new_cache();
    case.model.update_positions(q, &mut cache);
    case.model.update_velocities_of_speeds(q, u, &mut cache);
    case.model.update_accelerations_of_speeds(q, u, udot, &mut cache);
    let expected: Vec<Vec<f64>> = case
        .model
        .bodies
        .iter()
        .map(|body| serde_json::from_value(state["bodies"][&body.name].clone()).expect("24 numbers"))
        .collect();
    let scale = expected.iter().map(|values| largest(&values[18..24])).fold(0.0, f64::max);
    for (i, expected) in expected.iter().enumerate() {
        let found = cache.A_GB(BodyIndex(i));
        for (a, b) in found.alpha.iter().chain(found.a.iter()).zip(&expected[18..24]) {
            bodies.push((a - b) / scale, || format!("{} at state {number}", case.model.bodies[i].name));
        }
    }
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
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_dynamics_of_lab_models() {
    let n_states = if validation::folder().is_some() { 100 } else { 4 };
    let cases = lab_cases(n_states, &[]);
    let rows: Vec<Row> = cases
        .iter()
        .flat_map(|case| compare(case).into_iter().map(|d| d.row("dynamics", &case.name, TOLERANCE, Judge::Q99)))
        .collect();
    validation::write("dynamics", &rows);
    validation::assert_passed(&rows);
}

/// Accelerations, tendon forces and fibre velocities of whole models: muscles, springs, bushings and limits at once.
///
/// Models with muscles or forces that are not computed are left out; so are states with near-massless bodies at which
/// OpenSim's accelerations do not solve its own equations.
#[test]
#[cfg_attr(
    not(all(has_opensim, has_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and models (CARPUS_MODELS or CARPUS_SHARED)"
)]
fn val_opensim_accelerations_under_all_forces() {
    let n_states = if validation::folder().is_some() { 20 } else { 2 };
    let mut rows = Vec::new();
    for mut case in lab_cases(n_states, &["--forces"]) {
        for coordinate in &mut case.spec.coordinates {
            (coordinate.locked, coordinate.prescribed) = (false, false);
        }
        case.model = Model::compile(&case.spec).expect("model").with_accelerations_of_opensim();
        let plant = match Plant::compile(&case.spec, &case.model, false) {
            Ok(plant) => plant,
            Err(PlantError::UnsupportedForces { .. } | PlantError::NotExplicit { .. }) => continue,
            // A muscle of the oldest kinds whose file gives it no time scale: OpenSim divides by it.
            Err(error) if error.to_string().contains("time_scale is 0") => {
                println!("left out {}: {error}", case.name);
                continue;
            }
            Err(error) => panic!("{}: {error}", case.name),
        };
        if plant.muscles.is_empty() || case.states.is_empty() {
            continue;
        }
        rows.extend(compare_under_all_forces(&case, &plant));
    }
    validation::write("dynamics_under_all_forces", &rows);
    validation::assert_passed(&rows);
}

fn compare_under_all_forces(case: &Case, plant: &Plant) -> Vec<Row> {
    let mut forces = Differences::new("tendon force at random states", "Fmax");
    let mut velocities = Differences::new("fibre velocity at random states", "maximum velocity, or itself if larger");
    let mut accelerations = Differences::new("acceleration under all forces of the model", "largest one");
    let constraints = Constraints::compile(&case.spec, &case.model, false, false).expect("constraints");
    let mut dynamics = Dynamics::new(&case.model, &constraints);
    let mut work = plant.new_work();
    let mut rates = vec![0.0; plant.n_states()];
    let n = plant.reduction.n_free();
    let mut worst_imbalance: f64 = 0.0;
    for (number, state) in case.states.iter().enumerate() {
        let (q, u) = (case.by_coordinate(&state["q"]), case.by_coordinate(&state["u"]));
        let of_muscles = |values: &Value| -> Vec<f64> {
            plant.muscles.iter().map(|m| values[m.muscle.name()].as_f64().expect("a number")).collect()
        };
        let activation = of_muscles(&state["activation"]);
        let fiber_length = of_muscles(&state["fiber_length"]);
        let x = plant.pack(&PlantState {
            q: q.clone(),
            u: u.clone(),
            activation: activation.clone(),
            fiber_length,
            fiber_velocity: vec![0.0; plant.muscles.len()],
            dissipated_energy: Vec::new(),
            actuator_activation: Vec::new(),
        });
        plant.rates(0.0, &x, &activation, &mut work, &mut rates).unwrap_or_else(|e| panic!("{}: {e}", case.name));
        let (tension, speed) = (of_muscles(&state["tendon_force"]), of_muscles(&state["fiber_velocity"]));
        for (k, m) in plant.muscles.iter().enumerate() {
            let at = || format!("{} at state {number}", m.muscle.name());
            forces.push((work.tendon_force[k] - tension[k]) / m.muscle.max_isometric_force(), at);
            if let Some(i) = m.fiber_length {
                let scale = speed[k].abs().max(m.muscle.max_contraction_velocity() * m.muscle.optimal_fiber_length());
                velocities.push((rates[i] - speed[k]) / scale, at);
            }
        }
        let expected = case.by_coordinate(&state["udot"]);
        dynamics.update(&q, &u);
        let applied = plant.applied_forces(&x, &activation, &mut work);
        let imbalance = |dynamics: &mut Dynamics, udot: &[f64]| {
            let (force, violation) = dynamics.imbalance(0.0, &q, &u, udot, &applied);
            force / largest(&applied.mobility) + violation / largest(udot)
        };
        let theirs = imbalance(&mut dynamics, &expected);
        if theirs > TOLERANCE {
            worst_imbalance = worst_imbalance.max(theirs);
            continue;
        }
        let scale = largest(&expected);
        for (k, &c) in plant.reduction.free.iter().enumerate() {
            let name = &case.model.coordinates[c].name;
            let (a, b) = (rates[n + k], expected[c]);
            accelerations.push((a - b) / scale, || format!("{name} at state {number}: {a} instead of {b}"));
        }
    }
    if worst_imbalance > 0.0 {
        accelerations.remark(format!(
            "states left out where OpenSim's accelerations leave forces unbalanced, by up to {worst_imbalance:.0e} of \
             the largest"
        ));
    }
    let all = [(forces, 1e-5), (velocities, 1e-5), (accelerations, 1e-6)];
    let kept = all.into_iter().filter(|(d, _)| d.count() > 0);
    kept.map(|(d, tolerance)| d.row("dynamics", &case.name, tolerance, Judge::Q99)).collect()
}

/// Energy is conserved, and accelerations and forces are inverse to one another, on a chain without constraints.
#[test]
fn verif_energy_of_a_free_chain_is_conserved_and_inverse_dynamics_inverts() {
    let path = "fixtures/dynamics/weld.osim";
    let mut spec = OsimFile::parse(include_bytes!("../../fixtures/dynamics/weld.osim"), path).expect("fixture").spec;
    spec.constraints.clear();
    let model = Model::compile(&spec).expect("model");
    let constraints = Constraints::none();
    let mut dynamics = Dynamics::new(&model, &constraints);
    let applied = AppliedForces::new(&model);
    let n = model.n_coordinates();
    let mut q = model.default_coordinates();
    let mut u: Vec<f64> = (0..n).map(|i| 0.5 - 0.3 * (i % 4) as f64).collect();
    let energy = |dynamics: &Dynamics| model.kinetic_energy(dynamics.cache()) + model.gravity_energy(dynamics.cache());
    dynamics.update(&q, &u);
    let start = energy(&dynamics);
    let mut derivative = |q: &[f64], u: &[f64]| {
        dynamics.update(q, u);
        let qdot = dynamics.qdot().to_vec();
        let udot = dynamics.accelerations(0.0, q, u, &applied).expect("accelerations").udot;
        let needed = dynamics.inverse_dynamics(q, u, udot.as_slice(), &applied);
        assert!(needed.amax() < 1e-10, "inverse of forward dynamics: {needed}");
        (qdot, udot.as_slice().to_vec())
    };
    let add = |a: &[f64], h: f64, b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + h * b).collect() };
    let h = 1e-3;
    for _ in 0..200 {
        let (q1, u1) = derivative(&q, &u);
        let (q2, u2) = derivative(&add(&q, h / 2.0, &q1), &add(&u, h / 2.0, &u1));
        let (q3, u3) = derivative(&add(&q, h / 2.0, &q2), &add(&u, h / 2.0, &u2));
        let (q4, u4) = derivative(&add(&q, h, &q3), &add(&u, h, &u3));
        for i in 0..n {
            q[i] += h / 6.0 * (q1[i] + 2.0 * q2[i] + 2.0 * q3[i] + q4[i]);
            u[i] += h / 6.0 * (u1[i] + 2.0 * u2[i] + 2.0 * u3[i] + u4[i]);
        }
    }
    dynamics.update(&q, &u);
    let drift = (energy(&dynamics) - start).abs();
    let kinetic = model.kinetic_energy(dynamics.cache());
    assert!(kinetic > 0.5, "it moves: {kinetic} J");
    assert!(drift < 1e-8 * kinetic.max(1.0), "energy drifted by {drift} J");
    // Kinetic energy by the mass matrix.
    let speeds = nalgebra::DVector::from_column_slice(&u);
    let by_matrix = 0.5 * speeds.dot(&(dynamics.mass_matrix() * &speeds));
    assert!((by_matrix - kinetic).abs() < 1e-12 * kinetic, "{by_matrix} J instead of {kinetic} J");
}

/// Assembly and projection satisfy all constraints, and constraint forces do no work.
#[test]
fn verif_assembled_states_satisfy_constraints_whose_forces_do_no_work() {
    for case in fixture_cases().into_iter().filter(|case| !case.spec.constraints.is_empty()) {
        let constraints = Constraints::compile(&case.spec, &case.model, true, true).expect("constraints");
        let mut dynamics = Dynamics::new(&case.model, &constraints);
        let mut q = case.model.default_coordinates();
        dynamics.assemble(0.0, &mut q).expect("assembled");
        let mut u: Vec<f64> = (0..q.len()).map(|i| (1.3 * i as f64).sin()).collect();
        dynamics.project_speeds(0.0, &q, &mut u);
        dynamics.update(&q, &u);
        let applied = AppliedForces::new(&case.model);
        let solution = dynamics.accelerations(0.0, &q, &u, &applied).expect("accelerations");
        let power: f64 = solution.constraint_forces.iter().zip(&u).map(|(f, u)| f * u).sum();
        let size = solution.constraint_forces.amax();
        assert!(size > 0.1, "{}: constraints carry load", case.name);
        assert!(power.abs() < 1e-10 * size, "{}: constraint forces do work: {power} W", case.name);
        // The equations are linear in forces.
        let mut pushed = AppliedForces::new(&case.model);
        pushed.mobility[0] = 3.0;
        pushed.bodies[1] = SpatialForce { moment: Vector3::new(1.0, -2.0, 0.5), force: Vector3::new(5.0, 4.0, -3.0) };
        let together = dynamics.accelerations(0.0, &q, &u, &pushed).expect("accelerations").udot;
        let alone = dynamics.responses(0.0, &q, &u, std::slice::from_ref(&pushed)).expect("responses");
        let error = (&together - &solution.udot - alone.column(0)).amax();
        assert!(alone.amax() > 0.1 && error < 1e-9 * together.amax(), "{}: {error}", case.name);
        // A short time later the constraints still hold, to second order.
        let h = 1e-4;
        let qdot = dynamics.qdot().to_vec();
        let later: Vec<f64> = q.iter().zip(&qdot).map(|(q, v)| q + h * v).collect();
        let mut assembled = later.clone();
        dynamics.assemble(0.0, &mut assembled).expect("assembled");
        let moved = later.iter().zip(&assembled).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved < 1e-5, "{}: assembly moved by {moved}", case.name);
    }
}

/// Differences of coordinates [rad or m] from a trajectory that OpenSim's `Manager` integrated.
fn compare_trajectory(spec: &ModelSpec, reference: &Value, accuracy: f64) -> (Differences, Trajectory) {
    let mut model = Model::compile(spec).expect("model");
    for coordinate in &mut model.coordinates {
        let number = |value: &Value| value.as_f64().expect("a number");
        if let Some(sine) = reference["sine"].get(&coordinate.name) {
            let [amplitude, omega, phase, offset] = [0, 1, 2, 3].map(|i| number(&sine[i]));
            let sine = FunctionSpec::Sine { amplitude, omega, phase, offset };
            coordinate.prescribed = Some(Function::compile(&sine).expect("a sine"));
        }
        if reference["locked"].as_array().is_some_and(|names| names.contains(&coordinate.name.as_str().into())) {
            (coordinate.locked, coordinate.default_value) = (true, 0.0);
        }
    }
    let plant = Plant::compile(spec, &model, false).expect("plant");
    let rest = reference["rest"].as_f64().expect("rest");
    let rows = reference["rows"].as_array().expect("rows");
    let end = rows.last().and_then(|row| row["time"].as_f64()).expect("time");
    // Constant, or sampled at equal steps and linear in between.
    let excitation_at = |t: f64, muscle: &str| match reference["emg"][muscle].as_array() {
        Some(samples) => {
            let x = (t / end).clamp(0.0, 1.0) * (samples.len() - 1) as f64;
            let i = (x as usize).min(samples.len() - 2);
            let [a, b] = [i, i + 1].map(|k| samples[k].as_f64().expect("a number"));
            a + (x - i as f64) * (b - a)
        }
        None => reference["excitation"][muscle].as_f64().unwrap_or(rest),
    };
    let excite = |t: f64, e: &mut [f64]| {
        e.iter_mut().zip(&plant.muscles).for_each(|(e, m)| *e = excitation_at(t, m.muscle.name()));
    };
    let mut excitation = vec![0.0; plant.muscles.len()];
    excite(0.0, &mut excitation);
    let of = |row: &Value, what: &str| -> Vec<f64> {
        model.coordinates.iter().map(|c| row[what][&c.name].as_f64().expect("a number")).collect()
    };
    let mut work = plant.new_work();
    let start = plant
        .equilibrium_state(0.0, &of(&rows[0], "q"), &of(&rows[0], "u"), &excitation, &mut work)
        .expect("equilibrium");
    let times = rows.iter().map(|row| row["time"].as_f64().expect("time")).collect();
    let options =
        ForwardOptions { times, accuracy, first_step: 1e-3, step_range: [0.0, f64::INFINITY], most_steps: 1_000_000 };
    let trajectory = simulate_forward(&plant, &start, excite, &options).expect("trajectory");
    let mut differences = Differences::new("coordinate along a forward simulation", "rad or m");
    for (state, row) in trajectory.states.iter().zip(rows) {
        for (c, (found, expected)) in state.q.iter().zip(of(row, "q")).enumerate() {
            let name = &model.coordinates[c].name;
            differences.push(found - expected, || format!("{name} at {} s", row["time"]));
        }
    }
    (differences, trajectory)
}

#[test]
fn val_opensim_forward_simulation_of_the_bundled_wrist() {
    let file = OsimFile::parse(include_bytes!("../../models/wrist.osim"), "wrist.osim").expect("model");
    let reference = serde_json::from_str(include_str!("../../fixtures/forward/wrist.json")).expect("JSON");
    let (differences, trajectory) = compare_trajectory(&file.spec, &reference, 1e-8);
    println!("{:?}, largest difference {:.1e}", trajectory.cost, differences.max());
    differences.assert_below(1e-5);
}

/// A fall, the wrist extended by EMG, and the wrist driven while the fingers follow (tenodesis). There the path of EDCR
/// is shorter by 42 µm from 0.0910 to 0.0913 s only: the steps of accuracy 1e-6 may pass over that, which makes 1.4e-4
/// rad.
#[test]
#[cfg_attr(not(has_lab_models), ignore = "needs lab models (CARPUS_SHARED)")]
fn val_opensim_forward_simulations_of_the_mcfarland_hand() {
    let path = reference::shared("models/Hand_Wrist_Model_for_development.osim");
    let file = OsimFile::parse(std::fs::read(&path).expect("file"), "hand.osim").expect("model");
    for name in ["hand_fall", "hand_emg", "hand_weak_emg", "hand_tenodesis"] {
        let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/forward/{name}.json"));
        let reference: Value = serde_json::from_slice(&std::fs::read(reference).expect("fixture")).expect("JSON");
        let (differences, trajectory) = compare_trajectory(&file.spec, &reference, 1e-7);
        println!("{name}: {:?}, largest difference {:.1e}", trajectory.cost, differences.max());
        let moved = |c: usize| (trajectory.states.last().expect("a state").q[c] - trajectory.states[0].q[c]).abs();
        let most = (0..file.spec.coordinates.len()).map(moved).fold(0.0, f64::max);
        assert!(most > 0.1, "{name}: it moves, by {most} rad");
        differences.assert_below(1e-4);
    }
}

/// The hand falls for a second; fingers turn aside through the poles of their bushings' angles, where the equations
/// have no value and where OpenSim's integrator does not pass.
#[test]
#[cfg_attr(not(has_lab_models), ignore = "needs lab models (CARPUS_SHARED)")]
fn verif_the_mcfarland_hand_falls_for_a_second() {
    let path = reference::shared("models/Hand_Wrist_Model_for_development.osim");
    let spec = OsimFile::parse(std::fs::read(&path).expect("file"), "hand.osim").expect("model").spec;
    let model = Model::compile(&spec).expect("model");
    let plant = Plant::compile(&spec, &model, false).expect("plant");
    let excitation = vec![0.02; plant.muscles.len()];
    let (q, u) = (model.default_coordinates(), vec![0.0; model.n_coordinates()]);
    let mut work = plant.new_work();
    let start = plant.equilibrium_state(0.0, &q, &u, &excitation, &mut work).expect("equilibrium");
    let options = ForwardOptions {
        times: vec![0.0, 0.5, 1.0],
        accuracy: 1e-5,
        first_step: 1e-3,
        step_range: [0.0, f64::INFINITY],
        most_steps: 1_000_000,
    };
    let excite = |_: f64, e: &mut [f64]| e.copy_from_slice(&excitation);
    let trajectory = simulate_forward(&plant, &start, excite, &options).expect("trajectory");
    println!("{:?}", trajectory.cost);
    let end = &trajectory.states[2];
    assert!(end.q.iter().chain(&end.u).all(|x| x.is_finite()));
    let abduction = model.coordinates.iter().position(|c| c.name == "3mcp_abduction").expect("a coordinate");
    assert!(trajectory.states[1].q[abduction] < -1.6, "the third finger is beyond its pole");
}

/// A body that turns about y and then x, between it and ground a bushing that damps rotation about x.
const POLE: &str = r#"<OpenSimDocument Version="40500"><Model name="pole"><gravity>0 0 0</gravity>
<BodySet><objects><Body name="a"><mass>1</mass><mass_center>0 0 0</mass_center><inertia>0.001 0.001 0.001 0 0 0</inertia></Body></objects></BodySet>
<JointSet><objects><CustomJoint name="j"><socket_parent_frame>p</socket_parent_frame><socket_child_frame>c</socket_child_frame>
<coordinates><Coordinate name="about_y"/><Coordinate name="about_x"/></coordinates>
<frames><PhysicalOffsetFrame name="p"><socket_parent>/ground</socket_parent></PhysicalOffsetFrame>
<PhysicalOffsetFrame name="c"><socket_parent>/bodyset/a</socket_parent></PhysicalOffsetFrame></frames>
<SpatialTransform>
<TransformAxis name="rotation1"><coordinates>about_y</coordinates><axis>0 1 0</axis><function><LinearFunction><coefficients>1 0</coefficients></LinearFunction></function></TransformAxis>
<TransformAxis name="rotation2"><coordinates>about_x</coordinates><axis>1 0 0</axis><function><LinearFunction><coefficients>1 0</coefficients></LinearFunction></function></TransformAxis>
<TransformAxis name="rotation3"><axis>0 0 1</axis><function><Constant><value>0</value></Constant></function></TransformAxis>
<TransformAxis name="translation1"><axis>1 0 0</axis><function><Constant><value>0</value></Constant></function></TransformAxis>
<TransformAxis name="translation2"><axis>0 1 0</axis><function><Constant><value>0</value></Constant></function></TransformAxis>
<TransformAxis name="translation3"><axis>0 0 1</axis><function><Constant><value>0</value></Constant></function></TransformAxis>
</SpatialTransform></CustomJoint></objects></JointSet>
<ForceSet><objects><BushingForce name="b"><socket_frame1>/ground</socket_frame1><socket_frame2>/bodyset/a</socket_frame2>
<rotational_stiffness>0 0 0</rotational_stiffness><translational_stiffness>0 0 0</translational_stiffness>
<rotational_damping>20 0 0</rotational_damping><translational_damping>0 0 0</translational_damping></BushingForce></objects></ForceSet>
</Model></OpenSimDocument>"#;

/// A strong damper lets the angle θx = atan(sin f / (cos a cos f)) not change, f about x and a about y: the body moves
/// at constant kinetic energy ½ I (ȧ² + ḟ²) along tan f = cos a tan θx, through the pole at a = π/2, f = 0 and beyond.
#[test]
fn verif_motion_goes_through_the_pole_of_a_bushing() {
    let spec = OsimFile::parse(POLE, "pole.osim").expect("model").spec;
    let model = Model::compile(&spec).expect("model");
    let plant = Plant::compile(&spec, &model, false).expect("plant");
    let (theta, a, rate) = (0.3_f64, 1.2_f64, 2.0);
    let curve = |a: f64| (a.cos() * theta.tan()).atan();
    let slope = |a: f64| -a.sin() * theta.tan() * curve(a).cos().powi(2);
    let start = PlantState {
        q: vec![a, curve(a)],
        u: vec![rate, slope(a) * rate],
        activation: Vec::new(),
        fiber_length: Vec::new(),
        fiber_velocity: Vec::new(),
        dissipated_energy: vec![0.0],
        actuator_activation: Vec::new(),
    };
    let times = (0..=8).map(|k| 0.05 * f64::from(k)).collect();
    let options = ForwardOptions {
        times,
        accuracy: 1e-7,
        first_step: 1e-3,
        step_range: [0.0, f64::INFINITY],
        most_steps: 1_000_000,
    };
    let trajectory = simulate_forward(&plant, &start, |_, _| {}, &options).expect("trajectory");
    let energy = |state: &PlantState| 5e-4 * (state.u[0].powi(2) + state.u[1].powi(2));
    for (time, state) in trajectory.times.iter().zip(&trajectory.states) {
        let (f, expected) = (state.q[1], curve(state.q[0]));
        assert!((f - expected).abs() < 1e-3 * theta, "at {time} s: {f} instead of {expected}");
        let kept = energy(state) / energy(&start);
        assert!((kept - 1.0).abs() < 1e-3, "at {time} s: {kept} of the energy");
    }
    assert!(trajectory.states[8].q[0] > std::f64::consts::FRAC_PI_2 + 0.3, "it is beyond the pole");
}

/// Derivatives of the rates by all states, against differences of the rates.
#[test]
fn verif_derivatives_of_a_plants_rates() {
    let file = OsimFile::parse(include_bytes!("../../models/wrist.osim"), "wrist.osim").expect("model");
    let hand = reference::shared_if_here("models/Hand_Wrist_Model_for_development.osim")
        .map(|path| OsimFile::parse(std::fs::read(&path).expect("file"), "hand.osim").expect("model"));
    for spec in [Some(file.spec), hand.map(|hand| hand.spec)].into_iter().flatten() {
        let model = Model::compile(&spec).expect("model");
        let kind = ActuatorKind::Coordinate { coordinate: CoordinateIndex(2), activation: None };
        let motor = ActuatorSpec { optimal_force: 0.7, min_control: -1.0, max_control: 1.0, kind };
        let actuator = Actuator::compile("motor", &Location::default(), &motor, &model).expect("actuator");
        let motors = vec![LaggedActuator { actuator, time_constant: 0.04 }];
        let plant = Plant::compile(&spec, &model, false).expect("plant").with_lagged_actuators(motors);
        // Activation dynamics have a kink where both are equal.
        let (activation, excitation) = (vec![0.2; plant.muscles.len()], vec![0.3; plant.n_excitations()]);
        let q: Vec<f64> =
            model.default_coordinates().iter().enumerate().map(|(i, q)| q + 0.01 * (i % 5) as f64).collect();
        let u: Vec<f64> = (0..q.len()).map(|i| 0.5 - 0.3 * (i % 4) as f64).collect();
        let mut work = plant.new_work();
        let mut start = plant.equilibrium_state(0.0, &q, &u, &activation, &mut work).expect("equilibrium");
        start.actuator_activation = vec![0.4];
        let x = plant.pack(&start);
        let n = x.len();
        let mut jacobian = nalgebra::DMatrix::zeros(n, n);
        plant.jacobian(0.0, &x, &excitation, &mut work, &mut jacobian).expect("derivatives");
        let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            let step = 1e-6 * if j < 2 * plant.reduction.n_free() { 1.0 } else { x[j].abs() };
            let mut at = x.clone();
            at[j] = x[j] + step;
            plant.rates(0.0, &at, &excitation, &mut work, &mut up).expect("rates");
            at[j] = x[j] - step;
            plant.rates(0.0, &at, &excitation, &mut work, &mut down).expect("rates");
            let expected = nalgebra::DVector::from_fn(n, |i, _| (up[i] - down[i]) / (2.0 * step));
            let difference = (jacobian.column(j) - &expected).amax();
            assert!(difference < 1e-3 * expected.amax().max(1e-3), "{}: state {j}: {difference}", spec.name);
        }
    }
}
