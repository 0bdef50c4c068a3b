//! Tests of `paths`.

mod opensim;
mod wrapping;
