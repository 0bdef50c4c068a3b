//! A step of a study, and what steps work with.

use super::request::WholeStudy;
use crate::diagnostic::{Diagnostic, Failure};
use crate::dynamometer::ParticipantProcessing;
use crate::loading::LoadedParticipant;
use crate::output::OutputFolder;
use crate::report_parts::ReportParts;
use crate::study::Study;
use crate::units::{Unit, UnitStore};
use carpus_study::dynamometer::DragEstimate;

/// What a step has to tell when all participants are done.
#[derive(Clone, Debug)]
pub enum Told {
    /// Its section.
    Parts(ReportParts),
    /// Why there is none.
    NotRun(String),
}

/// What all steps work with.
pub(super) struct Context<'a> {
    /// The study.
    pub study: &'a Study,
    /// Where results go.
    pub out: &'a OutputFolder,
    /// How hard to work.
    pub request: &'a WholeStudy,
    /// Finished units.
    pub store: &'a UnitStore<'a>,
    /// What was done to the dynamometer's recordings before they became this study; `None` where nothing was asked for.
    pub processing: Option<Processed>,
}

/// A step of a study.
pub(super) trait Step: Sync {
    /// Key: the first part of its units' places, its section's anchor, and its name on the command line.
    fn id(&self) -> &'static str;

    /// Heading of its section.
    fn title(&self) -> &'static str;

    /// A participant's units; none where the study has nothing for this step.
    ///
    /// # Errors
    /// Why the participant's part cannot be done.
    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure>;

    /// Writes what is not part of the report, such as models.
    ///
    /// # Errors
    /// The disk.
    fn write(&self, _context: &Context, _run: &LoadedParticipant) -> Result<(), Failure> {
        Ok(())
    }

    /// The section, from the units of all participants; or why there is none.
    ///
    /// # Errors
    /// A fault of this program.
    fn section(&self, context: &Context) -> Result<Told, Failure>;
}

/// What was done to the recordings.
pub(super) struct Processed {
    pub constants: Vec<(String, String)>,
    pub outcomes: Vec<ParticipantProcessing>,
    /// Drag of the machine, from recordings of it alone.
    pub drag: Option<DragEstimate>,
    /// Drag that was reckoned with [N·m·s/rad].
    pub damping: f64,
    /// Why some participants' recordings could not be processed.
    pub failures: Vec<Diagnostic>,
}
