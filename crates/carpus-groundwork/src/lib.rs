//! What an analysis stands on: models by themselves, recordings, folders of results.
//!
//! In: files of a laboratory. A model is read, checked, shown and upgraded ([`model`], [`info`], [`audit`],
//! [`equilibrium`], [`sweep`]), recordings become trials of a study ([`init`], [`processed_study`], [`drag`]), and
//! results go into a folder that says what made it ([`output`], [`provenance`], [`units`]). Nothing here simulates a
//! study or estimates anything: that is `carpus-session`, which shows these modules under its own name.
//!
//! What is wrong, wherever it is found, is a [`diagnostic::Diagnostic`]: place, text, hint, severity.

pub mod account;
pub mod anova;
pub mod audit;
pub mod bundled;
pub mod diagnostic;
pub mod drag;
pub mod equilibrium;
pub mod errors;
pub mod geometry;
pub mod info;
pub mod info_study;
mod info_words;
pub mod init;
pub mod json;
pub mod model;
pub mod motion_capture;
pub mod output;
pub mod path_check;
pub mod power;
pub mod priors;
pub mod processed_study;
pub mod progress;
pub mod progress_lines;
pub mod provenance;
pub mod quantity;
pub mod report_parts;
pub mod run_tool;
pub mod said;
pub mod series;
pub mod shared_arguments;
pub mod shared_work;
pub mod sweep;
pub mod task;
pub mod ultrasound;
pub mod units;
pub mod upgrade;
