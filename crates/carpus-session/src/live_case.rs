//! The case that a report carries, so that its reader can change the model.

use std::collections::BTreeMap;

use super::diagnostic::Failure;
use super::images::images;
use super::participant::Session;
use super::prepared::largest_moment;
use carpus_diagnosis::diagnose::ParameterEstimate;
use carpus_diagnosis::inference::muscles::MuscleEstimate;
use carpus_effects::export::SideCar;
use carpus_effects::forward_model::Setting;
use carpus_effects::own_effect::registered;
use carpus_report::live::packed;
use carpus_simulation::simulation::MuscleParameters;
use carpus_web::case::{
    CASE_SCHEMA, Case, EffectOfCase, Header, ImageOfCase, SetupOfCase, StateOfCase, TrialOfCase, three,
};
use carpus_web::fitting::intervals;

/// Triangles of a bone that a report carries at most: all bones of an arm are some hundred kilobytes.
const TRIANGLES: usize = 1500;

impl Session<'_> {
    /// The case of this participant as results carry it; `None` where trials are too long for fits.
    ///
    /// - `seed`: of fits in the page; `states`: models to go back to, besides the one as given
    /// - `plain`: whether the report is of a command that adds no effects
    ///
    /// # Errors
    /// Images of the study that do not suit the model.
    pub(super) fn live_case(
        &self,
        seed: u64,
        plain: bool,
        states: Vec<StateOfCase>,
    ) -> Result<Option<String>, Failure> {
        // What is wrong with the trials was told when they were read.
        let Ok(again) = self.read_for_fits() else { return Ok(None) };
        let bytes = again.as_ref().unwrap_or(self).case(seed, plain, states)?.to_bytes();
        packed(&bytes).map(Some).map_err(|e| Failure::Internal(e.to_string()))
    }

    fn case(&self, seed: u64, plain: bool, states: Vec<StateOfCase>) -> Result<Case, Failure> {
        let (run, settings) = (&self.data, &self.study.tables.settings);
        let model = run.loaded.file.document.bytes().to_vec();
        let side_car = SideCar { coordinate: settings.dynamometer.coordinate.clone(), effects: run.given.clone() };
        let geometry = run.loaded.geometry(&[], TRIANGLES, &mut Vec::new()).bytes;
        let images = images(self.study, run)?.into_iter().map(|image| ImageOfCase {
            muscle: image.muscle,
            path_length: image.path_length,
            activation: image.activation,
            measured: image.measured,
            standard_deviation: image.standard_deviation,
        });
        let header = Header {
            schema: CASE_SCHEMA.to_owned(),
            study: settings.name.clone(),
            participant: run.participant.name.clone(),
            model_bytes: model.len(),
            geometry_bytes: geometry.len(),
            setup: SetupOfCase::of(run.model.setup()),
            bounds: settings.bounds,
            mvc: largest_moment(run),
            seed,
            own_effects: registered().into_iter().map(|e| e.defined().text.clone()).collect(),
            side_car: if run.given.is_empty() { String::new() } else { side_car.to_toml() },
            images: images.collect(),
            plain,
            averaged: run.averaged,
            trials: run.trials.iter().map(TrialOfCase::of).collect(),
            states,
        };
        Ok(Case { header, model, trials: run.trials.clone(), geometry })
    }
}

/// A model that the reader of a report can go back to.
pub(super) fn state(
    label: &str,
    parameters: &[MuscleParameters],
    muscles: &[MuscleEstimate],
    effects: &[Setting],
    estimates: &BTreeMap<String, ParameterEstimate>,
) -> StateOfCase {
    let effect = |s: &Setting| {
        let d = s.effect.description();
        let of = |name: &str| estimates.get(&format!("{}.{name}", d.id)).map(|e| e.ci95);
        let intervals = d.parameters.iter().filter_map(|p| of(p.name)).collect();
        EffectOfCase { id: d.id.to_owned(), values: s.values.clone(), intervals }
    };
    StateOfCase {
        label: label.to_owned(),
        muscles: parameters.iter().map(three).collect(),
        intervals: intervals(muscles, parameters.len()),
        effects: effects.iter().map(effect).collect(),
    }
}
