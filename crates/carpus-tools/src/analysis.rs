//! What analyses have in common: when they record, what they see, what they write.

use super::error::ToolError;
use super::result::Outcome;
use super::setup::Properties;
use super::system::{Evaluation, System, SystemState, SystemWork};
use carpus_osim::storage::Storage;
use nalgebra::DVector;
use std::path::Path;

/// Options of every analysis.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the analysis, part of its files' names.
    pub name: String,
    /// Every how manieth step is recorded.
    pub step_interval: usize,
    /// Whether angles are written in degrees.
    pub in_degrees: bool,
}

impl Options {
    /// Reads them.
    ///
    /// # Errors
    /// Values that cannot be used.
    pub fn read(analysis: &Properties) -> Result<Options, ToolError> {
        // OpenSim 4.6 reads start and end and records all times.
        analysis.ignore_all(&["start_time", "end_time"]);
        let name = analysis.name();
        Ok(Options {
            name: if name.is_empty() { analysis.class().to_owned() } else { name },
            step_interval: analysis.count("step_interval", 1, 1..=usize::MAX)?,
            in_degrees: analysis.boolean("in_degrees", true)?,
        })
    }
}

/// The system at a time, as analyses see it.
pub struct Instant<'a, 's> {
    /// The system.
    pub system: &'s System,
    /// Its buffers, kinematics at this instant.
    pub work: &'a mut SystemWork<'s>,
    /// The state.
    pub state: &'a SystemState,
    /// Forces.
    pub evaluation: &'a Evaluation,
    /// Rates of speeds; `None` where no analysis asked for them.
    pub udot: Option<&'a DVector<f64>>,
    /// Multipliers of the constraints, with them.
    pub multipliers: Option<&'a DVector<f64>>,
}

/// Something that records over time.
pub trait Analysis {
    /// Options.
    fn options(&self) -> &Options;

    /// Whether it needs accelerations.
    fn needs_accelerations(&self) -> bool {
        false
    }

    /// Whether it uses forces of everything that acts.
    fn needs_forces(&self) -> bool {
        true
    }

    /// Whether what it writes depends on forces.
    fn uses_forces(&self) -> bool {
        self.needs_forces()
    }

    /// Records an instant.
    ///
    /// # Errors
    /// What cannot be computed.
    fn record(&mut self, instant: &mut Instant) -> Result<(), ToolError>;

    /// Ends of file names, after `<tool>_<analysis>_`, and their storages.
    fn results(&self) -> Vec<(String, &Storage)>;

    /// Further files: name after `<tool>_<analysis>_` and text.
    fn texts(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// What the user should know.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Adds the files of an analysis.
pub fn add_results(analysis: &dyn Analysis, base: &str, folder: &Path, precision: usize, outcome: &mut Outcome) {
    let stem = format!("{base}_{}_", analysis.options().name);
    for (end, storage) in analysis.results() {
        outcome.add_storage(folder, &format!("{stem}{end}.sto"), storage, precision);
    }
    for (end, text) in analysis.texts() {
        let path = folder.join(format!("{stem}{end}"));
        outcome.files.push(super::result::ResultFile { path, bytes: text.into_bytes(), is_named: false });
    }
}

/// The last lines of most descriptions.
pub const UNITS: &str = "\nUnits are S.I. units (second, meters, Newtons, ...)\nIf the header above contains a line \
                         with 'inDegrees', this indicates whether rotational values are in degrees (yes) or radians \
                         (no).\n\n";
