//! The catalogue: one list of all effects.

use super::effect::Effect;
use super::effects as all;

/// All effects; this order is also the order in which effects of the same stage act.
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
    &all::Fatigue,
    &all::Potentiation,
    &all::HistoryDependence,
    &all::UnmodelledMuscles,
    &all::ElectromechanicalDelay,
    &all::ActivationDynamics,
    &all::EmgNonlinearity,
    &all::EmgCrosstalk,
    &all::EmgGainDrift,
    &all::EmgFloor,
    &all::EmgGain,
    &all::TorqueOffset,
    &all::TorqueGain,
    &all::TorqueDrift,
    &all::TimeShift,
    &all::SensorBandwidth,
];

/// The effect of that identifier.
pub fn effect(id: &str) -> Option<&'static dyn Effect> {
    CATALOGUE.iter().copied().find(|e| e.description().id == id)
}
