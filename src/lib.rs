//! Carpus personalizes OpenSim hand and wrist models from dynamometer and EMG recordings, and shows where the model
//! fails.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use carpus::Personalize;
//!
//! # let folder = tempfile::tempdir()?;
//! # let out = folder.path().join("out");
//! let study = carpus::Study::open("fixtures/demo_study")?;
//! for participant in study.participants() {
//!     let session = participant.load()?;
//!     let fit = session.personalize(&Personalize::default())?;
//!     println!("{}", fit.errors());
//!     fit.write(&out)?; // out/P01: model.osim, results.json, report.html, …
//! }
//! # assert!(["model.osim", "results.json", "report.html"].iter().all(|file| out.join("P01").join(file).is_file()));
//! # Ok(())
//! # }
//! ```
//!
//! [`session`] does what the command line does, for programs. Data flow, modules and invariants are described in
//! `ARCHITECTURE.md`. Inside the library all quantities are SI units and radians; another unit is part of a name
//! (`angle_deg`).

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
pub mod session;
pub mod signals;
pub mod simulation;
pub mod spatial;
pub mod statistics;
pub mod storage;
pub mod study;
pub mod tools;

pub use session::compare::Compare;
pub use session::diagnose::Diagnose;
pub use session::diagnostic::{Diagnostic, Failure};
pub use session::identify::Identify;
pub use session::personalize::Personalize;
pub use session::plan::Plan;
pub use session::simulate::Simulate;
pub use session::study::Study;
