//! The session around one point: a linear Gaussian model in which every column has a prior.
//!
//! With the noise whitened, the residual of all trials is (`docs/src/theory/many-small-errors.md`, equation (14))
//!
//! ```text
//! r = Z δ + ε,   ε ~ N(0, I),   δ_j + o_j ~ N(0, s_j²)                                       (14)
//! ```
//! Z: derivatives by muscle parameters and EMG baselines, by the parameters of every effect of the catalogue,
//! and the columns of the discrepancy; o: distance of the point from the prior's mean; s: prior standard
//! deviations. A set S of effects is *missing* from the model: their amplitudes have the standard deviation
//! of what is plausible. All others have κ times that: what a laboratory has of everything (spike and slab,
//! equation (3)). κ and the sizes of the discrepancy are estimated (18). With r₀ = r + Z o, M = I + s ZᵀZ s
//! and c = s Zᵀ r₀
//!
//! ```text
//! −2 log p(r | S, s) = r₀ᵀr₀ − cᵀ M⁻¹ c + log |M| + const                                     (15)
//! E[δ + o | r] = s M⁻¹ c,   Cov[δ | r] = s M⁻¹ s                                              (16)
//! ```
//! Everything is computed from the products ZᵀZ, Zᵀr, rᵀr: a set costs one factorization of some hundred columns.
//!
//! # References
//! George & McCulloch (1993), Variable selection via Gibbs sampling, doi:10.1080/01621459.1993.10476353.
//! Kennedy & O'Hagan (2001), Bayesian calibration of computer models, doi:10.1111/1467-9868.00294.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::fit::{product, whiten};
use carpus_numerics::numerics::cholesky;

/// What the prior standard deviation of a column is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// Known before the data.
    Known(f64),
    /// Amplitude of an effect: `plausible` where the effect is missing from the model, κ times that elsewhere.
    Amplitude {
        /// Place of the effect.
        effect: usize,
        /// Standard deviation of what is plausible.
        plausible: f64,
        /// Sign that the amplitude must have, if it must.
        sign: Option<f64>,
    },
    /// Shape of an effect: known where the effect is missing from the model; elsewhere it does not matter.
    Shape {
        /// Place of the effect.
        effect: usize,
        /// Standard deviation about the usual shape.
        sd: f64,
    },
    /// Column of the discrepancy.
    Discrepancy {
        /// Which of the sizes it goes with.
        size: usize,
        /// Its standard deviation for unit size.
        weight: f64,
    },
}

/// Sizes that are estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct Sizes {
    /// κ: what a laboratory has of every effect, as a share of what is plausible.
    pub everything: f64,
    /// Of the discrepancy.
    pub discrepancy: Vec<f64>,
}

impl Sizes {
    /// κ, then those of the discrepancy.
    fn all(&self) -> impl Iterator<Item = f64> + '_ {
        std::iter::once(self.everything).chain(self.discrepancy.iter().copied())
    }

    /// From κ, then those of the discrepancy.
    fn of(mut all: impl Iterator<Item = f64>) -> Sizes {
        Sizes { everything: all.next().unwrap_or(0.0), discrepancy: all.collect() }
    }

    /// All of them times a factor.
    pub fn scaled(&self, factor: f64) -> Sizes {
        Sizes {
            everything: factor * self.everything,
            discrepancy: self.discrepancy.iter().map(|s| factor * s).collect(),
        }
    }
}

/// Prior scales of [`Sizes`]: half-normal, equation (5).
#[derive(Clone, Debug)]
pub struct SizePriors {
    /// Of κ.
    pub everything: f64,
    /// Of the discrepancy.
    pub discrepancy: Vec<f64>,
}

/// Least size, as a share of its prior scale: smaller ones make no difference.
const LEAST_SIZE: f64 = 0.01;
/// Largest size, as a multiple of its prior scale.
const LARGEST_SIZE: f64 = 20.0;

/// Bisections towards a size that is a standard deviation above the most probable one.
const BISECTIONS: usize = 8;
/// Steps of the sizes at most.
const SIZE_STEPS: usize = 12;
/// Longest step of the logarithm of a size.
const LONGEST_STEP: f64 = 1.5;
/// A step of all sizes that lowers the deviance by less is the last.
const LEAST_FALL: f64 = 0.02;

/// Products of the whitened columns and the residual.
#[derive(Clone, Debug)]
pub struct LinearModel {
    /// Priors of the columns.
    pub priors: Vec<Prior>,
    /// Distance of the point from the prior's mean, per column.
    pub offset: DVector<f64>,
    /// [Z r]ᵀ[Z r] of every trial.
    pub by_trial: Vec<DMatrix<f64>>,
    /// Their sum.
    pub products: DMatrix<f64>,
    /// Prior of the sizes.
    pub size_priors: SizePriors,
}

/// What the data say of all columns, given a set of effects and the sizes.
pub struct Posterior {
    /// −2 log marginal likelihood (15) with signs (17) and prior of the sizes (5), up to a constant.
    pub deviance: f64,
    /// Prior standard deviation of every column.
    pub sd: DVector<f64>,
    /// Expected value of δ + o, per column, equation (16).
    pub mean: DVector<f64>,
    /// Least of the penalized sum of squares.
    pub squares: f64,
    factor: Cholesky<f64, Dyn>,
}

impl Posterior {
    /// Covariance of δ, equation (16).
    pub fn covariance(&self) -> DMatrix<f64> {
        let mut out = self.factor.inverse();
        for (i, mut column) in out.column_iter_mut().enumerate() {
            column *= self.sd[i];
            column.component_mul_assign(&self.sd);
        }
        out
    }

    /// Standard deviation of one column's δ.
    pub fn sd_of(&self, column: usize) -> f64 {
        let mut unit = DVector::zeros(self.sd.len());
        unit[column] = 1.0;
        self.sd[column] * self.factor.solve(&unit)[column].max(0.0).sqrt()
    }
}

impl LinearModel {
    /// - `by_trial`: [Z r]ᵀ[Z r] of every trial, the residual last
    pub fn new(
        priors: Vec<Prior>,
        offset: DVector<f64>,
        by_trial: Vec<DMatrix<f64>>,
        size_priors: SizePriors,
    ) -> LinearModel {
        let n = priors.len() + 1;
        let products = by_trial.iter().fold(DMatrix::zeros(n, n), |sum, part| sum + part);
        LinearModel { priors, offset, by_trial, products, size_priors }
    }

    /// With further rows of data that belong to no trial.
    ///
    /// - `rows`: whitened derivatives by all columns, and the residual
    pub fn with_rows(mut self, rows: impl Iterator<Item = DVector<f64>>) -> LinearModel {
        rows.for_each(|row| self.products.ger(1.0, &row, &row, 1.0));
        self
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.priors.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.priors.is_empty()
    }

    /// Sizes at the scales of their priors.
    pub fn usual_sizes(&self) -> Sizes {
        Sizes { everything: self.size_priors.everything, discrepancy: self.size_priors.discrepancy.clone() }
    }

    /// The model in which effects are absent: their amplitudes are nothing.
    ///
    /// - `effects`: their places
    pub fn without(&self, effects: &[usize]) -> LinearModel {
        let absent = |p: &Prior| matches!(p, Prior::Amplitude { effect, .. } if effects.contains(effect));
        let prior = |p: &Prior| if absent(p) { Prior::Known(0.0) } else { *p };
        LinearModel {
            priors: self.priors.iter().map(prior).collect(),
            offset: self.offset.clone(),
            by_trial: Vec::new(),
            products: self.products.clone(),
            size_priors: self.size_priors.clone(),
        }
    }

    /// The model in which the first columns stay where they are.
    pub fn holding(&self, columns: usize) -> LinearModel {
        let mut held = self.without(&[]);
        held.priors[..columns].fill(Prior::Known(0.0));
        held.offset.rows_mut(0, columns).fill(0.0);
        held
    }

    /// Prior standard deviation of every column.
    ///
    /// - `set`: places of the effects that are missing from the model
    pub fn sds(&self, set: &[usize], sizes: &Sizes) -> DVector<f64> {
        let sd = |prior: &Prior| match *prior {
            Prior::Known(sd) => sd,
            Prior::Amplitude { effect, plausible, .. } if set.contains(&effect) => plausible,
            Prior::Amplitude { plausible, .. } => plausible * sizes.everything,
            Prior::Shape { effect, sd } if set.contains(&effect) => sd,
            Prior::Shape { .. } => 0.0,
            Prior::Discrepancy { size, weight } => weight * sizes.discrepancy[size],
        };
        DVector::from_iterator(self.len(), self.priors.iter().map(sd))
    }

    /// Zᵀ r₀ and r₀ᵀ r₀ of some products.
    fn about_mean(&self, products: &DMatrix<f64>) -> (DVector<f64>, f64) {
        let p = self.len();
        let (a, b) = (products.view((0, 0), (p, p)), products.view((0, p), (p, 1)));
        let moved = a * &self.offset;
        let squares = products[(p, p)] + 2.0 * b.column(0).dot(&self.offset) + moved.dot(&self.offset);
        (b + moved, squares)
    }

    /// Zᵀ Z and Zᵀ r₀, the residual being that of the priors' means.
    pub fn about_prior_mean(&self) -> (DMatrix<f64>, DVector<f64>) {
        let p = self.len();
        (self.products.view((0, 0), (p, p)).into_owned(), self.about_mean(&self.products).0)
    }

    /// The posterior for a set of effects and sizes.
    pub fn posterior(&self, set: &[usize], sizes: &Sizes) -> Posterior {
        self.posterior_of(&self.products, set, sizes)
    }

    /// The same from the products of some trials.
    pub fn posterior_of(&self, products: &DMatrix<f64>, set: &[usize], sizes: &Sizes) -> Posterior {
        let sd = self.sds(set, sizes);
        let (right, squares) = self.about_mean(products);
        let p = self.len();
        let mut m = products.view((0, 0), (p, p)).into_owned();
        for (j, mut column) in m.column_iter_mut().enumerate() {
            column *= sd[j];
            column.component_mul_assign(&sd);
            column[j] += 1.0;
        }
        let c = right.component_mul(&sd);
        // I plus a positive semidefinite matrix: a factor exists unless a column is not finite.
        let factor = cholesky(m).unwrap_or_else(|| Cholesky::pack_dirty(DMatrix::identity(p, p)));
        let solved = factor.solve(&c);
        let squares = squares - c.dot(&solved);
        let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        let mean = solved.component_mul(&sd);
        let prior = (sizes.everything / self.size_priors.everything).powi(2)
            + sizes
                .discrepancy
                .iter()
                .zip(&self.size_priors.discrepancy)
                .map(|(s, scale)| (s / scale).powi(2))
                .sum::<f64>();
        let mut posterior = Posterior { deviance: squares + log_determinant + prior, sd, mean, squares, factor };
        posterior.deviance += self.of_signs(set, &posterior);
        posterior
    }

    /// −2 log of how much of the posterior's mass has the signs that amplitudes must have, over the prior's
    /// half, equation (17).
    fn of_signs(&self, set: &[usize], posterior: &Posterior) -> f64 {
        let normal = Normal::standard();
        let of = |(j, prior): (usize, &Prior)| match *prior {
            Prior::Amplitude { effect, sign: Some(sign), .. } if set.contains(&effect) => {
                let sd = posterior.sd_of(j).max(f64::MIN_POSITIVE);
                -2.0 * (2.0 * normal.cdf(sign * posterior.mean[j] / sd)).max(f64::MIN_POSITIVE).ln()
            }
            _ => 0.0,
        };
        self.priors.iter().enumerate().map(of).sum()
    }

    /// The sizes that are most probable for a set, starting from others, and the deviance with them: the
    /// minimum of equation (18).
    ///
    /// Fisher scoring in the logarithms of the sizes. With T = I − M⁻¹ and u = M⁻¹ c
    ///
    /// ```text
    /// ∂D/∂ln s_k = 2 Σ_{j∈k} (T_jj − u_j²) + 2 (s_k/scale_k)²
    /// E[∂²D/∂ln s_k ∂ln s_l] = 4 Σ_{i∈k, j∈l} T_ij²,   on the diagonal + 4 (s_k/scale_k)²
    /// ```
    pub fn sizes_for(&self, set: &[usize], start: &Sizes) -> (Sizes, f64) {
        let scales: Vec<f64> = self.size_scales().collect();
        let bounds: Vec<[f64; 2]> = scales.iter().map(|s| [(LEAST_SIZE * s).ln(), (LARGEST_SIZE * s).ln()]).collect();
        let mut sizes = start.clone();
        let mut logs = DVector::from_iterator(scales.len(), start.all().map(f64::ln));
        let mut here = self.posterior(set, &sizes);
        for _ in 0..SIZE_STEPS {
            let (mut gradient, mut information) = self.by_sizes(set, &here, &sizes);
            for (k, [least, most]) in bounds.iter().enumerate() {
                // Far from the minimum the expected curvature says little; a step is then one of the logarithm.
                information[(k, k)] += gradient[k].abs();
                let outwards = (logs[k] <= *least && gradient[k] > 0.0) || (logs[k] >= *most && gradient[k] < 0.0);
                if outwards || information[(k, k)] <= 0.0 {
                    gradient[k] = 0.0;
                    information.row_mut(k).fill(0.0);
                    information.column_mut(k).fill(0.0);
                    information[(k, k)] = 1.0;
                }
            }
            let Some(factor) = information.cholesky() else { break };
            let step = factor.solve(&gradient);
            let mut fall = 0.0;
            for part in [1.0, 0.4, 0.1] {
                let moved = DVector::from_fn(logs.len(), |k, _| {
                    (logs[k] - part * step[k].clamp(-LONGEST_STEP, LONGEST_STEP)).clamp(bounds[k][0], bounds[k][1])
                });
                let other = Sizes::of(moved.iter().map(|log| log.exp()));
                let there = self.posterior(set, &other);
                if there.deviance < here.deviance {
                    fall = here.deviance - there.deviance;
                    (sizes, logs, here) = (other, moved, there);
                    break;
                }
            }
            if fall < LEAST_FALL {
                break;
            }
        }
        (sizes, here.deviance)
    }

    /// Sizes a standard deviation above the most probable ones: each is where −2 log posterior is larger by
    /// 1, the others held.
    pub fn sizes_above(&self, set: &[usize], sizes: &Sizes) -> Sizes {
        let least = self.posterior(set, sizes).deviance;
        let all: Vec<f64> = sizes.all().collect();
        let of = |(k, scale): (usize, f64)| {
            let at = |size: f64| {
                let mut other = all.clone();
                other[k] = size;
                self.posterior(set, &Sizes::of(other.into_iter())).deviance - least
            };
            let [mut low, mut high] = [all[k], (4.0 * all[k]).max(scale)];
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                if at(middle) < 1.0 { low = middle } else { high = middle }
            }
            low
        };
        Sizes::of(self.size_scales().enumerate().map(of).collect::<Vec<_>>().into_iter())
    }

    /// Prior scales of the sizes, κ first.
    fn size_scales(&self) -> impl Iterator<Item = f64> + '_ {
        std::iter::once(self.size_priors.everything).chain(self.size_priors.discrepancy.iter().copied())
    }

    /// The size, κ first, that a column's prior goes with.
    fn size_of(&self, set: &[usize], column: usize) -> Option<usize> {
        match self.priors[column] {
            Prior::Amplitude { effect, .. } if !set.contains(&effect) => Some(0),
            Prior::Discrepancy { size, .. } => Some(1 + size),
            _ => None,
        }
    }

    /// Gradient of the deviance by the logarithms of the sizes, and its expected second derivatives; signs
    /// (17) are left out.
    fn by_sizes(&self, set: &[usize], here: &Posterior, sizes: &Sizes) -> (DVector<f64>, DMatrix<f64>) {
        let p = self.len();
        let root = whiten(&here.factor, &DMatrix::identity(p, p));
        let inverse = product(&root, &root);
        let of: Vec<(usize, usize)> = (0..p).filter_map(|j| Some((j, self.size_of(set, j)?))).collect();
        let count = 1 + sizes.discrepancy.len();
        let (mut gradient, mut information) = (DVector::zeros(count), DMatrix::zeros(count, count));
        for &(j, k) in of.iter().filter(|(j, _)| here.sd[*j] > 0.0) {
            let standardized = here.mean[j] / here.sd[j];
            gradient[k] += 2.0 * (1.0 - inverse[(j, j)] - standardized * standardized);
            for &(i, l) in &of {
                let t = if i == j { 1.0 - inverse[(i, j)] } else { -inverse[(i, j)] };
                information[(l, k)] += 4.0 * t * t;
            }
        }
        for (k, (size, scale)) in sizes.all().zip(self.size_scales()).enumerate() {
            let of_prior = (size / scale).powi(2);
            gradient[k] += 2.0 * of_prior;
            information[(k, k)] += 4.0 * of_prior;
        }
        (gradient, information)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn model() -> (LinearModel, DMatrix<f64>, DVector<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut draw = || rng.random::<f64>() - 0.5;
        let z = DMatrix::from_fn(40, 4, |_, _| draw());
        let r = DVector::from_fn(40, |_, _| 3.0 * draw());
        let priors = vec![
            Prior::Known(0.7),
            Prior::Amplitude { effect: 0, plausible: 2.0, sign: None },
            Prior::Shape { effect: 0, sd: 1.0 },
            Prior::Discrepancy { size: 0, weight: 0.5 },
        ];
        let offset = DVector::from_vec(vec![0.3, -0.8, 0.2, 0.0]);
        let trials = [0..15, 15..40].map(|rows| {
            let mut all = z.rows(rows.start, rows.len()).into_owned().resize_horizontally(5, 0.0);
            all.set_column(4, &r.rows(rows.start, rows.len()));
            all.tr_mul(&all)
        });
        let size_priors = SizePriors { everything: 0.2, discrepancy: vec![0.4] };
        (LinearModel::new(priors, offset, trials.to_vec(), size_priors), z, r)
    }

    /// −2 log density of the residual by its dense covariance.
    #[test]
    fn verif_deviance_is_that_of_the_dense_covariance() {
        let (model, z, r) = model();
        let dense = |set: &[usize], sizes: &Sizes| {
            let sd = model.sds(set, sizes);
            let v = DMatrix::identity(40, 40) + &z * DMatrix::from_diagonal(&sd.component_mul(&sd)) * z.transpose();
            let about = &r + &z * &model.offset;
            let factor = v.cholesky().unwrap();
            let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            let prior = (sizes.everything / 0.2).powi(2) + (sizes.discrepancy[0] / 0.4).powi(2);
            about.dot(&factor.solve(&about)) + determinant + prior
        };
        for set in [&[][..], &[0]] {
            for everything in [0.05, 0.3] {
                let sizes = Sizes { everything, discrepancy: vec![0.1] };
                let found = model.posterior(set, &sizes).deviance;
                assert!((found - dense(set, &sizes)).abs() < 1e-9, "{found} {}", dense(set, &sizes));
            }
        }
    }

    #[test]
    fn verif_sizes_are_where_no_neighbour_is_more_probable() {
        let (model, ..) = model();
        let (sizes, least) = model.sizes_for(&[0], &model.usual_sizes());
        for factor in [0.8, 1.25] {
            let mut other = sizes.clone();
            other.discrepancy[0] *= factor;
            assert!(model.posterior(&[0], &other).deviance > least - 0.05);
        }
    }

    /// An amplitude on the wrong side is paid for, on the right one it gains no more than the prior's half.
    #[test]
    fn verif_signs_are_kept() {
        let (mut model, ..) = model();
        let free = model.posterior(&[0], &model.usual_sizes());
        let sign = free.mean[1].signum();
        let mut with = |sign: f64| {
            model.priors[1] = Prior::Amplitude { effect: 0, plausible: 2.0, sign: Some(sign) };
            model.posterior(&[0], &model.usual_sizes()).deviance - free.deviance
        };
        let (right, wrong) = (with(sign), with(-sign));
        assert!(right < 0.0 && right >= -2.0 * 2f64.ln() - 1e-12 && wrong > 0.0, "{right} {wrong}");
    }
}
