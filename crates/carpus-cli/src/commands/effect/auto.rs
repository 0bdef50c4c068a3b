//! `carpus effect auto`: diagnose, and add what the data identify.

use std::path::Path;

use super::add;
use crate::args::Global;
use crate::args_diagnosis::EffectAutoArgs;
use crate::bars::Bars;
use crate::failure::{self, Diagnostic, Failure};
use crate::study_run::StudyRun;
use carpus_session::diagnose::forward_model;
use carpus_session::effect_choice::decide;
use carpus_session::effect_steps::AddEffects;
use carpus_session::loading::Purpose;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &EffectAutoArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "effect")?;
    let request = AddEffects { seed: global.seed, ..AddEffects::default() };
    let bars = Bars::new(global);
    let outcomes = study.each("adding effects", &bars, |participant| {
        let session = participant.load_for(Purpose::Diagnosis)?.with_progress(&bars);
        failure::print(&session.data.warnings);
        let (name, forward) = (&participant.about().name, forward_model(&session.data)?);
        let diagnosis = session.known_or_made(&study.out, &forward, global.seed)?;
        let (effects, why) = decide(&diagnosis.result)?;
        if let Some(why) = why {
            failure::print(&[Diagnostic::warning(format!("participant {name}: {why}"))]);
        }
        let added = session.add_effects(study.out.path(), &forward, &effects, &diagnosis, &request)?;
        added.write_to(&study.out, Path::new(name))?;
        Ok(added.results)
    })?;
    add::print(&study, outcomes, global)
}
