//! Linear systems of which most unknowns act only on a few common ones and within small groups.

use nalgebra::{DMatrix, DVector, Dyn, LU};
use std::ops::Range;

/// Factors of `I − c J`, where J is 0 between the groups: `[A B; C D]` with D block by block, by the complement
/// `A − B D⁻¹ C`. Of this the leading unknowns that do not act on one another, as coordinates whose rates are speeds,
/// are eliminated in the same way: `[I P; Q R]` by `R − Q P`.
#[derive(Clone, Debug)]
pub struct Grouped {
    /// Unknowns before all groups.
    core: usize,
    /// What the leading unknowns' rates depend on, and what depends on them.
    by_others: DMatrix<f64>,
    on_others: DMatrix<f64>,
    complement: LU<f64, Dyn, Dyn>,
    /// Rows of B that are not 0.
    rows: Range<usize>,
    right: DMatrix<f64>,
    /// Columns of D⁻¹ C that are not 0.
    columns: Range<usize>,
    below: DMatrix<f64>,
    /// D⁻¹ of every group.
    inverses: Vec<(Range<usize>, DMatrix<f64>)>,
}

impl Grouped {
    /// Factors `I − c J`; `None` where it is singular.
    ///
    /// - `groups`: trailing unknowns, ascending and without gaps
    pub fn new(jacobian: &DMatrix<f64>, c: f64, groups: &[Range<usize>]) -> Option<Grouped> {
        let n = jacobian.nrows();
        let core = groups.first().map_or(n, |group| group.start);
        let tail = n - core;
        let mut complement = DMatrix::identity(core, core) - jacobian.view((0, 0), (core, core)) * c;
        let (right, below) = (jacobian.view((0, core), (core, tail)), jacobian.view((core, 0), (tail, core)));
        let rows = extent(core, |i| right.row(i).iter().any(|x| *x != 0.0));
        let columns = extent(core, |j| below.column(j).iter().any(|x| *x != 0.0));
        let right = right.rows(rows.start, rows.len()) * -c;
        let mut below = below.columns(columns.start, columns.len()) * -c;
        let mut inverses = Vec::with_capacity(groups.len());
        for group in groups {
            let size = group.len();
            let block = jacobian.view((group.start, group.start), (size, size));
            let inverse = (DMatrix::identity(size, size) - block * c).try_inverse()?;
            let rows = &inverse * below.rows(group.start - core, size);
            below.rows_mut(group.start - core, size).copy_from(&rows);
            inverses.push((group.clone(), inverse));
        }
        let size = (rows.len(), columns.len());
        complement.view_mut((rows.start, columns.start), size).gemm(-1.0, &right, &below, 1.0);
        let lead = (0..rows.start).find(|l| (0..=*l).any(|i| jacobian[(i, *l)] != 0.0 || jacobian[(*l, i)] != 0.0));
        let lead = lead.unwrap_or(rows.start);
        let others = core - lead;
        let by_others = complement.view((0, lead), (lead, others)).into_owned();
        let on_others = complement.view((lead, 0), (others, lead)).into_owned();
        let mut complement = complement.view_range(lead.., lead..).into_owned();
        for (j, column) in by_others.column_iter().enumerate() {
            for (i, value) in column.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                complement.column_mut(j).axpy(-value, &on_others.column(i), 1.0);
            }
        }
        let complement = complement.lu();
        let found = Grouped { core, by_others, on_others, complement, rows, right, columns, below, inverses };
        found.complement.is_invertible().then_some(found)
    }

    /// Solves for one right side, in place.
    pub fn solve_mut(&self, x: &mut DVector<f64>) {
        for (group, inverse) in &self.inverses {
            let solved = inverse * x.rows(group.start, group.len());
            x.rows_mut(group.start, group.len()).copy_from(&solved);
        }
        let tail = x.len() - self.core;
        let mut first = x.rows(0, self.core).into_owned();
        let (rows, columns) = (&self.rows, &self.columns);
        first.rows_mut(rows.start, rows.len()).gemv(-1.0, &self.right, &x.rows(self.core, tail), 1.0);
        let lead = self.by_others.nrows();
        let mut others = first.rows(lead, self.core - lead).into_owned();
        others.gemv(-1.0, &self.on_others, &first.rows(0, lead), 1.0);
        self.complement.solve_mut(&mut others);
        first.rows_mut(0, lead).gemv(-1.0, &self.by_others, &others, 1.0);
        first.rows_mut(lead, others.len()).copy_from(&others);
        x.rows_mut(self.core, tail).gemv(-1.0, &self.below, &first.rows(columns.start, columns.len()), 1.0);
        x.rows_mut(0, self.core).copy_from(&first);
    }
}

/// From the first to the last of `n` that are something.
fn extent(n: usize, is: impl Fn(usize) -> bool) -> Range<usize> {
    let first = (0..n).find(|i| is(*i)).unwrap_or(n);
    first..(0..n).rev().find(|i| is(*i)).map_or(first, |last| last + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_groups_change_no_solution() {
        let groups = [3..5, 5..6, 6..9];
        let group_of = |i: usize| groups.iter().position(|g| g.contains(&i));
        let right = DVector::from_fn(9, |i, _| 1.0 + i as f64);
        for lead in 0..3 {
            let jacobian = DMatrix::from_fn(9, 9, |i, j| match (group_of(i), group_of(j)) {
                (Some(a), Some(b)) if a != b => 0.0,
                // Leading unknowns act on others only, and groups do not act on them.
                _ if i < lead && (j < lead || j >= 3) => 0.0,
                _ => ((i * 7 + j * 5) % 11) as f64 - 4.0,
            });
            let expected = (DMatrix::identity(9, 9) - &jacobian * 0.1).lu().solve(&right).expect("solution");
            for groups in [&groups[..], &[]] {
                let mut found = right.clone();
                let factors = Grouped::new(&jacobian, 0.1, groups).expect("factors");
                assert!(factors.by_others.nrows() == lead || groups.is_empty());
                factors.solve_mut(&mut found);
                assert!((&found - &expected).amax() < 1e-12, "{lead}: {found} instead of {expected}");
            }
        }
    }
}
