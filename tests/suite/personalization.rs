//! Tests of `personalization`.
