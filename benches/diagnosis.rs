//! How long a diagnosis takes, and of what.
//!
//! ```text
//! cargo bench --bench diagnosis -- [STUDY/study.toml]
//! ```
//! Without an argument the bundled study. All threads of rayon's pool (`RAYON_NUM_THREADS`). Times of evaluations are
//! the best of five.

use std::path::{Path, PathBuf};
use std::time::Instant;

use carpus::diagnosis::diagnose::{Request, diagnose};
use carpus::effects::catalogue::CATALOGUE;
use carpus::effects::forward_model::{DIAGNOSIS_ACCURACY, ForwardModel, Setting};
use carpus::osim::OsimFile;
use carpus::simulation::{MusculoskeletalModel, Setup, SimulationError};
use carpus::study::{Study, TrialUse};
use rayon::prelude::*;

fn main() {
    let argument = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo_study/study.toml");
    if let Err(message) = run(&argument.map_or(bundled, PathBuf::from)) {
        eprintln!("{message}");
        std::process::exit(1);
    }
}

fn run(path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let study = Study::read(path).map_err(|e| e.to_string())?;
    let model_path = path.parent().unwrap_or(Path::new(".")).join(&study.settings.model);
    let file = OsimFile::read(&model_path)?;
    let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings))?;
    let participant = study.participants.first().ok_or("no participant")?.name.clone();
    let trials = study.load_trials(&participant).map_err(|e| e.to_string())?;
    let start = Instant::now();
    let forward = ForwardModel::with_accuracy(&file.spec, &model, &trials, DIAGNOSIS_ACCURACY)?;
    report("model and trials prepared", start.elapsed().as_secs_f64());
    let train = forward.trials_for(TrialUse::Train);
    println!("{} training trials, {} threads", train.len(), rayon::current_num_threads());
    report("one evaluation without effects", best(|| evaluate(&forward, &train, &[]))?);
    for effect in CATALOGUE {
        let name = format!("derivatives by {}", effect.description().id);
        report(&name, best(|| evaluate(&forward, &train, &[Setting::absent(*effect)]))?);
    }
    let request = Request {
        images: Vec::new(),
        laboratory: None,
        participant,
        forward: &forward,
        bounds: study.settings.bounds,
        candidates: Vec::new(),
        mvc: trials.iter().map(|t| t.max_abs_moment()).fold(0.0, f64::max),
        seed: 0,
    };
    let start = Instant::now();
    let outcome = diagnose(&request, &|_| {})?;
    report(&format!("diagnosis ({:?})", outcome.diagnosis.verdict), start.elapsed().as_secs_f64());
    Ok(())
}

fn report(what: &str, seconds: f64) {
    println!("{:10.3} ms  {what}", 1e3 * seconds);
}

fn best(mut evaluate: impl FnMut() -> Result<(), SimulationError>) -> Result<f64, SimulationError> {
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let start = Instant::now();
        evaluate()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// Simulates all trials with derivatives by muscle parameters and by the amplitudes of the effects.
fn evaluate(forward: &ForwardModel, trials: &[usize], effects: &[Setting]) -> Result<(), SimulationError> {
    let variant = forward.variant(effects)?;
    let parameters = forward.nominal_parameters();
    for which in 0..effects.len() {
        let variants = forward.difference_variants(effects, which)?;
        trials.par_iter().try_for_each(|&g| {
            let input = forward.recorded_input(g);
            let core = forward.core(&variant, g, &input, &parameters, effects, true)?;
            for p in effects[which].effect.description().amplitudes() {
                forward.effect_derivative(g, &core, &input, &parameters, effects, which, &variants, p)?;
            }
            Ok::<(), SimulationError>(())
        })?;
    }
    if effects.is_empty() {
        trials.par_iter().try_for_each(|&g| {
            forward.core(&variant, g, &forward.recorded_input(g), &parameters, effects, true).map(|_| ())
        })?;
    }
    Ok(())
}
