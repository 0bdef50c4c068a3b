//! The controls: the model scaled to the participant's lengths, where the study says how, and to the maximum voluntary
//! moments.

use serde::{Deserialize, Serialize};

use super::step::{Context, Step, Told};
use crate::account::{csv_text, digits, fixed};
use crate::diagnostic::Failure;
use crate::evaluate::LINEAR;
use crate::loading::LoadedParticipant;
use crate::report_parts::{ReportParts, overview};
use crate::strength::refused;
use crate::units::{Unit, value};
use carpus_osim::osim::OsimFile;
use carpus_report::article::{Block, TextTable};
use carpus_simulation::scaling::strength_scale;

/// The step.
pub(super) struct Scale;

/// Key of the model whose forces are scaled to the maximum voluntary moments.
pub(super) const STRENGTH: &str = "strength";

/// A participant's factors, as they are stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Scaled {
    participant: String,
    /// Scaling of lengths was done here, not by the lab.
    segments: Vec<Factor>,
    groups: Vec<Factor>,
    /// Why forces were not scaled.
    note: Option<String>,
}

/// What something is in the participant and in the model, and the factor between them.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Factor {
    /// Segment or functional group.
    name: String,
    /// `m` or `N·m`.
    unit: String,
    participant: f64,
    model: f64,
    factor: f64,
}

impl Step for Scale {
    fn id(&self) -> &'static str {
        "scale"
    }

    fn title(&self) -> &'static str {
        "Scaling"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let work = move || {
            let lengths = run.scaling.iter().flat_map(|s| &s.segments).map(|s| Factor {
                name: s.segment.clone(),
                unit: "m".to_string(),
                participant: s.participant,
                model: s.model,
                factor: s.factor,
            });
            let mut scaled = Scaled {
                participant: run.participant.name.clone(),
                segments: lengths.collect(),
                groups: Vec::new(),
                note: None,
            };
            let mut file = run.loaded.file.clone();
            match strength_scale(&mut file, &context.study.tables, &run.participant) {
                Ok(found) => scaled.groups.extend(found.groups.iter().map(|g| Factor {
                    name: g.direction.word().to_string(),
                    unit: "N·m".to_string(),
                    participant: g.target,
                    model: g.before,
                    factor: g.factor,
                })),
                Err(error) => match refused(error, &run.loaded.path) {
                    Failure::Input(messages) => {
                        let texts: Vec<String> = messages.into_iter().map(|m| m.text).collect();
                        scaled.note = Some(texts.join("; "));
                    }
                    other => return Err(other),
                },
            }
            value(&scaled)
        };
        let place = format!("{}/{}", self.id(), run.participant.name);
        Ok(vec![Unit { place, depends_on: String::new(), work: Box::new(work) }])
    }

    fn write(&self, context: &Context, run: &LoadedParticipant) -> Result<(), Failure> {
        let folder = format!("models/{}", run.participant.name);
        context.out.write(format!("{folder}/{LINEAR}.osim"), run.loaded.file.document.bytes())?;
        if let Some(file) = strong(context, run)? {
            context.out.write(format!("{folder}/{STRENGTH}.osim"), file.document.bytes())?;
        }
        Ok(())
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let mut all: Vec<Scaled> = context.store.finished(self.id())?;
        all.sort_by_key(|s| context.study.chosen().iter().position(|p| p.name == s.participant));
        if all.is_empty() {
            return Ok(Told::NotRun("no participant could be read".to_string()));
        }
        let factors = || all.iter().flat_map(|s| s.segments.iter().chain(&s.groups).map(move |f| (s, f)));
        let shown: Vec<Vec<String>> = factors()
            .map(|(s, f)| {
                let number = |v: f64| format!("{} {}", fixed(v, 3), f.unit);
                vec![s.participant.clone(), f.name.clone(), number(f.participant), number(f.model), fixed(f.factor, 3)]
            })
            .collect();
        let rows = factors().map(|(s, f)| {
            let mut row = vec![s.participant.clone(), f.name.clone(), f.unit.clone()];
            row.extend([f.participant, f.model, f.factor].map(digits));
            row
        });
        let columns = ["participant", "what", "unit", "participant_value", "model_value", "factor"];
        let csv = csv_text(columns.iter(), rows)?;
        let by_lab = all.iter().filter(|s| s.segments.is_empty()).count();
        let header = ["participant", "what", "participant", "model", "factor"];
        Ok(Told::Parts(ReportParts {
            warnings: all
                .iter()
                .filter_map(|s| Some(format!("{}: no strength-scaled control: {}", s.participant, s.note.as_ref()?)))
                .collect(),
            blocks: vec![
                Block::Text(format!(
                    "The linearly scaled control is the model of the study, with [scaling] scaled to the participant's \
                     lengths \
                     ({by_lab} of {} participants: taken as it is); the strength-scaled control has one factor for the \
                     forces of \
                     each functional group, so that the group reaches the maximum voluntary moment.",
                    all.len()
                )),
                Block::Table(TextTable {
                    title: "Scale factors".to_string(),
                    header: header.map(String::from).to_vec(),
                    left_columns: 2,
                    rows: shown.clone(),
                    note: String::new(),
                }),
            ],
            tables: vec![("scale_factors.csv".to_string(), csv)],
            overview: vec![overview("", &header, 2, shown)],
            ..ReportParts::default()
        }))
    }
}

/// The strength-scaled model, if the study has maximum voluntary moments.
///
/// # Errors
/// A fault of this program.
pub(super) fn strong(context: &Context, run: &LoadedParticipant) -> Result<Option<OsimFile>, Failure> {
    let mut file = run.loaded.file.clone();
    match strength_scale(&mut file, &context.study.tables, &run.participant) {
        Ok(_) => Ok(Some(file)),
        Err(error) => match refused(error, &run.loaded.path) {
            Failure::Input(_) => Ok(None),
            other => Err(other),
        },
    }
}
