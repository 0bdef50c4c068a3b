//! Every model on every held-out condition.

use serde::{Deserialize, Serialize};

use super::personalize::files;
use super::{Context, Step};
use crate::cli::cohort_report::{self, ModelName, Representative};
use crate::cli::commands::evaluate::{LINEAR, ReportParts, evaluate};
use crate::cli::commands::strength_scale::refused;
use crate::cli::failure::Failure;
use crate::cli::provenance::hash;
use crate::cli::study_run::ParticipantRun;
use crate::cli::units::{Unit, value};
use crate::evaluation::{Cohort, ConditionError};
use crate::personalization::{Optimizer, TrainingCase};
use crate::scaling::strength_scale;

/// The step.
pub struct Evaluate;

/// The participant's model with forces scaled to the maximum voluntary moments.
const STRENGTH: &str = "strength";

/// A participant's evaluation, as it is stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Evaluated {
    participant: String,
    models: Vec<ModelName>,
    errors: Vec<ConditionError>,
    curves: Vec<Representative>,
    /// Why a control is missing.
    notes: Vec<String>,
}

impl Step for Evaluate {
    fn id(&self) -> &'static str {
        "evaluate"
    }

    fn title(&self) -> &'static str {
        "Evaluation on held-out trials"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a ParticipantRun) -> Result<Vec<Unit<'a>>, Failure> {
        let cases = files(context, run, Optimizer::ExactGradients)?;
        let mut names: Vec<ModelName> = cases.iter().map(|(case, _)| name_of(case)).collect();
        let mut models: Vec<_> = cases.iter().map(|(case, file)| (case.id(), file.spec.clone())).collect();
        let mut texts: Vec<String> =
            cases.iter().map(|(_, file)| String::from_utf8_lossy(file.document.bytes()).into_owned()).collect();
        let mut notes = Vec::new();
        let mut strong = run.loaded.file.clone();
        match strength_scale(&mut strong, &context.study.study, &run.participant) {
            Ok(_) => {
                texts.push(String::from_utf8_lossy(strong.document.bytes()).into_owned());
                context
                    .study
                    .out
                    .write(format!("models/{}/{STRENGTH}.osim", run.participant.name), strong.document.bytes())?;
                models.push((STRENGTH.to_string(), strong.spec));
                names.push(ModelName { id: STRENGTH.to_string(), label: "strength scaled".to_string() });
            }
            Err(error) => match refused(error, &run.loaded.path) {
                Failure::Input(messages) => notes.extend(
                    messages
                        .into_iter()
                        .map(|m| format!("{}: no strength-scaled control: {}", run.participant.name, m.text)),
                ),
                other => return Err(other),
            },
        }
        let depends_on = hash(&texts.iter().map(String::as_str).collect::<Vec<_>>());
        models.push((LINEAR.to_string(), run.loaded.file.spec.clone()));
        names.push(ModelName { id: LINEAR.to_string(), label: "linearly scaled".to_string() });
        let work = move || {
            let shown = shown(&models);
            let shown: Vec<&str> = shown.iter().map(String::as_str).collect();
            let (errors, curves) = evaluate(context.study, run, &models, &shown)?;
            let (participant, models, notes) = (run.participant.name.clone(), names.clone(), notes.clone());
            value(&Evaluated { participant, models, errors, curves, notes })
        };
        let place = format!("{}/{}", self.id(), run.participant.name);
        Ok(vec![Unit { place, depends_on, work: Box::new(work) }])
    }

    fn section(&self, context: &Context) -> Result<Option<ReportParts>, Failure> {
        let mut units: Vec<Evaluated> = context.store.finished(self.id())?;
        units.sort_by_key(|u| context.study.participants.iter().position(|p| p.name == u.participant));
        let mut names: Vec<ModelName> = Vec::new();
        for name in units.iter().flat_map(|u| &u.models) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        if names.is_empty() {
            return Ok(None);
        }
        // Participants may have different cases: controls stay last.
        names.sort_by_key(|n| [LINEAR, STRENGTH].iter().position(|c| *c == n.id).map_or(0, |i| i + 1));
        let errors = units.iter().flat_map(|u| u.errors.clone()).collect();
        let curves: Vec<Representative> = units.iter().flat_map(|u| u.curves.clone()).collect();
        let cohort = Cohort::new(errors, names.iter().map(|n| n.id.clone()).collect());
        let mut report = cohort_report::evaluation(&cohort, &names, &curves)?;
        report.warnings.extend(units.iter().flat_map(|u| u.notes.iter().cloned()));
        Ok(Some(report))
    }
}

fn name_of(case: &TrainingCase) -> ModelName {
    ModelName { id: case.id(), label: case.label() }
}

/// The combined case of the least effort, and the controls: figure 3.5.
fn shown(models: &[(String, crate::osim::spec::ModelSpec)]) -> Vec<String> {
    let combined = models.iter().find(|(id, _)| id.starts_with("combined")).or(models.first());
    let mut shown: Vec<String> = combined.iter().map(|(id, _)| id.clone()).collect();
    shown.extend([LINEAR, STRENGTH].into_iter().filter(|c| models.iter().any(|(id, _)| id == c)).map(String::from));
    shown.dedup();
    shown
}

/// All errors of the participants that were evaluated.
///
/// # Errors
/// A fault of this program.
pub fn cohort(context: &Context) -> Result<Vec<ConditionError>, Failure> {
    let units: Vec<Evaluated> = context.store.finished("evaluate")?;
    Ok(units.into_iter().flat_map(|u| u.errors).collect())
}
