//! OpenSim's files: models with their functions, read, edited and written; time series.

pub mod functions;
pub mod osim;
pub mod storage;
