//! OpenSim's functions of one variable, and of several, with first and second derivatives; and formulas in a coordinate
//! and its speed.
//!
//! In: a [`FunctionSpec`] as the file states it. Out: a [`Function`] with all coefficients computed, which evaluates
//! exactly as OpenSim 4.6 does, extrapolation included, without allocating.

mod error;
mod expression;
mod function;
mod gcv_spline;
mod piecewise;
mod points;
mod several;
mod simm_spline;

pub use error::FunctionError;
pub use expression::{Dialect, Expression, ExpressionError, function_names};
pub use function::Function;
pub use several::FunctionOfSeveral;
