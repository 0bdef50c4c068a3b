//! Numerical building blocks: the scalar trait (f64 and dual numbers), piecewise quintic Bézier curves, bracketed
//! root finding, integration of stiff differential equations, decompositions of matrices.

mod bdf;
mod decomposition;
mod dual;
mod grouped;
mod root;
mod scalar;
mod smooth_segmented;

pub use bdf::{Bdf, Cost, StepError, StiffSystem};
pub use decomposition::{cholesky, is_finite, symmetric_eigen, symmetric_root};
pub use dual::Dual;
pub use grouped::Grouped;
pub use root::{BracketedRoot, RootError, newton_bisection};
pub use scalar::Scalar;
pub use smooth_segmented::{CornerError, QuinticCorner, SmoothSegmentedFunction, ValueAndDerivative};
