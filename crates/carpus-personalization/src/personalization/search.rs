//! Points from which searches within a box start: Latin hypercubes.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Objective of a parameter set that cannot be simulated: worse than any that can.
pub(super) const UNUSABLE: f64 = 1e3;

/// `count` points of a Latin hypercube in the unit box of dimension `n`: every coordinate is stratified.
pub(super) fn latin_hypercube(count: usize, n: usize, seed: u64, stream: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    let mut points = vec![vec![0.0; n]; count];
    for k in 0..n {
        let mut strata: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            strata.swap(i, rng.random_range(0..=i));
        }
        for (point, stratum) in points.iter_mut().zip(strata) {
            point[k] = (stratum as f64 + rng.random::<f64>()) / count as f64;
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_latin_hypercube_is_stratified_and_repeatable() {
        let points = latin_hypercube(16, 5, 7, 1);
        for k in 0..5 {
            let mut strata: Vec<usize> = points.iter().map(|p| (p[k] * 16.0) as usize).collect();
            strata.sort_unstable();
            assert_eq!(strata, (0..16).collect::<Vec<_>>());
        }
        assert_eq!(points, latin_hypercube(16, 5, 7, 1));
        assert_ne!(points, latin_hypercube(16, 5, 8, 1));
    }
}
