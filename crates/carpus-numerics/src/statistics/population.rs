//! What is known of several persons, each by their own data, says about the next person.
//!
//! Normal hierarchical model of many quantities at once:
//!
//! ```text
//! x_i ~ N(μ, diag τ²),   data of person i: exp(−½ x_iᵀ Λ_i x_i + η_iᵀ x_i),   μ_k ~ N(0, s_k²),   τ_k ~ |N(0, s_k²)|
//! ```
//! Quantities are counted from what was expected before anyone was measured, s_k is how far off that may have been; the
//! half-normal law keeps few persons from being taken for all alike (Gelman 2006, doi:10.1214/06-BA117A). What a
//! person's data say of one quantity depends on the others (a longer tendon for a stronger muscle): information comes
//! as matrices, so that what all persons' data leave open together is not mistaken for something that they all tell.
//! Drawn by Gibbs' sampler (Gelman et al. 2013, Bayesian Data Analysis, 3rd ed., sections 5.4 and 11.1).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::distributions::normal_quantile;
use super::error::StatisticsError;
use crate::numerics::symmetric_eigen;

/// What one person's data say, whatever was known before.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// Λ, positive semidefinite: 0 for quantities that the person's data do not touch.
    pub information: DMatrix<f64>,
    /// η = Λ x where the data are most probable.
    pub weighted: DVector<f64>,
}

impl Evidence {
    /// What the data add to a standard normal prior, from a normal posterior: nothing along axes on which it is not
    /// narrower.
    ///
    /// - `covariance`, `mean`: of the posterior; finite
    pub fn of_posterior(covariance: DMatrix<f64>, mean: &DVector<f64>) -> Evidence {
        let eigen = symmetric_eigen(covariance);
        let along = eigen.eigenvectors.tr_mul(mean);
        let information = eigen.eigenvalues.map(|v| (1.0 / v.max(LEAST_VARIANCE) - 1.0).max(0.0));
        let weighted = along.zip_map(
            &information,
            |along, information| if information > 0.0 { along * (information + 1.0) } else { 0.0 },
        );
        Evidence {
            information: &eigen.eigenvectors * DMatrix::from_diagonal(&information) * eigen.eigenvectors.transpose(),
            weighted: &eigen.eigenvectors * weighted,
        }
    }
}

/// What is known of a quantity of the next person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Population {
    /// Expected value.
    pub mean: f64,
    /// Standard deviation of the next person's value: spread between persons, and what is not known of it and of the
    /// mean.
    pub sd: f64,
    /// Expected spread between persons.
    pub between: f64,
}

const WARM_UP: usize = 500;
const DRAWS: usize = 4000;
/// Spreads that are considered: so many, from the least to the greatest share of s.
const SPREADS: usize = 120;
const LEAST_SHARE: f64 = 0.01;
const GREATEST_SHARE: f64 = 5.0;
/// Variance that data leave of a prior's 1, at least.
const LEAST_VARIANCE: f64 = 1e-9;

/// What persons' data say about the next person, per quantity.
///
/// - `before`: s, how far off each quantity may be from what was expected
/// - `seed`: of the draws
///
/// # Errors
/// [`StatisticsError`]: no persons, sizes that differ, numbers that are not finite, s that is not positive.
pub fn population(persons: &[Evidence], before: &DVector<f64>, seed: u64) -> Result<Vec<Population>, StatisticsError> {
    check(persons, before)?;
    let n = before.len();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut values = vec![DVector::zeros(n); persons.len()];
    let (mut mean, mut spread) = (DVector::<f64>::zeros(n), before.clone());
    let mut sums = vec![[0.0; 4]; n];
    for round in 0..WARM_UP + DRAWS {
        let own = spread.map(|t| t.powi(-2));
        let scaled = DMatrix::from_diagonal(&own);
        // Semidefinite plus a positive diagonal: factors exist.
        let factors: Vec<_> = persons.iter().filter_map(|person| (&person.information + &scaled).cholesky()).collect();
        // The mean with all persons' values integrated out: beside given values it would hardly move.
        let mut precision = DMatrix::from_diagonal(&before.map(|s| s.powi(-2)));
        let mut weighted = DVector::zeros(n);
        for (factor, person) in factors.iter().zip(persons) {
            precision += &scaled - &scaled * factor.solve(&scaled);
            weighted += own.component_mul(&factor.solve(&person.weighted));
        }
        if let Some(factor) = (0.5 * (&precision + precision.transpose())).cholesky() {
            mean = drawn(&factor, &weighted, &mut rng);
        }
        for ((value, person), factor) in values.iter_mut().zip(persons).zip(&factors) {
            *value = drawn(factor, &(&person.weighted + own.component_mul(&mean)), &mut rng);
        }
        for k in 0..n {
            let squares = values.iter().map(|v| (v[k] - mean[k]).powi(2)).sum();
            spread[k] = draw_spread(squares, persons.len() as f64, before[k], &mut rng);
        }
        if round >= WARM_UP {
            for (k, sum) in sums.iter_mut().enumerate() {
                let of = [mean[k], mean[k] * mean[k], spread[k] * spread[k], spread[k]];
                sum.iter_mut().zip(of).for_each(|(sum, v)| *sum += v / DRAWS as f64);
            }
        }
    }
    let of = |[mean, square, variance, between]: [f64; 4]| Population {
        mean,
        sd: (square - mean * mean + variance).max(0.0).sqrt(),
        between,
    };
    Ok(sums.into_iter().map(of).collect())
}

fn check(persons: &[Evidence], before: &DVector<f64>) -> Result<(), StatisticsError> {
    if persons.is_empty() {
        return Err(StatisticsError::TooFew { what: "persons", expected: 1, found: 0 });
    }
    if let Some(found) = before.iter().find(|s| !(**s > 0.0 && s.is_finite())) {
        let (what, expected) = ("what was known before", "a positive number");
        return Err(StatisticsError::OutOfDomain { what, expected, found: *found });
    }
    let expected = before.len();
    for (row, person) in persons.iter().enumerate() {
        for found in [person.weighted.len(), person.information.nrows(), person.information.ncols()] {
            if found != expected {
                return Err(StatisticsError::Length { what: "quantities of a person", expected, found });
            }
        }
        let all = person.weighted.iter().chain(person.information.iter());
        if let Some((column, value)) = all.enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(StatisticsError::NotFinite { what: "person", row, column, value: *value });
        }
    }
    Ok(())
}

/// A draw from the normal law of a precision (its factor) and precision times mean.
fn drawn(factor: &Cholesky<f64, Dyn>, weighted: &DVector<f64>, rng: &mut ChaCha8Rng) -> DVector<f64> {
    let mut by = DVector::from_fn(weighted.len(), |_, _| normal(rng));
    factor.l_dirty().tr_solve_lower_triangular_mut(&mut by);
    factor.solve(weighted) + by
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    // Never 0 or 1: the middle of one of 2⁵² cells.
    normal_quantile(((rng.random::<u64>() >> 12) as f64 + 0.5) / 2.0_f64.powi(52))
}

/// A spread, given the sum of squared distances of `count` values from their mean: on a geometric grid, between its
/// points evenly.
fn draw_spread(squares: f64, count: f64, before: f64, rng: &mut ChaCha8Rng) -> f64 {
    let step = (GREATEST_SHARE / LEAST_SHARE).ln() / (SPREADS - 1) as f64;
    let logarithm = |place: f64| (before * LEAST_SHARE).ln() + step * place;
    let log_density = |i: usize| {
        let log = logarithm(i as f64);
        let variance = (2.0 * log).exp();
        // One more power of τ: the grid is even in its logarithm.
        (1.0 - count) * log - 0.5 * squares / variance - 0.5 * variance / (before * before)
    };
    let densities: [f64; SPREADS] = std::array::from_fn(log_density);
    let greatest = densities.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let total: f64 = densities.iter().map(|d| (d - greatest).exp()).sum();
    let mut left = rng.random::<f64>() * total;
    for (i, density) in densities.iter().enumerate() {
        let mass = (density - greatest).exp();
        if left < mass || i == SPREADS - 1 {
            return logarithm(i as f64 + (left / mass).min(1.0) - 0.5).exp();
        }
        left -= mass;
    }
    before
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rubin (1981), doi:10.3102/10769986006004377, table 1: effects of coaching in eight schools.
    const SCHOOLS: [(f64, f64); 8] =
        [(28.0, 15.0), (8.0, 10.0), (-3.0, 16.0), (7.0, 11.0), (-1.0, 9.0), (1.0, 11.0), (18.0, 10.0), (12.0, 18.0)];

    fn alone(value: f64, error: f64) -> Evidence {
        let information = error.powi(-2);
        Evidence {
            information: DMatrix::from_element(1, 1, information),
            weighted: DVector::from_element(1, information * value),
        }
    }

    #[test]
    fn verif_evidence_is_what_a_posterior_has_beyond_its_prior() {
        // Data: two combinations of three quantities. The posterior's precision is 1 + AᵀA, its mean solves (1 + AᵀA) m
        // = Aᵀ y.
        let a = DMatrix::from_row_slice(2, 3, &[2.0, 1.0, 0.0, -1.0, 3.0, 0.5]);
        let y = DVector::from_column_slice(&[1.5, -0.7]);
        let information = a.tr_mul(&a);
        let covariance = (&information + DMatrix::identity(3, 3)).try_inverse().unwrap();
        let mean = &covariance * a.tr_mul(&y);
        let found = Evidence::of_posterior(covariance, &mean);
        assert!((found.information - information).amax() < 1e-10);
        assert!((found.weighted - a.tr_mul(&y)).amax() < 1e-10);
    }

    #[test]
    fn verif_agrees_with_a_sum_over_mean_and_spread() {
        let schools: Vec<Evidence> = SCHOOLS.map(|(value, error)| alone(value, error)).to_vec();
        let found = population(&schools, &DVector::from_element(1, 12.0), 1).unwrap()[0];
        let normal = |x: f64, m: f64, sd: f64| (-0.5 * ((x - m) / sd).powi(2)).exp() / sd;
        let mut sums = [0.0; 4];
        for i in 0..1200 {
            let mean = -60.0 + 0.1 * (f64::from(i) + 0.5);
            for j in 0..600 {
                let between = 0.1 * (f64::from(j) + 0.5);
                let likelihood: f64 =
                    SCHOOLS.iter().map(|(y, e)| normal(*y, mean, (between * between + e * e).sqrt())).product();
                let density = likelihood * normal(mean, 0.0, 12.0) * (-0.5 * (between / 12.0).powi(2)).exp();
                let moments = [1.0, mean, mean * mean + between * between, between];
                sums.iter_mut().zip(moments).for_each(|(sum, m)| *sum += density * m);
            }
        }
        let mean = sums[1] / sums[0];
        let sd = (sums[2] / sums[0] - mean * mean).sqrt();
        let between = sums[3] / sums[0];
        println!("{found:?}; sums: {mean} {sd} {between}");
        assert!((found.mean - mean).abs() < 0.3, "{} {mean}", found.mean);
        assert!((found.sd / sd - 1.0).abs() < 0.04, "{} {sd}", found.sd);
        assert!((found.between / between - 1.0).abs() < 0.07, "{} {between}", found.between);
    }

    /// Two quantities of which the data know the sum alone: how it is shared stays as it was, however many persons say
    /// so.
    #[test]
    fn verif_what_no_person_tells_is_not_learnt_from_many() {
        let sum_is = |value: f64| {
            let information = DMatrix::from_element(2, 2, 1e4);
            Evidence { weighted: &information * DVector::from_vec(vec![0.5 * value; 2]), information }
        };
        let persons: Vec<Evidence> = (0..40).map(|i| sum_is(1.0 + 0.1 * f64::from(i % 5 - 2))).collect();
        let before = DVector::from_vec(vec![1.0, 1.0]);
        let found = population(&persons, &before, 3).unwrap();
        let sum = found[0].mean + found[1].mean;
        println!("{found:?}");
        assert!((sum - 1.0).abs() < 0.05, "{sum}");
        // Given their sum, one of two quantities of spread 1 keeps a spread of 1/√2.
        assert!(found.iter().all(|p| p.sd > 0.55), "{found:?}");
    }

    #[test]
    fn verif_many_exact_values_give_their_own_mean_and_spread() {
        let persons: Vec<Evidence> = (0..200).map(|i| alone(1.0 + 0.1 * f64::from(i % 5 - 2), 1e-3)).collect();
        let found = population(&persons, &DVector::from_element(1, 1.0), 2).unwrap()[0];
        assert!((found.mean - 1.0).abs() < 0.02, "{found:?}");
        assert!((found.between - 0.02_f64.sqrt()).abs() < 0.01, "{found:?}");
        assert!((found.sd - 0.02_f64.sqrt()).abs() < 0.012, "{found:?}");
    }

    #[test]
    fn verif_persons_without_information_leave_what_was_known() {
        let found = population(&[alone(3.0, 1e6)], &DVector::from_element(1, 0.1), 4).unwrap()[0];
        assert!(found.mean.abs() < 0.01, "{found:?}");
        // Mean and spread are both as wide as before: root of two.
        assert!((found.sd - 0.1 * 2.0_f64.sqrt()).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn verif_bad_input_is_refused() {
        let one = DVector::from_element(1, 1.0);
        assert!(matches!(population(&[], &one, 1), Err(StatisticsError::TooFew { .. })));
        assert!(matches!(population(&[alone(f64::NAN, 1.0)], &one, 1), Err(StatisticsError::NotFinite { .. })));
        assert!(matches!(population(&[alone(1.0, 1.0)], &(one * 0.0), 1), Err(StatisticsError::OutOfDomain { .. })));
        let two = DVector::from_element(2, 1.0);
        assert!(matches!(population(&[alone(1.0, 1.0)], &two, 1), Err(StatisticsError::Length { .. })));
    }
}
