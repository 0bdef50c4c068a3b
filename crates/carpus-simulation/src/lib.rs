//! Simulation of recorded trials, and what rests on it alone: error measures, comparison with images, scaling.

pub mod evaluation;
pub mod imaging;
pub mod scaling;
pub mod simulation;
