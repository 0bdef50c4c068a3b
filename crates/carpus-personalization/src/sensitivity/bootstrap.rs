//! Percentile intervals by resampling.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// 95 % percentile interval of a statistic over resamples, with replacement, of `n` items.
///
/// - `statistic`: of a list of item indices; resamples where it is not finite are left out
/// - `stream`: separates the random numbers of different statistics of one analysis
pub(super) fn interval_95(
    n: usize,
    resamples: usize,
    seed: u64,
    stream: u64,
    statistic: impl Fn(&[usize]) -> f64,
) -> Option<[f64; 2]> {
    if n < 2 || resamples == 0 {
        return None;
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    let mut items = vec![0; n];
    let mut values: Vec<f64> = (0..resamples)
        .map(|_| {
            items.iter_mut().for_each(|item| *item = random.random_range(0..n));
            statistic(&items)
        })
        .filter(|value| value.is_finite())
        .collect();
    values.sort_by(f64::total_cmp);
    let at = |fraction: f64| {
        let position = fraction * (values.len() as f64 - 1.0);
        let below = position.floor() as usize;
        let above = (below + 1).min(values.len() - 1);
        values[below] + (position - below as f64) * (values[above] - values[below])
    };
    (!values.is_empty()).then(|| [at(0.025), at(0.975)])
}
