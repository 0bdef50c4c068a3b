//! Bayesian optimization in the unit box: a Gaussian process through the points evaluated so far, and the next point
//! where the expected improvement over the best of them is largest.

use carpus_numerics::statistics::normal_cdf;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::gaussian_process::GaussianProcess;
use super::minimizers::Found;

/// Points at which the process is first observed, at random.
const FIRST_POINTS: usize = 10;
/// Random points among which the expected improvement is maximized.
const CANDIDATES: usize = 1000;

/// The best of `evaluations` points, each where the expected improvement over the points before is largest.
///
/// `fmincon`'s counterpart follows in [`super::minimizers`].
///
/// # References
/// Jones, Schonlau & Welch (1998), doi:10.1023/A:1008306431147
pub(super) fn minimize_by_expected_improvement(
    cost: &dyn Fn(&[f64]) -> f64,
    n: usize,
    evaluations: usize,
    seed: u64,
) -> Found {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut random_point = || -> Vec<f64> { (0..n).map(|_| rng.random::<f64>()).collect() };
    let (mut points, mut costs): (Vec<Vec<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut best = Found { point: vec![0.5; n], cost: f64::INFINITY, evaluations };
    for k in 0..evaluations {
        let process = if k < FIRST_POINTS { None } else { GaussianProcess::through(&points, &costs) };
        let point = match process {
            None => random_point(),
            Some(process) => {
                let candidates = (0..CANDIDATES).map(|_| random_point());
                let rated = candidates.map(|x| (expected_improvement(process.at(&x), best.cost), x));
                rated.fold((-1.0, Vec::new()), |most, new| if new.0 > most.0 { new } else { most }).1
            }
        };
        let value = cost(&point);
        if value < best.cost {
            (best.point, best.cost) = (point.clone(), value);
        }
        points.push(point);
        costs.push(value);
    }
    best
}

/// (f − μ) Φ(z) + σ φ(z), z = (f − μ)/σ: how much lower than f a normally distributed cost is expected to be, where it
/// is lower; 0 where it is not.
fn expected_improvement((mean, sd): (f64, f64), best: f64) -> f64 {
    if sd <= 0.0 {
        return (best - mean).max(0.0);
    }
    let z = (best - mean) / sd;
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    ((best - mean) * normal_cdf(z) + sd * density).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Branin's function on the unit square: three minima of 0.397887.
    fn branin(x: &[f64]) -> f64 {
        let (a, b) = (15.0 * x[0] - 5.0, 15.0 * x[1]);
        let pi = std::f64::consts::PI;
        (b - 5.1 / (4.0 * pi * pi) * a * a + 5.0 / pi * a - 6.0).powi(2)
            + 10.0 * (1.0 - 1.0 / (8.0 * pi)) * a.cos()
            + 10.0
    }

    #[test]
    fn verif_branin_is_nearly_minimized_and_repeatable() {
        let found = minimize_by_expected_improvement(&branin, 2, 60, 3);
        assert!(found.cost < 0.397887 + 0.1, "{}", found.cost);
        let again = minimize_by_expected_improvement(&branin, 2, 60, 3);
        assert_eq!(found.point, again.point);
    }

    /// The mean of max(0, f − y) over a fine grid of the normal distribution of y.
    #[test]
    fn verif_expected_improvement_is_that_of_a_sum_over_the_distribution() {
        for (mean, sd, best) in [(1.0, 0.5, 1.2), (1.0, 0.5, 0.2), (-3.0, 2.0, 1.0)] {
            let step = 1e-4;
            let sum: f64 = (-80_000..80_000)
                .map(|k| f64::from(k) * step)
                .map(|z| (best - mean - sd * z).max(0.0) * (-0.5 * z * z).exp() * step)
                .sum();
            let expected = sum / std::f64::consts::TAU.sqrt();
            assert!((expected_improvement((mean, sd), best) - expected).abs() < 1e-6);
        }
        assert_eq!(expected_improvement((1.0, 0.0), 3.0), 2.0);
    }
}
