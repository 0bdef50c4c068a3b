//! Tests of `forces`.
