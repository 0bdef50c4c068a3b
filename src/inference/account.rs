//! The account of the error: what muscles, every missing effect, the discrepancy and noise take of it.
//!
//! On the scale of mean squares the parts add up. With E²(S) the mean square of the residual of the training trials when muscles and the effects of S
//! are at their expected values, all else refitted for S, an effect's share is its Shapley value: the mean, over all orders in which the effects
//! may be added, of the fall of E² when it is. It lies between what only this effect can take (all others being there) and
//! what it takes alone.
//!
//! # References
//! Shapley (1953), A value for n-person games, doi:10.1515/9781400881970-018. Budescu (1993), Dominance analysis,
//! doi:10.1037/0033-2909.114.3.542.

use nalgebra::{DMatrix, DVector};

use super::linear_model::{LinearModel, Prior, Sizes};

/// Effects that may be taken one by one: beyond, orders are too many.
const MOST: usize = 10;

/// Raw columns and residuals: of blocks, not whitened [N·m].
pub struct Raw {
    /// [Z r]ᵀ[Z r], weighted by samples per block.
    products: DMatrix<f64>,
    /// Samples.
    count: f64,
}

impl Raw {
    /// - `columns`: per trial [Z r]; `samples`: of every block
    pub fn new(columns: &[DMatrix<f64>], samples: &[Vec<usize>]) -> Raw {
        let n = columns.first().map_or(0, DMatrix::ncols);
        let mut products = DMatrix::zeros(n, n);
        let mut count = 0.0;
        for (columns, samples) in columns.iter().zip(samples) {
            let mut weighted = columns.clone();
            for (i, samples) in samples.iter().enumerate() {
                weighted.row_mut(i).scale_mut((*samples as f64).sqrt());
                count += *samples as f64;
            }
            products += weighted.tr_mul(&weighted);
        }
        Raw { products, count }
    }

    /// Mean square of the residual after a step of all columns [(N·m)²].
    pub fn mean_square(&self, step: &DVector<f64>) -> f64 {
        let p = step.len();
        let of_step = self.products.view((0, 0), (p, p)) * step;
        let right = self.products.view((0, p), (p, 1)).column(0).into_owned();
        ((self.products[(p, p)] - 2.0 * right.dot(step) + of_step.dot(step)) / self.count).max(0.0)
    }
}

/// What an effect takes of the mean square [(N·m)²].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Mean over all orders.
    pub mean: f64,
    /// When all others are there.
    pub unique: f64,
    /// Alone.
    pub alone: f64,
}

/// The step to what is expected for a set: muscles and the effects of the set, without discrepancy and what a laboratory has of everything.
pub fn step_of(model: &LinearModel, set: &[usize], sizes: &Sizes) -> DVector<f64> {
    let mean = model.posterior(set, sizes).mean;
    let step = |(j, prior): (usize, &Prior)| match prior {
        Prior::Known(_) => mean[j] - model.offset[j],
        Prior::Amplitude { effect, .. } | Prior::Shape { effect, .. } if set.contains(effect) => {
            mean[j] - model.offset[j]
        }
        // Absent.
        _ => -model.offset[j],
    };
    DVector::from_iterator(model.len(), model.priors.iter().enumerate().map(step))
}

/// Shares of groups of effects, of which one each is in the set.
pub fn shares(model: &LinearModel, raw: &Raw, set: &[usize], sizes: &Sizes) -> Vec<Share> {
    let n = set.len().min(MOST);
    let squares: Vec<f64> = (0..1usize << n)
        .map(|mask| {
            let chosen: Vec<usize> = (0..set.len()).filter(|i| *i >= n || mask >> i & 1 == 1).map(|i| set[i]).collect();
            raw.mean_square(&step_of(model, &chosen, sizes))
        })
        .collect();
    let factorial = |k: usize| (1..=k).map(|i| i as f64).product::<f64>();
    (0..set.len())
        .map(|i| {
            if i >= n {
                return Share { mean: 0.0, unique: 0.0, alone: 0.0 };
            }
            let mut mean = 0.0;
            for mask in (0..1usize << n).filter(|mask| mask >> i & 1 == 0) {
                let others = mask.count_ones() as usize;
                let weight = factorial(others) * factorial(n - others - 1) / factorial(n);
                mean += weight * (squares[mask] - squares[mask | 1 << i]);
            }
            let full = (1 << n) - 1;
            Share { mean, unique: squares[full & !(1 << i)] - squares[full], alone: squares[0] - squares[1 << i] }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::linear_model::SizePriors;
    use super::*;

    #[test]
    fn verif_shares_add_up_to_the_fall_of_the_mean_square() {
        let z = DMatrix::from_fn(60, 4, |i, j| ((i * (j + 2)) as f64 * 0.37).sin() + 0.4 * (i as f64 * 0.1).cos());
        let r = z.column(1) * 1.5 - z.column(2) * 0.8 + z.column(3) * 0.3;
        let mut all = z.resize_horizontally(5, 0.0);
        all.set_column(4, &r);
        let amplitude = |effect| Prior::Amplitude { effect, plausible: 1.0, sign: None };
        let priors = vec![Prior::Known(0.5), amplitude(0), amplitude(1), amplitude(2)];
        let size_priors = SizePriors { everything: 0.1, discrepancy: Vec::new() };
        let model = LinearModel::new(priors, DVector::zeros(4), vec![all.tr_mul(&all) * 100.0], size_priors);
        let raw = Raw::new(&[all], &[vec![2; 60]]);
        let sizes = Sizes { everything: 1e-3, discrepancy: Vec::new() };
        let found = shares(&model, &raw, &[0, 1, 2], &sizes);
        let [none, full] = [&[][..], &[0, 1, 2]].map(|set| raw.mean_square(&step_of(&model, set, &sizes)));
        let sum: f64 = found.iter().map(|s| s.mean).sum();
        assert!((sum - (none - full)).abs() < 1e-9 * none, "{sum} {none} {full}");
        assert!(found[0].mean > found[2].mean && found[0].mean > 0.1 * none, "{found:?}");
    }
}
