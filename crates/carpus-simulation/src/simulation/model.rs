//! The model as a dynamometer trial needs it: skeleton, active muscles, passive forces, one moving coordinate.

use std::sync::Arc;

use super::activation_dynamics::{ActivationDynamics, ActivationLaw};
use super::activation_trajectory::TooFast;
use super::closed_loops::{self, ClosedLoops};
use super::error::SimulationError;
use super::fiber::CurveCache;
use super::fiber::equation::{Fiber, FiberCurves};
use carpus_multibody::forces::{Forces, PathForce, first_moment_of_mass};
use carpus_multibody::multibody::Model;
use carpus_multibody::muscles::{FirstOrderActivation, MuscleModel};
use carpus_multibody::paths::Path;
use carpus_osim::osim::spec::{CoordinateIndex, ModelSpec, MotionType, MuscleSpec};
use carpus_study::study::{MomentPart, PostureCoordinate, Settings};

/// Classes of OpenSim forces that do nothing without a control of their own.
const INERT_CLASSES: [&str; 1] = ["BodyActuator"];

/// Gravity on earth [m/s²].
const STANDARD_GRAVITY: f64 = 9.80665;

/// Activation that a `DeGrooteFregly2016Muscle` has at least. OpenSim's class has no bound and divides by the
/// activation.
const LEAST_ACTIVATION: f64 = 1e-3;

/// What is measured, and what of the model takes part.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Coordinate that the dynamometer moves and measures the generalized force of.
    pub coordinate: String,
    /// Coordinates held at a value.
    pub posture: Vec<HeldCoordinate>,
    /// Muscles that act, in the order of the excitations of every recording; all others are disabled.
    pub active_muscles: Vec<String>,
    /// What the simulated moment sums.
    pub parts: Vec<MomentPart>,
    /// Viscous drag of the machine [N·m·s/rad]: adds −damping·q̇ to the moment.
    pub dynamometer_damping: f64,
    /// Leave out forces and constraints that are not computed, instead of failing.
    pub allow_unsupported: bool,
}

/// A coordinate held at a value.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldCoordinate {
    /// OpenSim coordinate.
    pub coordinate: String,
    /// The value in degrees for angles and in metres for translations.
    pub value_deg_or_m: f64,
}

impl From<&PostureCoordinate> for HeldCoordinate {
    fn from(held: &PostureCoordinate) -> HeldCoordinate {
        HeldCoordinate { coordinate: held.coordinate.clone(), value_deg_or_m: held.value_deg_or_m }
    }
}

impl Setup {
    /// What a study's settings say.
    pub fn from_settings(settings: &Settings) -> Setup {
        Setup {
            coordinate: settings.dynamometer.coordinate.clone(),
            posture: settings.posture.iter().map(HeldCoordinate::from).collect(),
            active_muscles: settings.active_muscles.clone(),
            parts: settings.dynamometer.include.clone(),
            dynamometer_damping: settings.dynamometer.damping,
            allow_unsupported: false,
        }
    }

    pub(crate) fn includes(&self, part: MomentPart) -> bool {
        self.parts.contains(&part)
    }
}

/// The muscle parameters that personalization changes, under OpenSim's names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MuscleParameters {
    /// Force of the fibres at optimal length, full activation and zero velocity [N].
    pub max_isometric_force: f64,
    /// Fibre length of greatest active force [m].
    pub optimal_fiber_length: f64,
    /// Tendon length above which the tendon pulls [m].
    pub tendon_slack_length: f64,
    /// Angle between fibre and tendon at optimal fibre length [rad].
    pub pennation_angle_at_optimal: f64,
}

/// An active muscle.
#[derive(Clone, Debug)]
pub(crate) struct ActiveMuscle {
    pub(crate) name: String,
    pub(crate) path: Arc<Path>,
    pub(crate) curves: Arc<FiberCurves>,
    pub(crate) nominal: MuscleParameters,
    pub(crate) activation: ActivationDynamics,
    pub(crate) rigid_tendon: bool,
}

impl ActiveMuscle {
    /// Why its activation cannot be followed through a recording.
    pub(crate) fn too_fast(&self, recording: &str, stuck: TooFast) -> SimulationError {
        SimulationError::ActivationTooFast {
            recording: recording.to_owned(),
            muscle: self.name.clone(),
            time: stuck.time,
            activation_time_constant: self.activation.activation_time_constant,
            deactivation_time_constant: self.activation.deactivation_time_constant,
        }
    }
}

/// A passive force along a path.
#[derive(Clone, Debug)]
pub(crate) struct PassivePath {
    pub(crate) name: String,
    pub(crate) path: Path,
    pub(crate) law: PathForce,
}

/// A model compiled for trials in which a dynamometer moves one coordinate. Immutable; muscle parameters are given to
/// every simulation, so that one compiled model serves all candidate parameter sets.
#[derive(Clone, Debug)]
pub struct MusculoskeletalModel {
    pub(crate) skeleton: Model,
    pub(crate) coordinate: CoordinateIndex,
    /// All coordinates in the posture of the study, couplers satisfied [rad or m].
    pub posture: Vec<f64>,
    pub(crate) muscles: Vec<ActiveMuscle>,
    /// Tabulated curves of the muscles.
    pub(crate) curve_cache: CurveCache,
    pub(crate) forces: Forces,
    pub(crate) passive_paths: Vec<PassivePath>,
    pub(crate) setup: Setup,
    pub(crate) closed_loops: Option<ClosedLoops>,
    left_out: Vec<(String, String)>,
}

impl MusculoskeletalModel {
    /// Compiles what a trial needs of a model.
    ///
    /// # Errors
    /// A component that is missing, wrong or not computed (see [`SimulationError`]); forces and constraints that are
    /// not computed are an error unless `setup.allow_unsupported`.
    pub fn compile(spec: &ModelSpec, setup: &Setup) -> Result<MusculoskeletalModel, SimulationError> {
        let skeleton = Model::compile(spec)?;
        let coordinate = independent_coordinate(&skeleton, &setup.coordinate)?;
        let held = held_values(&skeleton, &setup.posture)?;
        let (skeleton, closed_loops) = closed_loops::close(spec, skeleton, coordinate, &held)?;
        let posture = posture(&skeleton, &setup.posture)?;
        let mut cache = CurveCache::default();
        let muscles = setup
            .active_muscles
            .iter()
            .enumerate()
            .map(|(i, name)| {
                if setup.active_muscles[..i].contains(name) {
                    return Err(SimulationError::RepeatedMuscle { name: name.clone() });
                }
                active_muscle(spec, &skeleton, name, &mut cache)
            })
            .collect::<Result<_, _>>()?;
        let mut left_out = skeleton.unsupported_constraints.clone();
        if !left_out.is_empty() && !setup.allow_unsupported {
            return Err(SimulationError::UnsupportedConstraints { constraints: left_out });
        }
        let passive = setup.includes(MomentPart::Passive);
        let forces = if passive { Forces::compile(spec, &skeleton)? } else { Forces::default() };
        // A muscle without a path that is read is not active, or it is missed above.
        let acts =
            |(_, class): &&(String, String)| !INERT_CLASSES.contains(&class.as_str()) && !class.contains("Muscle");
        let mut unsupported: Vec<_> = forces.unsupported.iter().filter(acts).cloned().collect();
        // A trial's own time is not that of the model's functions.
        unsupported.extend(forces.over_time.iter().map(|force| (force.name.clone(), "PrescribedForce".to_owned())));
        if !unsupported.is_empty() && !setup.allow_unsupported {
            return Err(SimulationError::UnsupportedForces { forces: unsupported });
        }
        left_out.extend(unsupported);
        let passive_paths = forces
            .along_paths
            .iter()
            .map(|force| {
                let path = compile_path(&force.path, spec, &skeleton, &force.name)?;
                Ok(PassivePath { name: force.name.clone(), path, law: force.law.clone() })
            })
            .collect::<Result<_, SimulationError>>()?;
        Ok(MusculoskeletalModel {
            skeleton,
            coordinate,
            posture,
            muscles,
            curve_cache: cache,
            forces,
            passive_paths,
            setup: setup.clone(),
            closed_loops,
            left_out,
        })
    }

    /// The compiled skeleton.
    pub fn skeleton(&self) -> &Model {
        &self.skeleton
    }

    /// What it was compiled for.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The coordinate that the dynamometer moves.
    pub fn coordinate(&self) -> CoordinateIndex {
        self.coordinate
    }

    /// All coordinates in the posture of the study with some held otherwise, couplers satisfied [rad or m].
    ///
    /// # Errors
    /// A coordinate that is not there, follows another, is outside its range, or belongs to a loop of constraints that
    /// was closed at another value.
    pub fn posture_with(&self, held: &[HeldCoordinate]) -> Result<Vec<f64>, SimulationError> {
        let mut q = self.posture.clone();
        if let Some(loops) = &self.closed_loops {
            let named = held.iter().filter_map(|held| Some((self.skeleton.coordinate(&held.coordinate)?, held)));
            let values = named.map(|(c, held)| (c, value_of(&self.skeleton, c, held)));
            loops.check_posture(&self.skeleton, &self.posture, values)?;
        }
        set_posture(&self.skeleton, &mut q, held)?;
        Ok(q)
    }

    /// Values of the moving coordinate at which the loops of constraints hold [rad or m]; `None` without loops.
    pub fn closed_range(&self) -> Option<[f64; 2]> {
        self.closed_loops.as_ref().map(ClosedLoops::range)
    }

    /// Checks that loops of constraints hold at values of the moving coordinate.
    ///
    /// - `range`: least and greatest [rad or m]
    ///
    /// # Errors
    /// [`SimulationError::LoopOpen`].
    pub(crate) fn check_loops(&self, range: [f64; 2]) -> Result<(), SimulationError> {
        self.closed_loops.as_ref().map_or(Ok(()), |loops| loops.check(&self.setup.coordinate, range))
    }

    /// Largest moment that gravity, however directed, has about the moving coordinate [N·m or N], in the posture of the
    /// study: how heavy what the coordinate moves is.
    pub fn weight_moment(&self) -> f64 {
        let (skeleton, moved) = (&self.skeleton, self.skeleton.bodies_moved_by(&[self.coordinate]));
        let mut cache = skeleton.new_cache();
        skeleton.update_positions(&self.posture, &mut cache);
        skeleton.update_unit_motion(&self.posture, self.coordinate, &mut cache);
        STANDARD_GRAVITY * first_moment_of_mass(skeleton, &moved, &cache).norm()
    }

    /// Names of the active muscles, in order.
    pub fn muscle_names(&self) -> impl Iterator<Item = &str> {
        self.muscles.iter().map(|m| m.name.as_str())
    }

    /// The active muscles' parameters as the file has them, in order.
    pub fn nominal_parameters(&self) -> Vec<MuscleParameters> {
        self.muscles.iter().map(|m| m.nominal).collect()
    }

    /// Name and class of forces and constraints that were left out because `allow_unsupported` was set.
    pub fn left_out(&self) -> &[(String, String)] {
        &self.left_out
    }

    /// Whether constraints make coordinates follow the moving one: the skeleton then has more couplers than the file.
    pub fn closes_loops(&self) -> bool {
        self.closed_loops.is_some()
    }

    /// Largest deviation of the tabulated muscle curves from the exact ones, of all active muscles.
    pub fn curve_deviation(&self) -> f64 {
        self.muscles.iter().map(|m| m.curves.deviation()).fold(0.0, f64::max)
    }
}

impl ActiveMuscle {
    /// The muscle with other parameters.
    pub(crate) fn fiber(&self, parameters: &MuscleParameters) -> Fiber {
        Fiber::new(
            Arc::clone(&self.curves),
            parameters.optimal_fiber_length,
            parameters.tendon_slack_length,
            parameters.pennation_angle_at_optimal,
        )
    }

    /// # Errors
    /// [`SimulationError::InvalidParameter`].
    pub(crate) fn check(&self, parameters: &MuscleParameters) -> Result<(), SimulationError> {
        let positive = [
            ("max_isometric_force", parameters.max_isometric_force),
            ("optimal_fiber_length", parameters.optimal_fiber_length),
            ("tendon_slack_length", parameters.tendon_slack_length),
        ];
        let invalid = |property, value, expected| {
            Err(SimulationError::InvalidParameter { muscle: self.name.clone(), property, value, expected })
        };
        for (property, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return invalid(property, value, "a number above 0");
            }
        }
        let angle = parameters.pennation_angle_at_optimal;
        if !(0.0..std::f64::consts::FRAC_PI_2).contains(&angle) {
            return invalid("pennation_angle_at_optimal", angle, "at least 0 and below π/2 rad");
        }
        Ok(())
    }
}

/// The coordinate of that name.
pub(crate) fn coordinate_named(skeleton: &Model, name: &str) -> Result<CoordinateIndex, SimulationError> {
    skeleton.coordinate(name).ok_or_else(|| SimulationError::UnknownCoordinate {
        name: name.to_owned(),
        available: skeleton.coordinates.iter().map(|c| c.name.clone()).collect(),
    })
}

/// The coordinate of that name, if no coupler determines it.
pub(crate) fn independent_coordinate(skeleton: &Model, name: &str) -> Result<CoordinateIndex, SimulationError> {
    let coordinate = coordinate_named(skeleton, name)?;
    match skeleton.driver_of(coordinate) {
        None => Ok(coordinate),
        Some(coupler) => Err(SimulationError::DependentCoordinate {
            name: name.to_owned(),
            driver: skeleton.names_of_roots(coordinate, "`"),
            coupler: coupler.name.clone(),
        }),
    }
}

/// Sets coordinates to values in degrees or metres and makes the others follow.
pub(crate) fn set_posture(skeleton: &Model, q: &mut [f64], held: &[HeldCoordinate]) -> Result<(), SimulationError> {
    held_values(skeleton, held)?.into_iter().for_each(|(index, value)| q[index.0] = value);
    skeleton.satisfy_couplers(q);
    Ok(())
}

/// The value that a coordinate is held at [rad or m].
fn value_of(skeleton: &Model, coordinate: CoordinateIndex, held: &HeldCoordinate) -> f64 {
    match skeleton.coordinates[coordinate.0].motion_type {
        MotionType::Translational => held.value_deg_or_m,
        MotionType::Rotational | MotionType::Coupled => held.value_deg_or_m.to_radians(),
    }
}

/// Coordinates that are held, and their values [rad or m].
fn held_values(skeleton: &Model, held: &[HeldCoordinate]) -> Result<Vec<(CoordinateIndex, f64)>, SimulationError> {
    let mut values = Vec::with_capacity(held.len());
    for item in held {
        let index = independent_coordinate(skeleton, &item.coordinate)?;
        let coordinate = &skeleton.coordinates[index.0];
        let value = value_of(skeleton, index, item);
        let [lower, upper] = coordinate.range;
        // A tenth of a degree: what rounding of values written in degrees may add.
        let slack = 1.8e-3;
        if !(value >= lower - slack && value <= upper + slack) {
            let is_translation = coordinate.motion_type == MotionType::Translational;
            let name = item.coordinate.clone();
            return Err(SimulationError::PostureOutOfRange { name, is_translation, value, lower, upper });
        }
        values.push((index, value));
    }
    Ok(values)
}

/// The default pose with some coordinates held and couplers followed [rad or m].
///
/// # Errors
/// A coordinate that is not there, follows another, or is outside its range.
pub fn posture(skeleton: &Model, held: &[HeldCoordinate]) -> Result<Vec<f64>, SimulationError> {
    let mut q = skeleton.default_coordinates();
    set_posture(skeleton, &mut q, held)?;
    Ok(q)
}

/// The skeleton in which loops of constraints are closed in a posture, its moving coordinate, and all coordinates there
/// [rad or m].
///
/// - `coordinate`: the one that moves
/// - `held`: the others
/// - `value_deg_or_m`: of the moving one
///
/// # Errors
/// The skeleton cannot be compiled; as [`posture`]; loops that do not close there.
pub fn skeleton_in_posture(
    spec: &ModelSpec,
    coordinate: &str,
    held: &[HeldCoordinate],
    value_deg_or_m: f64,
) -> Result<(Model, CoordinateIndex, Vec<f64>), SimulationError> {
    let skeleton = Model::compile(spec)?;
    let moving = independent_coordinate(&skeleton, coordinate)?;
    let values = held_values(&skeleton, held)?;
    let (skeleton, loops) = closed_loops::close(spec, skeleton, moving, &values)?;
    let mut all = held.to_vec();
    all.push(HeldCoordinate { coordinate: coordinate.to_owned(), value_deg_or_m });
    let q = posture(&skeleton, &all)?;
    if let Some(loops) = loops {
        loops.check(coordinate, [q[moving.0]; 2])?;
    }
    Ok((skeleton, moving, q))
}

/// Which muscles of a model can be active in a study, and why others cannot.
///
/// - `skeleton`: compiled from `spec`
pub fn check_muscles<'s>(
    spec: &'s ModelSpec,
    skeleton: &Model,
) -> impl Iterator<Item = (&'s str, Result<(), SimulationError>)> {
    let mut cache = CurveCache::default();
    spec.muscles.iter().map(move |m| (m.name.as_str(), active_muscle(spec, skeleton, &m.name, &mut cache).map(drop)))
}

fn active_muscle(
    spec: &ModelSpec,
    skeleton: &Model,
    name: &str,
    cache: &mut CurveCache,
) -> Result<ActiveMuscle, SimulationError> {
    let muscle = spec.muscles.iter().find(|m| m.name == name).ok_or_else(|| SimulationError::UnknownMuscle {
        name: name.to_owned(),
        available: spec.muscles.iter().map(|m| m.name.clone()).collect(),
    })?;
    if !muscle.applies_force {
        return Err(SimulationError::AppliesNoForce { name: name.to_owned() });
    }
    active_muscle_along(muscle, Arc::new(compile_path(&muscle.path, spec, skeleton, name)?), cache)
}

/// The muscle of that specification on a path that is compiled already.
pub(crate) fn active_muscle_along(
    muscle: &MuscleSpec,
    path: Arc<Path>,
    cache: &mut CurveCache,
) -> Result<ActiveMuscle, SimulationError> {
    let model = MuscleModel::from_spec(muscle)?;
    model.require_rates()?;
    let not_simulated = |reason| SimulationError::LawNotSimulated { muscle: muscle.name.clone(), reason };
    if let MuscleModel::DeGrooteFregly2016(own) = &model
        && own.properties.implicit_tendon_compliance
        && !own.ignore_tendon_compliance
    {
        return Err(not_simulated(
            "tendon_compliance_dynamics_mode is implicit, so that something outside the muscle would have to give the \
             rate of its tendon force",
        ));
    }
    let curves = FiberCurves::of(&model, muscle, cache)
        .ok_or_else(|| not_simulated("its properties are those of another class"))?;
    Ok(ActiveMuscle {
        name: muscle.name.clone(),
        path,
        curves,
        nominal: MuscleParameters {
            max_isometric_force: muscle.max_isometric_force,
            optimal_fiber_length: muscle.optimal_fiber_length,
            tendon_slack_length: muscle.tendon_slack_length,
            pennation_angle_at_optimal: muscle.pennation_angle_at_optimal,
        },
        activation: ActivationDynamics::of(&model),
        rigid_tendon: model.ignore_tendon_compliance(),
    })
}

impl ActivationDynamics {
    /// Those of a muscle.
    fn of(muscle: &MuscleModel) -> ActivationDynamics {
        let first_order = |own: FirstOrderActivation, law| ActivationDynamics {
            activation_time_constant: own.activation_time_constant,
            deactivation_time_constant: own.deactivation_time_constant,
            minimum_activation: own.minimum_activation,
            law,
        };
        let law = match muscle.ignore_activation_dynamics() {
            true => ActivationLaw::Excitation,
            false => ActivationLaw::FirstOrder,
        };
        match muscle {
            MuscleModel::Millard2012(own) => first_order(own.activation_dynamics(), law),
            MuscleModel::Thelen2003(own) => first_order(own.activation_dynamics(), law),
            MuscleModel::DeGrooteFregly2016(own) => {
                let p = &own.properties;
                let law = match law {
                    ActivationLaw::FirstOrder => ActivationLaw::Smooth { steepness: p.activation_dynamics_smoothing },
                    ignored => ignored,
                };
                ActivationDynamics {
                    activation_time_constant: p.activation_time_constant,
                    deactivation_time_constant: p.deactivation_time_constant,
                    minimum_activation: LEAST_ACTIVATION,
                    law,
                }
            }
            // Its time constants are never read.
            MuscleModel::RigidTendon(_) => ActivationDynamics {
                activation_time_constant: 1.0,
                deactivation_time_constant: 1.0,
                minimum_activation: 0.0,
                law,
            },
            MuscleModel::Deprecated(own) => {
                let [falling, rising] = own.activation_rates();
                ActivationDynamics {
                    activation_time_constant: 1.0 / (falling + rising),
                    deactivation_time_constant: 1.0 / falling,
                    minimum_activation: 0.0,
                    law: ActivationLaw::Linear,
                }
            }
        }
    }
}

pub(crate) fn compile_path(
    path: &carpus_osim::osim::spec::PathSpec,
    spec: &ModelSpec,
    skeleton: &Model,
    owner: &str,
) -> Result<Path, SimulationError> {
    Path::compile(path, spec, skeleton).map_err(|source| SimulationError::Path { owner: owner.to_owned(), source })
}
