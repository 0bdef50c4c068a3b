//! A bracketed root finder that cannot leave its bracket.

use thiserror::Error;

/// A root found by [`newton_bisection`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BracketedRoot {
    /// The root.
    pub x: f64,
    /// f(x).
    pub residual: f64,
    /// Function evaluations spent.
    pub evaluations: usize,
}

/// Why there is no root.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum RootError {
    /// The function has the same sign at both ends, or is not a number there.
    #[error("no sign change between {lower} (f = {f_lower}) and {upper} (f = {f_upper})")]
    NotBracketed {
        /// Lower end.
        lower: f64,
        /// Upper end.
        upper: f64,
        /// Value at the lower end.
        f_lower: f64,
        /// Value at the upper end.
        f_upper: f64,
    },
}

/// Finds a root of `f` in `[lower, upper]`, where `f(lower) <= 0 <= f(upper)`, to the last bits of x.
///
/// Newton's step where it stays inside the bracket and at least halves the previous step, bisection elsewhere.
/// - `f`: value and derivative
///
/// # Errors
/// [`RootError::NotBracketed`] unless the signs at the ends are as required.
///
/// # References
/// Press et al. (2007), *Numerical Recipes*, section 9.4.
pub fn newton_bisection(
    lower: f64,
    upper: f64,
    mut f: impl FnMut(f64) -> (f64, f64),
) -> Result<BracketedRoot, RootError> {
    let (f_lower, _) = f(lower);
    let (f_upper, _) = f(upper);
    if f_lower == 0.0 {
        return Ok(BracketedRoot { x: lower, residual: 0.0, evaluations: 2 });
    }
    if f_upper == 0.0 {
        return Ok(BracketedRoot { x: upper, residual: 0.0, evaluations: 2 });
    }
    if !(f_lower < 0.0 && f_upper > 0.0) {
        return Err(RootError::NotBracketed { lower, upper, f_lower, f_upper });
    }
    let (mut low, mut high) = (lower, upper);
    let mut x = 0.5 * (low + high);
    let mut step = high - low;
    let mut best = BracketedRoot { x, residual: f64::INFINITY, evaluations: 2 };
    loop {
        let (value, slope) = f(x);
        best.evaluations += 1;
        if value.abs() <= best.residual.abs() {
            (best.x, best.residual) = (x, value);
        }
        if value == 0.0 {
            return Ok(best);
        }
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        let inside = newton > low && newton < high && (newton - x).abs() <= 0.5 * step.abs();
        let next = if inside { newton } else { 0.5 * (low + high) };
        step = next - x;
        // Neighbouring floating-point numbers: nothing is left between them.
        if next == x || next <= low || next >= high || best.evaluations > 500 {
            return Ok(best);
        }
        x = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_root_of_a_flat_and_a_steep_function() {
        let cubic = newton_bisection(-1.0, 3.0, |x| ((x - 0.3).powi(3), 3.0 * (x - 0.3).powi(2))).expect("bracketed");
        assert!((cubic.x - 0.3).abs() < 1e-5, "{cubic:?}");
        let steep = newton_bisection(-5.0, 9.0, |x: f64| (x.exp() - 2.0, x.exp())).expect("bracketed");
        assert!((steep.x - 2.0_f64.ln()).abs() < 1e-15, "{steep:?}");
        assert!(steep.evaluations < 30);
    }

    #[test]
    fn verif_root_needs_a_bracket() {
        assert!(matches!(newton_bisection(1.0, 2.0, |x| (x, 1.0)), Err(RootError::NotBracketed { .. })));
        assert!(matches!(newton_bisection(1.0, 2.0, |_| (f64::NAN, 1.0)), Err(RootError::NotBracketed { .. })));
    }
}
