//! Every model on every held-out condition.

use serde::{Deserialize, Serialize};

use super::personalize::files;
use super::scale::{STRENGTH, strong};
use super::step::{Context, Step, Told};
use crate::diagnostic::Failure;
use crate::evaluate::LINEAR;
use crate::evaluation_report::{self, ModelName, Representative};
use crate::loading::LoadedParticipant;
use crate::provenance::hash;
use crate::units::{Unit, value};
use carpus_personalization::personalization::{Optimizer, TrainingCase};
use carpus_simulation::evaluation::{Cohort, ConditionError};

/// The step.
pub(super) struct Evaluate;

/// A participant's evaluation, as it is stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Evaluated {
    participant: String,
    models: Vec<ModelName>,
    errors: Vec<ConditionError>,
    curves: Vec<Representative>,
}

impl Step for Evaluate {
    fn id(&self) -> &'static str {
        "evaluate"
    }

    fn title(&self) -> &'static str {
        "Evaluation on held-out trials"
    }

    fn units<'a>(&self, context: &'a Context, run: &'a LoadedParticipant) -> Result<Vec<Unit<'a>>, Failure> {
        let cases = files(context, run, Optimizer::ExactGradients)?;
        let mut names: Vec<ModelName> = cases.iter().map(|(case, _)| name_of(case)).collect();
        let mut models: Vec<_> = cases.iter().map(|(case, file)| (case.id(), file.spec.clone())).collect();
        let mut texts: Vec<String> =
            cases.iter().map(|(_, file)| String::from_utf8_lossy(file.document.bytes()).into_owned()).collect();
        if let Some(strong) = strong(context, run)? {
            texts.push(String::from_utf8_lossy(strong.document.bytes()).into_owned());
            models.push((STRENGTH.to_string(), strong.spec));
            names.push(ModelName { id: STRENGTH.to_string(), label: "strength scaled".to_string() });
        }
        let depends_on = hash(&texts.iter().map(String::as_str).collect::<Vec<_>>());
        models.push((LINEAR.to_string(), run.loaded.file.spec.clone()));
        names.push(ModelName { id: LINEAR.to_string(), label: "linearly scaled".to_string() });
        let work = move || {
            let shown = shown(&models);
            let shown: Vec<&str> = shown.iter().map(String::as_str).collect();
            let (errors, curves) = context.study.errors_of(run, &models, &shown)?;
            value(&Evaluated { participant: run.participant.name.clone(), models: names.clone(), errors, curves })
        };
        let place = format!("{}/{}", self.id(), run.participant.name);
        Ok(vec![Unit { place, depends_on, work: Box::new(work) }])
    }

    fn section(&self, context: &Context) -> Result<Told, Failure> {
        let mut units: Vec<Evaluated> = context.store.finished(self.id())?;
        units.sort_by_key(|u| context.study.chosen().iter().position(|p| p.name == u.participant));
        let mut names: Vec<ModelName> = Vec::new();
        for name in units.iter().flat_map(|u| &u.models) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        if names.is_empty() {
            return Ok(Told::NotRun(
                "no model of a training case was evaluated: there are no participants with finished fits".to_string(),
            ));
        }
        // Participants may have different cases: controls stay last.
        names.sort_by_key(|n| [LINEAR, STRENGTH].iter().position(|c| *c == n.id).map_or(0, |i| i + 1));
        let errors = units.iter().flat_map(|u| u.errors.clone()).collect();
        let curves: Vec<Representative> = units.iter().flat_map(|u| u.curves.clone()).collect();
        let cohort = Cohort::new(errors, names.iter().map(|n| n.id.clone()).collect());
        evaluation_report::evaluation(&cohort, &names, &curves).map(Told::Parts)
    }
}

fn name_of(case: &TrainingCase) -> ModelName {
    ModelName { id: case.id(), label: case.label() }
}

/// The combined case of the least effort, and the controls: figure 3.5.
fn shown(models: &[(String, carpus_osim::osim::spec::ModelSpec)]) -> Vec<String> {
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
pub(super) fn cohort(context: &Context) -> Result<Vec<ConditionError>, Failure> {
    let units: Vec<Evaluated> = context.store.finished("evaluate")?;
    Ok(units.into_iter().flat_map(|u| u.errors).collect())
}
