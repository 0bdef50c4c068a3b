//! Recordings filtered, corrected, cut and aligned before they are the study's trials.

use super::request::WholeStudy;
use super::step::{Context, Processed, Step, Told};
use crate::diagnostic::Failure;
use crate::drag;
use crate::dynamometer::{COLUMNS, Processing, constants, process, rows, trials_csv};
use crate::loading::LoadedParticipant;
use crate::outcomes::Outcomes;
use crate::output::OutputFolder;
use crate::progress::Progress;
use crate::report_parts::{ReportParts, overview};
use crate::study::{Opening, Study};
use crate::units::Unit;
use carpus_report::article::{Block, TextTable};
use carpus_report::significant;
use carpus_study::dynamometer::DragEstimate;
use carpus_study::study::ProcessingSettings;
use std::path::Path;

/// Folder of the processed study in that of the results.
const FOLDER: &str = "processed";

/// The step.
pub(super) struct Dynamometer;

/// The study that all other steps work on, with the folder of its results: the one given, or what its `[processing]`
/// makes of it.
///
/// - `path`: the folder of the results
///
/// # Errors
/// The study, its recordings, the output folder; a request to stop.
pub(super) fn prepare(
    given: Study,
    request: &WholeStudy,
    path: &Path,
    progress: &dyn Progress,
) -> Result<(Study, OutputFolder, Option<Processed>), Failure> {
    let out = given.output_folder(path, "study")?;
    let settings = &given.tables.settings;
    if settings.processing == ProcessingSettings::default() {
        return Ok((given.scaling_models(), out, None));
    }
    let (constants, damping) =
        (constants(&settings.processing, settings.dynamometer.damping), settings.dynamometer.damping);
    let drag = drag::of_study(&given.tables)?;
    let raw = given.output_folder(&path.join(FOLDER), "dynamometer")?;
    raw.refuse_input(&raw.path().join("study.toml"))?;
    let Outcomes { done: outcomes, failed: failures } =
        process(&given, &Processing { seed: request.seed }, &raw, progress)?;
    progress.warnings(&raw.close("dynamometer", &given.others())?);
    let participants = outcomes.iter().map(|o| o.participant.clone()).collect();
    let opening = Opening { participants, ..given.opening.clone() };
    let study = Study::open_with(&raw.path().join("study.toml"), opening)?;
    let out = study.output_folder_of(&given, path, "study")?;
    Ok((study.scaling_models(), out, Some(Processed { constants, outcomes, drag, damping, failures })))
}

impl Step for Dynamometer {
    fn id(&self) -> &'static str {
        "dynamometer"
    }

    fn title(&self) -> &'static str {
        "Dynamometer"
    }

    fn units<'a>(&self, _: &'a Context, _: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        Ok(Vec::new()) // Recordings are processed before anything else.
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let Some(done) = &context.processing else {
            return Ok(Told::NotRun("the study has no [processing]: its recordings are taken as they are".to_string()));
        };
        let words: Vec<String> = done.constants.iter().map(|(name, value)| format!("{name}: {value}")).collect();
        let shown = rows(&done.outcomes);
        let mut blocks = vec![
            Block::Text(format!(
                "{}. The processed study is in {FOLDER}/, curves of every trial in {FOLDER}/reports/PARTICIPANT.html.",
                words.join("; ")
            )),
            Block::Table(TextTable {
                title: "Recordings and the trials that came of them".to_string(),
                header: COLUMNS.map(String::from).to_vec(),
                left_columns: 1,
                rows: shown.clone(),
                note:
                    "Passive: fit of the relaxed limb's moment over the passive trials; correlation: of the quantity \
                       that both \
                       recorders have."
                        .to_string(),
            }),
        ];
        blocks.extend(done.drag.as_ref().map(|drag| Block::Text(drag_in_words(drag, done.damping))));
        let warnings = done
            .outcomes
            .iter()
            .flat_map(|o| o.findings.iter().map(move |(file, text)| format!("{}: {file}: {text}", o.participant)));
        Ok(Told::Parts(ReportParts {
            warnings: warnings.collect(),
            blocks,
            tables: vec![("dynamometer_trials.csv".to_string(), trials_csv(&done.outcomes)?)],
            overview: vec![overview("", &COLUMNS, 1, shown)],
            ..ReportParts::default()
        }))
    }
}

fn drag_in_words(drag: &DragEstimate, reckoned: f64) -> String {
    let per_degree = |v: f64| significant(v * 1f64.to_radians(), 4);
    let friction = drag.friction.map_or(String::new(), |(f, [low, high])| {
        let [f, low, high] = [f, low, high].map(|v| significant(v, 3));
        format!(" Coulomb friction {f} N·m (95 %: {low} to {high}).")
    });
    format!(
        "Drag of the machine from {} phases of constant velocity without a participant: {} N·m·s/deg (95 %: {} to {}); \
         study.toml \
         reckons with {}.{friction}",
        drag.phases.len(),
        per_degree(drag.damping),
        per_degree(drag.interval[0]),
        per_degree(drag.interval[1]),
        per_degree(reckoned)
    )
}
