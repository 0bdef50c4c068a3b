//! Lengths of muscles that jump where an integration ends: no step is short enough for what is not continuous.

use super::error::PathJump;
use super::plant::{Plant, PlantMuscle};

/// Times from where the integration ended at which lengths are looked at [s], both ways.
const TIMES: [f64; 8] = [1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3];
/// A shorter change of length is no jump [m].
const SMALLEST: f64 = 1e-3;
/// Nor is one that a muscle may make at this speed [m/s], some ten times that of the fastest muscles.
const FASTEST: f64 = 20.0;

/// The largest jump nearest to a state, along the way that leads through it.
///
/// - `x`, `slope`: the state and its rates
pub(super) fn path_jump(plant: &Plant, time: f64, x: &[f64], slope: &[f64]) -> Option<PathJump> {
    let mut work = plant.new_work();
    let excitation = vec![0.0; plant.n_excitations()];
    let mut cache = plant.model.new_cache();
    let mut lengths = |after: f64| -> Vec<f64> {
        let moved: Vec<f64> = x.iter().zip(slope).map(|(x, rate)| x + after * rate).collect();
        let q = plant.unpack(time + after, &moved, &excitation, &mut work).q;
        plant.model.update_positions(&q, &mut cache);
        let length = |muscle: &PlantMuscle| {
            let mut geometry = muscle.path.new_geometry();
            muscle.path.update(&q, &cache, &mut geometry);
            geometry.length()
        };
        plant.muscles.iter().map(length).collect()
    };
    let here = lengths(0.0);
    for after in TIMES.iter().flat_map(|time| [*time, -*time]) {
        let there = lengths(after);
        let size = |k: usize| (there[k] - here[k]).abs();
        let largest = (0..here.len()).filter(|k| size(*k).is_finite()).max_by(|a, b| size(*a).total_cmp(&size(*b)))?;
        if size(largest) > SMALLEST + FASTEST * after.abs() {
            let muscle = plant.muscles[largest].muscle.name().to_owned();
            return Some(PathJump { muscle, lengths: [here[largest], there[largest]] });
        }
    }
    None
}
