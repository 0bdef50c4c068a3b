//! `carpus diagnose`: where the model fails, and which physical effect is missing.

use crate::args::{DiagnoseArgs, Global};
use crate::bars::Bars;
use crate::failure::Failure;
use crate::next_steps;
use crate::provenance;
use crate::study_run::{StudyRun, task_done};
use crate::table::{table, tables};
use carpus_diagnosis::diagnose::Diagnosis;
use carpus_session::candidates::candidates;
use carpus_session::cohort_diagnosis::Cohort;
use carpus_session::diagnose::Diagnose;
use carpus_session::diagnose_study::ParticipantDiagnosis;
use carpus_session::json;
use carpus_session::output::OutputFolder;
use carpus_session::text_tables::of_diagnosis;
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

/// What a diagnosis found, for a terminal.
fn readable(diagnosis: &Diagnosis) -> String {
    let mut text =
        format!("{}: {}\n\n{}", diagnosis.participant, in_words(diagnosis), tables(&of_diagnosis(diagnosis)));
    if !diagnosis.not_testable.is_empty() {
        text.push_str(&format!("\n\nNot testable with these trials: {}", diagnosis.not_testable.join(", ")));
    }
    text
}
