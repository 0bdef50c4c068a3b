//! `carpus plan`: which further trials would separate the explanations that survive, and what the trials at hand can
//! tell.

use crate::args::{Global, PlanArgs};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::next_steps::listed;
use crate::provenance::command_line;
use crate::study_run::StudyRun;
use crate::table::{fixed, table, tables};
use carpus_diagnosis::separability::Distance;
use carpus_diagnosis::separation::most_useful;
use carpus_effects::answers::SEPARABLE_Z;
use carpus_report::next_steps::after_plan;
use carpus_session::candidates::{EffectSize, known, names_of};
use carpus_session::diagnose::forward_model;
use carpus_session::json;
use carpus_session::loading::Purpose;
use carpus_session::plan::{Plan, Planned, Separability};
use carpus_session::text_tables::of_separations;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the candidates, or the output folder.
pub fn run(args: &PlanArgs, global: &Global) -> Result<(), Failure> {
    if let Some(asked) = &args.effect {
        return of_effect(asked, args, global);
    }
    let request = Plan { seed: global.seed, rivals: args.candidates.clone() };
    request.named()?;
    let study = StudyRun::prepare_with(&args.study, &args.effects, "plan")?;
    let outcomes = study.each("planning", Purpose::Diagnosis, &Bars::new(global), |session, folder| {
        let forward = forward_model(&session.data)?;
        let diagnosis = session.known_or_made(&study.out, &forward, global.seed)?;
        let planned = session.plan(&forward, diagnosis, &request)?;
        planned.write_to(&study.out, folder)?;
        Ok(planned)
    })?;
    if global.json {
        let text = json::line(&outcomes.done.iter().map(Planned::value).collect::<Vec<_>>())?;
        return study.print("plan", &text, outcomes.failed);
    }
    let text = outcomes.done.iter().map(readable).collect::<Vec<_>>().join("\n\n");
    study.print("plan", &text, outcomes.failed)
}

/// How far an effect of a size would be from none and from every other.
fn of_effect(asked: &EffectSize, args: &PlanArgs, global: &Global) -> Result<(), Failure> {
    known(&asked.id)?;
    let study = StudyRun::prepare_with(&args.study, &args.effects, "plan")?;
    let outcomes = study.each("planning", Purpose::Diagnosis, &Bars::new(global), |session, folder| {
        let found = session.separability(&forward_model(&session.data)?, asked, global.seed)?;
        found.write_to(&study.out, folder)?;
        Ok(found)
    })?;
    if global.json {
        let text = json::line(&outcomes.done.iter().map(|found| &found.value).collect::<Vec<_>>())?;
        return study.print("plan --effect", &text, outcomes.failed);
    }
    let shown = |found: &Separability| {
        let row = |d: &Distance| {
            let told = if d.z >= SEPARABLE_Z { "yes" } else { "no" };
            vec![d.rival.map_or("none".to_owned(), |id| names_of(&[id])), fixed(d.z, 1), told.to_owned()]
        };
        let title = format!(
            "{}: how far {} of this size is from the best that muscles do with others in its place (z; told apart from \
             {SEPARABLE_Z})",
            found.participant,
            names_of(&[&asked.id])
        );
        format!("{title}\n{}", table(&["in its place", "z", "told apart"], 1, found.distances.iter().map(row)))
    };
    let text = outcomes.done.iter().map(shown).collect::<Vec<_>>().join("\n\n");
    study.print("plan --effect", &text, outcomes.failed)
}

fn readable(planned: &Planned) -> String {
    let best = most_useful(&planned.separations);
    let told = best.iter().find(|s| s.z_then >= SEPARABLE_Z).map(|s| (s.trials, &s.separates[..]));
    let title = format!(
        "{}: further trials, and how far they would set explanations apart (z; told apart from {SEPARABLE_Z})",
        planned.participant
    );
    tables(&[of_separations(title, best)]) + &listed(&after_plan(&command_line(), told))
}
