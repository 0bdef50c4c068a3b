//! Minimum of a sum of squares within a box: Levenberg–Marquardt on the coordinates that are not held at a bound.

use nalgebra::{DMatrix, DVector};

/// A sum of squares D, half its gradient, and the Gauss–Newton half of its second derivatives.
#[derive(Clone, Debug)]
pub(super) struct Quadratic {
    pub(super) value: f64,
    pub(super) gradient: DVector<f64>,
    pub(super) information: DMatrix<f64>,
}

/// Box and limits of a descent.
pub(super) struct Limits<'a> {
    pub(super) lower: &'a [f64],
    pub(super) upper: &'a [f64],
    /// Coordinates that stay.
    pub(super) fixed: &'a [bool],
    /// Longest step of each coordinate.
    pub(super) step: &'a [f64],
    pub(super) evaluations: usize,
    /// Ends when a step promises less than this decrease of D.
    pub(super) tolerance: f64,
}

/// From `start` downhill. `None` only if `start` itself cannot be evaluated.
pub(super) fn descend(
    evaluate: &mut dyn FnMut(&DVector<f64>) -> Option<Quadratic>,
    start: DVector<f64>,
    limits: &Limits,
) -> Option<(DVector<f64>, Quadratic)> {
    let mut x = start;
    for i in 0..x.len() {
        x[i] = x[i].clamp(limits.lower[i], limits.upper[i]);
    }
    let mut at = evaluate(&x)?;
    let mut damping = 1e-4;
    for _ in 0..limits.evaluations {
        let Some(step) = step(&x, &at, damping, limits) else { break };
        let promised = -step.dot(&(2.0 * &at.gradient + &at.information * &step));
        if promised < limits.tolerance {
            break;
        }
        let next = DVector::from_fn(x.len(), |i, _| (x[i] + step[i]).clamp(limits.lower[i], limits.upper[i]));
        match evaluate(&next).filter(|q| q.value < at.value) {
            Some(q) => {
                (x, at) = (next, q);
                damping = (damping / 8.0).max(1e-9);
            }
            None => damping = (damping * 10.0).max(1e-3),
        }
    }
    Some((x, at))
}

/// The damped Gauss–Newton step on what is free to move.
fn step(x: &DVector<f64>, at: &Quadratic, damping: f64, limits: &Limits) -> Option<DVector<f64>> {
    let n = x.len();
    let mut free: Vec<usize> = (0..n)
        .filter(|i| {
            let outward = (x[*i] <= limits.lower[*i] && at.gradient[*i] > 0.0)
                || (x[*i] >= limits.upper[*i] && at.gradient[*i] < 0.0);
            !limits.fixed[*i] && !outward
        })
        .collect();
    // A coordinate that the step would take out of the box is stopped at its bound, and the others go on without it.
    for _ in 0..3 {
        let m = free.len();
        if m == 0 {
            return None;
        }
        let largest = free.iter().map(|i| at.information[(*i, *i)]).fold(0.0, f64::max);
        let matrix = DMatrix::from_fn(m, m, |a, b| {
            let h = at.information[(free[a], free[b])];
            if a == b { h * (1.0 + damping) + 1e-12 * largest + 1e-300 } else { h }
        });
        let right = DVector::from_fn(m, |a, _| -at.gradient[free[a]]);
        let solved = matrix.cholesky()?.solve(&right);
        let mut out = DVector::zeros(n);
        free.iter().enumerate().for_each(|(a, i)| out[*i] = solved[a]);
        let excess = (0..n).map(|i| out[i].abs() / limits.step[i]).fold(1.0, f64::max);
        out /= excess;
        let leaving =
            |i: &usize| (x[*i] <= limits.lower[*i] && out[*i] < 0.0) || (x[*i] >= limits.upper[*i] && out[*i] > 0.0);
        if !free.iter().any(leaving) {
            return Some(out);
        }
        free.retain(|i| !leaving(i));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_minimum_lies_inside_or_at_the_bound_that_kuhn_and_tucker_name() {
        // D = (x − 3)² + (x + y)², x ≤ 1: minimum at x = 1, y = −1.
        let mut evaluate = |p: &DVector<f64>| {
            let r = [p[0] - 3.0, p[0] + p[1]];
            Some(Quadratic {
                value: r[0] * r[0] + r[1] * r[1],
                gradient: DVector::from_vec(vec![r[0] + r[1], r[1]]),
                information: DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 1.0]),
            })
        };
        let limits = Limits {
            lower: &[-5.0, -5.0],
            upper: &[1.0, 5.0],
            fixed: &[false, false],
            step: &[10.0, 10.0],
            evaluations: 40,
            tolerance: 1e-12,
        };
        let (x, q) = descend(&mut evaluate, DVector::from_vec(vec![0.0, 4.0]), &limits).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] + 1.0).abs() < 1e-5, "{x}");
        assert!((q.value - 4.0).abs() < 1e-8);
        let limits = Limits { upper: &[5.0, 5.0], ..limits };
        let (x, _) = descend(&mut evaluate, DVector::from_vec(vec![0.0, 4.0]), &limits).unwrap();
        assert!((x[0] - 3.0).abs() < 1e-5 && (x[1] + 3.0).abs() < 1e-5, "{x}");
    }
}
