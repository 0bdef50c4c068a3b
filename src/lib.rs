//! Carpus personalizes OpenSim hand and wrist models from dynamometer and EMG recordings, and shows where the model
//! fails.
//!
//! Data flow, modules and invariants are described in `ARCHITECTURE.md`. Inside the library all quantities are SI
//! units and radians; another unit is part of a name (`angle_deg`).

pub mod cli;
pub mod diagnosis;
pub mod dynamics;
pub mod dynamometer;
pub mod evaluation;
pub mod forces;
pub mod functions;
pub mod identifiability;
pub mod imaging;
pub mod multibody;
pub mod muscles;
pub mod numerics;
pub mod osim;
pub mod paths;
pub mod personalization;
pub mod plausible;
pub mod printable;
pub mod regular_file;
pub mod report;
pub mod scaling;
pub mod sensitivity;
pub mod signals;
pub mod simulation;
pub mod spatial;
pub mod statistics;
pub mod storage;
pub mod study;
pub mod tools;
