//! `carpus effect add`: effects that a person names, if the diagnosis supports them or the person insists.

use std::path::Path;

use super::readable;
use crate::args::Global;
use crate::args_diagnosis::EffectAddArgs;
use crate::bars::Bars;
use crate::failure::{self, Failure, Severity};
use crate::next_steps;
use crate::study_run::StudyRun;
use carpus_report::results::Results;
use carpus_session::diagnose::forward_model;
use carpus_session::effect_choice::{chosen, objections};
use carpus_session::effect_steps::AddEffects;
use carpus_session::loading::Purpose;
use carpus_session::outcomes::Outcomes;
use carpus_session::result_files::summary;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the effects, a diagnosis that does not support them, or the output folder.
pub fn run(args: &EffectAddArgs, global: &Global) -> Result<(), Failure> {
    let effects = chosen(&args.chosen)?;
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "effect")?;
    let request = AddEffects { seed: global.seed, i_choose: args.i_choose };
    let bars = Bars::new(global);
    let outcomes = study.each("adding effects", &bars, |participant| {
        let session = participant.load_for(Purpose::Diagnosis)?.with_progress(&bars);
        failure::print(&session.data.warnings);
        let (name, forward) = (&participant.about().name, forward_model(&session.data)?);
        let diagnosis = session.known_or_made(&study.out, &forward, global.seed)?;
        let messages = objections(name, &diagnosis, &args.chosen, args.i_choose);
        if messages.iter().any(|m| m.severity == Severity::Error) {
            return Err(messages.into());
        }
        failure::print(&messages);
        let added = session.add_effects(study.out.path(), &forward, &effects, &diagnosis, &request)?;
        added.write_to(&study.out, Path::new(name))?;
        Ok(added.results)
    })?;
    print(&study, outcomes, global)
}

/// Prints what was done.
///
/// # Errors
/// Participants that could not be done.
pub fn print(study: &StudyRun, outcomes: Outcomes<Results>, global: &Global) -> Result<(), Failure> {
    if global.json {
        let one = |r: &Results| {
            let mut value = summary(r);
            value["ledger"] = serde_json::to_value(&r.ledger).unwrap_or_default();
            value
        };
        let text = serde_json::Value::Array(outcomes.done.iter().map(one).collect()).to_string();
        return study.print("effect", &text, outcomes.failed);
    }
    let mut text = String::new();
    for results in &outcomes.done {
        let Some(ledger) = &results.ledger else { continue };
        let folder = study.out.path().join(&results.participant.id);
        text.push_str(&readable(ledger));
        text.push_str(&format!("\n\nmodel    {}\n", folder.join("model.osim").display()));
        if ledger.now().is_some_and(|s| s.side_car.is_some()) {
            let file = folder.join("effects.toml");
            text.push_str(&format!("beside   {} (use it with --effects)\n", file.display()));
        }
        let (report, back) = (folder.join("report.html"), folder.display());
        text.push_str(&format!("report   {}\na step back: carpus effect remove {back}\n\n", report.display()));
    }
    let text = text.trim_end().to_owned() + &next_steps::in_words(&outcomes.done, study.out.path());
    study.print("effect", &text, outcomes.failed)
}
