//! Muscle paths: points, wrapping, lengths, moment arms.

pub mod wrapping;
