//! `[processing]` of `study.toml`: what happens to a dynamometer's recordings before they are a study's trials.
//!
//! In: trial files as recorders write them. Out: trials in which angle and moment are filtered, the machine's drag and
//! the relaxed limb's moment are removed, and long recordings are cut into repetitions; EMG of a recorder of its own is
//! on the dynamometer's clock. Nothing of it is applied unless a study asks for it.

mod process;
pub(super) mod recording;
pub(super) mod settings;

pub use process::{DelayFound, ProcessedTrial, ProcessingError, ProcessingResult};
pub use recording::Recorded;
pub use settings::ProcessingSettings;
