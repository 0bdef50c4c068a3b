//! Why a function cannot be built.

use super::expression::ExpressionError;

/// Why a function cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FunctionError {
    /// `x` and `y` differ in length.
    #[error("{class}: x has {x} values and y has {y}; expected equally many")]
    LengthMismatch {
        /// OpenSim class name.
        class: &'static str,
        /// Number of abscissae.
        x: usize,
        /// Number of ordinates.
        y: usize,
    },
    /// Not enough points for this class of function.
    #[error("{class}: expected at least {expected} points, found {found}")]
    TooFewPoints {
        /// OpenSim class name.
        class: &'static str,
        /// Fewest points that define the function.
        expected: usize,
        /// Number of points found.
        found: usize,
    },
    /// Abscissae do not increase.
    #[error("{class}: expected increasing x, found {next} after {previous} (value {index})")]
    NotIncreasing {
        /// OpenSim class name.
        class: &'static str,
        /// Position of the offending abscissa, counted from 1.
        index: usize,
        /// The abscissa before it.
        previous: f64,
        /// The offending abscissa.
        next: f64,
    },
    /// A property is NaN or infinite.
    #[error("{class}: expected a finite {property}, found {found}")]
    NotFinite {
        /// OpenSim class name.
        class: &'static str,
        /// Property name.
        property: &'static str,
        /// The value found.
        found: f64,
    },
    /// Points of which the coefficients are beyond the range of numbers.
    #[error("{class}: the points are too far apart, too close together or too large for a curve through them")]
    OutOfRange {
        /// OpenSim class name.
        class: &'static str,
    },
    /// A `StepFunction` whose transition starts and ends at the same time.
    #[error("StepFunction: expected different start and end of the transition, both are {at}")]
    EmptyTransition {
        /// Start and end.
        at: f64,
    },
    /// A `GCVSpline` whose `half_order` is not 1, 2, 3 or 4.
    #[error("GCVSpline: expected half_order 1 to 4, found {found}")]
    HalfOrder {
        /// The value found.
        found: usize,
    },
    /// A `PolynomialFunction` without coefficients.
    #[error("PolynomialFunction: expected at least one coefficient, found none")]
    NoCoefficients,
    /// A polynomial of several variables with another number of coefficients than its dimension and order ask for.
    #[error("{class}: expected {expected} coefficients for its dimension and order, found {found}")]
    CoefficientCount {
        /// OpenSim class name.
        class: &'static str,
        /// Number of terms.
        expected: usize,
        /// Number of coefficients found.
        found: usize,
    },
    /// The formula of an `ExpressionBasedFunction`.
    #[error("ExpressionBasedFunction: {0}")]
    Expression(#[from] ExpressionError),
    /// A function of another number of variables.
    #[error("expected a function of {expected} variables, found one of {found}")]
    Dimension {
        /// Number of variables that it is given.
        expected: usize,
        /// Number that it takes.
        found: usize,
    },
}
