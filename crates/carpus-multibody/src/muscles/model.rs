//! Muscles of any class that is simulated.

use super::degroote_fregly2016::DeGrooteFregly2016;
use super::deprecated::DeprecatedMuscle;
use super::dynamics::MuscleDynamics;
use super::equilibrium::{EquilibriumError, EquilibriumStatus};
use super::error::MuscleError;
use super::law::MuscleLaw;
use super::parameters::Millard2012;
use super::rigid_tendon::RigidTendon;
use super::thelen2003::Thelen2003;
use carpus_osim::osim::spec::{MuscleKind, MuscleSpec, OtherMuscleSpec};

/// Step of differences of a state over its own size.
const STEP: f64 = 1e-6;

/// A muscle.
#[derive(Clone, Debug)]
pub enum MuscleModel {
    /// `Millard2012EquilibriumMuscle`.
    Millard2012(Box<Millard2012>),
    /// `Thelen2003Muscle`.
    Thelen2003(Box<Thelen2003>),
    /// `DeGrooteFregly2016Muscle`.
    DeGrooteFregly2016(Box<DeGrooteFregly2016>),
    /// `RigidTendonMuscle`.
    RigidTendon(Box<RigidTendon>),
    /// `Schutte1993Muscle_Deprecated`, `Delp1990Muscle_Deprecated`.
    Deprecated(Box<DeprecatedMuscle>),
}

/// States of a muscle; those that its class does not have are not looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MuscleState {
    /// Activation; the control where activation dynamics are ignored.
    pub activation: f64,
    /// What the equilibrium of fibre and tendon is stated in: fibre length [m]; of a `DeGrooteFregly2016Muscle` tendon
    /// force over maximum isometric force.
    pub equilibrium_state: f64,
    /// Fibre velocity of a `Delp1990Muscle_Deprecated` [m/s].
    pub fiber_velocity: f64,
}

/// Rates of the states of a muscle, and its tendon force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MuscleRates {
    /// Rate of [`MuscleState::equilibrium_state`].
    pub equilibrium_state: f64,
    /// Rate of [`MuscleState::fiber_velocity`].
    pub fiber_velocity: f64,
    /// Tendon force [N].
    pub tendon_force: f64,
}

impl MuscleRates {
    fn slope(up: MuscleRates, down: MuscleRates, step: f64) -> MuscleRates {
        let slope = |up: f64, down: f64| (up - down) / (2.0 * step);
        MuscleRates {
            equilibrium_state: slope(up.equilibrium_state, down.equilibrium_state),
            fiber_velocity: slope(up.fiber_velocity, down.fiber_velocity),
            tendon_force: slope(up.tendon_force, down.tendon_force),
        }
    }
}

impl MuscleModel {
    /// The muscle that a model file specifies.
    ///
    /// # Errors
    /// [`MuscleError::NotComputed`] for classes that are not simulated; properties that OpenSim too would refuse.
    pub fn from_spec(spec: &MuscleSpec) -> Result<MuscleModel, MuscleError> {
        let MuscleKind::OtherClass { law: Some(law), .. } = &spec.kind else {
            return Ok(MuscleModel::Millard2012(Box::new(Millard2012::from_spec(spec)?)));
        };
        let built = match law.as_ref() {
            OtherMuscleSpec::Thelen2003(own) => {
                Thelen2003::build(spec, own).map(|m| MuscleModel::Thelen2003(Box::new(m)))
            }
            OtherMuscleSpec::DeGrooteFregly2016(own) => {
                DeGrooteFregly2016::build(spec, own).map(|m| MuscleModel::DeGrooteFregly2016(Box::new(m)))
            }
            OtherMuscleSpec::RigidTendon(own) => {
                RigidTendon::build(spec, own).map(|m| MuscleModel::RigidTendon(Box::new(m)))
            }
            OtherMuscleSpec::Deprecated(own) => {
                DeprecatedMuscle::build(spec, own).map(|m| MuscleModel::Deprecated(Box::new(m)))
            }
        };
        built.map_err(|source| MuscleError::InMuscle { muscle: spec.name.clone(), source: Box::new(source) })
    }

    /// The law of its class; of a `Delp1990Muscle_Deprecated` without its mass.
    pub fn law(&self) -> &dyn MuscleLaw {
        match self {
            MuscleModel::Millard2012(m) => m.as_ref(),
            MuscleModel::Thelen2003(m) => m.as_ref(),
            MuscleModel::DeGrooteFregly2016(m) => m.as_ref(),
            MuscleModel::RigidTendon(m) => m.as_ref(),
            MuscleModel::Deprecated(m) => m.as_ref(),
        }
    }

    /// What of it is finite at no state, as in OpenSim, and why; `None` for nearly all muscles.
    pub fn never_finite(&self) -> Option<&'static str> {
        match self {
            MuscleModel::Thelen2003(m) if m.tendon_slack_length == 0.0 => {
                Some("its force is not finite, as in OpenSim: tendon_slack_length is 0")
            }
            MuscleModel::Deprecated(m) if m.require_rates().is_err() => {
                Some("its velocities are not finite, as in OpenSim: time_scale is not above 0")
            }
            _ => None,
        }
    }

    /// Whether its states have rates: old files give muscles of the oldest kinds a `time_scale` of 0, by which OpenSim
    /// divides, and Thelen's a tendon of no length.
    ///
    /// # Errors
    /// [`MuscleError::InvalidProperty`], if not.
    pub fn require_rates(&self) -> Result<(), MuscleError> {
        let found = match self {
            MuscleModel::Deprecated(m) => m.require_rates(),
            MuscleModel::Thelen2003(m) => m.require_rates(),
            _ => Ok(()),
        };
        found.map_err(|source| MuscleError::InMuscle { muscle: self.name().to_owned(), source: Box::new(source) })
    }

    /// Name.
    pub fn name(&self) -> &str {
        match self {
            MuscleModel::Millard2012(m) => m.name(),
            MuscleModel::Thelen2003(m) => &m.name,
            MuscleModel::DeGrooteFregly2016(m) => &m.name,
            MuscleModel::RigidTendon(m) => &m.name,
            MuscleModel::Deprecated(m) => &m.name,
        }
    }

    /// Maximum isometric force [N].
    pub fn max_isometric_force(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().max_isometric_force,
            MuscleModel::Thelen2003(m) => m.max_isometric_force,
            MuscleModel::DeGrooteFregly2016(m) => m.max_isometric_force,
            MuscleModel::RigidTendon(m) => m.max_isometric_force,
            MuscleModel::Deprecated(m) => m.max_isometric_force,
        }
    }

    /// Optimal fibre length [m].
    pub fn optimal_fiber_length(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().optimal_fiber_length,
            MuscleModel::Thelen2003(m) => m.optimal_fiber_length,
            MuscleModel::DeGrooteFregly2016(m) => m.optimal_fiber_length,
            MuscleModel::RigidTendon(m) => m.optimal_fiber_length,
            MuscleModel::Deprecated(m) => m.optimal_fiber_length,
        }
    }

    /// Maximum contraction velocity [optimal fibre lengths/s].
    pub fn max_contraction_velocity(&self) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.parameters().max_contraction_velocity,
            MuscleModel::Thelen2003(m) => m.max_contraction_velocity,
            MuscleModel::DeGrooteFregly2016(m) => m.max_contraction_velocity,
            MuscleModel::RigidTendon(m) => m.max_contraction_velocity,
            MuscleModel::Deprecated(m) => m.max_contraction_velocity,
        }
    }

    /// Rate of the activation for a control [1/s].
    pub fn activation_rate(&self, activation: f64, excitation: f64) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.activation_dynamics().derivative(activation, excitation),
            MuscleModel::Thelen2003(m) => m.activation_dynamics().derivative(activation, excitation),
            MuscleModel::DeGrooteFregly2016(m) => m.activation_rate(activation, excitation),
            MuscleModel::RigidTendon(_) => 0.0,
            MuscleModel::Deprecated(m) => m.activation_rate(activation, excitation),
        }
    }

    /// Its derivative by the activation.
    pub fn activation_rate_slope(&self, activation: f64, excitation: f64) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => m.activation_dynamics().derivative_slope(activation, excitation),
            MuscleModel::Thelen2003(m) => m.activation_dynamics().derivative_slope(activation, excitation),
            MuscleModel::DeGrooteFregly2016(m) => m.activation_rate_slope(activation, excitation),
            MuscleModel::RigidTendon(_) => 0.0,
            MuscleModel::Deprecated(m) => m.activation_rate_slope(activation, excitation),
        }
    }

    /// Whether the activation equals the excitation, so that the activation is no state.
    pub fn ignore_activation_dynamics(&self) -> bool {
        match self {
            MuscleModel::Millard2012(m) => m.ignore_activation_dynamics(),
            MuscleModel::DeGrooteFregly2016(m) => m.ignore_activation_dynamics,
            MuscleModel::RigidTendon(_) => true,
            MuscleModel::Thelen2003(_) | MuscleModel::Deprecated(_) => false,
        }
    }

    /// Whether the tendon is rigid, so that the fibre length is no state.
    pub fn ignore_tendon_compliance(&self) -> bool {
        match self {
            MuscleModel::Millard2012(m) => m.ignore_tendon_compliance(),
            MuscleModel::DeGrooteFregly2016(m) => m.ignore_tendon_compliance,
            MuscleModel::RigidTendon(_) => true,
            MuscleModel::Thelen2003(_) | MuscleModel::Deprecated(_) => false,
        }
    }

    /// Whether [`MuscleModel::rates`] depends on the path's speed.
    pub fn depends_on_path_speed(&self) -> bool {
        match self {
            MuscleModel::Millard2012(m) => m.ignore_tendon_compliance(),
            MuscleModel::Thelen2003(_) => false,
            MuscleModel::DeGrooteFregly2016(_) | MuscleModel::RigidTendon(_) | MuscleModel::Deprecated(_) => true,
        }
    }

    /// Whether the fibre velocity is a state.
    pub fn has_velocity_state(&self) -> bool {
        matches!(self, MuscleModel::Deprecated(m) if m.has_velocity_state())
    }

    /// OpenSim's name of the state [`MuscleState::equilibrium_state`].
    pub fn equilibrium_state_name(&self) -> &'static str {
        match self {
            MuscleModel::DeGrooteFregly2016(_) => "normalized_tendon_force",
            _ => "fiber_length",
        }
    }

    /// What a change of [`MuscleState::equilibrium_state`] is measured by.
    pub fn equilibrium_state_scale(&self) -> f64 {
        match self {
            MuscleModel::DeGrooteFregly2016(_) => 1.0,
            _ => self.optimal_fiber_length(),
        }
    }

    /// States before initialization.
    pub fn default_state(&self) -> MuscleState {
        let (activation, fiber_length) = match self {
            MuscleModel::Millard2012(m) => (m.default_activation(), m.default_fiber_length()),
            MuscleModel::Thelen2003(m) => (m.properties.default_activation, m.properties.default_fiber_length),
            MuscleModel::DeGrooteFregly2016(m) => {
                (m.properties.default_activation, m.properties.default_normalized_tendon_force)
            }
            MuscleModel::RigidTendon(_) | MuscleModel::Deprecated(_) => (0.0, 0.0),
        };
        MuscleState { activation, equilibrium_state: fiber_length, fiber_velocity: 0.0 }
    }

    /// Rates and tendon force at a state.
    ///
    /// - `path_length` [m], `path_speed` [m/s]
    pub fn rates(&self, state: MuscleState, path_length: f64, path_speed: f64) -> MuscleRates {
        let MuscleState { activation, equilibrium_state: fiber_length, fiber_velocity } = state;
        let (fiber_length, fiber_velocity, tendon_force) = match self {
            MuscleModel::Millard2012(m) => {
                let found = m.fiber_velocity(fiber_length, activation, path_length, path_speed);
                (found.fiber_velocity, 0.0, found.norm_tendon_force * m.parameters().max_isometric_force)
            }
            MuscleModel::Thelen2003(m) => {
                let (velocity, force) = m.rates(fiber_length, activation, path_length);
                (velocity, 0.0, force)
            }
            MuscleModel::DeGrooteFregly2016(m) => {
                let (rate, force) = m.rates(fiber_length, activation, path_length, path_speed);
                (rate, 0.0, force)
            }
            MuscleModel::RigidTendon(m) => (0.0, 0.0, m.dynamics(activation, path_length, path_speed).tendon_force),
            MuscleModel::Deprecated(m) => m.rates(fiber_length, fiber_velocity, activation, path_length, path_speed),
        };
        MuscleRates { equilibrium_state: fiber_length, fiber_velocity, tendon_force }
    }

    /// Derivatives of rates and tendon force by activation, fibre length and fibre velocity.
    pub fn linearize(&self, state: MuscleState, path_length: f64, path_speed: f64) -> [MuscleRates; 3] {
        if let MuscleModel::Millard2012(m) = self {
            let by = m.linearize(state.equilibrium_state, state.activation, path_length, path_speed);
            let rates = |fiber_length, tendon_force| MuscleRates {
                equilibrium_state: fiber_length,
                fiber_velocity: 0.0,
                tendon_force,
            };
            return [
                rates(by.fiber_velocity_by.activation, by.tendon_force_by.activation),
                rates(by.fiber_velocity_by.fiber_length, by.tendon_force_by.fiber_length),
                MuscleRates::default(),
            ];
        }
        let slope = |step: f64, moved: &dyn Fn(f64) -> MuscleState| {
            let at = |step: f64| self.rates(moved(step), path_length, path_speed);
            MuscleRates::slope(at(step), at(-step), step)
        };
        let length = STEP * self.equilibrium_state_scale();
        [
            slope(STEP, &|step| MuscleState { activation: state.activation + step, ..state }),
            slope(length, &|step| MuscleState { equilibrium_state: state.equilibrium_state + step, ..state }),
            match self.has_velocity_state() {
                true => slope(length, &|step| MuscleState { fiber_velocity: state.fiber_velocity + step, ..state }),
                false => MuscleRates::default(),
            },
        ]
    }

    /// [`MuscleState::equilibrium_state`] at which fibre and tendon balance; 0 for muscles with rigid tendons of their
    /// own class.
    ///
    /// - `path_speed`: looked at as OpenSim's class does [m/s]
    ///
    /// # Errors
    /// No length balances them.
    pub fn equilibrium(&self, path_length: f64, path_speed: f64, activation: f64) -> Result<f64, EquilibriumError> {
        let found = match self {
            MuscleModel::Millard2012(m) => return Ok(m.equilibrium(path_length, activation)?.fiber_length),
            MuscleModel::Thelen2003(m) => m.equilibrium(path_length, path_speed, activation),
            MuscleModel::DeGrooteFregly2016(m) if m.ignore_tendon_compliance => Some(f64::NAN),
            MuscleModel::DeGrooteFregly2016(m) => m.equilibrium(path_length, path_speed, activation),
            MuscleModel::RigidTendon(m) => Some(m.fiber_length(path_length)),
            MuscleModel::Deprecated(m) => Some(m.isometric(path_length, activation).0),
        };
        found.ok_or_else(|| EquilibriumError::NoLength { muscle: self.name().to_owned(), path_length, activation })
    }

    /// Every quantity of the muscle in equilibrium at rest, and how the equilibrium was reached.
    ///
    /// - `path_length` [m]; `activation`: taken within the bounds that the class has
    ///
    /// # Errors
    /// No length balances fibre and tendon.
    pub fn at_rest(
        &self,
        path_length: f64,
        activation: f64,
    ) -> Result<(MuscleDynamics, EquilibriumStatus), EquilibriumError> {
        let activation = match self {
            MuscleModel::Millard2012(m) => {
                let found = m.equilibrium(path_length, activation)?;
                let at = m.dynamics(found.fiber_length, activation, path_length, 0.0);
                return Ok((MuscleDynamics { tendon_force: found.tendon_force, ..at }, found.status));
            }
            MuscleModel::Thelen2003(m) => m.activation_dynamics().clamp(activation),
            _ => activation,
        };
        let equilibrium_state = self.equilibrium(path_length, 0.0, activation)?;
        let at = self.dynamics(MuscleState { activation, equilibrium_state, fiber_velocity: 0.0 }, path_length, 0.0);
        let status = match self.ignore_tendon_compliance() {
            true => EquilibriumStatus::RigidTendon,
            false if at.is_clamped => EquilibriumStatus::FiberAtLowerBound,
            false => EquilibriumStatus::Converged,
        };
        Ok((at, status))
    }

    /// Every quantity at a state.
    pub fn dynamics(&self, state: MuscleState, path_length: f64, path_speed: f64) -> MuscleDynamics {
        let MuscleState { activation, equilibrium_state: fiber_length, fiber_velocity } = state;
        match self {
            MuscleModel::Millard2012(m) => m.dynamics(fiber_length, activation, path_length, path_speed),
            MuscleModel::Thelen2003(m) => m.dynamics(fiber_length, activation, path_length, path_speed),
            MuscleModel::DeGrooteFregly2016(m) => m.dynamics(fiber_length, activation, path_length, path_speed),
            MuscleModel::RigidTendon(m) => m.dynamics(activation, path_length, path_speed),
            MuscleModel::Deprecated(m) => m.dynamics(fiber_length, fiber_velocity, activation, path_length, path_speed),
        }
    }

    /// Active force if the tendon were rigid [N]: what static optimization takes for the force of a muscle.
    pub fn inextensible_tendon_active_fiber_force(&self, path_length: f64, path_speed: f64, activation: f64) -> f64 {
        match self {
            MuscleModel::Millard2012(m) => {
                m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation)
            }
            MuscleModel::Thelen2003(m) => m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation),
            MuscleModel::DeGrooteFregly2016(m) => {
                m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation)
            }
            MuscleModel::RigidTendon(m) => {
                m.dynamics(activation, path_length, path_speed).active_fiber_force_along_tendon
            }
            MuscleModel::Deprecated(m) => m.inextensible_tendon_active_fiber_force(path_length, path_speed, activation),
        }
    }
}
