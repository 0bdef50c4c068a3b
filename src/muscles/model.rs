//! Muscles of any class that is simulated.

use super::activation::FirstOrderActivation;
use super::dynamics::MuscleDynamics;
use super::equilibrium::EquilibriumError;
use super::parameters::{Millard2012, MuscleError};
use super::thelen2003::Thelen2003;
use crate::osim::spec::{MuscleKind, MuscleSpec};

/// Step of differences: of activation, and of fibre length over optimal fibre length.
const STEP: f64 = 1e-6;

/// A muscle.
#[derive(Clone, Debug)]
pub enum MuscleModel {
    /// `Millard2012EquilibriumMuscle`.
    Millard2012(Box<Millard2012>),
    /// `Thelen2003Muscle`.
    Thelen2003(Box<Thelen2003>),
}

/// Fibre velocity and tendon force, and how they change with the muscle's states.
#[derive(Clone, Copy, Debug)]
pub struct MuscleRates {
    /// Fibre velocity [m/s].
    pub fiber_velocity: f64,
    /// Tendon force [N].
    pub tendon_force: f64,
    /// By activation.
    pub by_activation: [f64; 2],
    /// By fibre length.
    pub by_fiber_length: [f64; 2],
}

impl MuscleModel {
    /// The muscle that a model file specifies.
    ///
    /// # Errors
    /// [`MuscleError::NotMillard2012`] for classes that are not simulated; properties that OpenSim too would refuse.
    pub fn from_spec(spec: &MuscleSpec) -> Result<MuscleModel, MuscleError> {
        match (&spec.kind, Thelen2003::from_spec(spec)) {
            (MuscleKind::PathOnly { .. }, Some(thelen)) => Ok(MuscleModel::Thelen2003(Box::new(thelen?))),
            _ => Ok(MuscleModel::Millard2012(Box::new(Millard2012::from_spec(spec)?))),
        }
    }

    /// Name.
    pub fn name(&self) -> &str {
        match self {
            MuscleModel::Millard2012(m) => m.name(),
            MuscleModel::Thelen2003(m) => &m.name,
        }
    }

    /// Maximum isometric force [N].
    pub fn max_isometric_force(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().max_isometric_force,
            MuscleModel::Thelen2003(m) => m.max_isometric_force,
        }
    }

    /// Optimal fibre length [m].
    pub fn optimal_fiber_length(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().optimal_fiber_length,
            MuscleModel::Thelen2003(m) => m.optimal_fiber_length,
        }
    }

    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub fn max_contraction_velocity(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().max_contraction_velocity,
            MuscleModel::Thelen2003(m) => m.max_contraction_velocity,
        }
    }

    /// Activation dynamics.
    pub fn activation_dynamics(&self) -> FirstOrderActivation {
        match self {
            MuscleModel::Millard2012(m) => m.activation_dynamics(),
            MuscleModel::Thelen2003(m) => m.activation_dynamics(),
        }
    }

    /// Whether the activation equals the excitation, so that the activation is no state.
    pub fn ignore_activation_dynamics(&self) -> bool {
        matches!(self, MuscleModel::Millard2012(m) if m.ignore_activation_dynamics())
    }

    /// Whether the tendon is rigid, so that the fibre length is no state.
    pub fn ignore_tendon_compliance(&self) -> bool {
        matches!(self, MuscleModel::Millard2012(m) if m.ignore_tendon_compliance())
    }

    /// Activation before initialization.
    pub fn default_activation(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.default_activation(),
            MuscleModel::Thelen2003(m) => m.properties.default_activation,
        }
    }

    /// Fibre length before initialization [m].
    pub fn default_fiber_length(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.default_fiber_length(),
            MuscleModel::Thelen2003(m) => m.properties.default_fiber_length,
        }
    }

    /// Fibre velocity [m/s] and tendon force [N] at a state (arguments as [`Millard2012::fiber_velocity`]).
    pub fn rates(&self, fiber_length: f64, activation: f64, path_length: f64, path_speed: f64) -> (f64, f64) {
        match self {
            MuscleModel::Millard2012(m) => {
                let found = m.fiber_velocity(fiber_length, activation, path_length, path_speed);
                (found.fiber_velocity, found.norm_tendon_force * m.parameters().max_isometric_force)
            }
            MuscleModel::Thelen2003(m) => m.rates(fiber_length, activation, path_length),
        }
    }

    /// The same with derivatives by the states.
    pub fn linearize(&self, fiber_length: f64, activation: f64, path_length: f64, path_speed: f64) -> MuscleRates {
        match self {
            MuscleModel::Millard2012(m) => {
                let by = m.linearize(fiber_length, activation, path_length, path_speed);
                MuscleRates {
                    fiber_velocity: by.fiber_velocity,
                    tendon_force: by.tendon_force,
                    by_activation: [by.fiber_velocity_by.activation, by.tendon_force_by.activation],
                    by_fiber_length: [by.fiber_velocity_by.fiber_length, by.tendon_force_by.fiber_length],
                }
            }
            MuscleModel::Thelen2003(m) => {
                let (fiber_velocity, tendon_force) = m.rates(fiber_length, activation, path_length);
                let slope = |step: f64, up: (f64, f64), down: (f64, f64)| {
                    [(up.0 - down.0) / (2.0 * step), (up.1 - down.1) / (2.0 * step)]
                };
                let a = |step: f64| m.rates(fiber_length, activation + step, path_length);
                let step = STEP * m.optimal_fiber_length;
                let l = |step: f64| m.rates(fiber_length + step, activation, path_length);
                MuscleRates {
                    fiber_velocity,
                    tendon_force,
                    by_activation: slope(STEP, a(STEP), a(-STEP)),
                    by_fiber_length: slope(step, l(step), l(-step)),
                }
            }
        }
    }

    /// Fibre length [m] at which fibre and tendon balance.
    ///
    /// - `path_speed`: looked at as OpenSim's class does, by Thelen's muscle alone [m/s]
    ///
    /// # Errors
    /// No length balances them.
    pub fn equilibrium(&self, path_length: f64, path_speed: f64, activation: f64) -> Result<f64, EquilibriumError> {
        match self {
            MuscleModel::Millard2012(m) => Ok(m.equilibrium(path_length, activation)?.fiber_length),
            MuscleModel::Thelen2003(m) => {
                m.equilibrium(path_length, path_speed, activation).ok_or_else(|| EquilibriumError::NotConverged {
                    muscle: m.name.clone(),
                    residual: f64::NAN,
                    fiber_length: m.minimum_fiber_length(),
                    path_length,
                    activation,
                })
            }
        }
    }

    /// Every quantity at a state (arguments as [`Millard2012::dynamics`]).
    pub fn dynamics(&self, fiber_length: f64, activation: f64, path_length: f64, path_speed: f64) -> MuscleDynamics {
        match self {
            MuscleModel::Millard2012(m) => m.dynamics(fiber_length, activation, path_length, path_speed),
            MuscleModel::Thelen2003(m) => m.dynamics(fiber_length, activation, path_length, path_speed),
        }
    }

    /// Active force along the tendon if the tendon were rigid [N].
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => {
                m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation)
            }
            MuscleModel::Thelen2003(m) => m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation),
        }
    }
}
