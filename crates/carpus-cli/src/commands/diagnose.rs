//! `carpus diagnose`: where the model fails, and which physical effect is missing.

use std::collections::BTreeMap;

use crate::args::{DiagnoseArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::next_steps;
use crate::provenance;
use crate::separations::separation_table;
use crate::study_run::{StudyRun, task_done};
use crate::table::{fixed, table};
use carpus_diagnosis::catalogue::effect;
use carpus_diagnosis::diagnose::{Diagnosis, NamedEffect, ParameterEstimate, Verdict, is_determined};
use carpus_diagnosis::separation::{SEPARABLE_Z, best_of_pairs};
use carpus_diagnosis::what_remains::ProposedFormula;
use carpus_report::intervals::with_validity;
use carpus_session::candidates::candidates;
use carpus_session::cohort_diagnosis::Cohort;
use carpus_session::diagnose::Diagnose;
use carpus_session::diagnose_study::ParticipantDiagnosis;
use carpus_session::diagnosis_file::proposal_file;
use carpus_session::json;
use carpus_session::output::OutputFolder;
use carpus_session::verdict_words::in_words;

/// Runs the command.
///
/// # Errors
/// The study, its models and trials, the candidates, or the output folder.
pub fn run(args: &DiagnoseArgs, global: &Global) -> Result<(), Failure> {
    candidates(&args.candidates)?;
    let study = StudyRun::prepare_with(&args.study, &args.effects, "diagnose")?;
    let request = Diagnose { seed: global.seed, candidates: args.candidates.clone(), baselines: args.baselines };
    let bars = Bars::new(global);
    if let Some(task) = args.task {
        let arguments = provenance::arguments_of_task();
        let done = study.study.diagnose_task(&request, (task, &arguments), &study.out, &readable, &bars)?;
        return task_done(&done, study.out.path(), global);
    }
    let found = study.study.diagnose_all(&request, &study.out, &readable, &bars)?;
    if global.json {
        let text = json::line(&found.participants.iter().map(ParticipantDiagnosis::value).collect::<Vec<_>>())?;
        return study.print("diagnose", &text, found.failed);
    }
    let one = |p: &ParticipantDiagnosis| format!("{}\n\n{}", p.told, study.report_of(&p.evidence.participant));
    let mut text: Vec<String> = found.participants.iter().map(one).collect();
    if let Some(last) = text.last_mut() {
        last.push_str(&next_steps::in_words(found.participants.iter().map(|p| &p.results), study.out.path()));
    }
    text.extend(found.cohort.map(|cohort| together(&cohort, &study.out)));
    let text = text.join("\n\n");
    study.print("diagnose", &text, found.failed)
}

/// What the participants say together.
fn together(cohort: &Cohort, out: &OutputFolder) -> String {
    let (header, words) = Cohort::HEADER;
    let mut text = format!("{}\n", cohort.in_words());
    if !cohort.diagnosis.effects.is_empty() {
        text.push_str(&format!("\n{}\n", table(&header, words, cohort.rows())));
    }
    text + &format!("\n{}", out.path().join("cohort.html").display())
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
        let percent = |shares: [f64; 3]| {
            let [value, low, high] = shares.map(|share| fixed(100.0 * share, 0));
            format!("{value} [{low}, {high}]")
        };
        vec![
            e.effect.to_owned(),
            fixed(e.probability, 2),
            percent(e.share_of_error.train),
            percent(e.unique_share.train),
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
        text.push_str(
            "\n\nMissing effects: probability, share of the model's mean squared error that each takes, and the part \
             of it that nothing else takes\n",
        );
        let header = ["effect", "probability", "training %", "unique %", "held out %", "parameters, 95 % intervals"];
        text.push_str(&table(&header, 5, several_rows(diagnosis)));
    } else if !diagnosis.explanations.is_empty() {
        text.push_str("\n\nExplanations that leave nothing\n");
        let rows = diagnosis.explanations.iter().flat_map(|e| estimate_rows(&e.parameters, &fixed(e.p_value, 3)));
        text.push_str(&table(&["parameter", "estimate, 95 % interval", "plausible", "p"], 2, rows));
        if !diagnosis.separating_experiments.is_empty() {
            text.push_str(&format!(
                "\n\nFurther trials that would tell (z: standard deviations; told apart from {SEPARABLE_Z})\n{}",
                separation_table(best_of_pairs(&diagnosis.separating_experiments))
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
            vec![p.formula.clone(), fixed(100.0 * p.share_of_error, 0), proposal_file(i)]
        };
        let rows = diagnosis.proposals.iter().enumerate().map(row);
        text.push_str(&table(&["formula", "%", "as an effect of your own"], 1, rows));
    }
    if !diagnosis.not_testable.is_empty() {
        text.push_str(&format!("\n\nNot testable with these trials: {}", diagnosis.not_testable.join(", ")));
    }
    text
}
