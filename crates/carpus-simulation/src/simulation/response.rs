//! Linear response of muscles' moments to small changes of excitation and of the joint's angle, along a simulated
//! trial.

use std::sync::Arc;

use super::fiber::equation::{Drive, Fiber};
use super::model::MusculoskeletalModel;
use super::sensitivity::MuscleSolution;
use super::tables::MOMENT_ARM;
use super::trial::{MuscleKinematics, PreparedTrial, TrialKinematics};

/// Differences of angle [rad] and its rates [rad/s, rad/s²], path length [m] and its speed [m/s], for derivatives of
/// formulas and tables.
const SMALL_ANGLE: f64 = 1e-3;
const SMALL_LENGTH: f64 = 1e-6;
const SMALL_SPEED: f64 = 1e-4;

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

/// What becomes of a disturbance in an interval in which ẏ = −λ y + g u, u linear: y' = left y + from[0] u + from[1]
/// u'.
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
    /// with the mean coefficients of every interval between samples. Of the response to a disturbance of 0.1 s at 100
    /// Hz 0.5 to 4 % off (root of squares over time): for covariances, not for fits.
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
        let force = solution.parameters.max_isometric_force;
        // Rates and gains of activation and fibre length at the samples [1/s].
        let mut activation = vec![[0.0; 2]; n];
        let mut length = vec![[0.0; 2]; n];
        let mut moment_by_fiber = vec![0.0; n];
        let mut moment_by_activation = vec![0.0; n];
        for k in 0..n {
            let a = kinematics.activation[k];
            activation[k] = dynamics.linearized(a, excitation[k]);
            let arm = arm(k);
            if prepared.muscle.rigid_tendon {
                let near = |a: f64| fiber.rigid_tendon(a, kinematics.length[k], kinematics.lengthening_speed[k]).force;
                moment_by_activation[k] = arm * force * (near(a + 1e-4) - near(a)) / 1e-4;
                continue;
            }
            let at = At::sample(&fiber, solution, kinematics, k);
            let more = |by: f64| at.residual(&fiber, Drive { activation: a + by, ..at.drive });
            length[k] = [at.rate, at.gain((more(1e-5) - more(0.0)) / 1e-5)];
            moment_by_fiber[k] = arm * force * fiber.tendon_force(at.x, kinematics.length[k]).by_x;
        }
        let mut relaxing = self.relaxations(&activation);
        let mut awake = activation[0][1] > 0.0;
        if dynamics.is_ignored() {
            // Activation is the excitation.
            relaxing.fill(Relaxation { left: 0.0, from: [0.0, 1.0] });
            awake = true;
        }
        ExcitationResponse {
            activation: relaxing,
            fiber: self.relaxations(&length),
            moment_by_fiber,
            moment_by_activation,
            start: [if awake { 1.0 } else { 0.0 }, equilibrium(length[0])],
        }
    }

    /// Linearizes the moment of everything but the muscles (passive forces, weight, inertia, drag) by the joint's angle
    /// and its rates along the trial.
    ///
    /// - `model`: with the forces of this trial
    pub fn rest_response(&self, model: &MusculoskeletalModel) -> RestResponse {
        let side = |series: fn(&mut TrialKinematics) -> &mut Vec<f64>, step: f64| {
            let mut moved = (*self.kinematics).clone();
            series(&mut moved).iter_mut().for_each(|v| *v += step);
            model.passive_moments(&mut moved, &self.tables);
            moved.moment_without_muscles()
        };
        let by = |series, step: f64| -> Vec<f64> {
            let (up, down) = (side(series, step), side(series, -step));
            up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * step)).collect()
        };
        RestResponse {
            by_angle: by(|k| &mut k.angle, SMALL_ANGLE),
            by_speed: by(|k| &mut k.speed, SMALL_ANGLE),
            by_acceleration: by(|k| &mut k.acceleration, SMALL_ANGLE),
            time: Arc::clone(&self.time),
        }
    }

    /// Linearizes the moment of all active muscles by the joint's angle along the trial, excitations held.
    ///
    /// ```text
    /// δẋ = (∂ẋ/∂x) δx − (∂ẋ/∂l) r δq,   δM = F_max ((r ∂f_T/∂x) δx + (∂r/∂q f_T − r² ∂f_T/∂l) δq)
    /// ```
    /// As accurate as [`PreparedTrial::excitation_response`].
    ///
    /// - `solutions`: of this trial, per active muscle
    /// - `factors`: of each muscle's moment, per sample
    pub fn angle_response(&self, solutions: &[MuscleSolution], factors: &[Vec<f64>]) -> AngleResponse {
        let muscles = solutions.iter().zip(factors).enumerate();
        let of =
            |(muscle, (solution, factor)): (usize, (_, &Vec<f64>))| self.angle_response_of(muscle, solution, factor);
        AngleResponse { muscles: muscles.map(of).collect() }
    }

    fn angle_response_of(&self, muscle: usize, solution: &MuscleSolution, factor: &[f64]) -> MuscleByAngle {
        let n = self.len();
        let prepared = &self.muscles[muscle];
        let kinematics = &self.kinematics.muscles[muscle];
        let fiber: Fiber = prepared.muscle.fiber(&solution.parameters);
        let table = &self.tables.muscles[muscle];
        let mut cursor = 0;
        let mut arm_at = |angle: f64| table.quantity::<MOMENT_ARM>(angle, &mut cursor);
        let mut length = vec![[0.0; 2]; n];
        let [mut by_fiber, mut by_angle, mut by_speed] = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        for k in 0..n {
            let (arm, path) = (kinematics.moment_arm[k], kinematics.length[k]);
            let angle = self.kinematics.angle[k];
            let arm_slope = (arm_at(angle + SMALL_ANGLE) - arm_at(angle - SMALL_ANGLE)) / (2.0 * SMALL_ANGLE);
            let strength = factor[k] * solution.parameters.max_isometric_force;
            let scale = strength * arm;
            let (value, by_change_of_angle);
            if prepared.muscle.rigid_tendon {
                let speed = kinematics.lengthening_speed[k];
                let near = |length, speed| fiber.rigid_tendon(kinematics.activation[k], length, speed).force;
                value = near(path, speed);
                let by_length =
                    (near(path + SMALL_LENGTH, speed) - near(path - SMALL_LENGTH, speed)) / (2.0 * SMALL_LENGTH);
                let by_lengthening =
                    (near(path, speed + SMALL_SPEED) - near(path, speed - SMALL_SPEED)) / (2.0 * SMALL_SPEED);
                // The path lengthens by −r q̇.
                by_change_of_angle = -arm * by_length - arm_slope * self.kinematics.speed[k] * by_lengthening;
                by_speed[k] = -scale * arm * by_lengthening;
            } else {
                let at = At::sample(&fiber, solution, kinematics, k);
                let force = |by: f64| fiber.tendon_force(at.x, path + by);
                let residual = |by: f64| at.residual(&fiber, Drive { length: path + by, ..at.drive });
                let difference =
                    |of: &dyn Fn(f64) -> f64| (of(SMALL_LENGTH) - of(-SMALL_LENGTH)) / (2.0 * SMALL_LENGTH);
                length[k] = [at.rate, -arm * at.gain(difference(&residual))];
                value = force(0.0).value;
                by_change_of_angle = -arm * difference(&|by| force(by).value);
                by_fiber[k] = scale * force(0.0).by_x;
            }
            by_angle[k] = scale * by_change_of_angle + strength * arm_slope * value;
        }
        let (fiber, start) = (self.relaxations(&length), equilibrium(length[0]));
        MuscleByAngle { fiber, start, by_fiber, by_angle, by_speed, time: self.time.clone() }
    }

    /// Of a quantity with these rates and gains at the samples, per interval between them.
    fn relaxations(&self, rates: &[[f64; 2]]) -> Vec<Relaxation> {
        let of = |k: usize| {
            let (a, b) = (rates[k], rates[k + 1]);
            Relaxation::new([a[0], b[0]], [a[1], b[1]], self.time[k + 1] - self.time[k])
        };
        (0..rates.len() - 1).map(of).collect()
    }
}

/// A fibre at a sample.
struct At {
    x: f64,
    u: f64,
    drive: Drive,
    /// λ: how fast a disturbance of its length dies away [1/s].
    rate: f64,
    /// Normalized rate per residual [1/s].
    per: f64,
}

impl At {
    fn sample(fiber: &Fiber, solution: &MuscleSolution, kinematics: &MuscleKinematics, k: usize) -> At {
        let x = solution.fiber_length[k];
        let u = solution.fiber_rate[k] / fiber.curves.max_velocity;
        let drive = Drive { activation: kinematics.activation[k], length: kinematics.length[k] };
        let residual = fiber.residual(x, u, drive);
        let per = fiber.curves.max_velocity / residual.by_u;
        At { x, u, drive, rate: (per * residual.by_x).max(1e-3), per }
    }

    fn residual(&self, fiber: &Fiber, drive: Drive) -> f64 {
        fiber.residual(self.x, self.u, drive).r
    }

    /// What changes the residual so changes the fibre's rate [1/s].
    fn gain(&self, residual_by: f64) -> f64 {
        -self.per * residual_by
    }
}

/// What a lasting disturbance becomes.
fn equilibrium([rate, gain]: [f64; 2]) -> f64 {
    if rate > 0.0 { gain / rate } else { 0.0 }
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

/// Linear response of the muscles' moment to the joint's angle, along a simulated trial.
#[derive(Clone, Debug)]
pub struct AngleResponse {
    muscles: Vec<MuscleByAngle>,
}

#[derive(Clone, Debug)]
struct MuscleByAngle {
    /// Per interval between samples: what the normalized fibre length becomes, driven by the angle.
    fiber: Vec<Relaxation>,
    /// Fibre length at the start per angle: in equilibrium.
    start: f64,
    /// Per sample: moment per normalized fibre length [N·m], per angle [N·m/rad] and, for a rigid tendon, per speed
    /// [N·m·s/rad].
    by_fiber: Vec<f64>,
    by_angle: Vec<f64>,
    by_speed: Vec<f64>,
    time: Arc<[f64]>,
}

impl AngleResponse {
    /// Change of the muscles' moment [N·m] that a change of the angle causes.
    ///
    /// - `change`: of the angle, at the samples [rad]
    pub fn moment(&self, change: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; change.len()];
        // Nothing happens before the first change.
        let Some(first) = change.iter().position(|c| *c != 0.0) else { return out };
        for muscle in &self.muscles {
            muscle.add_moment(first.saturating_sub(1), change, &mut out);
        }
        out
    }
}

impl MuscleByAngle {
    fn add_moment(&self, first: usize, change: &[f64], out: &mut [f64]) {
        let mut x = change[first] * self.start;
        for k in first..change.len() {
            out[k] += self.by_fiber[k] * x + self.by_angle[k] * change[k];
            if self.by_speed[k] != 0.0 {
                out[k] += self.by_speed[k] * rates(&self.time, change, k)[0];
            }
            if let Some(interval) = self.fiber.get(k) {
                x = interval.after(x, change[k], change[k + 1]);
            }
        }
    }
}

/// Linear response of everything but the muscles to the joint's angle, along a simulated trial.
#[derive(Clone, Debug)]
pub struct RestResponse {
    /// Per sample [N·m/rad, N·m·s/rad, N·m·s²/rad].
    by_angle: Vec<f64>,
    by_speed: Vec<f64>,
    by_acceleration: Vec<f64>,
    time: Arc<[f64]>,
}

impl RestResponse {
    /// Adds the change of moment [N·m] that a change of the angle causes; its rates are those of parabolas.
    ///
    /// - `change`: of the angle, at the samples [rad]
    pub fn add_moment(&self, change: &[f64], moment: &mut [f64]) {
        for (k, moment) in moment.iter_mut().enumerate() {
            let [speed, acceleration] = rates(&self.time, change, k);
            *moment += self.by_angle[k] * change[k] + self.by_speed[k] * speed + self.by_acceleration[k] * acceleration;
        }
    }
}

/// First and second derivative at a sample, by the parabola through three.
fn rates(time: &[f64], values: &[f64], k: usize) -> [f64; 2] {
    let middle = k.clamp(1, values.len() - 2);
    let [a, b] = [time[middle] - time[middle - 1], time[middle + 1] - time[middle]];
    let slopes = [(values[middle] - values[middle - 1]) / a, (values[middle + 1] - values[middle]) / b];
    let second = 2.0 * (slopes[1] - slopes[0]) / (a + b);
    let first = (slopes[0] * b + slopes[1] * a) / (a + b);
    [first + second * (time[k] - time[middle]), second]
}
