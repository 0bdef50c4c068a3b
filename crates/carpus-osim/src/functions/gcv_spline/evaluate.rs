//! Derivatives of a natural spline from its B-spline coefficients.

/// Derivative of order `order` at `t`, which lies in interval `interval` (the number of abscissae not above `t`), of
/// the natural spline of degree 2m − 1 with B-spline coefficients `c` (Woltring's SPLDER).
pub(super) fn derivative(order: usize, m: usize, t: f64, x: &[f64], c: &[f64], interval: usize) -> f64 {
    if order >= 2 * m {
        return 0.0;
    }
    // Signed arithmetic and counting from 1, as in the paper: intervals reach beyond both ends of the data.
    let (n, l, degree_plus_1, ider) = (x.len() as isize, interval as isize, 2 * m as isize, order as isize);
    let m = m as isize;
    let k = degree_plus_1 - ider;
    let knot = |j: isize| x[(j - 1) as usize];
    // Coefficients of the 2m B-splines that do not vanish here; q[0] is unused.
    let mut q = vec![0.0; degree_plus_1 as usize + 1];
    for j in (l + 1).max(m + 1)..=(l + degree_plus_1).min(n + m) {
        q[(j - l) as usize] = c[(j - m - 1) as usize];
    }
    if ider > 0 {
        differentiate(&mut q, ider, degree_plus_1, l, n, knot);
    }
    insert_knots(&mut q, k, t, l, n, knot);
    (k..degree_plus_1).fold(q[k as usize], |z, j| if ider > 0 { z * j as f64 } else { z })
}

/// Replaces coefficients by those of the derivative of order `ider`.
fn differentiate(q: &mut [f64], ider: isize, two_m: isize, l: isize, n: isize, knot: impl Fn(isize) -> f64) {
    let shift = two_m - l;
    for i in 1..=ider {
        let first = l + 1 - two_m + i;
        for j in (first.max(1)..=l.min(n - two_m + i)).rev() {
            let at = (shift + j) as usize;
            q[at] = (q[at] - q[at - 1]) / (knot(j + two_m - i) - knot(j));
        }
        if first < 1 {
            for j in (i + 1..=shift).rev() {
                q[j as usize] = -q[j as usize - 1];
            }
        }
    }
    q.copy_within(1 + ider as usize..=two_m as usize, 1);
}

/// Evaluates by repeated convex combination (de Boor), with the modified recursion of the natural end intervals; the
/// value ends in `q[k]`.
fn insert_knots(q: &mut [f64], k: isize, t: f64, l: isize, n: isize, knot: impl Fn(isize) -> f64) {
    for i in 1..k {
        let mut at = k as usize;
        let mut j = l;
        for _ in n - k + i + 1..=l {
            q[at] = q[at - 1] + (t - knot(j)) * q[at];
            at -= 1;
            j -= 1;
        }
        let first = l - k + 1 + i;
        for _ in first.max(1)..=l.min(n - k + i) {
            let end = knot(j + k - i);
            q[at] += (end - t) * (q[at - 1] - q[at]) / (end - knot(j));
            at -= 1;
            j -= 1;
        }
        if first <= 0 {
            j = k - i;
            for _ in 1..=1 - first {
                q[at] += (knot(j) - t) * q[at - 1];
                at -= 1;
                j -= 1;
            }
        }
    }
}
