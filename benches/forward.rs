//! How long forward simulation of a whole model takes: a fall under gravity, muscles at constant excitation.
//!
//! ```text
//! cargo bench --bench forward -- --model MODEL.osim [--seconds S] [--rest E] [--accuracy A]… [--reference REF.json] \
//!     [--repeat N] [--json]
//! ```
//! From the default pose, muscles in equilibrium at the excitation E (0.02). `REF.json` is a trajectory of
//! `fixtures/scripts/forward.py`, which then gives seconds, rows and excitation. Processor seconds of one thread, the
//! least of N runs. Printed per accuracy: seconds, the same over simulated time, steps, and the largest difference of a
//! coordinate from the reference [rad or m]. `benches/forward.py` runs this together with OpenSim.

use std::path::PathBuf;

use carpus::dynamics::{ForwardOptions, Plant, PlantState, Trajectory, simulate_forward};
use carpus::multibody::Model;
use carpus::osim::OsimFile;
use cpu_time::ProcessTime;
use serde_json::{Value, json};

fn main() {
    if let Err(message) = run() {
        eprintln!("{message}");
        std::process::exit(1);
    }
}

struct Arguments {
    model: PathBuf,
    reference: Option<Value>,
    seconds: f64,
    rest: f64,
    accuracies: Vec<f64>,
    repeat: usize,
    json: bool,
}

fn arguments() -> Result<Arguments, String> {
    let mut found = Arguments {
        model: PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/models/wrist.osim")),
        reference: None,
        seconds: 0.2,
        rest: 0.02,
        accuracies: Vec::new(),
        repeat: 3,
        json: false,
    };
    let mut args = std::env::args().skip(1);
    while let Some(name) = args.next() {
        let mut value = || args.next().ok_or(format!("{name}: a value is missing"));
        let number = |text: String| text.parse::<f64>().map_err(|e| format!("{name}: {text}: {e}"));
        match name.as_str() {
            "--model" => found.model = value()?.into(),
            "--seconds" => found.seconds = number(value()?)?,
            "--rest" => found.rest = number(value()?)?,
            "--accuracy" => found.accuracies.push(number(value()?)?),
            "--repeat" => found.repeat = number(value()?)?.max(1.0) as usize,
            "--reference" => {
                let path = value()?;
                let text = std::fs::read_to_string(&path).map_err(|e| format!("{path}: {e}"))?;
                found.reference = Some(serde_json::from_str(&text).map_err(|e| format!("{path}: {e}"))?);
            }
            "--json" => found.json = true,
            "--bench" => {}
            _ => return Err(format!("{name}: no such option")),
        }
    }
    if found.accuracies.is_empty() {
        found.accuracies = vec![1e-4, 1e-5, 1e-6];
    }
    Ok(found)
}

fn run() -> Result<(), String> {
    let arguments = arguments()?;
    let path = arguments.model.display().to_string();
    let bytes = std::fs::read(&arguments.model).map_err(|e| format!("{path}: {e}"))?;
    let spec = OsimFile::parse(bytes, &path).map_err(|e| e.to_string())?.spec;
    let model = Model::compile(&spec).map_err(|e| e.to_string())?;
    let plant = Plant::compile(&spec, &model, false).map_err(|e| e.to_string())?;
    let rows = arguments.reference.as_ref().and_then(|r| r["rows"].as_array());
    let rest = arguments.reference.as_ref().and_then(|r| r["rest"].as_f64()).unwrap_or(arguments.rest);
    let times: Vec<f64> = match rows {
        Some(rows) => rows.iter().filter_map(|row| row["time"].as_f64()).collect(),
        None => (0..=20).map(|k| arguments.seconds * f64::from(k) / 20.0).collect(),
    };
    let excitation = vec![rest; plant.muscles.len()];
    let (q, u) = (model.default_coordinates(), vec![0.0; model.n_coordinates()]);
    let mut work = plant.new_work();
    let start = plant.equilibrium_state(0.0, &q, &u, &excitation, &mut work).map_err(|e| e.to_string())?;
    let mut results = Vec::new();
    for &accuracy in &arguments.accuracies {
        let options = ForwardOptions {
            times: times.clone(),
            accuracy,
            first_step: 1e-3,
            step_range: [0.0, f64::INFINITY],
            most_steps: 1_000_000,
        };
        let (seconds, trajectory) = fastest(&plant, &start, &excitation, &options, arguments.repeat)?;
        let simulated = times.last().copied().unwrap_or(0.0);
        let difference = rows.map(|rows| difference(&model, &trajectory, rows));
        let cost = trajectory.cost;
        println!(
            "accuracy {accuracy:e}: {seconds:.3} s for {simulated} s ({:.2} of simulated time), {} steps{}",
            seconds / simulated,
            cost.steps,
            difference.map_or(String::new(), |d| format!(", largest difference {d:.1e}"))
        );
        results.push(json!({
            "accuracy": accuracy, "cpu_s": seconds, "simulated_s": simulated, "steps": cost.steps,
            "jacobians": cost.jacobians, "derivatives": cost.derivatives, "difference": difference,
        }));
    }
    if arguments.json {
        println!("{}", json!({ "model": path, "rest": rest, "runs": results }));
    }
    Ok(())
}

/// Processor seconds of the fastest of some runs, and its trajectory.
fn fastest(
    plant: &Plant,
    start: &PlantState,
    excitation: &[f64],
    options: &ForwardOptions,
    repeat: usize,
) -> Result<(f64, Trajectory), String> {
    let mut best: Option<(f64, Trajectory)> = None;
    for _ in 0..repeat {
        let started = ProcessTime::now();
        let excite = |_: f64, e: &mut [f64]| e.copy_from_slice(excitation);
        let trajectory = simulate_forward(plant, start, excite, options).map_err(|e| e.to_string())?;
        let seconds = started.elapsed().as_secs_f64();
        if best.as_ref().is_none_or(|(least, _)| seconds < *least) {
            best = Some((seconds, trajectory));
        }
    }
    best.ok_or_else(|| "nothing was run".to_owned())
}

/// Largest difference of a coordinate from the reference [rad or m].
fn difference(model: &Model, trajectory: &Trajectory, rows: &[Value]) -> f64 {
    let mut largest = 0.0_f64;
    for (state, row) in trajectory.states.iter().zip(rows) {
        for (coordinate, q) in model.coordinates.iter().zip(&state.q) {
            let expected = row["q"][&coordinate.name].as_f64().unwrap_or(f64::NAN);
            largest = if expected.is_nan() { f64::NAN } else { largest.max((q - expected).abs()) };
        }
    }
    largest
}
