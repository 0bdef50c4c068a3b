//! Piecewise polynomials: which piece, its value, the quintic between two ends.

/// Coefficients c₀…c₅ of the quintic on 0…1 with the given values, slopes and second derivatives (per unit of x) at the
/// ends of an interval of the given width.
pub(crate) fn quintic(left: [f64; 3], right: [f64; 3], width: f64) -> [f64; 6] {
    let [p0, v0, a0] = [left[0], left[1] * width, left[2] * width * width];
    let [p1, v1, a1] = [right[0], right[1] * width, right[2] * width * width];
    let rise = p1 - p0;
    [
        p0,
        v0,
        0.5 * a0,
        10.0 * rise - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
        -15.0 * rise + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
        6.0 * rise - 3.0 * (v0 + v1) - 0.5 * (a0 - a1),
    ]
}

/// c₀ + c₁ t + c₂ t² + …
#[inline(always)]
pub(crate) fn polynomial<const N: usize>(c: &[f64; N], t: f64) -> f64 {
    let mut value = c[N - 1];
    for k in (0..N - 1).rev() {
        value = c[k] + t * value;
    }
    value
}

/// The piece that `x` falls in: the last one that starts at or before it, the first for what lies before all.
///
/// - `count`: number of pieces, at least one
/// - `start`: where a piece starts, ascending
/// - `cursor`: the piece found last; most questions are about it or the next one
#[inline]
pub(crate) fn locate(count: usize, start: impl Fn(usize) -> f64, x: f64, cursor: &mut usize) -> usize {
    let last = count - 1;
    let mut i = (*cursor).min(last);
    if x >= start(i) {
        // Mostly here or a few pieces on.
        let near = (i + MOST_ON).min(last);
        while i < near && x >= start(i + 1) {
            i += 1;
        }
        if i == last || x < start(i + 1) {
            *cursor = i;
            return i;
        }
    }
    let (mut low, mut high) = (0, count);
    while low < high {
        let middle = (low + high) / 2;
        if start(middle) <= x { low = middle + 1 } else { high = middle }
    }
    *cursor = low.saturating_sub(1);
    *cursor
}

/// Pieces looked at beyond the last one before all are searched.
const MOST_ON: usize = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_quintic_has_the_given_ends() {
        // x³ − x⁵ on 1…3.
        let jet = |x: f64| [x.powi(3) - x.powi(5), 3.0 * x * x - 5.0 * x.powi(4), 6.0 * x - 20.0 * x.powi(3)];
        let c = quintic(jet(1.0), jet(3.0), 2.0);
        for t in [0.0, 0.2, 0.7, 1.0] {
            assert!((polynomial(&c, t) - jet(1.0 + 2.0 * t)[0]).abs() < 1e-11);
        }
    }

    #[test]
    fn verif_pieces_are_located_from_any_cursor() {
        let starts = [0.0, 1.0, 1.5, 4.0];
        for (x, expected) in [(-1.0, 0), (0.0, 0), (0.9, 0), (1.0, 1), (1.4, 1), (1.5, 2), (3.9, 2), (4.0, 3), (9.0, 3)]
        {
            for from in 0..6 {
                let mut cursor = from;
                assert_eq!(locate(starts.len(), |i| starts[i], x, &mut cursor), expected, "{x} from {from}");
            }
        }
    }
}
