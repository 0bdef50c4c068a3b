//! Numerical building blocks: the scalar trait (f64 and dual numbers), piecewise quintic Bézier curves, bracketed
//! root finding, integration of stiff differential equations, roots of covariances.

mod bdf;
mod dual;
mod grouped;
mod root;
mod scalar;
mod smooth_segmented;
mod symmetric_root;

pub use bdf::{Bdf, Cost, StepError, StiffSystem};
pub use dual::Dual;
pub use grouped::Grouped;
pub use root::{BracketedRoot, RootError, newton_bisection};
pub use scalar::Scalar;
pub use smooth_segmented::{CornerError, QuinticCorner, SmoothSegmentedFunction, ValueAndDerivative};
pub use symmetric_root::symmetric_root;
