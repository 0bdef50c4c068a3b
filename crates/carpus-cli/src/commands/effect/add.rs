//! `carpus effect add`: effects that a person names, if the diagnosis supports them or the person insists; `carpus
//! effect auto`: those that the data identify.

use super::ledger::readable;
use crate::args::{EffectAddArgs, EffectsFile, Global, StudyArgs, StudyWithEffects};
use crate::bars::Bars;
use crate::failure::{self, Diagnostic, Failure, Severity};
use crate::next_steps;
use crate::study_run::StudyRun;
use carpus_effects::effect::Effect;
use carpus_report::results::Results;
use carpus_session::diagnose::forward_model;
use carpus_session::diagnosis_file::KnownDiagnosis;
use carpus_session::effect_choice::{chosen, decide, objections};
use carpus_session::effect_steps::AddEffects;
use carpus_session::loading::Purpose;
use carpus_session::outcomes::Outcomes;
use carpus_session::result_files::summaries_with_ledgers;

/// Effects to add, and what a person should know of the choice.
type Choice = (Vec<&'static dyn Effect>, Vec<Diagnostic>);

/// Runs `carpus effect add`.
///
/// # Errors
/// The study, its models and trials, the effects, a diagnosis that does not support them, or the output folder.
pub fn run(args: &EffectAddArgs, global: &Global) -> Result<(), Failure> {
    let effects = chosen(&args.chosen)?;
    let request = AddEffects { seed: global.seed, i_choose: args.i_choose };
    add(&args.study, &args.effects, &request, global, |name, diagnosis| {
        let messages = objections(name, diagnosis, &args.chosen, args.i_choose);
        match messages.iter().any(|m| m.severity == Severity::Error) {
            true => Err(messages.into()),
            false => Ok((effects.clone(), messages)),
        }
    })
}

/// Runs `carpus effect auto`.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run_auto(args: &StudyWithEffects, global: &Global) -> Result<(), Failure> {
    let request = AddEffects { seed: global.seed, ..AddEffects::default() };
    add(&args.study, &args.effects, &request, global, |name, diagnosis| {
        let (effects, why) = decide(&diagnosis.result)?;
        let warning = |why| Diagnostic::warning(format!("participant {name}: {why}"));
        Ok((effects, why.into_iter().map(warning).collect()))
    })
}

/// Adds the effects that are chosen by each participant's diagnosis.
fn add(
    study: &StudyArgs,
    beside: &EffectsFile,
    request: &AddEffects,
    global: &Global,
    choice: impl Fn(&str, &KnownDiagnosis) -> Result<Choice, Failure>,
) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(study, beside, "effect")?;
    let outcomes = study.each("adding effects", Purpose::Diagnosis, &Bars::new(global), |session, folder| {
        let forward = forward_model(&session.data)?;
        let diagnosis = session.known_or_made(&study.out, &forward, global.seed)?;
        let (effects, messages) = choice(&session.data.participant.name, &diagnosis)?;
        failure::print(&messages);
        let added = session.add_effects(study.out.path(), &forward, &effects, &diagnosis, request)?;
        added.write_to(&study.out, folder)?;
        Ok(added.results)
    })?;
    print(&study, outcomes, global)
}

/// Prints what was done.
///
/// # Errors
/// Participants that could not be done.
fn print(study: &StudyRun, outcomes: Outcomes<Results>, global: &Global) -> Result<(), Failure> {
    if global.json {
        return study.print("effect", &summaries_with_ledgers(&outcomes.done), outcomes.failed);
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
