//! Muscle parameters as the parameters of a sensitivity analysis, and the model's error as its response.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::error::SensitivityError;
use super::parameter::Parameter;
use carpus_simulation::evaluation::{EvaluationError, error_measures};
use carpus_simulation::simulation::{MuscleParameters, PreparedTrial, SimulationError};

/// A muscle parameter that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScreenedProperty {
    /// `optimal_fiber_length`.
    OptimalFiberLength,
    /// `tendon_slack_length`.
    TendonSlackLength,
    /// `max_isometric_force`.
    MaxIsometricForce,
    /// `pennation_angle_at_optimal`.
    PennationAngleAtOptimal,
    /// `fiber_damping`.
    FiberDamping,
}

impl ScreenedProperty {
    /// All, in the order in which parameters of a muscle stand.
    pub const ALL: [ScreenedProperty; 5] = [
        ScreenedProperty::OptimalFiberLength,
        ScreenedProperty::TendonSlackLength,
        ScreenedProperty::MaxIsometricForce,
        ScreenedProperty::PennationAngleAtOptimal,
        ScreenedProperty::FiberDamping,
    ];

    /// OpenSim's property name.
    pub fn name(self) -> &'static str {
        match self {
            ScreenedProperty::OptimalFiberLength => "optimal_fiber_length",
            ScreenedProperty::TendonSlackLength => "tendon_slack_length",
            ScreenedProperty::MaxIsometricForce => "max_isometric_force",
            ScreenedProperty::PennationAngleAtOptimal => "pennation_angle_at_optimal",
            ScreenedProperty::FiberDamping => "fiber_damping",
        }
    }

    /// Range it is varied over, as fractions of the model's value: Jadelis (2025), table 2.1, after Lieber et al.
    /// (1990, 1992) for lengths and pennation, Holzbaur et al. (2007) for force, Millard et al. (2013) for damping.
    pub fn usual_bounds(self) -> [f64; 2] {
        match self {
            ScreenedProperty::OptimalFiberLength => [0.822, 1.178],
            ScreenedProperty::TendonSlackLength => [0.868, 1.132],
            ScreenedProperty::MaxIsometricForce => [0.42, 2.514],
            ScreenedProperty::PennationAngleAtOptimal => [0.0, 2.16],
            ScreenedProperty::FiberDamping => [0.0, 2.0],
        }
    }
}

/// Why a run gave no response.
#[derive(Debug)]
pub enum ScreeningError {
    /// The trial could not be simulated.
    Simulation(SimulationError),
    /// The simulated moment could not be compared with the measured one.
    Evaluation(EvaluationError),
    /// The error has no value: the measured moment is zero throughout.
    NoError,
}

impl fmt::Display for ScreeningError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ScreeningError::Simulation(error) => write!(f, "{error}"),
            ScreeningError::Evaluation(error) => write!(f, "{error}"),
            ScreeningError::NoError => write!(f, "the measured moment is zero throughout: no normalized error"),
        }
    }
}

impl std::error::Error for ScreeningError {}

/// Moments of one muscle per unit of maximum isometric force [m], trial by trial.
type UnitMoments = Vec<Vec<f64>>;

/// What a muscle's unit moments depend on: the muscle, and the bits of its fractions but for the force.
type MomentKey = (usize, [u64; 4]);

/// Unit moments that are remembered: in a design that changes one parameter at a time most muscles stay as they were.
const REMEMBERED: usize = 512;

/// Trials of one condition whose error is the response to muscle parameters.
#[derive(Debug)]
pub struct MuscleScreening<'a> {
    trials: Vec<(&'a PreparedTrial, &'a [f64])>,
    without_muscles: Vec<Vec<f64>>,
    nominal: &'a [MuscleParameters],
    /// β of each muscle; `None` for classes without it.
    damping: Vec<Option<f64>>,
    remembered: Mutex<HashMap<MomentKey, Arc<UnitMoments>>>,
}

impl<'a> MuscleScreening<'a> {
    /// - `trials`: prepared trials with their measured moments [N·m]
    /// - `nominal`: the model's parameters of each active muscle
    ///
    /// # Errors
    /// [`SensitivityError::TooFew`]: no trial.
    pub fn new(
        trials: Vec<(&'a PreparedTrial, &'a [f64])>,
        nominal: &'a [MuscleParameters],
    ) -> Result<Self, SensitivityError> {
        let Some((first, _)) = trials.first() else {
            return Err(SensitivityError::TooFew { what: "trials of the condition", expected: 1, found: 0 });
        };
        let damping = first.fiber_damping();
        let without_muscles = trials.iter().map(|(trial, _)| trial.moment_without_muscles()).collect();
        Ok(Self { trials, without_muscles, nominal, damping, remembered: Mutex::new(HashMap::new()) })
    }

    /// The parameters, as fractions of the model's values, within table 2.1: `MUSCLE.property`, muscle by muscle.
    ///
    /// # Errors
    /// None with the usual bounds.
    pub fn parameters(muscles: &[&str]) -> Result<Vec<Parameter>, SensitivityError> {
        let of_muscle = |muscle: &&str| {
            let muscle = (*muscle).to_owned();
            ScreenedProperty::ALL.map(move |property| {
                let [lower, upper] = property.usual_bounds();
                Parameter::new(format!("{muscle}.{}", property.name()), lower, upper)
            })
        };
        muscles.iter().flat_map(of_muscle).collect()
    }

    /// Equation 2.4, NRMSE + MaxErr + XCorr, averaged over the trials.
    ///
    /// - `fractions`: in the order of [`Self::parameters`]; a muscle without damping keeps none, so that its fraction
    ///   does nothing
    ///
    /// # Errors
    /// A trial that cannot be simulated or compared.
    pub fn response(&self, fractions: &[f64]) -> Result<f64, ScreeningError> {
        let n = ScreenedProperty::ALL.len();
        let units: Vec<Arc<UnitMoments>> = (0..self.nominal.len())
            .map(|i| self.unit_moments(i, fractions.get(i * n..(i + 1) * n).unwrap_or(&[1.0; 5])))
            .collect::<Result<_, _>>()?;
        let mut total = 0.0;
        for (t, (_, measured)) in self.trials.iter().enumerate() {
            let mut moment = self.without_muscles[t].clone();
            for (i, unit) in units.iter().enumerate() {
                let force = self.nominal[i].max_isometric_force * fractions.get(i * n + 2).unwrap_or(&1.0);
                moment.iter_mut().zip(&unit[t]).for_each(|(sum, u)| *sum += force * u);
            }
            let errors = error_measures(measured, &moment).map_err(ScreeningError::Evaluation)?;
            total += errors.objective.value().ok_or(ScreeningError::NoError)?;
        }
        Ok(total / self.trials.len() as f64)
    }

    /// A muscle's moments per unit of maximum isometric force in all trials.
    ///
    /// - `fractions`: of the muscle's properties, in the order of [`ScreenedProperty::ALL`]
    fn unit_moments(&self, muscle: usize, fractions: &[f64]) -> Result<Arc<UnitMoments>, ScreeningError> {
        let key = (muscle, [0, 1, 3, 4].map(|k: usize| fractions[k].to_bits()));
        let remembered = || self.remembered.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = remembered().get(&key) {
            return Ok(Arc::clone(known));
        }
        let mut parameters = self.nominal[muscle];
        parameters.optimal_fiber_length *= fractions[0];
        parameters.tendon_slack_length *= fractions[1];
        parameters.pennation_angle_at_optimal *= fractions[3];
        let mut damping = self.damping.clone();
        damping[muscle].iter_mut().for_each(|damping| *damping *= fractions[4]);
        let of_trial = |(trial, _): &(&PreparedTrial, &[f64])| {
            let damped = trial.with_fiber_damping(&damping).map_err(ScreeningError::Simulation)?;
            let mut moment = vec![0.0; trial.len()];
            damped.add_unit_moment(muscle, &parameters, &mut moment).map_err(ScreeningError::Simulation)?;
            Ok(moment)
        };
        let moments = Arc::new(self.trials.iter().map(of_trial).collect::<Result<UnitMoments, _>>()?);
        let mut all = remembered();
        if all.len() >= REMEMBERED {
            all.clear();
        }
        all.insert(key, Arc::clone(&moments));
        Ok(moments)
    }
}
