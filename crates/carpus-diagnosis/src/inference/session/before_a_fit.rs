//! What trials can determine at all: to first order about the model as given, before anything is fitted.

use super::super::muscle_columns::COLUMNS;
use super::amplitudes::marginal;
use super::noise_along_the_way::factors;
use super::state::Session;
use carpus_effects::forward_model::FITTED_PER_MUSCLE;
use carpus_simulation::simulation::{Property, SimulationError};

/// What trials can determine.
#[derive(Clone, Debug)]
pub struct Determinable {
    /// Muscle, property, and the share of the prior variance of the property's logarithm that the trials would remove.
    pub parameters: Vec<(usize, Property, f64)>,
    /// Effects, and by how many standard deviations the trials would tell one of a plausible size from none, everything
    /// else left open.
    pub effects: Vec<(&'static str, f64)>,
}

impl Session<'_> {
    /// What the trials would say with usual noise, a little of everything and the discrepancy; what they measured does
    /// not matter.
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(crate) fn determinable(&mut self) -> Result<Determinable, SimulationError> {
        let point = self.analysis.nominal_point();
        let mut linear = self.analysis.linearize(&point, &[])?;
        let noise = self.structure(&mut linear, &point);
        let directions;
        (directions, self.analysis.blocks) = self.analysis.calc_directions(&linear, &point)?;
        let columns = self.all_columns(&point, &linear, &directions);
        let model = self.model(&point, &columns, &factors(&noise, &self.levels)?);
        let sizes = model.usual_sizes();
        let posterior = model.posterior(&[], &sizes);
        let of_gains = self.gain_log_sd();
        let share = |(column, property): (usize, Property)| {
            let gains = if property == Property::MaxIsometricForce { of_gains } else { 0.0 };
            let left = posterior.sd_of(column).hypot(gains) / posterior.sd[column];
            (column / FITTED_PER_MUSCLE, property, (1.0 - left * left).clamp(0.0, 1.0))
        };
        let muscles = 0..self.analysis.n_muscles();
        let own = muscles.flat_map(|m| (0..FITTED_PER_MUSCLE).map(move |i| (m * FITTED_PER_MUSCLE + i, COLUMNS[i])));
        let parameters = own.map(share).collect();
        let ((products, right), sds) = (model.about_prior_mean(), model.sds(&[], &sizes));
        let amplitude_columns = self.amplitude_columns(&model);
        let distance = |place: usize| {
            let effect = self.analysis.candidates[place];
            let amplitudes = effect.description().amplitudes().zip(&amplitude_columns[place].amplitudes);
            let of = |(i, column): (usize, &usize)| {
                let (information, _) = marginal((&products, &right), &[(*column, self.plausible(effect, i).0)], &sds);
                information[(0, 0)].max(0.0).sqrt()
            };
            (effect.description().id, amplitudes.map(of).fold(0.0, f64::max))
        };
        Ok(Determinable { parameters, effects: self.testable().into_iter().map(distance).collect() })
    }
}
