//! `carpus plan`: which further trials would separate the explanations that survive, and what the trials at hand can tell.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use super::diagnose::{at_size, candidates, forward_model, known, laboratory, names_of, request};
use super::simulate::write_results;
use crate::cli::args::{Global, PlanArgs};
use crate::cli::args_diagnosis::EffectSize;
use crate::cli::diagnosis_file::{self, KnownDiagnosis, known_or_made};
use crate::cli::failure::{self, Failure, Message};
use crate::cli::provenance::provenance;
use crate::cli::study_run::{StudyRun, progress};
use crate::cli::table::{fixed, table};
use crate::diagnosis::plan::plan;
use crate::diagnosis::separability::{Distance, separability};
use crate::diagnosis::separation::{SEPARABLE_Z, Separation, most_useful};
use crate::report::diagnosis::DiagnosisResult;
use crate::report::results::{Results, rounded};

/// Effects that are told apart where the diagnosis leaves fewer than two.
const RIVALS: usize = 3;

/// The plan of one participant.
struct Planned {
    participant: String,
    separations: Vec<Separation>,
}

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the candidates, or the output folder.
pub fn run(args: &PlanArgs, global: &Global) -> Result<(), Failure> {
    if let Some(asked) = &args.effect {
        return of_effect(asked, args, global);
    }
    let asked: Vec<&'static str> =
        args.candidates.iter().map(|id| known(id).map(|e| e.description().id)).collect::<Result<_, _>>()?;
    if asked.len() == 1 {
        return Err(Message::error("--candidates: expected at least two effects to tell apart").into());
    }
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "plan")?;
    let outcomes = study.each(|participant| {
        let run = study.participant_to_diagnose(participant)?;
        failure::print(&run.warnings);
        let forward = forward_model(&run)?;
        let mut diagnosis = known_or_made(&study, &run, &forward, global)?;
        let rivals = if asked.is_empty() { rivals(&diagnosis.result)? } else { asked.clone() };
        let bar = progress(global, 1, &format!("planning {}", participant.name));
        let request = request(&study, &run, &forward, candidates(&[])?, global);
        let separations = plan(&request, laboratory(&run), &rivals, &|done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        })
        .map_err(|e| Message::error(e.to_string()).in_file(&run.loaded.path))?;
        bar.finish_and_clear();
        write(&study, &participant.name, &mut diagnosis, &separations)?;
        report_again(&study, &participant.name, &diagnosis.value)?;
        Ok(Planned { participant: participant.name.clone(), separations })
    })?;
    if global.json {
        let one = |p: &Planned| json!({ "participant": p.participant, "separating_experiments": p.separations });
        let text = Value::Array(outcomes.done.iter().map(one).collect()).to_string();
        return outcomes.print(&study, "plan", &text);
    }
    let text = outcomes.done.iter().map(readable).collect::<Vec<_>>().join("\n\n");
    outcomes.print(&study, "plan", &text)
}

/// How far an effect of a size would be from none and from every other.
fn of_effect(asked: &EffectSize, args: &PlanArgs, global: &Global) -> Result<(), Failure> {
    known(&asked.id)?;
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "plan")?;
    let bar = progress(global, study.participants.len() as u64, "separating");
    let outcomes = study.each(|participant| {
        let run = study.participant_to_diagnose(participant)?;
        failure::print(&run.warnings);
        let forward = forward_model(&run)?;
        let truth = at_size(asked, &forward.muscles, &forward.joint)?;
        let request = request(&study, &run, &forward, candidates(&[])?, global);
        let distances =
            separability(&request, &truth).map_err(|e| Message::error(e.to_string()).in_file(&run.loaded.path))?;
        let names = truth.effect.description().parameters.iter().map(|p| p.name);
        let size: BTreeMap<&str, f64> = names.zip(truth.effect.reported(&truth.values, &forward.muscles)).collect();
        let listed = distances.iter().map(|d| json!({ "rival": d.rival, "z": rounded(d.z, 3) }));
        let value = json!({
            "schema": "carpus.separability/1",
            "participant": participant.name,
            "effect": asked.id,
            "size": size,
            "separable_z": SEPARABLE_Z,
            "distances": listed.collect::<Vec<_>>(),
            "provenance": provenance(global, run.inputs.clone()),
        });
        let text = serde_json::to_string_pretty(&value).map_err(|e| Failure::Internal(e.to_string()))? + "\n";
        study.out.write(format!("{}/separability.json", participant.name), text.as_bytes())?;
        bar.inc(1);
        Ok((participant.name.clone(), distances, value))
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    if global.json {
        let text = Value::Array(outcomes.done.iter().map(|(_, _, value)| value.clone()).collect()).to_string();
        return outcomes.print(&study, "plan --effect", &text);
    }
    let shown = |(name, distances, _): &(String, Vec<Distance>, Value)| {
        let rows = distances.iter().map(|d| {
            let told = if d.z >= SEPARABLE_Z { "yes" } else { "no" };
            vec![d.rival.map_or("none".to_owned(), |id| names_of(&[id])), fixed(d.z, 1), told.to_owned()]
        });
        let title = format!(
            "{name}: how far {} of this size is from the best that muscles do with others in its place (z; told apart from {SEPARABLE_Z})",
            names_of(&[&asked.id])
        );
        format!("{title}\n{}", table(&["in its place", "z", "told apart"], 1, rows))
    };
    let text = outcomes.done.iter().map(shown).collect::<Vec<_>>().join("\n\n");
    outcomes.print(&study, "plan --effect", &text)
}

/// The effects to tell apart: those of the explanations, and the strongest others where these are fewer than two.
fn rivals(diagnosis: &DiagnosisResult) -> Result<Vec<&'static str>, Failure> {
    let mut ids: Vec<&'static str> = Vec::new();
    let mut add = |id: &str| -> Result<usize, Failure> {
        let id = known(id)?.description().id;
        if !ids.contains(&id) {
            ids.push(id);
        }
        Ok(ids.len())
    };
    let mut count = 0;
    for id in diagnosis.explanations.iter().flat_map(|e| &e.effects) {
        count = add(id)?;
    }
    let mut others: Vec<_> =
        diagnosis.candidates.iter().filter(|c| !diagnosis.not_testable.contains(&c.effect)).collect();
    others.sort_by(|a, b| b.score.unwrap_or(0.0).total_cmp(&a.score.unwrap_or(0.0)));
    let wanted = if count < 2 { RIVALS } else { count };
    for candidate in others {
        if count >= wanted {
            break;
        }
        count = add(&candidate.effect)?;
    }
    Ok(ids)
}

fn write(
    study: &StudyRun,
    participant: &str,
    diagnosis: &mut KnownDiagnosis,
    separations: &[Separation],
) -> Result<(), Failure> {
    let internal = |e: serde_json::Error| Failure::Internal(e.to_string());
    let short = |s: &Separation| json!({ "trials": s.trials, "separates": s.separates, "z_now": rounded(s.z_now, 3), "z_then": rounded(s.z_then, 3) });
    let listed = Value::Array(most_useful(separations).into_iter().map(short).collect());
    if let Some(map) = diagnosis.value.as_object_mut() {
        map.insert("separating_experiments".to_owned(), listed);
    }
    diagnosis_file::write(study, participant, &diagnosis.value)?;
    let all = json!({
        "schema": "carpus.plan/1",
        "participant": participant,
        "separable_z": SEPARABLE_Z,
        "experiments": separations.iter().map(short).collect::<Vec<_>>(),
    });
    let text = serde_json::to_string_pretty(&all).map_err(internal)? + "\n";
    study.out.write(format!("{participant}/plan.json"), text.as_bytes())?;
    Ok(())
}

/// Writes the report of the diagnosis again, now that it has experiments.
fn report_again(study: &StudyRun, participant: &str, diagnosis: &Value) -> Result<(), Failure> {
    let folder = Path::new(participant);
    let Ok(text) = crate::regular_file::read_text(&study.out.path().join(folder).join("results.json")) else {
        return Ok(());
    };
    let Ok(mut results) = Results::parse(&text) else { return Ok(()) };
    if results.diagnosis.is_some() {
        results.diagnosis = Some(diagnosis_file::result(diagnosis)?);
        write_results(study, folder, &results)?;
    }
    Ok(())
}

fn readable(planned: &Planned) -> String {
    format!(
        "{}: further trials, and how far they would set explanations apart (z; told apart from {SEPARABLE_Z})\n{}",
        planned.participant,
        as_table(most_useful(&planned.separations))
    )
}

/// A row for every experiment.
pub fn as_table<'a>(separations: impl IntoIterator<Item = &'a Separation>) -> String {
    let rows = separations.into_iter().map(|s| {
        let told = if s.z_then >= SEPARABLE_Z { "yes" } else { "no" };
        vec![s.separates.join(" | "), s.trials.to_owned(), fixed(s.z_now, 1), fixed(s.z_then, 1), told.to_owned()]
    });
    table(&["tell apart", "record", "z now", "z then", "told apart"], 2, rows)
}
