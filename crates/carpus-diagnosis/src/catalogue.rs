//! The catalogue: one list of all effects.

use super::effect::Effect;
use super::effects as all;
use super::own_effect;

/// All effects. In this order they act within a stage: recorded EMG loses baseline and cross-talk before its gain is
/// corrected, and the sensor delays and filters before it scales and shifts.
pub static CATALOGUE: &[&dyn Effect] = &[
    &all::JointStiffness,
    &all::EndRangeSpring,
    &all::LigamentStop,
    &all::JointDamping,
    &all::PowerLawDamping,
    &all::CoulombFriction,
    &all::Thixotropy,
    &all::StretchReflex,
    &all::Gravity,
    &all::Inertia,
    &all::MomentArmShift,
    &all::MomentArmSlope,
    &all::AngleOffset,
    &all::JointCompliance,
    &all::AxisMisalignment,
    &all::TendonCompliance,
    &all::MaxContractionVelocity,
    &all::ActiveForceWidth,
    &all::PassiveFiberForce,
    &all::ActivationDependentLength,
    &all::HistoryDependence,
    &all::UnmodelledMuscles,
    &all::ActivationDynamics,
    &all::EmgFloor,
    &all::EmgCrosstalk,
    &all::EmgGain,
    &all::EmgGainDrift,
    &all::ElectromechanicalDelay,
    &all::EmgNonlinearity,
    &all::Potentiation,
    &all::Fatigue,
    &all::TimeShift,
    &all::SensorBandwidth,
    &all::TorqueGain,
    &all::TorqueOffset,
    &all::TorqueDrift,
];

/// All effects: those of the catalogue, then those that a laboratory has defined ([`own_effect`]).
pub fn with_own() -> Vec<&'static dyn Effect> {
    let own = own_effect::registered().into_iter().map(|e| e as &dyn Effect);
    CATALOGUE.iter().copied().chain(own).collect()
}

/// The effect of that identifier, of the catalogue or of a laboratory's own.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    let known = CATALOGUE.iter().copied().find(|e| e.description().id == id);
    known.or_else(|| with_own().into_iter().find(|e| e.description().id == id))
}

/// Place of an effect among all: a laboratory's own act after those of the catalogue.
pub fn position(effect: &dyn Effect) -> usize {
    let id = effect.description().id;
    let known = CATALOGUE.iter().position(|e| e.description().id == id);
    known.or_else(|| with_own().iter().position(|e| e.description().id == id)).unwrap_or(usize::MAX)
}
