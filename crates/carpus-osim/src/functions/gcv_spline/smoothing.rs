//! Woltring's fit of a smoothing spline: banded linear systems and the search for the smoothing parameter.

/// Relative size below which the smoothing parameter counts as zero, and above whose inverse as infinite.
const EPSILON: f64 = 1e-15;
/// Smoothing parameter at which the search for a larger one ends.
const LARGEST_PARAMETER: f64 = 999_999_999_999_999.9;
/// Golden ratio, with the digits of the original.
const TAU: f64 = 1.618033983;
/// Relative width of the bracket at which the search ends.
const SEARCH_TOLERANCE: f64 = 1e-6;

/// A band matrix of n rows; element (i, i + l) for −half ≤ l ≤ half.
struct Band {
    half: isize,
    data: Vec<f64>,
}

impl Band {
    fn new(n: usize, half: usize) -> Self {
        Self { half: half as isize, data: vec![0.0; n * (2 * half + 1)] }
    }

    fn index(&self, row: usize, offset: isize) -> usize {
        (row as isize * (2 * self.half + 1) + offset + self.half) as usize
    }

    fn at(&self, row: usize, offset: isize) -> f64 {
        self.data[self.index(row, offset)]
    }

    fn at_mut(&mut self, row: usize, offset: isize) -> &mut f64 {
        let index = self.index(row, offset);
        &mut self.data[index]
    }

    /// Offsets of row `row` that lie inside an n × n matrix, at most `half` from the diagonal.
    fn offsets(n: usize, row: usize, half: isize) -> std::ops::RangeInclusive<isize> {
        -half.min(row as isize)..=half.min((n - 1 - row) as isize)
    }
}

/// B-spline coefficients of the smoothing spline through (x, y) with unit weights. `variance`: known variance of the
/// noise (zero: interpolation); `None`: by generalized cross-validation.
pub(super) fn fit(m: usize, x: &[f64], y: &[f64], variance: Option<f64>) -> Vec<f64> {
    let (basis, basis_scale) = basis(m, x);
    let roughness = roughness(m, x);
    let roughness_scale = roughness.data.iter().map(|e| e.abs()).sum::<f64>() / x.len() as f64 / basis_scale;
    let problem = Smoothing { m, y, basis, roughness, roughness_scale, variance };
    let parameter = problem.best_parameter();
    problem.solve(parameter).coefficients
}

/// Values of the natural B-splines at the data abscissae (band of m − 1), and the mean sum of their magnitudes.
fn basis(m: usize, x: &[f64]) -> (Band, f64) {
    let n = x.len();
    let mut band = Band::new(n, m - 1);
    if m == 1 {
        band.data.fill(1.0);
        return (band, 1.0);
    }
    let knot = |j: usize| x[j - 1]; // knots count from 1 below, as in the paper
    let mut q = vec![0.0; 2 * m]; // q[k] holds offset k + 1 − m
    for l in 1..=n {
        let arg = knot(l);
        q.fill(0.0);
        q[2 * m - 2] = if l == 1 || l == n { 1.0 } else { 1.0 / (knot(l + 1) - knot(l - 1)) };
        for i in 3..=2 * m {
            let mut r = 2 * m - i;
            let mut v = q[r];
            let mut next = |q: &mut [f64], combine: &dyn Fn(f64, f64) -> f64| {
                let u = v;
                v = q[r + 1];
                q[r] = combine(u, v);
                r += 1;
            };
            for j in l + 1..=i {
                next(&mut q, &|u, v| u + (knot(j) - arg) * v);
            }
            let first = (l + 1).saturating_sub(i).max(1);
            let last = (l - 1).min(n - i);
            for j in first..=last {
                if i < 2 * m {
                    let y = knot(i + j);
                    next(&mut q, &|u, v| u + (v - u) * (y - arg) / (y - knot(j)));
                } else {
                    next(&mut q, &|u, v| (arg - knot(j)) * u + (knot(i + j) - arg) * v);
                }
            }
            for j in n - i + 1..l {
                next(&mut q, &|u, v| (arg - knot(j)) * u + v);
            }
        }
        let start = band.index(l - 1, 1 - m as isize);
        band.data[start..start + 2 * m - 1].copy_from_slice(&q[..2 * m - 1]);
    }
    for row in 0..m - 1 {
        for k in row + 1..m {
            *band.at_mut(row, -(k as isize)) = 0.0;
            *band.at_mut(n - 1 - row, k as isize) = 0.0;
        }
    }
    let scale = band.data.iter().map(|e| e.abs()).sum::<f64>() / n as f64;
    (band, scale)
}

/// The matrix of the roughness penalty (integral of the squared m-th derivative) in the natural B-spline basis, band
/// of m: divided-difference coefficients.
fn roughness(m: usize, x: &[f64]) -> Band {
    let n = x.len();
    let mut band = Band::new(n, m);
    let mut sign = -1.0;
    for i in 2..=m {
        sign *= -(i as f64);
    }
    for i in m + 1..2 * m {
        sign *= i as f64;
    }
    // Column j holds the divided difference over the points within m of it; row i, offset j − i.
    for j in 0..n {
        if j + m >= n {
            sign = -sign;
        }
        let low = j.saturating_sub(m);
        let high = (j + m).min(n - 1);
        let factor = if j + m < n && j >= m { sign * (x[j + m] - x[j - m]) } else { sign };
        for i in low..=high {
            let divided = (low..=high).filter(|&k| k != i).fold(factor, |f, k| f / (x[i] - x[k]));
            *band.at_mut(i, j as isize - i as isize) = divided;
        }
    }
    band
}

/// One smoothing problem.
struct Smoothing<'a> {
    m: usize,
    y: &'a [f64],
    basis: Band,
    roughness: Band,
    roughness_scale: f64,
    variance: Option<f64>,
}

/// Also where either is not a number: points beyond the range of numbers end the search, too.
fn is_worse(criterion: f64, than: f64) -> bool {
    criterion > than || criterion.is_nan() || than.is_nan()
}

/// The fit for one smoothing parameter.
struct Solution {
    coefficients: Vec<f64>,
    /// What the search minimizes.
    criterion: f64,
    /// The parameter, zero if it was too small to matter and capped if too large.
    parameter: f64,
}

impl Smoothing<'_> {
    /// The parameter that minimizes the criterion: bracketing by doubling, then golden section.
    fn best_parameter(&self) -> f64 {
        let criterion = |p: f64| self.solve(p).criterion;
        let mut low = 1.0 / self.roughness_scale;
        let mut middle = 2.0 * low;
        let mut at_middle = criterion(middle);
        loop {
            let solution = self.solve(low);
            if is_worse(solution.criterion, at_middle) {
                break;
            }
            if solution.parameter <= 0.0 {
                return low;
            }
            middle = low;
            at_middle = solution.criterion;
            low /= 2.0;
        }
        let mut high = 2.0 * middle;
        loop {
            let solution = self.solve(high);
            if is_worse(solution.criterion, at_middle) {
                break;
            }
            if solution.parameter >= LARGEST_PARAMETER || high > f64::MAX / 4.0 {
                return low;
            }
            at_middle = solution.criterion;
            high *= 2.0;
        }
        let mut step = (high - low) / TAU;
        let (mut right, mut left) = (low + step, high - step);
        let (mut at_left, mut at_right) = (criterion(left), criterion(right));
        loop {
            let leftwards = at_left <= at_right;
            if leftwards {
                high = right;
            } else {
                low = left;
            }
            let error = (high - low) / (low + high);
            if error * error + 1.0 == 1.0 || error <= SEARCH_TOLERANCE || error.is_nan() {
                return (low + high) / 2.0;
            }
            step /= TAU;
            if leftwards {
                (right, at_right) = (left, at_left);
                left = high - step;
                at_left = criterion(left);
            } else {
                (left, at_left) = (right, at_right);
                right = low + step;
                at_right = criterion(right);
            }
        }
    }

    fn solve(&self, parameter: f64) -> Solution {
        let n = self.y.len();
        let m = self.m as isize;
        let scaled = parameter * self.roughness_scale;
        let (effective, reported) = if scaled < EPSILON {
            (EPSILON / self.roughness_scale, 0.0)
        } else if scaled * EPSILON > 1.0 {
            let cap = 1.0 / (self.roughness_scale * EPSILON);
            (cap, cap)
        } else {
            (parameter, parameter)
        };
        let mut system = Band::new(n, self.m);
        for i in 0..n {
            for l in Band::offsets(n, i, m) {
                let basis = if l.abs() == m { 0.0 } else { self.basis.at(i, l) };
                *system.at_mut(i, l) = basis + effective * self.roughness.at(i, l);
            }
        }
        factorize(&mut system, n);
        let coefficients = substitute(&system, self.y);
        let trace = trace_of_product_with_inverse(&self.roughness, &mut system, n) * effective;
        let mean_trace = trace / n as f64;
        let mut residual = 0.0;
        for i in 0..n {
            let fitted: f64 = Band::offsets(n, i, m - 1)
                .map(|l| self.basis.at(i, l) * coefficients[(i as isize + l) as usize])
                .fold(-self.y[i], |sum, term| sum + term);
            residual += fitted * fitted;
        }
        residual /= n as f64;
        let criterion = match self.variance {
            Some(variance) => residual - variance * (2.0 * mean_trace - 1.0),
            None => residual / mean_trace / mean_trace,
        };
        Solution { coefficients, criterion, parameter: reported }
    }
}

/// LU factors of a band matrix in place, without pivoting: unit lower factor below the diagonal.
fn factorize(e: &mut Band, n: usize) {
    let m = e.half;
    for i in 0..n {
        let mut diagonal = e.at(i, 0);
        for k in 1..=m.min(i as isize) {
            diagonal -= e.at(i, -k) * e.at(i - k as usize, k);
        }
        *e.at_mut(i, 0) = diagonal;
        for l in 1..=m.min((n - 1 - i) as isize) {
            let mut lower = e.at(i + l as usize, -l);
            let mut upper = e.at(i, l);
            for k in 1..=(m - l).min(i as isize) {
                let row = i - k as usize;
                upper -= e.at(i, -k) * e.at(row, l + k);
                lower -= e.at(i + l as usize, -l - k) * e.at(row, k);
            }
            *e.at_mut(i, l) = upper;
            *e.at_mut(i + l as usize, -l) = lower / diagonal;
        }
    }
}

/// Solves with the factors of [`factorize`].
fn substitute(e: &Band, y: &[f64]) -> Vec<f64> {
    let n = y.len();
    let mut c = y.to_vec();
    for i in 1..n {
        for l in 1..=e.half.min(i as isize) {
            c[i] -= e.at(i, -l) * c[i - l as usize];
        }
    }
    for i in (0..n).rev() {
        for l in 1..=e.half.min((n - 1 - i) as isize) {
            c[i] -= e.at(i, l) * c[i + l as usize];
        }
        c[i] /= e.at(i, 0);
    }
    c
}

/// Trace of `b · E⁻¹` from the factors of E, which are replaced by the central bands of its inverse.
fn trace_of_product_with_inverse(b: &Band, e: &mut Band, n: usize) -> f64 {
    let m = e.half;
    let mut upper = vec![0.0; m as usize + 1];
    let mut lower = vec![0.0; m as usize + 1];
    *e.at_mut(n - 1, 0) = 1.0 / e.at(n - 1, 0);
    for i in (0..n - 1).rev() {
        let width = m.min((n - 1 - i) as isize);
        let inverse_diagonal = 1.0 / e.at(i, 0);
        for k in 1..=width {
            upper[k as usize] = e.at(i, k) * inverse_diagonal;
            lower[k as usize] = e.at(i + k as usize, -k);
        }
        let mut diagonal = 2.0 * inverse_diagonal;
        for j in (1..=width).rev() {
            let (mut above, mut below) = (0.0, 0.0);
            for k in 1..=width {
                above -= upper[k as usize] * e.at(i + k as usize, j - k);
                below -= lower[k as usize] * e.at(i + j as usize, k - j);
            }
            *e.at_mut(i, j) = above;
            *e.at_mut(i + j as usize, -j) = below;
            diagonal -= upper[j as usize] * below + lower[j as usize] * above;
        }
        *e.at_mut(i, 0) = diagonal / 2.0;
    }
    let mut trace = 0.0;
    for i in 0..n {
        for k in Band::offsets(n, i, m) {
            trace += b.at(i, k) * e.at((i as isize + k) as usize, -k);
        }
    }
    trace
}
