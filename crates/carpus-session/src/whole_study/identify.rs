//! Intervals of the muscle parameters, what the data leave open, and which trial would narrow it down.

use super::step::{Context, Step, Told};
use crate::account::{csv_text, warning_result};
use crate::cohort_intervals;
use crate::diagnostic::Failure;
use crate::identify_files::write;
use crate::loading::{LoadedParticipant, Purpose};
use crate::progress::Silent;
use crate::provenance::input_file;
use crate::report_parts::ReportParts;
use crate::units::{Unit, value};
use carpus_report::identifiability::IdentifiabilityResult;
use carpus_study::study::TrialUse;

/// The step.
pub(super) struct Identify;

impl Step for Identify {
    fn id(&self) -> &'static str {
        "identify"
    }

    fn title(&self) -> &'static str {
        "Identifiability and uncertainty"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        if !run.trials.iter().any(|t| t.info.usage == TrialUse::Train) {
            return Ok(Vec::new());
        }
        let request = context.request.identification()?;
        let priors = context.request.priors.as_deref().map(|path| input_file(path, "priors", "priors")).transpose()?;
        let depends_on = format!("{:?} {priors:?}", context.request.identify);
        let work = move || {
            let run = context.study.load(&run.participant, Purpose::Identification)?;
            let (mut result, _, warnings) = request.answered(context.study, &run, &Silent)?;
            result.warnings = warnings.iter().map(warning_result).collect();
            value(&result)
        };
        let place = format!("{}/{}", self.id(), run.participant.name);
        Ok(vec![Unit { place, depends_on, work: Box::new(work) }])
    }

    fn write(&self, context: &Context, run: &LoadedParticipant) -> Result<(), Failure> {
        let name = &run.participant.name;
        let place = format!("{}/{name}", self.id());
        let Some(mut result) = context.store.get::<IdentifiabilityResult>(&place)? else { return Ok(()) };
        result.provenance = context.study.provenance(context.request, context.request.seed, run.inputs.clone());
        write(context.out, &std::path::Path::new(self.id()).join(name), &result)
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let mut all: Vec<IdentifiabilityResult> = context.store.finished(self.id())?;
        all.sort_by_key(|r| context.study.chosen().iter().position(|p| p.name == r.participant));
        if all.is_empty() {
            return Ok(Told::NotRun("no participant has training trials".to_string()));
        }
        let mut parts: ReportParts = cohort_intervals::report(&all)?;
        let header = ["participant", "combination", "share_from_data", "prior_sd_percent", "sd_percent"];
        let rows = all.iter().flat_map(|r| {
            r.combinations.iter().map(move |c| {
                let mut row = vec![r.participant.clone(), c.words.clone()];
                row.extend([c.share_from_data, c.prior_sd_percent, c.sd_percent].map(|v| v.to_string()));
                row
            })
        });
        parts.tables.push(("identify_combinations.csv".to_string(), csv_text(header.iter(), rows)?));
        Ok(Told::Parts(parts))
    }
}
