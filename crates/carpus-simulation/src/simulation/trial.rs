//! A recorded trial, prepared once ([`MusculoskeletalModel::prepare`]) and then simulated for any number of parameter
//! sets.

use std::sync::Arc;

use rayon::prelude::*;

use super::activation_trajectory::ActivationTrajectory;
use super::error::SimulationError;
use super::fiber::equation::{Drive, Fiber};
use super::fiber::plan::StepPlan;
use super::fiber::radau::Work;
use super::fiber::step::{Cursor, DriveSource, FiberAccuracy, StepTaken};
use super::model::{ActiveMuscle, HeldCoordinate, MuscleParameters};
use super::motion::{Motion, MotionInterpolation};
use super::path_table::PathTable;
use super::tables::{CoordinateTables, LENGTH, UNIT_SPEED};
use carpus_study::study::Trial;

/// Fewest samples of a recording: the motion's spline needs six.
pub const MIN_RECORDING_SAMPLES: usize = 6;

/// What was recorded, as far as a simulation needs it.
#[derive(Clone, Debug)]
pub struct Recording<'a> {
    /// Name for messages, usually the file.
    pub name: String,
    /// Time [s], strictly increasing.
    pub time: &'a [f64],
    /// Angle of the dynamometer's coordinate [rad or m].
    pub angle: &'a [f64],
    /// Excitation of each active muscle, in the model's order; linear between samples.
    pub excitation: Vec<&'a [f64]>,
    /// Coordinates held otherwise than in the posture of the study.
    pub held: Vec<HeldCoordinate>,
}

impl<'a> From<&'a Trial> for Recording<'a> {
    fn from(trial: &'a Trial) -> Self {
        Recording {
            name: trial.info.file_as_written.clone(),
            time: &trial.time,
            angle: &trial.angle,
            excitation: trial.excitation.iter().map(Vec::as_slice).collect(),
            held: trial.info.held.iter().map(HeldCoordinate::from).collect(),
        }
    }
}

/// Results as large as this are none: squares of larger ones, summed over ten million samples, leave the range of
/// floating-point numbers, so that no error can be computed, and no muscle is so strong by more than a hundred powers
/// of ten.
const LARGEST_RESULT: f64 = 1e150;

/// How a trial is simulated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// How the angle between samples is found.
    pub motion: MotionInterpolation,
    /// Accuracy of fibre lengths.
    pub fiber: FiberAccuracy,
    /// Accept angles outside the coordinate's range.
    pub allow_angle_outside_range: bool,
}

/// A trial of which everything that does not depend on muscle parameters is computed: motion, path lengths, moment
/// arms, activations, passive forces.
#[derive(Clone, Debug)]
pub struct PreparedTrial {
    pub(crate) name: String,
    pub(crate) time: Arc<[f64]>,
    pub(crate) motion: Arc<Motion>,
    pub(crate) tables: Arc<CoordinateTables>,
    pub(crate) muscles: Vec<Arc<PreparedMuscle>>,
    pub(crate) kinematics: Arc<TrialKinematics>,
    pub(crate) accuracy: FiberAccuracy,
    /// The angle as recorded.
    pub(crate) angle: Arc<[f64]>,
}

/// A muscle in a prepared trial.
#[derive(Clone, Debug)]
pub(crate) struct PreparedMuscle {
    pub(crate) muscle: ActiveMuscle,
    /// As recorded.
    pub(crate) excitation: Arc<[f64]>,
    pub(crate) activation: Arc<ActivationTrajectory>,
    /// `None` for a rigid tendon.
    pub(crate) plan: Option<Arc<StepPlan>>,
}

/// What a trial's motion gives, at every sample, whatever the muscles' parameters are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrialKinematics {
    /// Time [s].
    pub time: Vec<f64>,
    /// Angle of the moving coordinate [rad or m].
    pub angle: Vec<f64>,
    /// Its speed [rad/s or m/s].
    pub speed: Vec<f64>,
    /// Its acceleration [rad/s² or m/s²].
    pub acceleration: Vec<f64>,
    /// Per active muscle.
    pub muscles: Vec<MuscleKinematics>,
    /// Moment of passive forces [N·m], zero unless included.
    pub passive_moment: Vec<f64>,
    /// Moment of gravity [N·m], zero unless included: positive where the weight of what moves pulls the coordinate in
    /// its positive sense. Opposite to what OpenSim's `InverseDynamicsSolver` finds at rest, which is what balances it.
    pub gravity_moment: Vec<f64>,
    /// Moment of inertia forces (d'Alembert) [N·m], zero unless included: −(M q̈ + C q̇²) along the coordinate,
    /// negative while the coordinate accelerates in its positive sense. Opposite to the solver's inertial part.
    pub inertia_moment: Vec<f64>,
    /// Drag of the dynamometer [N·m].
    pub damping_moment: Vec<f64>,
}

impl TrialKinematics {
    /// The part of the moment that does not depend on the muscles [N·m].
    pub fn moment_without_muscles(&self) -> Vec<f64> {
        (0..self.time.len())
            .map(|i| self.passive_moment[i] + self.gravity_moment[i] + self.inertia_moment[i] + self.damping_moment[i])
            .collect()
    }
}

/// A muscle's path and activation over a trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MuscleKinematics {
    /// Path length [m].
    pub length: Vec<f64>,
    /// Lengthening speed [m/s].
    pub lengthening_speed: Vec<f64>,
    /// Moment arm about the moving coordinate [m], positive when tension increases the coordinate.
    pub moment_arm: Vec<f64>,
    /// Activation.
    pub activation: Vec<f64>,
}

/// Result of one simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrialSimulation {
    /// Time [s].
    pub time: Vec<f64>,
    /// Moment about the moving coordinate, the sum of all parts that the setup includes [N·m].
    pub moment: Vec<f64>,
    /// Per active muscle.
    pub muscles: Vec<MuscleSimulation>,
    /// Work done.
    pub work: Work,
}

/// One muscle over a trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MuscleSimulation {
    /// Fibre length [m].
    pub fiber_length: Vec<f64>,
    /// Fibre velocity [m/s].
    pub fiber_velocity: Vec<f64>,
    /// Tendon force [N].
    pub tendon_force: Vec<f64>,
    /// Moment about the moving coordinate [N·m].
    pub moment: Vec<f64>,
}

/// Moment of one muscle per unit of maximum isometric force [m], and how it changes with the muscle's other parameters.
///
/// The moment is `max_isometric_force` × `moment`: exactly linear, since fibre and tendon scale with the same force.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnitMoment {
    /// Per sample [m].
    pub moment: Vec<f64>,
    /// Per sample, derivative by optimal fibre length [1].
    pub by_optimal_fiber_length: Vec<f64>,
    /// Per sample, derivative by tendon slack length [1].
    pub by_tendon_slack_length: Vec<f64>,
    /// Per sample, derivative by pennation angle at optimal fibre length [m/rad].
    pub by_pennation_angle: Vec<f64>,
    /// Work done.
    pub work: Work,
}

/// What drives a muscle: activation and path length as functions of time.
pub(crate) struct Source<'a> {
    pub(crate) activation: &'a ActivationTrajectory,
    pub(crate) motion: &'a Motion,
    pub(crate) path: &'a PathTable<3>,
}

impl Source<'_> {
    /// Path length [m].
    #[inline]
    pub(crate) fn length(&self, time: f64, cursor: &mut Cursor) -> f64 {
        let angle = self.motion.angle(time, &mut cursor.angle);
        self.path.quantity::<LENGTH>(angle, &mut cursor.path)
    }
}

impl DriveSource for Source<'_> {
    fn speed(&self, time: f64) -> f64 {
        let [angle, speed, _] = self.motion.jet(time, &mut 0);
        self.path.quantity::<UNIT_SPEED>(angle, &mut 0) * speed
    }

    fn drive(&self, time: f64, cursor: &mut Cursor) -> Drive {
        Drive { activation: self.activation.value(time, &mut cursor.activation), length: self.length(time, cursor) }
    }
}

impl PreparedTrial {
    /// Name of the recording.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples; never so.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Number of active muscles.
    pub fn n_muscles(&self) -> usize {
        self.muscles.len()
    }

    /// Motion, paths, activations and passive moments at every sample.
    pub fn kinematics(&self) -> &TrialKinematics {
        &self.kinematics
    }

    /// The part of the moment that does not depend on the muscles [N·m]: passive, gravity, inertia, drag.
    pub fn moment_without_muscles(&self) -> Vec<f64> {
        self.kinematics.moment_without_muscles()
    }

    /// Steps that are planned for each muscle (0 for a rigid tendon).
    pub fn planned_steps(&self) -> Vec<usize> {
        self.muscles.iter().map(|m| m.plan.as_ref().map_or(0, |p| p.len())).collect()
    }

    /// Evaluations of paths and passive forces that the tables took, shared by all trials prepared together.
    pub fn path_evaluations(&self) -> usize {
        self.tables.evaluations()
    }

    /// Angles of the moving coordinate [rad or m] around which the path of an active muscle jumps, as conditional path
    /// points make it do; empty for a smooth path.
    pub fn path_discontinuities(&self, muscle: usize) -> &[f64] {
        self.tables.muscles[muscle].discontinuities()
    }

    /// Simulates the trial.
    ///
    /// - `parameters`: of each active muscle, in order
    ///
    /// # Errors
    /// Parameters that are not allowed; a muscle whose forces cannot be balanced.
    pub fn simulate(&self, parameters: &[MuscleParameters]) -> Result<TrialSimulation, SimulationError> {
        self.check(parameters)?;
        let mut out = TrialSimulation {
            time: self.time.to_vec(),
            moment: self.moment_without_muscles(),
            ..TrialSimulation::default()
        };
        for (i, p) in parameters.iter().enumerate() {
            let series = || Vec::with_capacity(self.len());
            let mut series = MuscleSimulation {
                fiber_length: series(),
                fiber_velocity: series(),
                tendon_force: series(),
                moment: series(),
            };
            let kinematics = &self.kinematics.muscles[i];
            out.work += self.run::<false>(i, p, |k, at| {
                let force = p.max_isometric_force * at.force;
                series.fiber_length.push(at.x * p.optimal_fiber_length);
                series.fiber_velocity.push(at.rate * p.optimal_fiber_length);
                series.tendon_force.push(force);
                series.moment.push(force * kinematics.moment_arm[k]);
            })?;
            for (total, moment) in out.moment.iter_mut().zip(&series.moment) {
                *total += moment;
            }
            out.muscles.push(series);
        }
        self.check_finite(&out)?;
        Ok(out)
    }

    /// Finds the first number of a simulation that is none, or that is too large to be computed with
    /// ([`LARGEST_RESULT`]).
    fn check_finite(&self, simulation: &TrialSimulation) -> Result<(), SimulationError> {
        let fails = |muscle: Option<usize>, quantity: &'static str, series: &[f64]| {
            let Some(k) = series.iter().position(|v| !(v.abs() < LARGEST_RESULT)) else { return Ok(()) };
            Err(SimulationError::NotFiniteResult {
                recording: self.name.clone(),
                muscle: muscle.map(|i| self.muscles[i].muscle.name.clone()),
                quantity,
                value: series[k],
                time: self.time[k],
                angle: self.kinematics.angle[k],
            })
        };
        for (i, muscle) in simulation.muscles.iter().enumerate() {
            fails(Some(i), "fibre length [m]", &muscle.fiber_length)?;
            fails(Some(i), "tendon force [N]", &muscle.tendon_force)?;
            fails(Some(i), "moment [N·m]", &muscle.moment)?;
        }
        let kinematics = &self.kinematics;
        fails(None, "moment of passive forces [N·m]", &kinematics.passive_moment)?;
        fails(None, "moment of gravity [N·m]", &kinematics.gravity_moment)?;
        fails(None, "moment of inertia [N·m]", &kinematics.inertia_moment)?;
        fails(None, "sum of all moments [N·m]", &simulation.moment)
    }

    /// Adds the moment of one muscle per unit of maximum isometric force to `moment` [m]; allocates nothing.
    ///
    /// - `muscle`: position among the active muscles
    /// - `parameters`: its parameters; the maximum isometric force does not matter
    /// - `moment`: one value per sample
    ///
    /// # Errors
    /// As [`PreparedTrial::simulate`].
    pub fn add_unit_moment(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
        moment: &mut [f64],
    ) -> Result<Work, SimulationError> {
        self.muscles[muscle].muscle.check(parameters)?;
        let arms = &self.kinematics.muscles[muscle].moment_arm;
        self.run::<false>(muscle, parameters, |k, at| moment[k] += arms[k] * at.force)
    }

    /// Moment of one muscle per unit of maximum isometric force with its exact derivatives: those of the discrete
    /// solution, by forward sensitivities.
    ///
    /// # Errors
    /// As [`PreparedTrial::simulate`].
    pub fn unit_moment_with_derivatives(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
    ) -> Result<UnitMoment, SimulationError> {
        let arms = &self.kinematics.muscles[muscle].moment_arm;
        self.unit_with_derivatives(muscle, parameters, |k| arms[k])
    }

    /// As [`PreparedTrial::unit_moment_with_derivatives`] with a moment arm of 1: tendon force over maximum isometric
    /// force, for moments about any coordinate.
    ///
    /// # Errors
    /// As [`PreparedTrial::simulate`].
    pub fn unit_force_with_derivatives(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
    ) -> Result<UnitMoment, SimulationError> {
        self.unit_with_derivatives(muscle, parameters, |_| 1.0)
    }

    /// Tendon force of one muscle over its maximum isometric force, at every sample.
    ///
    /// # Errors
    /// As [`PreparedTrial::simulate`].
    pub fn unit_force(&self, muscle: usize, parameters: &MuscleParameters) -> Result<Vec<f64>, SimulationError> {
        self.muscles[muscle].muscle.check(parameters)?;
        let mut force = vec![0.0; self.len()];
        self.run::<false>(muscle, parameters, |k, at| force[k] = at.force)?;
        Ok(force)
    }

    fn unit_with_derivatives(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
        arm: impl Fn(usize) -> f64,
    ) -> Result<UnitMoment, SimulationError> {
        self.muscles[muscle].muscle.check(parameters)?;
        let n = self.len();
        let mut out = UnitMoment {
            moment: vec![0.0; n],
            by_optimal_fiber_length: vec![0.0; n],
            by_tendon_slack_length: vec![0.0; n],
            by_pennation_angle: vec![0.0; n],
            work: Work::default(),
        };
        let cosine = parameters.pennation_angle_at_optimal.cos();
        out.work = self.run::<true>(muscle, parameters, |k, at| {
            out.moment[k] = arm(k) * at.force;
            out.by_optimal_fiber_length[k] = arm(k) * at.force_by[0];
            out.by_tendon_slack_length[k] = arm(k) * at.force_by[1];
            out.by_pennation_angle[k] = arm(k) * at.force_by[2] * cosine;
        })?;
        Ok(out)
    }

    fn check(&self, parameters: &[MuscleParameters]) -> Result<(), SimulationError> {
        if parameters.len() != self.muscles.len() {
            let (found, expected) = (parameters.len(), self.muscles.len());
            return Err(SimulationError::ParameterCount { found, expected });
        }
        self.muscles.iter().zip(parameters).try_for_each(|(prepared, p)| prepared.muscle.check(p))
    }

    /// Follows one muscle; `emit` receives every sample in order.
    fn run<const DERIVATIVES: bool>(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
        emit: impl FnMut(usize, ForceSample),
    ) -> Result<Work, SimulationError> {
        self.run_observed::<DERIVATIVES>(muscle, parameters, emit, |_| ())
    }

    /// As [`PreparedTrial::run`]; `observe` receives every step taken.
    pub(crate) fn run_observed<const DERIVATIVES: bool>(
        &self,
        muscle: usize,
        parameters: &MuscleParameters,
        mut emit: impl FnMut(usize, ForceSample),
        observe: impl FnMut(StepTaken),
    ) -> Result<Work, SimulationError> {
        let prepared = &self.muscles[muscle];
        let kinematics = &self.kinematics.muscles[muscle];
        let fiber = prepared.muscle.fiber(parameters);
        let Some(plan) = &prepared.plan else {
            self.run_rigid(&fiber, muscle, emit);
            return Ok(Work { residual_evaluations: self.len(), ..Work::default() });
        };
        let source =
            Source { activation: &prepared.activation, motion: &self.motion, path: &self.tables.muscles[muscle] };
        fiber
            .follow::<DERIVATIVES>(
                plan,
                &source,
                &self.accuracy,
                |k, at| {
                    let tendon = fiber.tendon_force(at.x, kinematics.length[k]);
                    let mut force_by = [0.0; 3];
                    if DERIVATIVES {
                        for p in 0..3 {
                            force_by[p] = tendon.by_x * at.by_parameters[p] + tendon.by_parameters[p];
                        }
                    }
                    emit(k, ForceSample { x: at.x, rate: at.rate, force: tendon.value, force_by });
                },
                observe,
            )
            .map_err(|stuck| SimulationError::NoBalance {
                recording: self.name.clone(),
                muscle: prepared.muscle.name.clone(),
                time: stuck.time,
            })
    }

    fn run_rigid(&self, fiber: &Fiber, muscle: usize, mut emit: impl FnMut(usize, ForceSample)) {
        let kinematics = &self.kinematics.muscles[muscle];
        for k in 0..self.len() {
            let at =
                fiber.rigid_tendon(kinematics.activation[k], kinematics.length[k], kinematics.lengthening_speed[k]);
            let rate = at.u * fiber.curves.max_velocity;
            emit(k, ForceSample { x: at.x, rate, force: at.force, force_by: at.by_parameters });
        }
    }
}

/// A muscle at a sample, normalized.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ForceSample {
    /// Normalized fibre length.
    pub(crate) x: f64,
    /// Its rate [1/s].
    pub(crate) rate: f64,
    /// Tendon force over maximum isometric force.
    pub(crate) force: f64,
    /// Its derivatives by optimal fibre length, tendon slack length and sine of pennation.
    pub(crate) force_by: [f64; 3],
}

/// Simulates many trials, in parallel over trials; the result is the same at any number of threads.
///
/// # Errors
/// The first error in the order of the trials.
pub fn simulate_all(
    trials: &[PreparedTrial],
    parameters: &[MuscleParameters],
) -> Result<Vec<TrialSimulation>, SimulationError> {
    trials.par_iter().map(|trial| trial.simulate(parameters)).collect::<Vec<_>>().into_iter().collect()
}
