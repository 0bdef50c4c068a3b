//! Random numbers.

use carpus_numerics::statistics::normal_of_uniform;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A draw from N(0, 1).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    normal_of_uniform([rng.random::<f64>().max(1e-300), rng.random()])
}
