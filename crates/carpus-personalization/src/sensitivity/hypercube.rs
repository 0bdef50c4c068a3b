//! Latin hypercube samples: every parameter's range is cut in n slices, and every slice is visited once.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `n` points in the unit cube of `m` dimensions; in each dimension one in each of n equal slices, at random in it.
///
/// # References
/// McKay, Beckman & Conover (1979), doi:10.1080/00401706.1979.10489755
pub fn latin_hypercube(n: usize, m: usize, seed: u64) -> Vec<Vec<f64>> {
    sample(n, m, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// The one of `candidates` (at least 1) Latin hypercubes whose two closest points are farthest apart.
///
/// # References
/// Johnson, Moore & Ylvisaker (1990), doi:10.1016/0378-3758(90)90122-B
pub fn maximin_latin_hypercube(n: usize, m: usize, candidates: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut best = sample(n, m, &mut random);
    let mut farthest = closest_squared(&best);
    for _ in 1..candidates {
        let candidate = sample(n, m, &mut random);
        let distance = closest_squared(&candidate);
        if distance > farthest {
            (best, farthest) = (candidate, distance);
        }
    }
    best
}

fn sample(n: usize, m: usize, random: &mut impl Rng) -> Vec<Vec<f64>> {
    let mut points = vec![vec![0.0; m]; n];
    let mut slices: Vec<usize> = (0..n).collect();
    for dimension in 0..m {
        shuffle(&mut slices, random);
        for (point, slice) in points.iter_mut().zip(&slices) {
            point[dimension] = (*slice as f64 + random.random::<f64>()) / n as f64;
        }
    }
    points
}

/// All orders equally likely (Fisher–Yates).
pub(super) fn shuffle<T>(items: &mut [T], random: &mut impl Rng) {
    for i in (1..items.len()).rev() {
        items.swap(i, random.random_range(0..=i));
    }
}

/// Square of the smallest distance between two points.
fn closest_squared(points: &[Vec<f64>]) -> f64 {
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
    let pairs = (0..points.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs.map(|(i, j)| distance(&points[i], &points[j])).fold(f64::INFINITY, f64::min)
}
