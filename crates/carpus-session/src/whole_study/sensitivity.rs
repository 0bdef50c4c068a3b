//! Morris screening and Sobol' indices of every condition.

use super::step::{Context, Step, Told};
use crate::diagnostic::Failure;
use crate::loading::LoadedParticipant;
use crate::progress::Silent;
use crate::screening::{
    ConditionSensitivity, DEFAULT_RESAMPLES, ScreeningOptions, condition_name, conditions, screened,
};
use crate::sensitivity_report;
use crate::units::{Unit, value};

/// The step.
pub(super) struct Sensitivity;

impl Step for Sensitivity {
    fn id(&self) -> &'static str {
        "sensitivity"
    }

    fn title(&self) -> &'static str {
        "Sensitivity"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let options = ScreeningOptions {
            starts: context.request.starts,
            sobol: Some(context.request.sobol).filter(|n| *n > 1),
            resamples: DEFAULT_RESAMPLES,
            seed: context.request.seed,
        };
        let unit = |condition| {
            let name = condition_name(condition).replace(" %", "").replace(' ', "_");
            Unit {
                place: format!("{}/{}/{name}", self.id(), run.participant.name),
                depends_on: format!("{options:?}"),
                work: Box::new(move || value(&screened(run, condition, &options, &Silent)?)),
            }
        };
        Ok(conditions(run)?.into_iter().map(unit).collect())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let mut found: Vec<ConditionSensitivity> = context.store.finished(self.id())?;
        found.sort_by_key(|f| context.study.chosen().iter().position(|p| p.name == f.participant));
        if found.is_empty() {
            return Ok(Told::NotRun("the study has no isometric or isotonic training trials to screen".to_string()));
        }
        sensitivity_report::report(&found).map(Told::Parts)
    }
}
