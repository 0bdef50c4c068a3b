//! `carpus diagnose`: where the model fails, and which physical effect is missing.

use std::collections::BTreeMap;
use std::path::Path;

use super::plan::as_table;
use super::simulate::{account, write_results};
use crate::cli::account::ModelRun;
use crate::cli::args::{DiagnoseArgs, Global};
use crate::cli::args_diagnosis::EffectSize;
use crate::cli::diagnosis_file;
use crate::cli::failure::{self, Failure, Message};
use crate::cli::residuals::residual_result;
use crate::cli::study_run::{ParticipantRun, StudyRun, progress};
use crate::cli::table::{fixed, table};
use crate::diagnosis::baselines::Ingredients;
use crate::diagnosis::catalogue::{effect, with_own};
use crate::diagnosis::diagnose::{Diagnosis, Outcome, ParameterEstimate, Request, Verdict, diagnose, is_determined};
use crate::diagnosis::effect::Effect;
use crate::diagnosis::forward_model::{ForwardModel, Setting};
use crate::diagnosis::joint_traits::JointTraits;
use crate::diagnosis::moments::simulate_all;
use crate::diagnosis::named::NamedEffect;
use crate::diagnosis::separation::{Laboratory, SEPARABLE_Z, Separation};
use crate::diagnosis::synthesis::sized;
use crate::diagnosis::what_remains::ProposedFormula;
use crate::osim::spec::MuscleSpec;
use crate::report::intervals::with_validity;
use crate::report::results::{Kind, Results};
use crate::simulation::MuscleParameters;
use crate::study::TrialUse;

/// Effects of a group that are listed.
const IN_GROUP: usize = 3;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the candidates, or the output folder.
pub fn run(args: &DiagnoseArgs, global: &Global) -> Result<(), Failure> {
    let candidates = candidates(&args.candidates)?;
    let study = StudyRun::prepare_with(&args.study, args.effects.file(), "diagnose")?;
    let restricted: &[String] = if args.candidates == ["all"] { &[] } else { &args.candidates };
    let bar = progress(global, study.participants.len() as u64, "diagnosing");
    let outcomes = study.each(|participant| {
        let run = study.participant_to_diagnose(participant)?;
        failure::print(&run.warnings);
        let forward = forward_model(&run)?;
        let outcome = diagnosed(&study, &run, &forward, candidates.clone(), global)?;
        let value = diagnosis_file::value(&outcome, &run, restricted, global)?;
        if args.baselines {
            diagnosis_file::write(&study, &participant.name, &with_baselines(&value, &outcome.ingredients)?)?;
        } else {
            diagnosis_file::write(&study, &participant.name, &value)?;
        }
        let results = with_models(&study, &run, &forward, &outcome, &value, global)?;
        write_results(&study, Path::new(&participant.name), &results)?;
        bar.inc(1);
        Ok((outcome.diagnosis, value))
    });
    bar.finish_and_clear();
    let outcomes = outcomes?;
    if global.json {
        let text = serde_json::Value::Array(outcomes.done.iter().map(|(_, value)| value.clone()).collect()).to_string();
        return outcomes.print(&study, "diagnose", &text);
    }
    let page = |d: &Diagnosis| study.out.path().join(&d.participant).join("report.html").display().to_string();
    let shown = |(d, _): &(Diagnosis, serde_json::Value)| format!("{}\n\n{}", readable(d), page(d));
    let text = outcomes.done.iter().map(shown).collect::<Vec<_>>().join("\n\n");
    outcomes.print(&study, "diagnose", &text)
}

/// The results of a diagnosis: the model as given, with its muscles refitted, and with the best explanation.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn with_models(
    study: &StudyRun,
    run: &ParticipantRun,
    forward: &ForwardModel,
    outcome: &Outcome,
    value: &serde_json::Value,
    global: &Global,
) -> Result<Results, Failure> {
    let nominal = forward.nominal_parameters();
    let refitted = &outcome.recalibrated.parameters;
    let mut fitted: Vec<(&str, String, &[MuscleParameters], &[Setting])> =
        vec![("base", "As given".to_owned(), &nominal, &[]), ("refit", "Muscles refitted".to_owned(), refitted, &[])];
    let (parameters, effects) = (&outcome.handed_over.parameters, &outcome.handed_over.effects);
    if !effects.is_empty() {
        let names = effects.iter().map(|s| s.effect.description().name).collect::<Vec<_>>().join(" + ");
        fitted.push(("with_effect", format!("With {names}"), parameters, effects));
    }
    let mut models = Vec::new();
    let mut residuals = Vec::new();
    for (id, label, parameters, effects) in fitted {
        let simulated = simulate_all(forward, parameters, effects)
            .map_err(|e| Message::error(e.to_string()).in_file(&run.loaded.path))?;
        let moments: Vec<Vec<f64>> = simulated.into_iter().map(|t| t.moment).collect();
        residuals.push(residual_result(run, id, &moments));
        let file = run.loaded.path.display().to_string();
        let name = run.loaded.model.name.clone();
        models.push(ModelRun { id: id.to_owned(), label, name, file, moments });
    }
    let mut results = account(Kind::Diagnosis, global, study, run, &models)?;
    results.residuals = residuals;
    results.diagnosis = Some(diagnosis_file::result(value)?);
    Ok(results)
}

fn with_baselines(value: &serde_json::Value, ingredients: &Ingredients) -> Result<serde_json::Value, Failure> {
    let mut value = value.clone();
    value["baselines"] = serde_json::to_value(ingredients).map_err(|e| Failure::Internal(e.to_string()))?;
    Ok(value)
}

/// The trials of a participant, ready to be simulated with effects.
///
/// # Errors
/// A trial that cannot be simulated; nothing to train on.
pub fn forward_model(run: &ParticipantRun) -> Result<ForwardModel, Failure> {
    let forward = ForwardModel::for_diagnosis(&run.loaded.file.spec, &run.model, &run.trials)
        .map_err(|e| Message::error(e.to_string()).in_file(&run.loaded.path))?
        .with_given(run.given.clone());
    let found = forward.trials_for(TrialUse::Train).len();
    if found < 2 {
        let name = &run.participant.name;
        let text = format!("participant {name}: expected at least two trials with use = train, found {found}");
        let message = Message::error(text).in_file(&run.trials_file);
        return Err(message.hint("a diagnosis compares trials with each other").into());
    }
    Ok(forward)
}

/// Diagnoses one participant.
///
/// # Errors
/// A trial that cannot be simulated.
pub fn diagnosed(
    study: &StudyRun,
    run: &ParticipantRun,
    forward: &ForwardModel,
    candidates: Vec<&'static dyn Effect>,
    global: &Global,
) -> Result<Outcome, Failure> {
    diagnose(&request(study, run, forward, candidates, global))
        .map_err(|e| Message::error(e.to_string()).in_file(&run.loaded.path).into())
}

/// What is asked of a participant's data.
pub fn request<'a>(
    study: &StudyRun,
    run: &'a ParticipantRun,
    forward: &'a ForwardModel,
    candidates: Vec<&'static dyn Effect>,
    global: &Global,
) -> Request<'a> {
    Request {
        participant: run.participant.name.clone(),
        forward,
        laboratory: Some(laboratory(run)),
        bounds: study.study.settings.bounds,
        candidates,
        mvc: largest_moment(run),
        seed: global.seed,
    }
}

/// What experiments are simulated with.
pub fn laboratory(run: &ParticipantRun) -> Laboratory<'_> {
    Laboratory { spec: &run.loaded.file.spec, model: &run.model }
}

/// The session's MVC moment [N·m]: as the study states it, else the largest that was recorded.
fn largest_moment(run: &ParticipantRun) -> f64 {
    let p = &run.participant;
    let stated = [p.mvc_flexion, p.mvc_extension].into_iter().flatten().fold(0.0, f64::max);
    if stated > 0.0 { stated } else { run.trials.iter().map(|t| t.max_abs_moment()).fold(0.0, f64::max) }
}

/// The effects of these identifiers; `all` or nothing: the whole catalogue and the laboratory's own.
///
/// # Errors
/// An unknown identifier.
pub fn candidates(ids: &[String]) -> Result<Vec<&'static dyn Effect>, Failure> {
    if ids.is_empty() || ids == ["all"] {
        return Ok(with_own());
    }
    let mut found: Vec<&'static dyn Effect> = Vec::new();
    for id in ids {
        let effect = known(id)?;
        if found.iter().all(|e| e.description().id != effect.description().id) {
            found.push(effect);
        }
    }
    Ok(found)
}

/// The effect of an identifier.
///
/// # Errors
/// There is none.
pub fn known(id: &str) -> Result<&'static dyn Effect, Failure> {
    effect(id).ok_or_else(|| {
        let message = Message::error(format!("there is no effect `{id}`"));
        let hint = match crate::study::nearest(id, with_own().iter().map(|e| e.description().id)) {
            Some(nearest) => format!("did you mean `{nearest}`? `carpus effects` lists all"),
            None if Path::new(id).exists() => {
                "the study comes first, then the effects; `carpus effects` lists all".to_string()
            }
            None => "`carpus effects` lists all".to_string(),
        };
        message.hint(hint).into()
    })
}

/// An effect of the size that was asked for with `--effect`.
///
/// Prints a warning of what is not plausible: an angle in degrees, say.
///
/// - `muscles`, `joint`: of the model
///
/// # Errors
/// An unknown effect or parameter; a size out of reach.
pub fn at_size(asked: &EffectSize, muscles: &[MuscleSpec], joint: &JointTraits) -> Result<Setting, Failure> {
    for p in known(&asked.id)?.description().parameters {
        let [low, high] = joint.plausible(p);
        for (_, value) in asked.values.iter().filter(|(name, value)| name == p.name && !(low..=high).contains(value)) {
            let text =
                format!("--effect: {}.{} is {value} {}; plausible are {low} to {high}", asked.id, p.name, p.unit);
            failure::print(&[Message::warning(text)]);
        }
    }
    sized(known(&asked.id)?, &asked.values, muscles, joint).map_err(|e| {
        let hint = format!("carpus effects {} tells its parameters", asked.id);
        Message::error(format!("--effect: {e}")).hint(hint).into()
    })
}

/// The names of effects, joined.
pub fn names_of<S: AsRef<str>>(ids: &[S]) -> String {
    let name = |id: &S| effect(id.as_ref()).map_or(id.as_ref().to_owned(), |e| e.description().name.to_owned());
    ids.iter().map(name).collect::<Vec<_>>().join(" + ")
}

/// A verdict in words.
pub fn in_words(diagnosis: &Diagnosis) -> String {
    let sets: Vec<String> = diagnosis.explanations.iter().map(|e| names_of(&e.effects)).collect();
    match diagnosis.verdict {
        Verdict::Identified => format!("consistent with one missing effect: {}", sets.join("")),
        Verdict::TwoEffects => format!("no single effect explains the data; consistent with {}", sets.join("")),
        Verdict::CannotTell => format!("cannot tell; consistent with any of: {}", sets.join("; ")),
        Verdict::NothingDetectable => "nothing detectable beyond muscle parameters and noise".to_string(),
        Verdict::Negligible => format!("detectable but negligible; consistent with {}", sets.join("; ")),
        Verdict::Unknown if diagnosis.candidates.len() < with_own().len() => {
            "something is missing, and no effect that was considered explains it".to_string()
        }
        Verdict::Unknown => "something is missing, and no effect of the catalogue explains it".to_string(),
        Verdict::Implausible => format!("only implausible sizes explain the data: {}", sets.join("; ")),
        Verdict::Dominant => format!("many things are a little wrong; missing beyond that: {}", groups(diagnosis)),
        Verdict::Several if diagnosis.effects.iter().all(|e| !e.dominant) => {
            format!("many things are a little wrong, and none stands out; the largest first: {}", groups(diagnosis))
        }
        Verdict::Several => {
            format!("many things are a little wrong; missing beyond that, the largest first: {}", groups(diagnosis))
        }
    }
}

/// Effects that are missing where many things are a little wrong, each with those that cannot be told from it.
fn groups(diagnosis: &Diagnosis) -> String {
    let name = |e: &NamedEffect| match e.group.as_slice() {
        [_] => names_of(&[e.effect]),
        group => {
            let listed: Vec<String> = group.iter().take(IN_GROUP).map(|id| names_of(&[*id])).collect();
            let more = match group.len().saturating_sub(IN_GROUP) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("one of {}{more}", listed.join(" / "))
        }
    };
    diagnosis.effects.iter().map(name).collect::<Vec<_>>().join("; ")
}

/// A row per effect that is missing where many things are a little wrong: probability, share of the error, parameters.
fn several_rows(diagnosis: &Diagnosis) -> Vec<Vec<String>> {
    let row = |e: &NamedEffect| {
        let parameters = e.parameters.iter().map(|(name, p)| {
            format!(
                "{name} {:.4} [{:.4}, {:.4}] {}",
                p.value,
                p.ci95[0],
                p.ci95[1],
                if p.unit == "1" { "" } else { p.unit }
            )
        });
        let percent =
            |[value, low, high]: [f64; 3]| format!("{:.0} [{:.0}, {:.0}]", 100.0 * value, 100.0 * low, 100.0 * high);
        vec![
            e.effect.to_owned(),
            fixed(e.probability, 2),
            percent(e.share_of_error.train),
            e.share_of_error.held_out.map_or("–".to_owned(), percent),
            parameters.map(|p| p.trim_end().to_owned()).collect::<Vec<_>>().join("\n"),
        ]
    };
    diagnosis.effects.iter().map(row).collect()
}

/// A row per parameter: name, estimate, what is plausible, and one more column.
fn estimate_rows(parameters: &BTreeMap<String, ParameterEstimate>, last: &str) -> Vec<Vec<String>> {
    let row = |(name, p): (&String, &ParameterEstimate)| {
        let interval = match is_determined(p.ci95) {
            true => with_validity(format!("[{:.4}, {:.4}]", p.ci95[0], p.ci95[1]), p.ci95, p.value),
            false => "(not determined)".to_owned(),
        };
        vec![
            name.clone(),
            format!("{:.4} {interval} {}", p.value, p.unit),
            format!("{} to {}", p.plausible[0], p.plausible[1]),
            last.to_owned(),
        ]
    };
    parameters.iter().map(row).collect()
}

/// The most useful experiment of every pair.
fn best_of_pairs(separations: &[Separation]) -> Vec<&Separation> {
    let mut best: Vec<&Separation> = Vec::new();
    for s in separations {
        if best.iter().all(|b| b.separates != s.separates) {
            best.push(s);
        }
    }
    best
}

fn readable(diagnosis: &Diagnosis) -> String {
    let mut text = format!("{}: {}\n", diagnosis.participant, in_words(diagnosis));
    let percent = |v: Option<f64>| v.map_or("–".to_string(), |v| fixed(100.0 * v, 2));
    let mut rows = Vec::new();
    let steps = [("training", Some(diagnosis.error.train)), ("held out", diagnosis.error.held_out)];
    for (name, steps) in steps {
        let Some(s) = steps else { continue };
        let floor = percent(Some(diagnosis.error.noise_floor));
        rows.push(vec![
            name.to_string(),
            percent(Some(s.base)),
            percent(Some(s.refit_only)),
            percent(s.with_effect),
            floor,
        ]);
    }
    text.push_str("\nRMSE in % of the session's MVC moment\n");
    text.push_str(&table(&["trials", "as given", "muscles refitted", "with effect", "noise floor"], 1, rows));
    if matches!(diagnosis.verdict, Verdict::Dominant | Verdict::Several) {
        text.push_str("\n\nMissing effects: probability, and share of the model's mean squared error that each takes beside those above it\n");
        let header = ["effect", "probability", "training %", "held out %", "parameters, 95 % intervals"];
        text.push_str(&table(&header, 4, several_rows(diagnosis)));
        text.push_str("\n`carpus effect auto STUDY` adds them, one after the other");
    } else if !diagnosis.explanations.is_empty() {
        text.push_str("\n\nExplanations that leave nothing\n");
        let rows = diagnosis.explanations.iter().flat_map(|e| estimate_rows(&e.parameters, &fixed(e.p_value, 3)));
        text.push_str(&table(&["parameter", "estimate, 95 % interval", "plausible", "p"], 2, rows));
        if !diagnosis.separating_experiments.is_empty() {
            text.push_str(&format!(
                "\n\nFurther trials that would tell (z: standard deviations; told apart from {SEPARABLE_Z})\n{}",
                as_table(best_of_pairs(&diagnosis.separating_experiments))
            ));
        }
    } else if diagnosis.verdict == Verdict::NothingDetectable {
        text.push_str(&format!("\n\np = {:.3}. Smallest sizes that would have been found:\n", diagnosis.null_p_value));
        let rows = diagnosis.candidates.iter().flat_map(|c| {
            let unit = |name: &str| {
                let description = effect(c.effect).map(|e| e.description());
                description.and_then(|d| d.parameters.iter().find(|p| p.name == name)).map_or("", |p| p.unit)
            };
            c.detectable_size.iter().map(move |(name, size)| {
                vec![c.effect.to_string(), (*name).to_string(), format!("{size:.4}"), unit(name).to_owned()]
            })
        });
        text.push_str(&table(&["effect", "parameter", "size", "unit"], 2, rows));
    }
    if !diagnosis.proposals.is_empty() {
        text.push_str(
            "\n\nWhat remains looks like this moment [N·m]; share of its mean square in trials that were left out\n",
        );
        let row = |(i, p): (usize, &ProposedFormula)| {
            vec![p.formula.clone(), fixed(100.0 * p.share_of_error, 0), diagnosis_file::proposal_file(i)]
        };
        let rows = diagnosis.proposals.iter().enumerate().map(row);
        text.push_str(&table(&["formula", "%", "as an effect of your own"], 1, rows));
        text.push_str("\n`carpus effect add STUDY proposal_1 --own-effect …/proposal_1.toml --i-choose` adds one");
    }
    if !diagnosis.not_testable.is_empty() {
        text.push_str(&format!("\n\nNot testable with these trials: {}", diagnosis.not_testable.join(", ")));
    }
    text
}
