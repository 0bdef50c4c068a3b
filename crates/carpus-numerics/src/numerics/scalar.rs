//! The number type of physics code that must yield exact derivatives.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number that may carry first derivatives: [`f64`] (none) or [`Dual`](super::Dual) (forward mode).
///
/// Comparisons look at the value alone, so that code written for `f64` takes the same branches with derivatives.
pub trait Scalar:
    Copy
    + Debug
    + PartialEq
    + PartialOrd
    + Send
    + Sync
    + 'static
    + From<f64>
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// The value without its derivatives.
    fn value(self) -> f64;

    /// f(self), where the caller knows the `value` f(x) and the `derivative` f′(x) at x = `self.value()`.
    fn chain(self, value: f64, derivative: f64) -> Self;

    /// A number whose derivatives are zero.
    fn constant(value: f64) -> Self {
        Self::from(value)
    }
    /// Square root.
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.chain(root, 0.5 / root)
    }
    /// Sine of an angle [rad].
    fn sin(self) -> Self {
        let (sin, cos) = self.value().sin_cos();
        self.chain(sin, cos)
    }
    /// Cosine of an angle [rad].
    fn cos(self) -> Self {
        let (sin, cos) = self.value().sin_cos();
        self.chain(cos, -sin)
    }
    /// Tangent of an angle [rad].
    fn tan(self) -> Self {
        let tan = self.value().tan();
        self.chain(tan, 1.0 + tan * tan)
    }
    /// Inverse sine [rad].
    fn asin(self) -> Self {
        let x = self.value();
        self.chain(x.asin(), 1.0 / (1.0 - x * x).sqrt())
    }
    /// Inverse cosine [rad].
    fn acos(self) -> Self {
        let x = self.value();
        self.chain(x.acos(), -1.0 / (1.0 - x * x).sqrt())
    }
    /// Exponential.
    fn exp(self) -> Self {
        let e = self.value().exp();
        self.chain(e, e)
    }
    /// Natural logarithm.
    fn ln(self) -> Self {
        let x = self.value();
        self.chain(x.ln(), 1.0 / x)
    }
    /// Integer power.
    fn powi(self, n: i32) -> Self {
        let x = self.value();
        self.chain(x.powi(n), f64::from(n) * x.powi(n - 1))
    }
    /// Reciprocal.
    fn recip(self) -> Self {
        let r = 1.0 / self.value();
        self.chain(r, -r * r)
    }
    /// Absolute value.
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// The larger by value; `self` if equal.
    fn max(self, other: Self) -> Self {
        if other.value() > self.value() { other } else { self }
    }
    /// The smaller by value; `self` if equal.
    fn min(self, other: Self) -> Self {
        if other.value() < self.value() { other } else { self }
    }
}

impl Scalar for f64 {
    fn value(self) -> f64 {
        self
    }
    fn chain(self, value: f64, _derivative: f64) -> Self {
        value
    }
}
