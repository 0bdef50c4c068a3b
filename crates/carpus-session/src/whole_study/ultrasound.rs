//! The models of the study beside ultrasound images: chapter 4.

use serde::{Deserialize, Serialize};

use super::personalize::files;
use super::scale::{STRENGTH, strong};
use super::step::{Context, Step, Told};
use crate::diagnostic::{Diagnostic, Failure};
use crate::evaluate::LINEAR;
use crate::loading::LoadedParticipant;
use crate::provenance::hash;
use crate::report_parts::ReportParts;
use crate::ultrasound::{agreement, case_result, missing_ratios, pairs_with, tables};
use crate::units::{Unit, value};
use carpus_multibody::multibody::Model;
use carpus_osim::osim::OsimFile;
use carpus_personalization::personalization::Optimizer;
use carpus_report::article::Block;
use carpus_report::results::rounded;
use carpus_report::ultrasound::{CaseResult, ultrasound_blocks};
use carpus_simulation::imaging::Pair;

/// The step.
pub(super) struct Ultrasound;

/// A participant's images beside every model, as they are stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Imaged {
    participant: String,
    cases: Vec<Case>,
}

/// The images beside one model.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Case {
    id: String,
    label: String,
    pairs: Vec<Pair>,
}

impl Step for Ultrasound {
    fn id(&self) -> &'static str {
        "ultrasound"
    }

    fn title(&self) -> &'static str {
        "Models beside ultrasound images"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let participant = &run.participant.name;
        if !context.study.tables.ultrasound.iter().any(|m| m.participant == *participant) {
            return Ok(Vec::new());
        }
        let fitted = files(context, run, Optimizer::ExactGradients)?;
        let mut models: Vec<(String, String, OsimFile)> =
            fitted.into_iter().map(|(case, file)| (case.id(), case.label(), file)).collect();
        if let Some(file) = strong(context, run)? {
            models.push((STRENGTH.to_string(), "strength scaled".to_string(), file));
        }
        models.push((LINEAR.to_string(), "linearly scaled".to_string(), run.loaded.file.clone()));
        let texts: Vec<String> =
            models.iter().map(|(.., file)| String::from_utf8_lossy(file.document.bytes()).into_owned()).collect();
        let depends_on = hash(&texts.iter().map(String::as_str).collect::<Vec<_>>());
        let work = move || {
            let mut cases = Vec::new();
            for (id, label, file) in &models {
                let skeleton = Model::compile(&file.spec).map_err(|e| {
                    Failure::from(Diagnostic::error(e.to_string()).in_file(&run.loaded.path).at_line(e.at().line))
                })?;
                let pairs = pairs_with(&context.study.tables, participant, &file.spec, &skeleton)?;
                cases.push(Case { id: id.clone(), label: label.clone(), pairs });
            }
            value(&Imaged { participant: participant.clone(), cases })
        };
        Ok(vec![Unit { place: format!("{}/{participant}", self.id()), depends_on, work: Box::new(work) }])
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let cases = cases(context)?;
        if cases.is_empty() {
            return Ok(Told::NotRun("the study has no ultrasound.csv with images of these participants".to_string()));
        }
        let results: Vec<CaseResult> = cases.iter().map(|c| case_result(&c.label, &c.pairs)).collect();
        let mut warnings = Vec::new();
        missing_ratios(&context.study.tables, &results, &mut warnings);
        let imaging = &context.study.tables.settings.imaging;
        let tension = rounded(imaging.specific_tension / 1e4, 8);
        let [correlation, agreement_blocks, figures] = ultrasound_blocks(&results, tension, imaging.source.as_deref());
        let explained = Block::Text(format!(
            "Every muscle of every model is at rest (activation {}) in the posture of its image. No image was used to \
             fit.",
            imaging.activation
        ));
        let tables = tables(&results)?.map(|(name, text)| (format!("ultrasound_{name}"), text));
        Ok(Told::Parts(ReportParts {
            warnings: warnings.iter().map(|w| w.text.clone()).collect(),
            blocks: [vec![explained], correlation, agreement_blocks, figures].concat(),
            tables: tables.to_vec(),
            overview: vec![agreement(&results)],
            ..ReportParts::default()
        }))
    }
}

/// All images beside every model, participants together; controls last.
fn cases(context: &Context) -> Result<Vec<Case>, Failure> {
    let mut all: Vec<Imaged> = context.store.finished("ultrasound")?;
    all.sort_by_key(|i| context.study.chosen().iter().position(|p| p.name == i.participant));
    let mut cases: Vec<Case> = Vec::new();
    for case in all.into_iter().flat_map(|i| i.cases) {
        match cases.iter_mut().find(|known| known.id == case.id) {
            Some(known) => known.pairs.extend(case.pairs),
            None => cases.push(case),
        }
    }
    // Participants may have different cases.
    cases.sort_by_key(|c| [STRENGTH, LINEAR].iter().position(|id| *id == c.id).map_or(0, |i| i + 1));
    Ok(cases)
}

/// Of every model and quantity: key of the model, quantity, Pearson's r and p.
///
/// # Errors
/// A fault of this program.
pub(super) fn correlations(context: &Context) -> Result<Vec<(String, String, f64, f64)>, Failure> {
    let of = |c: &Case| {
        let found = case_result(&c.label, &c.pairs).quantities;
        found.into_iter().filter_map(|q| Some((c.id.clone(), q.quantity, q.r?, q.p?))).collect::<Vec<_>>()
    };
    Ok(cases(context)?.iter().flat_map(of).collect())
}
