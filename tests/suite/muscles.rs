//! Tests of `muscles`.
