//! `carpus study`: chapters 2 to 4 of the dissertation from one study folder, resumable.
//!
//! A study is a list of [`STEPS`]. A step divides a participant's work into [units](carpus_session::units) and, when all
//! participants are done, makes a section of the report from the units' results. A step is one file and one line of the
//! list.

mod conclusions;
mod dynamometer;
mod emg;
mod evaluate;
mod identify;
mod personalize;
mod power;
mod scale;
mod sensitivity;
mod ultrasound;

use crate::args::{Global, WholeStudyArgs};
use crate::failure::{self, Diagnostic, Failure, Severity};
use crate::print_result;
use crate::provenance::provenance;
use crate::report_parts::ReportParts;
use crate::study_run::{StudyRun, progress};
use carpus_report::article::{Article, Block, Section};
use carpus_report::render_article;
use carpus_report::results::InputFile;
use carpus_session::loading::LoadedParticipant;
use carpus_session::output::OutputFolder;
use carpus_session::units::{Unit, UnitStore};

use dynamometer::Processed;

/// The steps, in the order in which they are done.
const STEPS: [&dyn Step; 10] = [
    &dynamometer::Dynamometer,
    &emg::Emg,
    &scale::Scale,
    &sensitivity::Sensitivity,
    &personalize::Personalize,
    &evaluate::Evaluate,
    &identify::Identify,
    &ultrasound::Ultrasound,
    &power::Power,
    &conclusions::Conclusions,
];

/// What a step has to tell when all participants are done.
pub enum Told {
    /// Its section.
    Parts(ReportParts),
    /// Why there is none.
    NotRun(String),
}

/// What all steps work with.
pub struct Context<'a> {
    /// The study and the output folder.
    pub study: &'a StudyRun,
    /// How hard to work.
    pub args: &'a WholeStudyArgs,
    /// Seed.
    pub global: &'a Global,
    /// Finished units.
    pub store: &'a UnitStore<'a>,
    /// What was done to the dynamometer's recordings before they became this study; `None` where nothing was asked for.
    pub processing: Option<Processed>,
}

/// A step of a study.
pub trait Step: Sync {
    /// Key: the first part of its units' places, its section's anchor, and its name on the command line.
    fn id(&self) -> &'static str;

    /// Heading of its section.
    fn title(&self) -> &'static str;

    /// A participant's units; none where the study has nothing for this step.
    ///
    /// # Errors
    /// Why the participant's part cannot be done.
    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure>;

    /// Writes what is not part of the report, such as models.
    ///
    /// # Errors
    /// The disk.
    fn write(&self, _context: &Context, _run: &LoadedParticipant) -> Result<(), Failure> {
        Ok(())
    }

    /// The section, from the units of all participants; or why there is none.
    ///
    /// # Errors
    /// A fault of this program.
    fn section(&self, context: &Context) -> Result<Told, Failure>;
}

/// Runs the command.
///
/// # Errors
/// The study, an unknown step, the output folder; after everything else is done, whatever could not be done.
pub fn run(args: &WholeStudyArgs, global: &Global) -> Result<(), Failure> {
    let steps = chosen(&args.steps)?;
    let (study, processing) = dynamometer::prepare(&args.study, global)?;
    let store = UnitStore::new(&study.out)?;
    let context = Context { study: &study, args, global, store: &store, processing };
    let bar = progress(global, (study.participants().len() * steps.len()) as u64, "reading");
    let (mut inputs, mut warnings): (Vec<InputFile>, Vec<Diagnostic>) = Default::default();
    let mut printed: Vec<(&str, Vec<Diagnostic>)> = Vec::new();
    let mut failures = context.processing.as_ref().map(|p| p.failures.clone()).unwrap_or_default();
    for participant in study.participants() {
        bar.set_message(format!("{}: reading", participant.name));
        let run = match study.participant(participant) {
            Ok(run) => run,
            Err(Failure::Input(messages)) => {
                failures.extend(messages);
                bar.inc(steps.len() as u64);
                continue;
            }
            Err(other) => return Err(other),
        };
        add_new(&mut warnings, &run.warnings);
        printed.push((participant.name.as_str(), run.warnings.clone()));
        add_new(&mut inputs, &run.inputs);
        let hashes: Vec<&str> = run.inputs.iter().map(|i| i.sha256.as_str()).collect();
        for step in &steps {
            let units = match step.units(&context, &run) {
                Ok(units) => units,
                Err(Failure::Input(messages)) => {
                    failures.extend(messages);
                    bar.inc(1);
                    continue;
                }
                Err(other) => return Err(other),
            };
            let done = |place: &str| bar.set_message(place.to_string());
            let said = store.run(&units, &hashes.join(" "), &done)?;
            let (damaged, not_done): (Vec<_>, Vec<_>) =
                said.into_iter().partition(|message| message.severity == Severity::Warning);
            // Said now, and not in the report, which does not depend on what lay in the folder.
            failure::print(&damaged);
            failures.extend(not_done);
            step.write(&context, &run)?;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    for (participant, own) in &printed {
        failure::about(participant);
        failure::print(own);
    }
    failure::account();
    let told = steps.iter().map(|s| Ok((*s, s.section(&context)?))).collect::<Result<Vec<_>, Failure>>()?;
    let article = article(&context, &told, &warnings, &failures, inputs);
    let parts: Vec<(&dyn Step, &ReportParts)> = told
        .iter()
        .filter_map(|(step, told)| match told {
            Told::Parts(part) => Some((*step, part)),
            Told::NotRun(_) => None,
        })
        .collect();
    write(&study.out, &article, &parts)?;
    write_timings(&store, &study.out)?;
    // Of a run of some steps the others' results stay.
    study.close(if args.steps.is_empty() { "study" } else { "study --steps" })?;
    let report = study.out.path().join("report.html");
    let [found, computed] = store.counts();
    if global.json {
        let result = serde_json::json!({
            "schema": "carpus.study/1",
            "report": report,
            "steps": parts.iter().map(|(step, part)| serde_json::json!({
                "step": step.id(),
                "summary": part.lead,
                "tables": part.tables.iter().map(|(name, _)| name).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "not_run": told.iter().filter_map(|(step, told)| match told {
                Told::NotRun(why) => Some(serde_json::json!({ "step": step.id(), "why": why })),
                Told::Parts(_) => None,
            }).collect::<Vec<_>>(),
            "units_found_finished": found,
            "units_computed": computed,
        });
        print_result(&result.to_string())?;
    } else {
        let mut text = String::new();
        for (step, told) in &told {
            match told {
                Told::Parts(part) => text.push_str(&format!("{}\n{}\n\n", step.title(), part.readable)),
                Told::NotRun(why) => text.push_str(&format!("{}\nnot run: {why}\n\n", step.title())),
            }
        }
        text.push_str(&format!("{found} units were finished before, {computed} were computed\n{}\n", report.display()));
        print_result(&text)?;
    }
    if failures.is_empty() { Ok(()) } else { Err(Failure::Input(failures)) }
}

/// The steps of these names, or all.
fn chosen(names: &[String]) -> Result<Vec<&'static dyn Step>, Failure> {
    if names.is_empty() {
        return Ok(STEPS.to_vec());
    }
    for name in names {
        if !STEPS.iter().any(|s| s.id() == name) {
            let known: Vec<&str> = STEPS.iter().map(|s| s.id()).collect();
            let hint = match carpus_study::study::nearest(name, known.iter().copied()) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are: {}", known.join(", ")),
            };
            return Err(Diagnostic::error(format!("there is no step `{name}`")).hint(hint).into());
        }
    }
    Ok(STEPS.iter().copied().filter(|s| names.iter().any(|n| n == s.id())).collect())
}

fn add_new<T: Clone + PartialEq>(all: &mut Vec<T>, more: &[T]) {
    for item in more {
        if !all.contains(item) {
            all.push(item.clone());
        }
    }
}

fn article(
    context: &Context,
    told: &[(&dyn Step, Told)],
    warnings: &[Diagnostic],
    failures: &[Diagnostic],
    inputs: Vec<InputFile>,
) -> Article {
    let text = |m: &Diagnostic| match m.place() {
        Some(place) => format!("{place}: {}", m.text),
        None => m.text.clone(),
    };
    let parts = || {
        told.iter().filter_map(|(_, told)| match told {
            Told::Parts(part) => Some(part),
            Told::NotRun(_) => None,
        })
    };
    let mut read_first: Vec<String> = failures.iter().map(|m| format!("Not done: {}", text(m))).collect();
    read_first.extend(parts().flat_map(|part| part.warnings.iter().cloned()));
    read_first.extend(warnings.iter().map(text));
    let settings = &context.study.study.tables.settings;
    Article {
        title: settings.name.clone(),
        kicker: "Study".to_string(),
        lead: parts().map(|p| p.lead.as_str()).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" "),
        facts: vec![
            ("participants".to_string(), context.study.participants().len().to_string()),
            ("muscles".to_string(), settings.active_muscles.join(", ")),
            ("coordinate".to_string(), settings.dynamometer.coordinate.clone()),
        ],
        warnings: read_first,
        sections: told
            .iter()
            .map(|(step, told)| Section {
                id: step.id().to_string(),
                title: step.title().to_string(),
                blocks: match told {
                    Told::Parts(part) => [part.blocks.clone(), files(part)].concat(),
                    Told::NotRun(why) => vec![Block::Text(format!("Not run: {why}."))],
                },
            })
            .collect(),
        provenance: provenance(context.global, inputs),
    }
}

fn files(part: &ReportParts) -> Vec<Block> {
    let names: Vec<&str> = part.tables.iter().map(|(name, _)| name.as_str()).collect();
    if names.is_empty() { Vec::new() } else { vec![Block::Text(format!("As tables: {}.", names.join(", ")))] }
}

fn write(out: &OutputFolder, article: &Article, parts: &[(&dyn Step, &ReportParts)]) -> Result<(), Failure> {
    for (name, text) in parts.iter().flat_map(|(_, part)| &part.tables) {
        out.write(name, text.as_bytes())?;
    }
    out.write("report.html", render_article(article).as_bytes())?;
    Ok(())
}

/// Processor seconds of every unit: the one table that depends on the machine.
fn write_timings(store: &UnitStore, out: &OutputFolder) -> Result<(), Failure> {
    let rows = store.seconds().into_iter().map(|(place, seconds)| vec![place, format!("{seconds:.3}")]);
    let text = carpus_session::account::csv_text(["unit", "processor_seconds"].iter(), rows)?;
    out.put("timings.csv".as_ref(), text.as_bytes())?;
    Ok(())
}
