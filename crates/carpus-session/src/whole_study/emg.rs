//! Raw EMG to excitations: levels at maximum voluntary contraction, and what is doubtful about channels.

use std::path::Path;

use super::step::{Context, Step, Told};
use crate::account::csv_text;
use crate::diagnostic::Failure;
use crate::emg::{COLUMNS, Emg as Request, ParticipantEmg, constants, findings, processed, rows};
use crate::loading::LoadedParticipant;
use crate::report_parts::{ReportParts, overview};
use crate::units::{Unit, value};
use carpus_report::article::{Block, TextTable};
use carpus_study::study::EmgSignal;

/// The step.
pub(super) struct Emg;

impl Step for Emg {
    fn id(&self) -> &'static str {
        "emg"
    }

    fn title(&self) -> &'static str {
        "EMG"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let EmgSignal::Raw(processing) = &context.study.tables.settings.emg else { return Ok(Vec::new()) };
        let name = &run.participant.name;
        let folder = Path::new(self.id()).join(name);
        let request = Request { seed: context.request.seed };
        let work =
            move || value(&processed(context.study, context.out, &run.participant, processing, &request, &folder)?);
        let place = format!("{}/{name}", self.id());
        Ok(vec![Unit { place, depends_on: String::new(), work: Box::new(work) }])
    }

    fn write(&self, context: &Context, run: &LoadedParticipant) -> Result<(), Failure> {
        // A unit that was found finished wrote its files then.
        context.out.keep(Path::new(self.id()).join(&run.participant.name));
        Ok(())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let EmgSignal::Raw(processing) = &context.study.tables.settings.emg else {
            return Ok(Told::NotRun("the study's EMG is normalized already ([emg] kind = \"normalized\")".to_string()));
        };
        let mut all: Vec<ParticipantEmg> = context.store.finished(self.id())?;
        all.sort_by_key(|o| context.study.chosen().iter().position(|p| p.name == o.participant));
        if all.is_empty() {
            return Ok(Told::NotRun("no participant could be read".to_string()));
        }
        let shown = rows(&all);
        let words: Vec<String> = constants(processing).into_iter().map(|(name, v)| format!("{name}: {v}")).collect();
        let doubtful = findings(&all);
        let mut blocks = vec![
            Block::Text(format!(
                "From raw channels to excitations, 1 being the maximum voluntary contraction. {}. Plots of every \
                 channel of \
                 every trial are in emg/PARTICIPANT/report.html.",
                words.join("; ")
            )),
            Block::Table(TextTable {
                title: "Channels and their level at maximum voluntary contraction".to_string(),
                header: COLUMNS.map(String::from).to_vec(),
                left_columns: 3,
                rows: shown.clone(),
                note: "The level is in the channel's unit; highest: of all trials, as a share of that level."
                    .to_string(),
            }),
        ];
        if !doubtful.is_empty() {
            blocks.push(Block::Table(TextTable {
                title: "What is doubtful about channels".to_string(),
                header: ["participant", "trial", "channel", "finding"].map(String::from).to_vec(),
                left_columns: 4,
                rows: doubtful.iter().map(|row| row.to_vec()).collect(),
                note: String::new(),
            }));
        }
        let csv = csv_text(COLUMNS.iter(), shown.clone().into_iter())?;
        let found = csv_text(
            ["participant", "trial", "channel", "finding"].iter(),
            doubtful.into_iter().map(|row| row.to_vec()),
        )?;
        Ok(Told::Parts(ReportParts {
            blocks,
            tables: vec![("emg_channels.csv".to_string(), csv), ("emg_findings.csv".to_string(), found)],
            overview: vec![overview("", &COLUMNS, 3, shown)],
            ..ReportParts::default()
        }))
    }
}
