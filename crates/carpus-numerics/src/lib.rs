//! What knows nothing of models and studies: numerical methods, rotations and transforms, filters, statistics,
//! plausible ranges, and reading files safely.

pub mod numerics;
pub mod plausible;
pub mod printable;
pub mod regular_file;
pub mod signals;
pub mod spatial;
pub mod statistics;
