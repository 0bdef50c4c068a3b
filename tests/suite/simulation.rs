//! Tests of `simulation`.
