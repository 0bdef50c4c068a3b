//! Forward-mode automatic differentiation with a fixed number of directions.

use super::scalar::Scalar;
use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value and its partial derivatives with respect to `N` chosen variables.
///
/// # References
/// Griewank & Walther (2008), *Evaluating Derivatives*, chapter 3, doi:10.1137/1.9780898717761.
#[derive(Clone, Copy, Debug)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// Partial derivatives of the value.
    pub gradient: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number with the given derivatives.
    pub fn new(value: f64, gradient: [f64; N]) -> Self {
        Self { value, gradient }
    }

    /// The variable with number `index` < `N`: derivative 1 with respect to itself.
    pub fn variable(value: f64, index: usize) -> Self {
        let mut gradient = [0.0; N];
        gradient[index] = 1.0;
        Self { value, gradient }
    }

    #[inline]
    fn combine(self, a: f64, other: Self, b: f64, value: f64) -> Self {
        let mut gradient = [0.0; N];
        for i in 0..N {
            gradient[i] = a * self.gradient[i] + b * other.gradient[i];
        }
        Self { value, gradient }
    }
}

impl<const N: usize> Scalar for Dual<N> {
    #[inline]
    fn value(self) -> f64 {
        self.value
    }
    #[inline]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, gradient: self.gradient.map(|g| derivative * g) }
    }
}

impl<const N: usize> From<f64> for Dual<N> {
    #[inline]
    fn from(value: f64) -> Self {
        Self { value, gradient: [0.0; N] }
    }
}

impl<const N: usize> PartialEq for Dual<N> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.combine(1.0, other, 1.0, self.value + other.value)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.combine(1.0, other, -1.0, self.value - other.value)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.combine(other.value, other, self.value, self.value * other.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let reciprocal = 1.0 / other.value;
        self.combine(reciprocal, other, -value * reciprocal, value)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, gradient: self.gradient }
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, gradient: self.gradient }
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, other: f64) -> Self {
        self.chain(self.value * other, other)
    }
}

impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, other: f64) -> Self {
        self.chain(self.value / other, 1.0 / other)
    }
}

macro_rules! assign {
    ($trait:ident, $method:ident, $op:tt) => {
        impl<const N: usize> $trait for Dual<N> {
            #[inline]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    };
}
assign!(AddAssign, add_assign, +);
assign!(SubAssign, sub_assign, -);
assign!(MulAssign, mul_assign, *);
assign!(DivAssign, div_assign, /);

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// One expression that uses every operation, as a function of two variables.
    fn expression<S: Scalar>(x: S, y: S) -> S {
        let mut s = (x * y + 2.0 - x / y) * 3.0 / 7.0 - 1.0;
        s += x.sqrt() * y.sin() - x.cos() / y.tan();
        s -= (x / 10.0).asin() + (y / 10.0).acos() * x.exp().ln();
        s *= x.powi(3).recip() + (-y).abs();
        s /= x.max(y) + x.min(y) * S::constant(0.5);
        s
    }

    #[test]
    fn verif_dual_derivatives_equal_finite_differences() {
        let (x, y, h) = (1.3, 0.7, 1e-6);
        let dual = expression(Dual::<2>::variable(x, 0), Dual::<2>::variable(y, 1));
        assert_relative_eq!(dual.value, expression(x, y), max_relative = 1e-14);
        let dx = (expression(x + h, y) - expression(x - h, y)) / (2.0 * h);
        let dy = (expression(x, y + h) - expression(x, y - h)) / (2.0 * h);
        assert_relative_eq!(dual.gradient[0], dx, max_relative = 1e-8);
        assert_relative_eq!(dual.gradient[1], dy, max_relative = 1e-8);
    }
}
