//! Tests of `paths`.

mod wrapping;
