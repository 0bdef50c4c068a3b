//! The variances of the noise and its correlations in time, by restricted maximum likelihood (REML).
//!
//! # References
//! Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal,
//! doi:10.1093/biomet/58.3.545.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::levels::{COMPONENTS, EMG, NoiseLevels, SLOW};
use super::trial_noise::{TrialNoise, factor};
use crate::ONE_BY_ONE;
use crate::kernel::{Family, Kernel};
use carpus_numerics::numerics::cholesky;

/// Iterations of the variance estimate.
const ITERATIONS: usize = 6;
/// Standard deviation of the EMG's noise between laboratories and sessions, as a factor.
const USUAL_FACTOR: f64 = 1.5;
/// Standard deviation of slow disturbances between directions of effort, as a factor.
const DIRECTION_FACTOR: f64 = 1.5;

/// Restricted maximum likelihood of the variances, by Fisher scoring with the exact gradient. The EMG's have a prior,
/// what laboratories usually see ([`NoiseLevels::default`]; standard deviations times or over 2.25 in 95 of 100): of
/// the gain per trial a session says little, because it has few trials and many directions compete for what differs
/// between them. Slow disturbances of one direction of effort are expected to be those of the others, times or over a
/// factor.
///
/// ```text
/// ∂ℓ/∂σᵢ² = ½ (rᵀ P Vᵢ P r − tr(P Vᵢ)),   Iᵢⱼ ≈ ½ tr(V⁻¹ Vᵢ V⁻¹ Vⱼ)
/// ```
/// - `trials`: noise structure, regressors X and residual of every trial
/// - `precision`: prior precision of the regressors' coefficients (mean 0)
/// - `least_white`: least standard deviation of white noise of the moment [N·m], [`LEAST_WHITE`] or more
pub fn estimate(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    least_white: f64,
    start: NoiseLevels,
) -> NoiseLevels {
    estimate_within(ITERATIONS, trials, precision, least_white, start)
}

/// As [`estimate`], with at most this many iterations.
pub fn estimate_within(
    iterations: usize,
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    least_white: f64,
    start: NoiseLevels,
) -> NoiseLevels {
    let mut levels = start;
    for _ in 0..iterations {
        let Some((mut gradient, mut information)) = gradient(trials, precision, &levels) else { return levels };
        for (i, mean, precision) in priors(&levels) {
            let level = levels.0[i];
            gradient[i] += precision * (mean - level.ln()) / level;
            information[(i, i)] += precision / (level * level);
        }
        let mut largest = 0.0_f64;
        let Some(solver) = information.cholesky() else { return levels };
        let step = solver.solve(&gradient);
        for i in 0..COMPONENTS {
            let old = levels.0[i];
            levels.0[i] = (old + step[i]).clamp(0.25 * old, 4.0 * old).clamp(SMALLEST[i], LARGEST[i]);
            levels.0[0] = levels.0[0].max(least_white * least_white);
            largest = largest.max((levels.0[i] / old).ln().abs());
        }
        if largest < 0.02 {
            break;
        }
    }
    levels
}

/// What is expected of variances before the data: which, mean of the logarithm, precision of the logarithm.
fn priors(levels: &NoiseLevels) -> impl Iterator<Item = (usize, f64, f64)> {
    let of_directions = SLOW.map(|i| levels.0[i].ln()).sum::<f64>() / SLOW.len() as f64;
    let usual = NoiseLevels::default().0;
    let precision = |factor: f64| (2.0 * factor.ln()).powi(-2);
    let of_emg = EMG.map(move |i| (i, usual[i].ln(), precision(USUAL_FACTOR)));
    of_emg.chain(SLOW.map(move |i| (i, of_directions, precision(DIRECTION_FACTOR))))
}

/// −2 log of what is expected of variances before the data, up to a constant.
pub fn prior_deviance(levels: &NoiseLevels) -> f64 {
    priors(levels).map(|(i, mean, precision)| precision * (levels.0[i].ln() - mean).powi(2)).sum()
}

/// How well the variances are known: covariance of their logarithms, from `½ tr(P Vᵢ P Vⱼ)` of the trials' own blocks
/// of P and what is expected before the data.
///
/// - `trials`, `precision`: as for [`estimate`]
pub fn spread(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<DMatrix<f64>> {
    let parts: Vec<DMatrix<f64>> = projected(trials, precision, levels)?
        .par_iter()
        .with_max_len(ONE_BY_ONE)
        .zip(trials)
        .map(|(p, (noise, ..))| noise.information(&p.projection))
        .collect();
    let mut of_logarithms = DMatrix::zeros(COMPONENTS, COMPONENTS);
    parts.iter().for_each(|part| of_logarithms += part);
    for ((i, j), v) in
        (0..COMPONENTS * COMPONENTS).map(|k| (k / COMPONENTS, k % COMPONENTS)).zip(of_logarithms.as_mut_slice())
    {
        *v *= levels.0[i] * levels.0[j];
    }
    for (i, _, precision) in priors(levels) {
        of_logarithms[(i, i)] += precision;
    }
    Some(of_logarithms.cholesky()?.inverse())
}

/// −2 log of the restricted likelihood, up to a constant; infinite where V cannot be factored.
pub fn restricted_deviance(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> f64 {
    let parts: Vec<_> = trials
        .par_iter()
        .with_max_len(ONE_BY_ONE)
        .filter_map(|(noise, x, r)| {
            let factor = factor(noise, levels)?;
            let lower = factor.l_dirty();
            let determinant: f64 = lower.diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            let mut all = DMatrix::zeros(r.len(), x.ncols() + 1);
            all.columns_mut(0, x.ncols()).copy_from(x);
            all.set_column(x.ncols(), r);
            lower.solve_lower_triangular_mut(&mut all);
            Some((determinant, all.tr_mul(&all)))
        })
        .collect();
    if parts.len() < trials.len() {
        return f64::INFINITY;
    }
    let n = precision.len();
    let mut total = DMatrix::zeros(n + 1, n + 1);
    let mut deviance = 0.0;
    for (determinant, products) in parts {
        deviance += determinant;
        total += products;
    }
    let information = total.view((0, 0), (n, n)) + DMatrix::from_diagonal(precision);
    let right = total.view((0, n), (n, 1)).into_owned();
    let Some(solver) = cholesky(information) else { return f64::INFINITY };
    let fitted = right.dot(&solver.solve(&right));
    deviance + solver.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>() + total[(n, n)] - fitted
}

/// Longest and shortest correlation that is considered [s].
const LENGTHS: [f64; 2] = [0.02, 1.5];
/// Ratio of neighbouring lengths that are compared.
const LENGTH_RATIO: f64 = 1.4;

/// The kernel of least `deviance`: of every family the best length, found by steps from the length at hand and then
/// where the parabola through the best and its neighbours is least.
///
/// - `families`: that are compared
pub fn best_kernel(start: &Kernel, families: &[Family], mut deviance: impl FnMut(&Kernel) -> f64) -> Kernel {
    let mut best = (f64::INFINITY, *start);
    let mut length = start.length;
    for family in families.iter().copied() {
        let mut at = |steps: f64| {
            let length = (length * LENGTH_RATIO.powf(steps)).clamp(LENGTHS[0], LENGTHS[1]);
            let kernel = Kernel { family, length };
            (deviance(&kernel), kernel)
        };
        let (mut here, mut steps) = (at(0.0), 0.0);
        let (up, down) = (at(1.0), at(-1.0));
        let direction = if up.0 < here.0 && up.0 <= down.0 { 1.0 } else { -1.0 };
        let (mut before, mut next) = if direction > 0.0 { (down, up) } else { (up, down) };
        while next.0 < here.0 && next.1.length != here.1.length {
            steps += direction;
            (before, here) = (here, next);
            next = at(steps + direction);
        }
        let bend = before.0 - 2.0 * here.0 + next.0;
        if bend > 0.0 && bend.is_finite() {
            let vertex = at(steps + direction * 0.5 * (before.0 - next.0) / bend);
            here = if vertex.0 < here.0 { vertex } else { here };
        }
        if here.0 < best.0 {
            best = here;
        }
        // Families are in an order in which the best length changes little.
        length = here.1.length;
    }
    best.1
}

/// A trial's share of a regression.
struct Projected {
    /// V⁻¹.
    inverse: DMatrix<f64>,
    /// The trial's own block of P.
    projection: DMatrix<f64>,
    /// P r.
    residual: DVector<f64>,
}

fn projected(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<Vec<Projected>> {
    let parts: Vec<_> = trials
        .par_iter()
        .with_max_len(ONE_BY_ONE)
        .filter_map(|(noise, x, r)| {
            let factor = factor(noise, levels)?;
            let n = r.len();
            let root = factor.l_dirty().solve_lower_triangular(&DMatrix::identity(n, n))?;
            let inverse = root.tr_mul(&root);
            let ax = &inverse * *x;
            let ar = &inverse * *r;
            Some((x.transpose() * &ax, ax.tr_mul(*r), inverse, ax, ar))
        })
        .collect();
    if parts.len() < trials.len() {
        return None;
    }
    let mut information = DMatrix::from_diagonal(precision);
    let mut right = DVector::zeros(precision.len());
    for part in &parts {
        information += &part.0;
        right += &part.1;
    }
    let information = cholesky(information)?;
    let coefficients = information.solve(&right);
    let covariance = information.inverse();
    let of_trial = |(_, _, inverse, ax, ar): (_, _, DMatrix<f64>, DMatrix<f64>, DVector<f64>)| {
        let residual = ar - &ax * &coefficients;
        let projection = &inverse - (&ax * &covariance) * ax.transpose();
        Projected { inverse, projection, residual }
    };
    Some(parts.into_par_iter().with_max_len(ONE_BY_ONE).map(of_trial).collect())
}

/// Gradient of the restricted log likelihood by the variances, and its approximate information.
fn gradient(
    trials: &[(&TrialNoise, &DMatrix<f64>, &DVector<f64>)],
    precision: &DVector<f64>,
    levels: &NoiseLevels,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let sums: Vec<_> = projected(trials, precision, levels)?
        .par_iter()
        .with_max_len(ONE_BY_ONE)
        .zip(trials)
        .map(|(Projected { inverse, projection, residual }, (noise, ..))| {
            let column = DMatrix::from_column_slice(residual.len(), 1, residual.as_slice());
            let mut gradient = DVector::zeros(COMPONENTS);
            for (i, place) in noise.components().into_iter().enumerate() {
                let found = noise.times_component(i, &column).dot(&column);
                gradient[place] = 0.5 * (found - noise.trace_with(i, projection));
            }
            (gradient, noise.information(inverse))
        })
        .collect();
    let mut gradient = DVector::zeros(COMPONENTS);
    let mut information = DMatrix::zeros(COMPONENTS, COMPONENTS);
    for (g, i) in &sums {
        gradient += g;
        information += i;
    }
    Some((gradient, information))
}

/// Least standard deviation of white noise of the moment [N·m]: below, simulations differ by their numerical errors.
pub const LEAST_WHITE: f64 = 0.001;

/// Least variances (0.001 N·m, 0.2 % of the EMG), as for [`LEAST_WHITE`].
const SMALLEST: [f64; COMPONENTS] = [
    LEAST_WHITE * LEAST_WHITE,
    0.001 * 0.001,
    0.001 * 0.001,
    0.001 * 0.001,
    0.002 * 0.002,
    0.002 * 0.002,
    0.0001 * 0.0001,
];

/// Largest variances: beyond these it is not noise of the EMG (30 % envelope, 15 % gain, 0.01 added), whatever it is.
const LARGEST: [f64; COMPONENTS] =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::INFINITY, 0.3 * 0.3, 0.15 * 0.15, 0.01 * 0.01];

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rand::SeedableRng;

    use super::*;
    use crate::kernel::{FAMILIES, Family};
    use crate::noise::levels::Kernels;
    use crate::noise::response::Response;
    use crate::noise::trial_noise::TrialTimes;
    use carpus_effects::random::normal;
    use carpus_study::study::Direction;

    #[test]
    fn verif_correlation_of_the_noise_is_found() {
        let times: Vec<f64> = (0..80).map(|b| 0.044 * f64::from(b)).collect();
        for truth in
            [Kernel { family: Family::Gaussian, length: 0.3 }, Kernel { family: Family::Exponential, length: 0.15 }]
        {
            let structure = |kernel: &Kernel| {
                let times = Arc::new(TrialTimes::correlated(Direction::None, &times, &[4; 80], kernel));
                TrialNoise::correlated(&times, vec![Response::new(80, 3)], &[vec![0.1; 3]], kernel)
            };
            let levels = NoiseLevels([0.0025, 0.005, 0.005, 0.005, 1e-4, 1e-4, 2.5e-7]);
            let mut rng = rand_chacha::ChaCha8Rng::from_seed([7; 32]);
            let drawn = structure(&truth);
            let draws: Vec<DVector<f64>> = (0..30).map(|_| drawn.draw_moment(&levels, || normal(&mut rng))).collect();
            let regressors = DMatrix::from_element(80, 1, 1.0);
            let precision = DVector::from_element(1, 1e-6);
            let best = best_kernel(&Kernels::default().moment, &FAMILIES, |kernel| {
                let noise = structure(kernel);
                let trials: Vec<_> = draws.iter().map(|d| (&noise, &regressors, d)).collect();
                let found = estimate(&trials, &precision, LEAST_WHITE, levels);
                restricted_deviance(&trials, &precision, &found)
            });
            let rough = |k: &Kernel| FAMILIES.iter().position(|f| *f == k.family).unwrap_or(9);
            assert!(rough(&best).abs_diff(rough(&truth)) <= 1, "{best:?} of {truth:?}");
            assert!((best.length / truth.length).ln().abs() < 0.5, "{best:?} of {truth:?}");
        }
    }

    #[test]
    fn verif_every_direction_has_its_slow_noise_and_one_without_trials_that_of_the_others() {
        let times: Vec<f64> = (0..80).map(|b| 0.044 * f64::from(b)).collect();
        let Kernels { emg, moment } = Kernels::default();
        let truth = NoiseLevels([0.0025, 0.04, 0.005, 0.0, 1e-4, 1e-4, 2.5e-7]);
        let mut rng = rand_chacha::ChaCha8Rng::from_seed([8; 32]);
        let drawn: Vec<(TrialNoise, DVector<f64>)> = (0..24)
            .map(|k| {
                let direction = if k % 2 == 0 { Direction::Flexion } else { Direction::Extension };
                let times = Arc::new(TrialTimes::correlated(direction, &times, &[4; 80], &moment));
                let noise = TrialNoise::correlated(&times, vec![Response::new(80, 3)], &[vec![0.1; 3]], &emg);
                let draw = noise.draw_moment(&truth, || normal(&mut rng));
                (noise, draw)
            })
            .collect();
        let regressors = DMatrix::from_element(80, 1, 1.0);
        let trials: Vec<_> = drawn.iter().map(|(noise, draw)| (noise, &regressors, draw)).collect();
        let found = estimate_within(30, &trials, &DVector::from_element(1, 1e-6), LEAST_WHITE, NoiseLevels::default());
        let off = |direction| (found.slow(direction) / truth.slow(direction)).ln().abs();
        assert!(off(Direction::Flexion) < 0.3 && off(Direction::Extension) < 0.3, "{found:?}");
        let between = (found.slow(Direction::Flexion) * found.slow(Direction::Extension)).sqrt();
        assert!((found.slow(Direction::None) / between).ln().abs() < 0.05, "{found:?}");
    }
}
