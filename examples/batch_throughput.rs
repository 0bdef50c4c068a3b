//! How many simulations of trials a second all cores do, with other muscle parameters every time: what
//! `Session.simulate(parameters)` of the Python package is measured against (`python/benchmarks/batch.py`). `cargo run
//! --release --example batch_throughput`.

use std::time::Instant;

use carpus::Study;
use carpus::simulation::{MuscleParameters, PreparedTrial, SimulationError};
use rayon::prelude::*;

/// Sets of parameters in a call.
const SETS: usize = 400;
/// Calls, of which the fastest counts.
const CALLS: usize = 5;

/// The moment of a trial [N·m].
fn moment(trial: &PreparedTrial, parameters: &[MuscleParameters]) -> Result<Vec<f64>, SimulationError> {
    let mut moment = trial.moment_without_muscles();
    let mut unit = vec![0.0; trial.len()];
    for (muscle, p) in parameters.iter().enumerate() {
        unit.fill(0.0);
        trial.add_unit_moment(muscle, p, &mut unit)?;
        moment.iter_mut().zip(&unit).for_each(|(m, u)| *m += p.max_isometric_force * u);
    }
    Ok(moment)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let study = Study::open("fixtures/demo_study")?;
    let session = study.participants().next().ok_or("there is a participant")?.load()?;
    let (trials, nominal) = (&session.data.prepared, session.data.model.nominal_parameters());
    let set = |i: usize| -> Vec<MuscleParameters> {
        let factor = 0.97 + 0.06 * (i as f64 / SETS as f64);
        let scaled =
            |p: &MuscleParameters| MuscleParameters { optimal_fiber_length: factor * p.optimal_fiber_length, ..*p };
        nominal.iter().map(scaled).collect()
    };
    let sets: Vec<Vec<MuscleParameters>> = (0..SETS).map(set).collect();
    let mut best = f64::INFINITY;
    for _ in 0..CALLS {
        let begun = Instant::now();
        let of_set = |set: &Vec<MuscleParameters>| trials.iter().map(|t| moment(t, set)).collect::<Result<Vec<_>, _>>();
        let moments = sets.par_iter().map(of_set).collect::<Result<Vec<_>, _>>()?;
        best = best.min(begun.elapsed().as_secs_f64());
        assert_eq!(moments.len(), SETS);
    }
    println!("{:.0} simulations/s", (SETS * trials.len()) as f64 / best);
    Ok(())
}
