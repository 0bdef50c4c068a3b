//! The EMG that goes with a point: its corrections are a fixed point, each passing through the muscles anew
//! (`docs/src/theory/many-small-errors.md`, equation (10)).
//!
//! # References
//! Walker & Ni (2011), Anderson acceleration for fixed-point iterations, doi:10.1137/10078356X.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::noise_along_the_way::LARGEST_NOISE;
use crate::noise::TrialNoise;
use carpus_numerics::numerics::cholesky;

/// Earlier corrections that the next one is extrapolated from.
const DEPTH: usize = 3;
/// Share of the largest eigenvalue below which differences of corrections say nothing of their own.
const SMALLEST: f64 = 1e-8;

/// Errors of the logarithm of every trial's EMG, per muscle on knots.
type Correction = Vec<Vec<DVector<f64>>>;

/// Corrections so far, and where each would go.
#[derive(Default)]
pub(super) struct EmgIteration {
    /// The correction, by how much it is to change, and what this change does to the moment, whitened.
    before: Vec<(Correction, Correction, DVector<f64>)>,
}

impl EmgIteration {
    /// The next correction: that of the weights of the last ones, with the sum 1, with which the moment would change
    /// least (Anderson acceleration); within the bounds of the EMG's noise.
    ///
    /// - `here`, `expected`: the present correction, and that which equation (10) expects there
    /// - `noise`, `factors`: there
    pub(super) fn next(
        &mut self,
        here: &Correction,
        expected: Correction,
        noise: &[TrialNoise],
        factors: &[Cholesky<f64, Dyn>],
    ) -> Correction {
        let change = combined(&[(1.0, &expected), (-1.0, here)]);
        let of_trial = |((noise, factor), change): ((&TrialNoise, &Cholesky<f64, Dyn>), &Vec<DVector<f64>>)| {
            let moment = noise.respond(change);
            factor.l_dirty().solve_lower_triangular(&moment).unwrap_or(moment)
        };
        let of_trials: Vec<DVector<f64>> = noise.par_iter().zip(factors).zip(&change).map(of_trial).collect();
        let rows: usize = of_trials.iter().map(DVector::len).sum();
        let shown = DVector::from_iterator(rows, of_trials.iter().flat_map(|v| v.iter().copied()));
        self.before.push((here.clone(), change, shown));
        let first = self.before.len().saturating_sub(DEPTH + 1);
        self.before.drain(..first);
        let weights = self.weights();
        let terms = self.before.iter().zip(weights.iter()).flat_map(|((x, f, _), w)| [(*w, x), (*w, f)]);
        let mut next = combined(&terms.collect::<Vec<_>>());
        next.iter_mut().flatten().for_each(|w| w.apply(|w| *w = w.clamp(-LARGEST_NOISE, LARGEST_NOISE)));
        next
    }

    /// Of every correction.
    fn weights(&self) -> DVector<f64> {
        let n = self.before.len();
        let last = n - 1;
        let shown = |i: usize| &self.before[i].2;
        let differences: Vec<DVector<f64>> = (0..last).map(|i| shown(i) - shown(last)).collect();
        let products = DMatrix::from_fn(last, last, |i, j| differences[i].dot(&differences[j]));
        let largest = products.diagonal().amax();
        let right = DVector::from_fn(last, |i, _| -differences[i].dot(shown(last)));
        let solved = cholesky(products + DMatrix::identity(last, last) * (SMALLEST * largest)).map(|f| f.solve(&right));
        let mut weights = solved.unwrap_or_else(|| DVector::zeros(last)).push(0.0);
        weights[last] = 1.0 - weights.sum();
        weights
    }
}

/// A weighted sum.
fn combined(terms: &[(f64, &Correction)]) -> Correction {
    let Some((_, first)) = terms.first() else { return Vec::new() };
    let of_muscle = |trial: usize, muscle: usize| {
        let mut out = DVector::zeros(first[trial][muscle].len());
        terms.iter().for_each(|(weight, of)| out.axpy(*weight, &of[trial][muscle], 1.0));
        out
    };
    (0..first.len()).map(|t| (0..first[t].len()).map(|m| of_muscle(t, m)).collect()).collect()
}
