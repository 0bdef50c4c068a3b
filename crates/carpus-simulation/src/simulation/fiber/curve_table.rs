//! Tabulated muscle curves: the Bézier curves of a muscle, resampled once so that a value and a slope cost a few
//! nanoseconds.
//!
//! A Bézier curve gives y as a function of a parameter that must be solved for at every evaluation. Between uniformly
//! spaced abscissae the curve is replaced by the quintic that matches value, slope and second derivative at both ends
//! of the cell. Value and slope that [`CurveTable::value_and_slope`] returns belong to the same function, so that
//! Newton's method and sensitivities built on them are exact for the tabulated curve.

use crate::simulation::piecewise::quintic;

/// Largest deviation of a tabulated curve from the original, relative to the curve's largest tabulated magnitude
/// (at least 1); 1,000 times below what moves a force by 1e-5·`max_isometric_force`.
const TABLE_TOLERANCE: f64 = 1e-8;
const FEWEST_CELLS: usize = 64;
const MOST_CELLS: usize = 8192;
/// 1.5·2⁵²: adding it to a small number leaves the nearest integer in the lowest bits.
const ROUNDING: f64 = 6_755_399_441_055_744.0;

/// A curve y(x), quintic between uniform abscissae, linear beyond its domain.
#[derive(Clone, Debug)]
pub(crate) struct CurveTable {
    lower: f64,
    upper: f64,
    cells_per_unit: f64,
    /// Coefficients c₀…c₅ in the local coordinate −½…½ of each cell.
    cells: Vec<[f64; 6]>,
    /// Value and slope at the ends of the domain.
    ends: [(f64, f64); 2],
    /// Largest deviation found at the points checked.
    deviation: f64,
}

impl CurveTable {
    /// Tabulates a curve whose value, first and second derivative `jet` gives, on `domain`.
    pub(crate) fn build(jet: impl Fn(f64) -> [f64; 3], domain: [f64; 2]) -> CurveTable {
        let mut cells = FEWEST_CELLS;
        loop {
            let table = CurveTable::with_cells(&jet, domain, cells);
            let scale = table.cells.iter().fold(1.0_f64, |m, c| m.max(c[0].abs()));
            if table.deviation <= TABLE_TOLERANCE * scale || cells >= MOST_CELLS {
                return table;
            }
            cells *= 2;
        }
    }

    fn with_cells(jet: &impl Fn(f64) -> [f64; 3], [lower, upper]: [f64; 2], count: usize) -> CurveTable {
        let width = (upper - lower) / count as f64;
        // End jets are taken just inside the domain, where the curve and not its extrapolation decides the second
        // derivative.
        let inset = 1e-12 * (upper - lower);
        let abscissa = |i: usize| {
            if i == 0 {
                lower + inset
            } else if i == count {
                upper - inset
            } else {
                lower + width * i as f64
            }
        };
        let mut cells = Vec::with_capacity(count);
        let mut left = jet(abscissa(0));
        let first = left;
        for i in 0..count {
            let right = jet(abscissa(i + 1));
            cells.push(centred(quintic(left, right, width)));
            left = right;
        }
        let mut table = CurveTable {
            lower,
            upper,
            cells_per_unit: 1.0 / width,
            cells,
            ends: [(first[0], first[1]), (left[0], left[1])],
            deviation: 0.0,
        };
        table.deviation = (0..count)
            .flat_map(|i| [0.25, 0.5, 0.75].map(|f| lower + width * (i as f64 + f)))
            .map(|x| (table.value_and_slope(x).0 - jet(x)[0]).abs())
            .fold(0.0, f64::max);
        table
    }

    /// y and dy/dx at `x`.
    #[inline]
    pub(crate) fn value_and_slope(&self, x: f64) -> (f64, f64) {
        if x <= self.lower {
            let (y, slope) = self.ends[0];
            return (y + slope * (x - self.lower), slope);
        }
        if x >= self.upper {
            let (y, slope) = self.ends[1];
            return (y + slope * (x - self.upper), slope);
        }
        // The nearest middle of a cell, by the rounding of an addition: cheaper than a conversion that saturates.
        let position = (x - self.lower) * self.cells_per_unit - 0.5;
        let rounded = position + ROUNDING;
        let Some(&[c0, c1, c2, c3, c4, c5]) = self.cells.get(rounded.to_bits() as u32 as usize) else {
            // Rounding has led past the last cell.
            return self.ends[1];
        };
        let t = position - (rounded - ROUNDING);
        // Horner's scheme for the value, and over its intermediate values for the slope.
        let v4 = c4 + t * c5;
        let v3 = c3 + t * v4;
        let v2 = c2 + t * v3;
        let v1 = c1 + t * v2;
        let value = c0 + t * v1;
        let slope = v1 + t * (v2 + t * (v3 + t * (v4 + t * c5)));
        (value, slope * self.cells_per_unit)
    }

    /// Largest deviation from the original curve at the points checked while building.
    pub(crate) fn deviation(&self) -> f64 {
        self.deviation
    }

    /// Domain outside of which the curve is linear.
    #[cfg(test)]
    pub(crate) fn domain(&self) -> [f64; 2] {
        [self.lower, self.upper]
    }
}

/// The same polynomial in the coordinate −½…½.
fn centred(mut c: [f64; 6]) -> [f64; 6] {
    for first in 0..5 {
        for k in (first..5).rev() {
            c[k] += 0.5 * c[k + 1];
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_table_matches_a_smooth_curve_and_extends_linearly() {
        let jet = |x: f64| [x.sin(), x.cos(), -x.sin()];
        let table = CurveTable::build(jet, [0.2, 2.9]);
        for i in 0..1000 {
            let x = 0.2 + 2.7 * (i as f64 + 0.37) / 1000.0;
            let (y, slope) = table.value_and_slope(x);
            assert!((y - x.sin()).abs() < 1e-10 && (slope - x.cos()).abs() < 1e-8, "x = {x}");
        }
        let (y, slope) = table.value_and_slope(3.4);
        assert!((slope - 2.9_f64.cos()).abs() < 1e-10 && (y - (2.9_f64.sin() + 0.5 * slope)).abs() < 1e-10);
        assert!(table.deviation() < 1e-9);
        // Cells meet without a gap, the last one the straight line.
        for i in 0..=64 {
            let x = 0.2 + 2.7 * f64::from(i) / 64.0;
            let (y, slope) = table.value_and_slope(x.next_down());
            assert!((y - x.sin()).abs() < 1e-10 && (slope - x.cos()).abs() < 1e-8, "x = {x}");
        }
        assert_eq!(table.domain(), [0.2, 2.9]);
    }

    #[test]
    fn verif_slope_is_the_derivative_of_the_tabulated_value() {
        let table = CurveTable::build(|x: f64| [x.exp(), x.exp(), x.exp()], [-1.0, 1.0]);
        for x in [-0.93, -0.5, 0.013, 0.77] {
            let difference = (table.value_and_slope(x + 1e-6).0 - table.value_and_slope(x - 1e-6).0) / 2e-6;
            assert!((difference - table.value_and_slope(x).1).abs() < 1e-8);
        }
    }
}
