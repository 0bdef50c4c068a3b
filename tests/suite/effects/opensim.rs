//! Exported effects in real OpenSim.

use std::path::PathBuf;
use std::process::Command;

use carpus::effects::effect::{JointState, OsimForm, TrialContext};
use carpus::effects::export;
use carpus::effects::forward_model::Setting;
use carpus::effects::silent_muscles::SilentMuscles;
use carpus::forces::{Forces, gravity_force, inertia_force};
use carpus::multibody::Model;
use carpus::muscles::Millard2012;
use carpus::osim::spec::ModelSpec;
use carpus::paths::Path as MusclePath;
use carpus::study::MomentPart;
use serde_json::{Value, json};

use super::*;
use crate::reference::{opensim_python, shared};

const STATES: usize = 50;
const MUSCLES: [&str; 5] = ["ECRL", "ECRB", "ECU", "FCR", "FCU"];
/// Of the moment and of forces, relative, or absolute below 1 N·m and 1 N; of rates, relative, or absolute below 1/s.
const TOLERANCE: f64 = 1e-6;

/// Joint and muscles at an instant.
struct State {
    angle: f64,
    speed: f64,
    acceleration: f64,
    activation: [f64; 5],
    excitation: [f64; 5],
}

/// What a model gives there.
#[derive(Default)]
struct Outcome {
    force: f64,
    fiber_length: Vec<f64>,
    tendon_force: Vec<f64>,
    fiber_velocity: Vec<f64>,
    activation_rate: Vec<f64>,
}

fn states() -> Vec<State> {
    let mut seed = 20_u64;
    let mut uniform = |low: f64, high: f64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..STATES)
        .map(|i| State {
            angle: uniform(-1.1, 1.1),
            // Every fifth near rest, where friction is steep.
            speed: if i % 5 == 0 { uniform(-0.05, 0.05) } else { uniform(-4.0, 4.0) },
            acceleration: uniform(-40.0, 40.0),
            activation: std::array::from_fn(|_| uniform(0.02, 1.0)),
            excitation: std::array::from_fn(|_| uniform(0.02, 1.0)),
        })
        .collect()
}

fn posture(model: &Model, angle: f64) -> Vec<f64> {
    let mut q = model.default_coordinates();
    q[model.coordinate("elbow_flexion").unwrap().0] = std::f64::consts::FRAC_PI_2;
    q[model.coordinate("flexion").unwrap().0] = angle;
    q
}

/// Muscles, springs, gravity and inertia about flexion.
fn ours(spec: &ModelSpec, states: &[State]) -> Vec<Outcome> {
    let model = Model::compile(spec).unwrap();
    let forces = Forces::compile(spec, &model).unwrap();
    let coordinate = model.coordinate("flexion").unwrap();
    let muscles: Vec<(MusclePath, Millard2012)> = MUSCLES
        .iter()
        .map(|name| {
            let muscle = spec.muscles.iter().find(|m| m.name == *name).unwrap();
            (MusclePath::compile(&muscle.path, spec, &model).unwrap(), Millard2012::from_spec(muscle).unwrap())
        })
        .collect();
    let mut cache = model.new_cache();
    let at = |state: &State| {
        let q = posture(&model, state.angle);
        let (mut qdot, mut qddot) = (vec![0.0; q.len()], vec![0.0; q.len()]);
        (qdot[coordinate.0], qddot[coordinate.0]) = (state.speed, state.acceleration);
        model.update_positions(&q, &mut cache);
        model.update_velocities(&q, &qdot, &mut cache);
        model.update_unit_motion(&q, coordinate, &mut cache);
        model.update_accelerations(&q, &qdot, &qddot, &mut cache);
        let all = model.all_bodies();
        let mut out = Outcome {
            force: forces.generalized_force(&model, &q, &qdot, &cache)
                + gravity_force(&model, &all, &cache)
                + inertia_force(&model, &all, &cache),
            ..Outcome::default()
        };
        for (i, (path, muscle)) in muscles.iter().enumerate() {
            let mut geometry = path.new_geometry();
            path.update(&q, &cache, &mut geometry);
            let activation = state.activation[i];
            let fiber = muscle.equilibrium(geometry.length(), activation).unwrap();
            let speed = path.lengthening_speed(&q, &qdot, &cache, &geometry);
            let found = muscle.dynamics(fiber.fiber_length, activation, geometry.length(), speed);
            out.force += found.tendon_force * path.moment_arm(&q, &cache, &geometry);
            out.fiber_length.push(fiber.fiber_length);
            out.tendon_force.push(found.tendon_force);
            out.fiber_velocity.push(found.fiber_velocity);
            out.activation_rate.push(muscle.activation_dynamics().derivative(activation, state.excitation[i]));
        }
        out
    };
    states.iter().map(at).collect()
}

/// The moment that the effect itself adds at a state.
fn added(effect: &Setting, state: &State) -> f64 {
    let silent_muscles = SilentMuscles::default();
    let (zero, one) = ([0.0], [1.0; 5]);
    let excitation: Vec<Vec<f64>> = state.excitation.iter().map(|e| vec![*e]).collect();
    let trial = TrialContext {
        time: &zero,
        session: 0.0,
        arm_flipped: false,
        exposure: &one,
        recorded_angle: &[state.angle],
        neutral_angle: 0.0,
        muscle_moment: &zero,
        directions: &one,
        excitation: &excitation,
        silent_muscles: &silent_muscles,
        muscles: &[],
    };
    let joint = JointState {
        trial: &trial,
        angle: &[state.angle],
        speed: &[state.speed],
        acceleration: &[state.acceleration],
        muscles: &[],
    };
    let mut moment = [0.0];
    effect.effect.add_moment(&effect.values, &joint, &mut moment);
    moment[0]
}

struct Case {
    name: String,
    effect: Setting,
    path: PathBuf,
    outcomes: Vec<Outcome>,
    /// The base model with the effect as the catalogue has it.
    expected: Vec<f64>,
}

fn cases(folder: &Path, states: &[State]) -> Vec<Case> {
    let (study, file, _) = study();
    let mut setup = Setup::from_settings(&study.settings);
    setup.parts = vec![MomentPart::Muscles, MomentPart::Passive, MomentPart::Inertia];
    let native = CATALOGUE.iter().filter(|e| matches!(e.description().osim_form, OsimForm::Native(_)));
    let mut cases = Vec::new();
    for (effect, size) in native.flat_map(|e| [(*e, 0.3), (*e, 2.0)]) {
        let id = effect.description().id;
        let effect = sized(effect, size);
        let mut exported = file.clone();
        let report = export::write(&mut exported, &setup, std::slice::from_ref(&effect)).unwrap();
        assert_eq!(report.native.len(), 1, "{id}");
        let name = format!("{id} × {size}");
        let path = folder.join(format!("{id}_{size}.osim"));
        exported.write(&path).unwrap();
        let outcomes = ours(&OsimFile::read(&path).unwrap().spec, states);
        let mut changed = file.spec.clone();
        let mut active: Vec<_> = changed.muscles.clone();
        effect.effect.change_muscles(&effect.values, &mut active);
        changed.muscles = active;
        let base = ours(&changed, states);
        let expected = base.iter().zip(states).map(|(base, state)| base.force + added(&effect, state)).collect();
        cases.push(Case { name, effect, path, outcomes, expected });
    }
    cases
}

fn opensim(cases: &[Case], states: &[State], folder: &Path, python: &Path) -> Value {
    let listed: Vec<Value> = states
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let fibers: Vec<_> = cases.iter().map(|case| case.outcomes[k].fiber_length.clone()).collect();
            json!({
                "coordinates": {
                    "elbow_flexion": std::f64::consts::FRAC_PI_2, "pro_sup": 0.0,
                    "flexion": s.angle, "deviation": 0.0,
                },
                "speed": s.speed, "acceleration": s.acceleration,
                "activation": s.activation, "excitation": s.excitation, "fiber_length": fibers,
            })
        })
        .collect();
    let models: Vec<&PathBuf> = cases.iter().map(|case| &case.path).collect();
    let request = json!({ "models": models, "coordinate": "flexion", "muscles": MUSCLES, "states": listed });
    run_script(&[], &request, folder, python)
}

fn run_script(options: &[&str], request: &Value, folder: &Path, python: &Path) -> Value {
    let file = folder.join("states.json");
    std::fs::write(&file, request.to_string()).unwrap();
    let script = in_repository("fixtures/effects/opensim_states.py");
    let output = Command::new(python).arg(script).args(options).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    let json = text.lines().last().unwrap_or_default();
    serde_json::from_str(json).unwrap_or_else(|e| panic!("{e}: {text:.300}"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn relative(ours: f64, theirs: f64) -> f64 {
    (ours - theirs).abs() / theirs.abs().max(1.0)
}

#[test]
#[cfg_attr(not(has_opensim), ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON)")]
fn val_opensim_exported_effects_give_the_moment_that_carpus_reports() {
    let python = opensim_python();
    let folder = tempfile::tempdir().unwrap();
    let states = states();
    let cases = cases(folder.path(), &states);
    let theirs = opensim(&cases, &states, folder.path(), &python);
    let mut failed = Vec::new();
    for (case, theirs) in cases.iter().zip(theirs.as_array().unwrap()) {
        let mut worst = [0.0_f64; 5];
        let mut note = |i: usize, residual: f64| {
            worst[i] = if residual > worst[i] || residual.is_nan() { residual } else { worst[i] }
        };
        for (k, at) in theirs.as_array().unwrap().iter().enumerate() {
            let force = at["force"].as_f64().unwrap();
            note(0, relative(case.expected[k], force));
            note(1, relative(case.outcomes[k].force, force));
            let ours = &case.outcomes[k];
            for (i, (ours, theirs)) in [
                (&ours.tendon_force, &at["tendon_force"]),
                (&ours.fiber_velocity, &at["fiber_velocity"]),
                (&ours.activation_rate, &at["activation_rate"]),
            ]
            .into_iter()
            .enumerate()
            {
                ours.iter().zip(numbers(theirs)).for_each(|(ours, theirs)| note(2 + i, relative(*ours, theirs)));
            }
        }
        let [effect, read, tendon, fiber, activation] = worst;
        println!(
            "{:34} moment {effect:.1e} (model read again {read:.1e}), tendon force {tendon:.1e}, fibre velocity \
             {fiber:.1e}, activation rate {activation:.1e}",
            case.name
        );
        if !worst.iter().all(|w| *w < TOLERANCE) {
            failed.push(format!("{}: {worst:?} ({:?})", case.name, case.effect));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    assert!(cases.len() >= 20);
}

#[test]
#[cfg_attr(
    not(all(has_opensim, has_lab_models)),
    ignore = "needs a Python with OpenSim 4.6 (CARPUS_PYTHON) and lab models (CARPUS_SHARED)"
)]
fn val_opensim_a_coordinate_that_others_follow_takes_the_forces() {
    // In MoBL-ARMS the carpal rows follow flexion: OpenSim reads its limits in radians.
    let (python, path) = (opensim_python(), shared("models/MOBL_ARMS_fixed_41.osim"));
    let folder = tempfile::tempdir().unwrap();
    let mut file = OsimFile::read(&path).unwrap();
    let setup = Setup {
        coordinate: "flexion".to_owned(),
        posture: Vec::new(),
        active_muscles: Vec::new(),
        parts: vec![MomentPart::Muscles, MomentPart::Passive],
        dynamometer_damping: 0.0,
        allow_unsupported: true,
    };
    let ids = [
        "joint_stiffness",
        "ligament_stop",
        "end_range_spring",
        "joint_damping",
        "power_law_damping",
        "coulomb_friction",
        "gravity",
    ];
    let effects: Vec<Setting> = ids.iter().map(|id| sized(named(id), 1.5)).collect();
    let report = export::write(&mut file, &setup, &effects).unwrap();
    assert_eq!(report.native.len(), ids.len());
    let exported = folder.path().join("exported.osim");
    file.write(&exported).unwrap();
    let states = states();
    let listed: Vec<[f64; 2]> = states.iter().map(|s| [s.angle, s.speed]).collect();
    let names: Vec<String> = ids.iter().map(|id| format!("carpus_{id}")).collect();
    let request = json!({ "model": exported, "coordinate": "flexion", "forces": names, "states": listed });
    let theirs = run_script(&["--forces"], &request, folder.path(), &python);
    let mut worst = 0.0_f64;
    for (state, theirs) in states.iter().zip(theirs.as_array().unwrap()) {
        for (effect, theirs) in effects.iter().zip(numbers(theirs)) {
            let off = relative(added(effect, state), theirs);
            assert!(off < TOLERANCE, "{effect:?} at {} rad: {off:.1e}", state.angle);
            worst = worst.max(off);
        }
    }
    println!("forces on a coordinate that others follow: {worst:.1e}");
}
