//! Tests of `osim`.
