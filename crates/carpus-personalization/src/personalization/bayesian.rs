//! Bayesian optimization in the unit box, through the crate `optimizer`: a Gaussian process with a Matérn 5/2 kernel, and
//! expected improvement.

use optimizer::parameter::{FloatParam, Parameter};
use optimizer::sampler::gp::GpSampler;
use optimizer::{Direction, Study};

use super::search::Found;

/// Points at which the process is first observed, at random.
const FIRST_POINTS: usize = 10;
/// Random points among which the expected improvement is maximized.
const CANDIDATES: usize = 1000;

/// The best of `evaluations` points, each where the expected improvement over the points before is largest.
///
/// The length scales are those of the spread of the points, not fitted, and the process knows the last 100 points: what the
/// crate does. `fmincon`'s counterpart follows in [`super::sqp`].
///
/// # References
/// Jones, Schonlau & Welch (1998), doi:10.1023/A:1008306431147
pub(super) fn minimize_by_expected_improvement(
    cost: &dyn Fn(&[f64]) -> f64,
    n: usize,
    evaluations: usize,
    seed: u64,
) -> Result<Found, String> {
    let sampler = GpSampler::builder().n_startup_trials(FIRST_POINTS).n_candidates(CANDIDATES).seed(seed).build();
    let study: Study<f64> = Study::with_sampler(Direction::Minimize, sampler);
    let coordinates: Vec<FloatParam> = (0..n).map(|i| FloatParam::new(0.0, 1.0).name(format!("x{i}"))).collect();
    let mut best = Found { point: vec![0.5; n], cost: f64::INFINITY, evaluations };
    for _ in 0..evaluations {
        let mut trial = study.ask();
        let point: Vec<f64> =
            coordinates.iter().map(|x| x.suggest(&mut trial)).collect::<Result<_, _>>().map_err(|e| e.to_string())?;
        let value = cost(&point);
        if value < best.cost {
            (best.point, best.cost) = (point, value);
        }
        study.tell(trial, Ok::<f64, &str>(value));
    }
    Ok(best)
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
        let found = minimize_by_expected_improvement(&branin, 2, 60, 3).unwrap();
        assert!(found.cost < 0.397887 + 0.1, "{}", found.cost);
        let again = minimize_by_expected_improvement(&branin, 2, 60, 3).unwrap();
        assert_eq!(found.point, again.point);
    }
}
