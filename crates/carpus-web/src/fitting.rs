//! Fits in a page: the estimator of the program, on the trials of the case.

use super::case::{EffectOfCase, StateOfCase, three};
use super::workbench::{Workbench, WorkbenchError};
use carpus_diagnosis::addition::fit_with;
use carpus_diagnosis::diagnose::Request;
use carpus_diagnosis::inference::muscles::{MuscleEstimate, MuscleProblem};
use carpus_diagnosis::inference::resting_fiber::{ImagedMuscle, RestingFiber};
use carpus_effects::catalogue::with_own;
use carpus_effects::forward_model::ForwardModel;
use carpus_personalization::personalization::personalize;
use carpus_simulation::simulation::Property;
use carpus_study::study::TrialUse;

/// Level of the intervals of muscle parameters, as in reports.
const LEVEL: f64 = 0.9;
/// Properties in the order of [`three`].
const PROPERTIES: [Property; 3] =
    [Property::MaxIsometricForce, Property::OptimalFiberLength, Property::TendonSlackLength];

impl Workbench {
    /// Fits the muscles to the training trials as `carpus personalize` does; with effects, muscles and effects together
    /// as `carpus effect add` does.
    ///
    /// - `effects`: identifiers
    /// - `report`: told now and then that a further step is done
    ///
    /// # Errors
    /// An unknown effect; fewer than two training trials; a trial that cannot be simulated.
    pub fn fit(&self, effects: &[String], report: &dyn Fn(&str)) -> Result<StateOfCase, WorkbenchError> {
        let found = self.trials.iter().filter(|t| t.info.usage == TrialUse::Train).count();
        if found < 2 {
            return Err(WorkbenchError::Fit(format!("expected at least two training trials, found {found}")));
        }
        let forward = ForwardModel::for_diagnosis(&self.file.spec, &self.model, &self.trials)?;
        let forward = forward.with_given(self.given.clone());
        if effects.is_empty() { self.fit_muscles(&forward, report) } else { self.fit_with(&forward, effects, report) }
    }

    fn fit_muscles(&self, forward: &ForwardModel, report: &dyn Fn(&str)) -> Result<StateOfCase, WorkbenchError> {
        let problem = MuscleProblem {
            forward,
            bounds: self.header.bounds,
            images: self.images()?,
            priors: Vec::new(),
            seed: self.header.seed,
        };
        let fit =
            personalize(&problem, &|p| report(p.stage), &|| true).map_err(|e| WorkbenchError::Fit(e.to_string()))?;
        let estimates: Vec<MuscleEstimate> = fit.fitted.iter().filter_map(|p| p.estimate.clone()).collect();
        Ok(StateOfCase {
            label: "Muscles fitted".to_owned(),
            muscles: fit.parameters.iter().map(three).collect(),
            intervals: intervals(&estimates, fit.parameters.len()),
            effects: Vec::new(),
        })
    }

    fn fit_with(
        &self,
        forward: &ForwardModel,
        ids: &[String],
        report: &dyn Fn(&str),
    ) -> Result<StateOfCase, WorkbenchError> {
        let absent = |id: &String| EffectOfCase { id: id.clone(), values: Vec::new(), intervals: Vec::new() };
        let known = |id: &String| {
            let all = with_own();
            let known = all.into_iter().find(|e| e.description().id == *id);
            known.ok_or_else(|| WorkbenchError::Effect { id: absent(id).id, expected: 0, found: 0 })
        };
        let effects = ids.iter().map(known).collect::<Result<Vec<_>, _>>()?;
        let request = Request {
            participant: self.header.participant.clone(),
            forward,
            laboratory: None,
            bounds: self.header.bounds,
            images: self.images()?,
            candidates: with_own(),
            mvc: self.header.mvc,
            seed: self.header.seed,
        };
        let step = fit_with(&request, &effects, report)?;
        let of_case = |s: &carpus_effects::forward_model::Setting| {
            let description = s.effect.description();
            let of = |name: &str| step.estimates.get(&format!("{}.{name}", description.id)).map(|e| e.ci95);
            let intervals: Vec<[f64; 2]> = description.parameters.iter().filter_map(|p| of(p.name)).collect();
            EffectOfCase { id: description.id.to_owned(), values: s.values.clone(), intervals }
        };
        let names: Vec<&str> = effects.iter().map(|e| e.description().name).collect();
        Ok(StateOfCase {
            label: format!("Fitted with {}", names.join(" + ")),
            muscles: step.parameters.iter().map(three).collect(),
            intervals: intervals(&step.muscles, step.parameters.len()),
            effects: step.effects.iter().map(of_case).collect(),
        })
    }

    fn images(&self) -> Result<Vec<RestingFiber>, WorkbenchError> {
        let of = |image: &super::case::ImageOfCase| {
            let name = self.header.setup.active_muscles.get(image.muscle);
            let spec = self.file.spec.muscles.iter().find(|m| Some(&m.name) == name);
            let imaged = spec.and_then(|spec| ImagedMuscle::from_spec(spec).ok());
            let imaged = imaged.ok_or_else(|| WorkbenchError::Fit("an image is of no muscle here".to_owned()))?;
            Ok(RestingFiber {
                muscle: image.muscle,
                imaged,
                path_length: image.path_length,
                activation: image.activation,
                measured: image.measured,
                standard_deviation: image.standard_deviation,
            })
        };
        self.header.images.iter().map(of).collect()
    }
}

/// Intervals of three properties of every muscle.
pub fn intervals(estimates: &[MuscleEstimate], muscles: usize) -> Vec<[[f64; 2]; 3]> {
    let of = |muscle: usize, property: Property| {
        let found = estimates.iter().find(|e| e.muscle == muscle && e.property == property);
        found.map(|e| e.interval(LEVEL))
    };
    let all: Option<Vec<[[f64; 2]; 3]>> = (0..muscles)
        .map(|m| {
            let [force, fiber, tendon] = PROPERTIES.map(|p| of(m, p));
            Some([force?, fiber?, tendon?])
        })
        .collect();
    all.unwrap_or_default()
}
