//! Numerical building blocks: the scalar trait (f64 and dual numbers), Bézier curves, root finding, interpolation.
