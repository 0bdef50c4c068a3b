//! Tests of `paths`.

mod motion;
mod opensim;
mod wrapping;
