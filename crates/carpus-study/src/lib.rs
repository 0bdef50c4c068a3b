//! Recordings of participants: the study folder with its checks, and what concerns the dynamometer.

pub mod dynamometer;
pub mod study;
