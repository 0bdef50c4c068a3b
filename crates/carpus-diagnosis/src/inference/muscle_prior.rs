//! What is known of muscle parameters beside their bounds.

use super::muscle_columns::place;
use carpus_effects::forward_model::FITTED_PER_MUSCLE;
use carpus_simulation::simulation::Property;

/// Prior knowledge of a muscle's parameter beside the bounds, or of several muscles that have one factor of a property.
#[derive(Clone, Debug, PartialEq)]
pub struct MusclePrior {
    /// Positions of the muscles among the active ones.
    pub muscles: Vec<usize>,
    /// The property.
    pub property: Property,
    /// Logarithm of the most probable factor of the model's value.
    pub log_mean: f64,
    /// Standard deviation of the logarithm.
    pub log_sd: f64,
}

impl MusclePrior {
    /// Columns of the muscles' parameters in the linear model.
    pub fn columns(&self) -> impl Iterator<Item = usize> + '_ {
        self.muscles.iter().map(|m| m * FITTED_PER_MUSCLE + place(self.property))
    }
}
