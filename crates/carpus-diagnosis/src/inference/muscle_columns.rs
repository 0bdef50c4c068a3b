//! Columns of muscle parameters in the linear model.

use carpus_effects::forward_model::FITTED_PER_MUSCLE;
use carpus_simulation::simulation::Property;

/// Columns of every muscle, in their order.
pub(crate) const COLUMNS: [Property; FITTED_PER_MUSCLE] =
    [Property::MaxIsometricForce, Property::OptimalFiberLength, Property::TendonSlackLength];

/// Place of the maximum force among the columns of a muscle.
pub(super) const FORCE: usize = 0;

/// Place of a property among the columns of a muscle.
pub(crate) fn place(property: Property) -> usize {
    COLUMNS.iter().position(|p| *p == property).unwrap_or(0)
}
