//! The properties of a muscle that trials are fitted with.

use super::model::MuscleParameters;

/// A fitted property of a muscle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Property {
    /// `optimal_fiber_length`.
    OptimalFiberLength,
    /// `tendon_slack_length`.
    TendonSlackLength,
    /// `max_isometric_force`.
    MaxIsometricForce,
}

impl Property {
    /// All, in the order of results.
    pub const ALL: [Property; 3] =
        [Property::OptimalFiberLength, Property::TendonSlackLength, Property::MaxIsometricForce];

    /// OpenSim's property name.
    pub fn name(self) -> &'static str {
        match self {
            Property::OptimalFiberLength => "optimal_fiber_length",
            Property::TendonSlackLength => "tendon_slack_length",
            Property::MaxIsometricForce => "max_isometric_force",
        }
    }

    /// Unit in the file.
    pub fn unit(self) -> &'static str {
        match self {
            Property::OptimalFiberLength | Property::TendonSlackLength => "m",
            Property::MaxIsometricForce => "N",
        }
    }

    /// Its value among a muscle's parameters.
    pub fn of(self, parameters: &MuscleParameters) -> f64 {
        match self {
            Property::OptimalFiberLength => parameters.optimal_fiber_length,
            Property::TendonSlackLength => parameters.tendon_slack_length,
            Property::MaxIsometricForce => parameters.max_isometric_force,
        }
    }

    /// The same, to be changed.
    pub fn of_mut(self, parameters: &mut MuscleParameters) -> &mut f64 {
        match self {
            Property::OptimalFiberLength => &mut parameters.optimal_fiber_length,
            Property::TendonSlackLength => &mut parameters.tendon_slack_length,
            Property::MaxIsometricForce => &mut parameters.max_isometric_force,
        }
    }
}
