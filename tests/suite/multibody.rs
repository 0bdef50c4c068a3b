//! Tests of `multibody`.
