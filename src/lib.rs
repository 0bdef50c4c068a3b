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
//! [`session`] does what the command line does, for programs. `examples/` has five short ones. Data flow, modules and invariants are described in
//! `ARCHITECTURE.md`. Inside the library all quantities are SI units and radians; another unit is part of a name
//! (`angle_deg`).

#[cfg(feature = "session")]
pub use session::compare::Compare;
#[cfg(feature = "session")]
pub use session::diagnose::Diagnose;
#[cfg(feature = "session")]
pub use session::diagnostic::{Diagnostic, Failure};
#[cfg(feature = "session")]
pub use session::evaluate::Evaluate;
#[cfg(feature = "session")]
pub use session::identify::Identify;
#[cfg(feature = "session")]
pub use session::personalize::Personalize;
#[cfg(feature = "session")]
pub use session::plan::Plan;
#[cfg(feature = "session")]
pub use session::simulate::Simulate;
#[cfg(feature = "session")]
pub use session::study::Study;
#[cfg(feature = "session")]
pub use session::whole_study::WholeStudy;

#[cfg(feature = "cli")]
pub use carpus_cli as cli;
pub use carpus_diagnosis as diagnosis;
pub use carpus_identifiability as identifiability;
pub use carpus_multibody::{dynamics, forces, multibody, muscles, paths};
pub use carpus_numerics::{numerics, plausible, printable, regular_file, signals, spatial, statistics};
pub use carpus_osim::{functions, osim, storage};
pub use carpus_personalization::{personalization, sensitivity};
#[cfg(feature = "report")]
pub use carpus_report as report;
#[cfg(feature = "session")]
pub use carpus_session as session;
pub use carpus_simulation::{evaluation, imaging, scaling, simulation};
pub use carpus_study::{dynamometer, study};
pub use carpus_tools as tools;
