//! How noise of the EMG passes through one muscle.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

/// Moment of one muscle by the logarithm of its excitation on knots, blocks × knots.
#[derive(Clone, Debug)]
pub struct Response {
    pub(super) by_knots: DMatrix<f64>,
    /// Per knot: the blocks in which it shows.
    rows: Vec<Range<usize>>,
}

impl Response {
    /// - `blocks`, `knots`: how many
    pub fn new(blocks: usize, knots: usize) -> Response {
        Response { by_knots: DMatrix::zeros(blocks, knots), rows: vec![0..0; knots] }
    }

    /// Adds what a knot causes in a block.
    pub fn add(&mut self, block: usize, knot: usize, moment: f64) {
        self.by_knots[(block, knot)] += moment;
        let rows = &mut self.rows[knot];
        *rows = if rows.start == rows.end { block..block + 1 } else { rows.start.min(block)..rows.end.max(block + 1) };
    }

    /// Adds G K Gᵀ to the lower triangle of `covariance`; with `factors` on the knots G D K D Gᵀ.
    ///
    /// - `by_step`: correlations over knots
    pub(super) fn add_covariance(
        &self,
        by_step: &[f64],
        factors: Option<&DVector<f64>>,
        covariance: &mut DMatrix<f64>,
    ) {
        let factor = |knot: usize| factors.map_or(1.0, |f| f[knot]);
        let (n, knots) = self.by_knots.shape();
        if self.rows.iter().all(|rows| rows.len() == n) {
            let step = |steps: usize| by_step.get(steps).copied().unwrap_or(0.0);
            let k = DMatrix::from_fn(knots, knots, |i, j| factor(i) * step(i.abs_diff(j)) * factor(j));
            *covariance += &self.by_knots * k * self.by_knots.transpose();
            return;
        }
        let mut spread = vec![0.0; n];
        for (knot, rows) in self.rows.iter().enumerate().filter(|(_, rows)| !rows.is_empty()) {
            let end = self.spread(by_step, factor, knot, &mut spread).end;
            for row in rows.clone() {
                let weight = self.by_knots[(row, knot)] * factor(knot);
                let to = &mut covariance.as_mut_slice()[row * n..(row + 1) * n];
                to[row..end].iter_mut().zip(&spread[row..end]).for_each(|(to, from)| *to += weight * from);
            }
        }
    }

    /// A column of G K, of factors on the knots G D K, and the blocks in which it shows.
    ///
    /// - `knot`: which column; `out`: per block, overwritten
    fn spread(&self, by_step: &[f64], factor: impl Fn(usize) -> f64, knot: usize, out: &mut [f64]) -> Range<usize> {
        let (n, knots) = self.by_knots.shape();
        out.fill(0.0);
        let (mut start, mut end) = (n, 0);
        for other in knot.saturating_sub(by_step.len() - 1)..(knot + by_step.len()).min(knots) {
            let weight = by_step[knot.abs_diff(other)] * factor(other);
            let shown = self.rows[other].clone();
            if shown.is_empty() {
                continue;
            }
            let column = &self.by_knots.as_slice()[other * n..(other + 1) * n];
            (start, end) = (start.min(shown.start), end.max(shown.end));
            out[shown.clone()].iter_mut().zip(&column[shown]).for_each(|(s, g)| *s += weight * g);
        }
        start.min(end)..end
    }
}
