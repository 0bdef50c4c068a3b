//! Time per pose and per unit motion, of all bodies and of those that one coordinate moves, and to compile a model.
//!
//! `cargo bench --bench kinematics [-- MODEL.osim COORDINATE]`; without arguments the project's own wrist model.

use carpus::multibody::Model;
use carpus::osim::OsimFile;
use std::hint::black_box;
use std::time::Instant;

/// Poses per round.
const SAMPLES: usize = 1000;
/// Rounds; the fastest counts.
const ROUNDS: usize = 100;

/// Nanoseconds per call of `work` in the fastest round.
fn nanoseconds(mut work: impl FnMut(usize)) -> f64 {
    let round = |_| {
        let start = Instant::now();
        (0..SAMPLES).for_each(&mut work);
        start.elapsed().as_secs_f64() * 1e9 / SAMPLES as f64
    };
    (0..ROUNDS).map(round).fold(f64::INFINITY, f64::min)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/models/wrist.osim");
    let path = arguments.first().map_or(own, String::as_str);
    let start = Instant::now();
    let file = OsimFile::read(path)?;
    let read = start.elapsed();
    let start = Instant::now();
    let model = Model::compile(&file.spec)?;
    println!(
        "{path}: read in {:.1} ms, compiled in {:.3} ms",
        read.as_secs_f64() * 1e3,
        start.elapsed().as_secs_f64() * 1e3
    );

    let name = arguments.get(1).map_or("flexion", String::as_str);
    let c = model.coordinate(name).ok_or(format!("no coordinate {name}"))?;
    let mut q = model.default_coordinates();
    let mut cache = model.new_cache();
    model.update_positions(&q, &mut cache);
    let moved = model.bodies_moved_by(&[c]);
    println!("{} bodies, {} of them moved by {name}", model.bodies.len(), moved.len());
    let [low, high] = model.coordinates[c.0].range;
    let pose = |q: &mut Vec<f64>, i: usize| {
        q[c.0] = low + (high - low) * i as f64 / SAMPLES as f64;
        model.satisfy_couplers(q);
    };
    let all = nanoseconds(|i| {
        pose(&mut q, i);
        model.update_positions(&q, &mut cache);
        black_box(&cache);
    });
    let subset = nanoseconds(|i| {
        pose(&mut q, i);
        model.update_positions_in(&moved, &q, &mut cache);
        black_box(&cache);
    });
    let unit = nanoseconds(|i| {
        pose(&mut q, i);
        model.update_unit_motion_in(&moved, &q, c, &mut cache);
        black_box(&cache);
    });
    println!(
        "poses of all bodies {all:.0} ns, of moved bodies {subset:.0} ns, unit motion of moved bodies {unit:.0} ns"
    );
    Ok(())
}
