//! `carpus effect auto`: diagnose, and add what the data identify.

use super::{add, steps};
use crate::cli::args::Global;
use crate::cli::args_diagnosis::EffectAutoArgs;
use crate::cli::commands::diagnose::{forward_model, known, names_of};
use crate::cli::diagnosis_file::known_or_made;
use crate::cli::failure::{self, Failure, Message};
use crate::cli::study_run::StudyRun;
use crate::diagnosis::effect::Effect;
use crate::report::diagnosis::DiagnosisResult;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, or the output folder.
pub fn run(args: &EffectAutoArgs, global: &Global) -> Result<(), Failure> {
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "effect")?;
    let outcomes = study.each(|participant| {
        let run = study.participant_to_diagnose(participant)?;
        failure::print(&run.warnings);
        let forward = forward_model(&run)?;
        let diagnosis = known_or_made(&study, &run, &forward, global)?;
        let (effects, why) = decide(&diagnosis.result)?;
        failure::print(
            &why.map(|w| Message::warning(format!("participant {}: {w}", participant.name)))
                .into_iter()
                .collect::<Vec<_>>(),
        );
        steps::add(&study, &run, &forward, &effects, &diagnosis, false, global)
    })?;
    add::print(&study, outcomes, global)
}

/// The effects to add, and why none is if none is.
fn decide(diagnosis: &DiagnosisResult) -> Result<(Vec<&'static dyn Effect>, Option<String>), Failure> {
    let none = |why: &str| Ok((Vec::new(), Some(format!("no effect is added: {why}"))));
    match (diagnosis.verdict.as_str(), diagnosis.explanations.as_slice()) {
        ("identified" | "two_effects", [only, ..]) => {
            let effects = only.effects.iter().map(|id| known(id)).collect::<Result<Vec<_>, _>>()?;
            Ok((effects, None))
        }
        ("dominant" | "several", _) => {
            let ids = diagnosis.effects.iter().map(|e| e.effect.as_str());
            Ok((ids.map(known).collect::<Result<Vec<_>, _>>()?, None))
        }
        ("cannot_tell", all) => {
            let sets: Vec<String> = all.iter().map(|e| names_of(&e.effects)).collect();
            none(&format!(
                "the data are consistent with any of: {}; `carpus plan` says what would tell",
                sets.join("; ")
            ))
        }
        ("nothing_detectable", _) => none("muscle parameters and noise explain the data"),
        ("negligible", _) => none("what is missing hardly matters"),
        ("implausible", _) => none("only implausible sizes explain the data"),
        _ => none("something is missing, and no effect of the catalogue explains it"),
    }
}
