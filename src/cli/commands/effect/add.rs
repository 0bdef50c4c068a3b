//! `carpus effect add`: effects that a person names, if the diagnosis supports them or the person insists.

use super::{readable, steps};
use crate::cli::args::Global;
use crate::cli::args_diagnosis::EffectAddArgs;
use crate::cli::commands::diagnose::{forward_model, known, names_of};
use crate::cli::commands::simulate::summary;
use crate::cli::diagnosis_file::{KnownDiagnosis, known_or_made};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::study_run::StudyRun;
use crate::diagnosis::effect::Effect;
use crate::report::diagnosis::DiagnosisResult;
use crate::report::results::Results;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the effects, a diagnosis that does not support them, or the output folder.
pub fn run(args: &EffectAddArgs, global: &Global) -> Result<(), Failure> {
    let effects = chosen(&args.chosen)?;
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "effect")?;
    let outcomes = study.each(|participant| {
        let run = study.participant_to_diagnose(participant)?;
        failure::print(&run.warnings);
        let forward = forward_model(&run)?;
        let diagnosis = known_or_made(&study, &run, &forward, global)?;
        let messages = objections(&participant.name, &diagnosis, &args.chosen, args.i_choose);
        if messages.iter().any(|m| m.gravity == failure::Gravity::Error) {
            return Err(messages.into());
        }
        failure::print(&messages);
        steps::add(&study, &run, &forward, &effects, &diagnosis, args.i_choose, global)
    })?;
    print(&study, outcomes, global)
}

/// Prints what was done.
///
/// # Errors
/// Participants that could not be done.
pub fn print(
    study: &StudyRun,
    outcomes: crate::cli::study_run::Outcomes<Results>,
    global: &Global,
) -> Result<(), Failure> {
    if global.json {
        let one = |r: &Results| {
            let mut value = summary(r);
            value["ledger"] = serde_json::to_value(&r.ledger).unwrap_or_default();
            value
        };
        let text = serde_json::Value::Array(outcomes.done.iter().map(one).collect()).to_string();
        return outcomes.print(study, "effect", &text);
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
    outcomes.print(study, "effect", text.trim_end())
}

/// The effects of these identifiers, each once.
fn chosen(ids: &[String]) -> Result<Vec<&'static dyn Effect>, Failure> {
    let mut effects = Vec::new();
    for (i, id) in ids.iter().enumerate() {
        if ids[..i].contains(id) {
            return Err(Message::error(format!("the effect `{id}` is named twice")).into());
        }
        effects.push(known(id)?);
    }
    Ok(effects)
}

/// Whether these effects are one of the explanations.
pub fn is_explanation(explanations: &[Vec<String>], chosen: &[String]) -> bool {
    explanations.iter().any(|e| e.len() == chosen.len() && e.iter().all(|id| chosen.contains(id)))
}

/// Whether the diagnosis supports these effects: one of its explanations, or some of those that are missing where many things are a
/// little wrong, or effects that cannot be told from these.
pub fn is_supported(diagnosis: &DiagnosisResult, chosen: &[String]) -> bool {
    let explanations: Vec<Vec<String>> = diagnosis.explanations.iter().map(|e| e.effects.clone()).collect();
    let is_missing = |id: &String| diagnosis.effects.iter().any(|e| e.group.contains(id));
    is_explanation(&explanations, chosen) || !diagnosis.effects.is_empty() && chosen.iter().all(is_missing)
}

/// What the diagnosis has against the choice: errors unless a person insists.
fn objections(participant: &str, diagnosis: &KnownDiagnosis, chosen: &[String], i_choose: bool) -> Vec<Message> {
    let result = &diagnosis.result;
    let explanations: Vec<Vec<String>> = result.explanations.iter().map(|e| e.effects.clone()).collect();
    let listed: Vec<String> = explanations.iter().map(|e| names_of(e)).collect();
    let text = match result.verdict.as_str() {
        "unknown" => "something is missing, and no effect of the catalogue explains it".to_owned(),
        "cannot_tell" => format!("the data are consistent with any of: {}; they cannot tell which", listed.join("; ")),
        _ if is_supported(result, chosen) => return Vec::new(),
        "dominant" | "several" => {
            let missing: Vec<String> = result.effects.iter().map(|e| e.effect.clone()).collect();
            format!(
                "beyond a little of everything the data call for {}, not for {}",
                names_of(&missing),
                names_of(chosen)
            )
        }
        "nothing_detectable" => "the data call for no effect: muscle parameters and noise explain them".to_owned(),
        _ => format!("the data are consistent with {}, not with {}", listed.join("; "), names_of(chosen)),
    };
    let text = format!("participant {participant}: {text}");
    let must_choose = matches!(result.verdict.as_str(), "unknown" | "cannot_tell");
    match (must_choose, i_choose) {
        (true, false) => vec![Message::error(text).hint(match result.verdict.as_str() {
            "cannot_tell" => "`carpus plan` says which further trials would tell; --i-choose adds it all the same and records that you chose",
            _ => "--i-choose adds it all the same and records that you chose",
        })],
        (_, true) => vec![Message::warning(format!("{text}; added because you chose so (--i-choose)"))],
        (false, false) => vec![Message::warning(text)],
    }
}
