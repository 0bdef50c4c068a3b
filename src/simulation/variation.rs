//! Variations of a prepared trial: other muscle properties, another angle or excitation, on the paths already tabulated;
//! and the linear response of a muscle's moment to its excitation.

use std::sync::Arc;

use super::activation_trajectory::ActivationTrajectory;
use super::error::SimulationError;
use super::fiber::equation::{Drive, Fiber, FiberCurves};
use super::model::{ActiveMuscle, MusculoskeletalModel, active_muscle_along};
use super::sensitivity::MuscleSolution;
use super::tables::CoordinateTables;
use super::trial::{Options, PreparedMuscle, PreparedTrial, Recording, Source};
use crate::osim::spec::MuscleSpec;

/// How far beyond the recorded angles paths are tabulated for variations [rad]: 12°.
const ANGLE_MARGIN: f64 = 0.21;

impl MusculoskeletalModel {
    /// The same model with other properties of its active muscles (paths excepted).
    ///
    /// - `muscles`: one specification for each active muscle, in order
    ///
    /// # Errors
    /// A property that is not allowed.
    pub fn with_muscles(&self, muscles: &[MuscleSpec]) -> Result<MusculoskeletalModel, SimulationError> {
        let mut model = self.clone();
        let mut cache = model.curve_cache.clone();
        for (muscle, spec) in model.muscles.iter_mut().zip(muscles) {
            *muscle = active_muscle_along(spec, Arc::clone(&muscle.path), &mut cache)?;
        }
        Ok(model)
    }

    /// The same model with an optimal fibre length of its active muscles' active force of lo (1 + λ (1 − a)): longer at
    /// low activation. The force–velocity curve keeps lo.
    ///
    /// - `lambda`: λ; 0 is OpenSim's muscle
    ///
    /// # References
    /// Lloyd DG, Besier TF (2003), An EMG-driven musculoskeletal model to estimate muscle forces and knee joint moments in
    /// vivo, J Biomech 36.
    pub fn with_length_by_activation(&self, lambda: f64) -> MusculoskeletalModel {
        let mut model = self.clone();
        for muscle in &mut model.muscles {
            let mut curves = (*muscle.curves).clone();
            curves.length_by_activation = lambda;
            muscle.curves = Arc::new(curves);
        }
        model
    }

    /// As [`MusculoskeletalModel::prepare_all`], with paths tabulated 12° beyond the recorded angles, so that
    /// [`MusculoskeletalModel::prepare_like`] may change the angle that far.
    ///
    /// # Errors
    /// As there.
    pub fn prepare_all_with_margin(
        &self,
        recordings: &[Recording],
        options: &Options,
    ) -> Result<Vec<PreparedTrial>, SimulationError> {
        let motions =
            recordings.iter().map(|r| self.checked_motion(r, options)).collect::<Result<Vec<_>, SimulationError>>()?;
        let Some([low, high]) = motions.iter().map(|m| m.range()).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
        else {
            return Ok(Vec::new());
        };
        let tables = Arc::new(CoordinateTables::build(self, [low - ANGLE_MARGIN, high + ANGLE_MARGIN])?);
        recordings
            .iter()
            .zip(motions)
            .map(|(recording, motion)| self.prepare_with(recording, motion, Arc::clone(&tables), options))
            .collect()
    }

    /// Prepares a variation of a trial on the paths and steps of `like`, which must come from this skeleton and have the
    /// same times: only what depends on something that differs is computed. A step that misses the tolerance for the
    /// variation is divided while it is simulated.
    ///
    /// # Errors
    /// As [`MusculoskeletalModel::prepare`].
    pub fn prepare_like(
        &self,
        recording: &Recording,
        like: &PreparedTrial,
        options: &Options,
    ) -> Result<PreparedTrial, SimulationError> {
        self.prepare_from(recording, like, options, None)
    }

    /// As [`MusculoskeletalModel::prepare_like`] for two variations so small that their difference gives a derivative:
    /// activation is integrated in the steps of `like`. They are not to be simulated.
    ///
    /// - `models`: of each variation
    ///
    /// # Errors
    /// As there.
    pub fn prepare_beside(
        models: [&MusculoskeletalModel; 2],
        recordings: [&Recording; 2],
        like: &PreparedTrial,
        options: &Options,
    ) -> Result<[PreparedTrial; 2], SimulationError> {
        let same_time = recordings.iter().all(|r| r.time == &*like.time);
        let mut activations: [Vec<Option<Arc<ActivationTrajectory>>>; 2] = [Vec::new(), Vec::new()];
        for (i, known) in like.muscles.iter().enumerate() {
            let dynamics = models.map(|m| &m.muscles[i].activation);
            let excitation = recordings.map(|r| r.excitation[i]);
            let differs =
                [0, 1].map(|side| *dynamics[side] != known.muscle.activation || excitation[side] != &*known.excitation);
            let long_enough = excitation.iter().all(|e| e.len() == like.time.len());
            let both = if same_time && long_enough && differs.contains(&true) {
                known.activation.beside(dynamics, &like.time, excitation).map(|a| Some(Arc::new(a)))
            } else {
                [None, None]
            };
            for (to, found) in activations.iter_mut().zip(both) {
                to.push(found);
            }
        }
        let [up, down] = [0, 1].map(|i| models[i].prepare_from(recordings[i], like, options, Some(&activations[i])));
        Ok([up?, down?])
    }

    /// - `beside`: activations in the steps of `like`, for muscles that are activated otherwise
    fn prepare_from(
        &self,
        recording: &Recording,
        like: &PreparedTrial,
        options: &Options,
        beside: Option<&[Option<Arc<ActivationTrajectory>>]>,
    ) -> Result<PreparedTrial, SimulationError> {
        let known = like.muscles.iter().map(|m| m.muscle.rigid_tendon);
        let same_tendons = self.muscles.iter().map(|m| m.rigid_tendon).eq(known);
        if recording.time != &*like.time || !same_tendons {
            let motion = self.checked_motion(recording, options)?;
            return self.prepare_with(recording, motion, Arc::clone(&like.tables), options);
        }
        let mut out = like.clone();
        let moves_otherwise = recording.angle != &*like.angle;
        if moves_otherwise {
            out.motion = Arc::new(self.checked_motion(recording, options)?);
            out.angle = recording.angle.into();
        } else {
            self.check_samples(recording)?;
        }
        let mut driven_otherwise = false;
        for (i, muscle) in self.muscles.iter().enumerate() {
            let known = &like.muscles[i];
            let excitation = recording.excitation[i];
            let same_activation = muscle.activation == known.muscle.activation && excitation == &*known.excitation;
            let same_muscle =
                Arc::ptr_eq(&muscle.curves, &known.muscle.curves) && muscle.nominal == known.muscle.nominal;
            if same_activation && same_muscle && !moves_otherwise {
                continue;
            }
            muscle.check(&muscle.nominal)?;
            let activation = if same_activation {
                Arc::clone(&known.activation)
            } else if let Some(found) = beside.and_then(|b| b[i].as_ref()) {
                Arc::clone(found)
            } else {
                Arc::new(ActivationTrajectory::integrate(&muscle.activation, recording.time, excitation))
            };
            let source = Source { activation: &activation, motion: &out.motion, path: &out.tables.muscles[i] };
            let plan = match &known.plan {
                Some(plan) if beside.is_some() || same_activation && !moves_otherwise => Some(Arc::clone(plan)),
                Some(plan) => Some(Arc::new(plan.driven_by(&source))),
                None => None,
            };
            let muscle = ActiveMuscle { path: Arc::clone(&known.muscle.path), ..muscle.clone() };
            let excitation = if same_activation { Arc::clone(&known.excitation) } else { excitation.into() };
            out.muscles[i] = Arc::new(PreparedMuscle { muscle, excitation, activation, plan });
            driven_otherwise |= !same_activation;
        }
        if moves_otherwise {
            out.kinematics = Arc::new(self.kinematics(recording.time, &out.motion, &out.tables, &out.muscles));
        } else if driven_otherwise {
            let kinematics = Arc::make_mut(&mut out.kinematics);
            for (series, prepared) in kinematics.muscles.iter_mut().zip(&out.muscles) {
                let mut cursor = 0;
                for (a, t) in series.activation.iter_mut().zip(&*out.time) {
                    *a = prepared.activation.value(*t, &mut cursor);
                }
            }
        }
        Ok(out)
    }
}

impl PreparedTrial {
    /// Fibre damping β of each active muscle.
    pub fn fiber_damping(&self) -> Vec<f64> {
        self.muscles.iter().map(|m| m.muscle.curves.damping).collect()
    }

    /// The same trial with other fibre damping.
    ///
    /// - `damping`: β of each active muscle, in order. The model without damping is another one (its fibre velocity comes
    ///   from an inverted curve), so a damped muscle needs more than 0 and an undamped one keeps 0.
    ///
    /// # Errors
    /// [`SimulationError::ParameterCount`]; [`SimulationError::InvalidParameter`] for a damping that is not allowed.
    pub fn with_fiber_damping(&self, damping: &[f64]) -> Result<PreparedTrial, SimulationError> {
        if damping.len() != self.muscles.len() {
            let (found, expected) = (damping.len(), self.muscles.len());
            return Err(SimulationError::ParameterCount { found, expected });
        }
        let mut trial = self.clone();
        for (prepared, &value) in trial.muscles.iter_mut().zip(damping) {
            let muscle = &mut Arc::make_mut(prepared).muscle;
            let (allowed, expected) = if muscle.curves.damping > 0.0 {
                (value > 0.0 && value <= 1.0, "more than 0 and at most 1")
            } else {
                (value == 0.0, "0, as the muscle has no damping")
            };
            if !allowed {
                let (muscle, property) = (muscle.name.clone(), "fiber_damping");
                return Err(SimulationError::InvalidParameter { muscle, property, value, expected });
            }
            muscle.curves = Arc::new(FiberCurves { damping: value, ..(*muscle.curves).clone() });
        }
        Ok(trial)
    }
}

/// Linear response of one muscle's moment to its excitation, along a simulated trial.
#[derive(Clone, Debug)]
pub struct ExcitationResponse {
    /// Per interval between samples: what activation becomes.
    activation: Vec<Relaxation>,
    /// The same for the normalized fibre length, driven by activation.
    fiber: Vec<Relaxation>,
    /// Per sample: moment per normalized fibre length [N·m], and per activation for a rigid tendon.
    moment_by_fiber: Vec<f64>,
    moment_by_activation: Vec<f64>,
    /// Activation at the start per excitation, and fibre length per activation: in equilibrium.
    start: [f64; 2],
}

/// What becomes of a disturbance in an interval in which ẏ = −λ y + g u, u linear: y' = left y + from[0] u + from[1] u'.
#[derive(Clone, Copy, Debug)]
struct Relaxation {
    left: f64,
    from: [f64; 2],
}

impl Relaxation {
    /// Coefficients at both ends are averaged.
    ///
    /// - `rate`: λ [1/s]; `gain`: g [1/s]; `h`: length of the interval [s]
    fn new(rate: [f64; 2], gain: [f64; 2], h: f64) -> Relaxation {
        let [rate, gain] = [rate, gain].map(|[a, b]| 0.5 * (a + b));
        let x = rate * h;
        let left = (-x).exp();
        // ∫ e^{−x(1−s)} ds and ∫ s e^{−x(1−s)} ds over 0…1.
        let (whole, late) = if x < 1e-3 {
            (1.0 - 0.5 * x, 0.5 - x / 6.0)
        } else {
            let whole = (1.0 - left) / x;
            (whole, (1.0 - whole) / x)
        };
        Relaxation { left, from: [whole - late, late].map(|w| w * gain * h) }
    }

    fn after(&self, y: f64, here: f64, next: f64) -> f64 {
        self.left * y + self.from[0] * here + self.from[1] * next
    }
}

impl PreparedTrial {
    /// Linearizes activation and fibre dynamics of a muscle along the trial.
    ///
    /// ```text
    /// δȧ = (∂ȧ/∂a) δa + (∂ȧ/∂e) δe,   δẋ = (∂ẋ/∂x) δx + (∂ẋ/∂a) δa,   δM = F_max r (∂f_T/∂x) δx
    /// ```
    /// with the mean coefficients of every interval between samples. Good to a few per mille at 100 Hz: for covariances, not for fits.
    ///
    /// - `solution`: of this trial and muscle
    /// - `excitation`: of this muscle, at the samples
    pub fn excitation_response(
        &self,
        muscle: usize,
        solution: &MuscleSolution,
        excitation: &[f64],
    ) -> ExcitationResponse {
        let arms = &self.kinematics.muscles[muscle].moment_arm;
        self.response(muscle, solution, excitation, |k| arms[k])
    }

    /// As [`PreparedTrial::excitation_response`], with the moment multiplied by a factor per sample.
    pub fn scaled_excitation_response(
        &self,
        muscle: usize,
        solution: &MuscleSolution,
        excitation: &[f64],
        factor: &[f64],
    ) -> ExcitationResponse {
        let arms = &self.kinematics.muscles[muscle].moment_arm;
        self.response(muscle, solution, excitation, |k| arms[k] * factor[k])
    }

    /// As [`PreparedTrial::excitation_response`] with a moment arm of 1: the response of the tendon force [N].
    pub fn force_response(&self, muscle: usize, solution: &MuscleSolution, excitation: &[f64]) -> ExcitationResponse {
        self.response(muscle, solution, excitation, |_| 1.0)
    }

    fn response(
        &self,
        muscle: usize,
        solution: &MuscleSolution,
        excitation: &[f64],
        arm: impl Fn(usize) -> f64,
    ) -> ExcitationResponse {
        let n = self.len();
        let prepared = &self.muscles[muscle];
        let kinematics = &self.kinematics.muscles[muscle];
        let fiber: Fiber = prepared.muscle.fiber(&solution.parameters);
        let dynamics = &prepared.muscle.activation;
        let max_velocity = fiber.curves.max_velocity;
        let force = solution.parameters.max_isometric_force;
        // Rates and gains of activation and fibre length at the samples [1/s].
        let mut activation = vec![[0.0; 2]; n];
        let mut length = vec![[0.0; 2]; n];
        let mut moment_by_fiber = vec![0.0; n];
        let mut moment_by_activation = vec![0.0; n];
        for k in 0..n {
            let a = kinematics.activation[k];
            activation[k] = dynamics.linearized(a, excitation[k]);
            let (x, rate) = (solution.fiber_length[k], solution.fiber_rate[k]);
            let arm = arm(k);
            if prepared.muscle.rigid_tendon {
                let near = |a: f64| fiber.rigid_tendon(a, kinematics.length[k], kinematics.lengthening_speed[k]).force;
                moment_by_activation[k] = arm * force * (near(a + 1e-4) - near(a)) / 1e-4;
                continue;
            }
            let drive = Drive { activation: a, length: kinematics.length[k] };
            let u = rate / max_velocity;
            let residual = fiber.residual(x, u, drive);
            let more = fiber.residual(x, u, Drive { activation: a + 1e-5, ..drive });
            let by_a = (more.r - residual.r) / 1e-5;
            let per = max_velocity / residual.by_u;
            length[k] = [(per * residual.by_x).max(1e-3), -per * by_a];
            moment_by_fiber[k] = arm * force * fiber.tendon_force(x, kinematics.length[k]).by_x;
        }
        let relax = |rates: &[[f64; 2]]| -> Vec<Relaxation> {
            let of = |k: usize| {
                let (a, b) = (rates[k], rates[k + 1]);
                Relaxation::new([a[0], b[0]], [a[1], b[1]], self.time[k + 1] - self.time[k])
            };
            (0..n - 1).map(of).collect()
        };
        let equilibrium = |[rate, gain]: [f64; 2]| if rate > 0.0 { gain / rate } else { 0.0 };
        let mut relaxing = relax(&activation);
        let mut awake = activation[0][1] > 0.0;
        if dynamics.ignored {
            // Activation is the excitation.
            relaxing.fill(Relaxation { left: 0.0, from: [0.0, 1.0] });
            awake = true;
        }
        ExcitationResponse {
            activation: relaxing,
            fiber: relax(&length),
            moment_by_fiber,
            moment_by_activation,
            start: [if awake { 1.0 } else { 0.0 }, equilibrium(length[0])],
        }
    }
}

impl ExcitationResponse {
    /// Moment [N·m] that a disturbance of excitation from sample `first` on causes; `disturbance` holds its values from
    /// there to its last sample that is not zero. Stops where less than 10⁻⁴ of the largest response is left.
    pub fn respond(&self, first: usize, disturbance: &[f64], mut emit: impl FnMut(usize, f64)) {
        let n = self.moment_by_fiber.len();
        let at = |k: usize| if k < first { 0.0 } else { disturbance.get(k - first).copied().unwrap_or(0.0) };
        // The trial starts in equilibrium with its first excitation.
        let mut a = at(0) * self.start[0];
        let mut x = a * self.start[1];
        let mut largest = 0.0_f64;
        // A disturbance rises from the sample before its first one.
        for k in first.saturating_sub(1)..n {
            emit(k, self.moment_by_fiber[k] * x + self.moment_by_activation[k] * a);
            largest = largest.max(x.abs() + a.abs());
            if k + 1 == n || k >= first + disturbance.len() && x.abs() + a.abs() <= 1e-4 * largest {
                break;
            }
            let before = a;
            a = self.activation[k].after(a, at(k), at(k + 1));
            x = self.fiber[k].after(x, before, a);
        }
    }
}
