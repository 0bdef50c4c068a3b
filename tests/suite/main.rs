//! All integration tests, one module per subject (one binary, so that linking happens once).

mod cohort;
mod diagnosis;
mod dynamics;
mod dynamometer;
mod effects;
mod emg;
mod evaluation;
mod fixtures;
mod forces;
mod functions;
mod multibody;
mod muscles;
mod osim;
mod paths;
mod personalization;
mod reference;
mod report;
mod scaling;
mod sensitivity;
mod signals;
mod simulation;
mod statistics;
mod study;
mod study_command;
mod user_path;
mod validation;
