//! How a muscle's force changes with anything that changes a trial: excitation, angle, properties of the muscle.
//!
//! The fibre's length obeys R(x, ẋ; drive, properties) = 0. Along a solution x(t) a change in a direction d obeys
//!
//! ```text
//! (∂R/∂x) s + (∂R/∂ẋ) ṡ + ∂R/∂d = 0,   s = dx/dd
//! ```
//! which is solved in the steps in which x was found, so that s is the derivative of the numbers computed. Only ∂R/∂d
//! is a difference, of closed formulas on both sides at the same x: its error is that of rounding and of the step
//! squared. What all directions have in common is computed with the first one.

use std::sync::{Arc, OnceLock};

use super::error::SimulationError;
use super::fiber::equation::{Drive, Fiber, Undriven};
use super::fiber::radau::{INVERSE_BUTCHER, NewtonMatrix, STAGES, dot, stage_weights};
use super::fiber::step::{Cursor, DriveSource, StepTaken};
use super::model::MuscleParameters;
use super::trial::{PreparedTrial, Source};

/// A muscle's force over a trial, its derivatives by the muscle's lengths, and what further derivatives need.
#[derive(Clone, Debug)]
pub struct MuscleSolution {
    /// Tendon force over maximum isometric force, per sample.
    pub force: Vec<f64>,
    /// Its derivative by optimal fibre length [1/m].
    pub by_optimal_fiber_length: Vec<f64>,
    /// Its derivative by tendon slack length [1/m].
    pub by_tendon_slack_length: Vec<f64>,
    /// Parameters of the muscle.
    pub parameters: MuscleParameters,
    /// Normalized fibre length, and its rate [1/s].
    pub(crate) fiber_length: Vec<f64>,
    pub(crate) fiber_rate: Vec<f64>,
    pub(super) steps: Vec<StepTaken>,
    linearization: OnceLock<Linearization>,
}

/// A muscle's force along its solution, linearized by fibre length.
#[derive(Clone, Debug)]
pub(super) struct Linearization {
    /// `None` where the fibre rests at its shortest length.
    pub(super) steps: Vec<Option<LinearStep>>,
    /// Normalized tendon force by normalized fibre length, per sample.
    pub(super) force: Vec<f64>,
}

#[derive(Clone, Debug)]
pub(super) struct LinearStep {
    /// At the stages.
    pub(super) undriven: [Undriven; 3],
    /// ∂R/∂x at the stages.
    pub(super) by_x: [f64; 3],
    /// `None` if it is singular.
    pub(super) matrix: Option<NewtonMatrix>,
}

impl MuscleSolution {
    /// - `fiber`: the muscle; `path`: length of its path per sample [m]
    pub(super) fn linearization(&self, fiber: &Fiber, path: &[f64]) -> &Linearization {
        self.linearization.get_or_init(|| Linearization::new(fiber, self, path))
    }
}

impl Linearization {
    /// - `path`: length of the path per sample [m]
    fn new(fiber: &Fiber, solution: &MuscleSolution, path: &[f64]) -> Linearization {
        let steps = solution.steps.iter().map(|step| {
            step.path?;
            let (mut by_x, mut by_u) = ([0.0; 3], [0.0; 3]);
            let undriven = [0, 1, 2].map(|i| {
                let (x, rate) = stage(step, i);
                let u = rate / fiber.curves.max_velocity;
                let own = fiber.residual(x, u, step.input.drive[i]);
                (by_x[i], by_u[i]) = (own.by_x, own.by_u);
                fiber.undriven(x, u)
            });
            let matrix = NewtonMatrix::new(by_x, by_u, 1.0 / step.input.h / fiber.curves.max_velocity);
            Some(LinearStep { undriven, by_x, matrix })
        });
        let force = solution.fiber_length.iter().zip(path).map(|(x, length)| fiber.tendon_force(*x, *length).by_x);
        Linearization { steps: steps.collect(), force: force.collect() }
    }
}

/// Normalized fibre length at a stage of a step, and its rate [1/s].
fn stage(step: &StepTaken, i: usize) -> (f64, f64) {
    let (from, z) = step.path.unwrap_or_default();
    (from + z[i], 1.0 / step.input.h * dot(INVERSE_BUTCHER[i], z))
}

/// One side of a difference.
struct Side<'a> {
    fiber: Fiber,
    /// The muscle is the trial's own.
    same_fiber: bool,
    source: Source<'a>,
    cursor: Cursor,
    /// Path length at the samples [m], its speed [m/s], activation.
    length: &'a [f64],
    speed: &'a [f64],
    activation: &'a [f64],
    /// Driven as the trial itself.
    same_drive: bool,
}

impl Side<'_> {
    fn drive(&mut self, time: f64, known: Drive) -> Drive {
        if self.same_drive { known } else { self.source.drive(time, &mut self.cursor) }
    }

    /// What R needs at a stage, from the trial's own where the muscle is the same.
    fn undriven(&self, known: &LinearStep, step: &StepTaken, i: usize) -> Undriven {
        if self.same_fiber {
            return known.undriven[i];
        }
        let (x, rate) = stage(step, i);
        self.fiber.undriven(x, rate / self.fiber.curves.max_velocity)
    }
}

/// Both sides of a difference.
struct Sides<'a> {
    sides: [Side<'a>; 2],
    /// Both are activated by the same trajectory, both move the same.
    same_activation: bool,
    same_motion: bool,
}

impl Sides<'_> {
    /// What drives both at a time; what they share is looked up once.
    fn drives(&mut self, time: f64, known: Drive) -> [Drive; 2] {
        let [up, down] = &mut self.sides;
        if up.same_drive || down.same_drive {
            return [up.drive(time, known), down.drive(time, known)];
        }
        let first = up.drive(time, known);
        let activation = match self.same_activation {
            true => first.activation,
            false => down.source.activation.value(time, &mut down.cursor.activation),
        };
        let length = match self.same_motion {
            true => first.length,
            false => down.source.length(time, &mut down.cursor),
        };
        [first, Drive { activation, length }]
    }

    /// Difference of R between the sides at the stage `i` of a step.
    ///
    /// - `known`: what the trial itself has there
    fn difference(&mut self, known: &LinearStep, step: &StepTaken, i: usize) -> f64 {
        let h = step.input.h;
        let time = if i == 2 { step.start + h } else { step.start + STAGES[i] * h };
        let drives = self.drives(time, step.input.drive[i]);
        let [up, down] = &self.sides;
        let above = up.undriven(known, step, i);
        let pull = up.fiber.pull(&above, drives[0].length);
        let first = up.fiber.imbalance(&above, drives[0].activation, pull);
        if up.same_fiber && down.same_fiber {
            let pull = match drives[1].length == drives[0].length {
                true => pull,
                false => down.fiber.pull(&above, drives[1].length),
            };
            return first - down.fiber.imbalance(&above, drives[1].activation, pull);
        }
        let below = down.undriven(known, step, i);
        first - down.fiber.imbalance(&below, drives[1].activation, down.fiber.pull(&below, drives[1].length))
    }
}

impl PreparedTrial {
    /// Follows one muscle and keeps its steps.
    ///
    /// # Errors
    /// As [`PreparedTrial::simulate`].
    pub fn solve(&self, muscle: usize, parameters: &MuscleParameters) -> Result<MuscleSolution, SimulationError> {
        self.muscles[muscle].muscle.check(parameters)?;
        let n = self.len();
        let mut out = MuscleSolution {
            force: vec![0.0; n],
            by_optimal_fiber_length: vec![0.0; n],
            by_tendon_slack_length: vec![0.0; n],
            parameters: *parameters,
            fiber_length: vec![0.0; n],
            fiber_rate: vec![0.0; n],
            steps: Vec::with_capacity(n),
            linearization: OnceLock::new(),
        };
        let steps = &mut out.steps;
        self.run_observed::<true>(
            muscle,
            parameters,
            |k, at| {
                out.force[k] = at.force;
                out.by_optimal_fiber_length[k] = at.force_by[0];
                out.by_tendon_slack_length[k] = at.force_by[1];
                (out.fiber_length[k], out.fiber_rate[k]) = (at.x, at.rate);
            },
            |step| steps.push(step),
        )?;
        Ok(out)
    }

    /// - `fiber`: the muscle of `like`
    fn side(&self, like: &PreparedTrial, muscle: usize, fiber: &Fiber, parameters: &MuscleParameters) -> Side<'_> {
        let (own, known) = (&self.muscles[muscle], &like.muscles[muscle]);
        let kinematics = &self.kinematics.muscles[muscle];
        let source = Source { activation: &own.activation, motion: &self.motion, path: &self.tables.muscles[muscle] };
        let own_fiber = own.muscle.fiber(parameters);
        Side {
            same_fiber: own_fiber.is_same(fiber),
            fiber: own_fiber,
            source,
            cursor: Cursor::default(),
            length: &kinematics.length,
            speed: &kinematics.lengthening_speed,
            activation: &kinematics.activation,
            same_drive: Arc::ptr_eq(&own.activation, &known.activation) && Arc::ptr_eq(&self.motion, &like.motion),
        }
    }

    /// Derivative of a muscle's normalized tendon force in a direction, per sample; `None` where nothing changes.
    ///
    /// - `solution`: of this trial and muscle
    /// - `sides`: the trial a little way in the direction and against it, from
    ///   [`MusculoskeletalModel::prepare_beside`](super::MusculoskeletalModel::prepare_beside)
    /// - `distance`: between the sides
    pub fn force_derivative(
        &self,
        muscle: usize,
        solution: &MuscleSolution,
        sides: [&PreparedTrial; 2],
        distance: f64,
    ) -> Option<Vec<f64>> {
        let unchanged = |side: &&PreparedTrial| {
            Arc::ptr_eq(&side.muscles[muscle], &self.muscles[muscle]) && Arc::ptr_eq(&side.motion, &self.motion)
        };
        if sides.iter().all(unchanged) {
            return None;
        }
        let per = 1.0 / distance;
        let fiber = self.muscles[muscle].muscle.fiber(&solution.parameters);
        let both = sides.map(|side| side.side(self, muscle, &fiber, &solution.parameters));
        let n = self.len();
        let Some(plan) = &self.muscles[muscle].plan else {
            let force = |side: &Side, k: usize| {
                side.fiber.rigid_tendon(side.activation[k], side.length[k], side.speed[k]).force
            };
            return Some((0..n).map(|k| per * (force(&both[0], k) - force(&both[1], k))).collect());
        };
        let path = &self.kinematics.muscles[muscle].length;
        let known = solution.linearization(&fiber, path);
        let mut sides = Sides {
            same_activation: std::ptr::eq(both[0].source.activation, both[1].source.activation),
            same_motion: std::ptr::eq(both[0].source.motion, both[1].source.motion),
            sides: both,
        };
        let lengths =
            self.fiber_length_derivative(&fiber, solution, known, (plan.initial, plan.initial_speed), &mut sides, per);
        let [up, down] = &sides.sides;
        let same_tendon = up.same_fiber && down.same_fiber && sides.same_motion;
        let series = (0..n).map(|k| {
            let x = solution.fiber_length[k];
            let direct = match same_tendon {
                true => 0.0,
                false => {
                    up.fiber.tendon_force(x, up.length[k]).value - down.fiber.tendon_force(x, down.length[k]).value
                }
            };
            known.force[k] * lengths[k] + per * direct
        });
        Some(series.collect())
    }

    /// s at every sample.
    ///
    /// - `initial`, `speed`: what drives the fibre at the first sample, and the speed of its path there [m/s]
    fn fiber_length_derivative(
        &self,
        fiber: &Fiber,
        solution: &MuscleSolution,
        known: &Linearization,
        (initial, speed): (Drive, f64),
        sides: &mut Sides,
        per: f64,
    ) -> Vec<f64> {
        let n = self.len();
        let shortest = per * (sides.sides[0].fiber.shortest - sides.sides[1].fiber.shortest);
        let x = solution.fiber_length[0];
        let mut out = vec![shortest; n];
        let mut s = shortest;
        if x > fiber.shortest {
            let drives = sides.drives(self.time[0], initial);
            let at_rest = sides.sides.iter().all(|side| side.fiber.starts_at_rest(side.speed[0]));
            s = if at_rest && fiber.starts_at_rest(speed) {
                let [up, down] = [0, 1].map(|i| sides.sides[i].fiber.static_residual(x, drives[i])[0]);
                -per * (up - down) / fiber.static_residual(x, initial)[1]
            } else {
                let [up, down] = [0, 1].map(|i| sides.sides[i].fiber.start(drives[i], sides.sides[i].speed[0]).0);
                per * (up - down)
            };
        }
        out[0] = s;
        let mut sample = 1;
        for (step, linear) in solution.steps.iter().zip(&known.steps) {
            let h = step.input.h;
            let end = step.start + h;
            let Some(linear) = linear else {
                s = shortest;
                while sample < n && self.time[sample] <= end {
                    sample += 1;
                }
                continue;
            };
            let per_h = 1.0 / h;
            let direct = [0, 1, 2].map(|i| per * sides.difference(linear, step, i));
            let right = [0, 1, 2].map(|i| -(linear.by_x[i] * s + direct[i]));
            let rises = linear.matrix.as_ref().map_or([0.0; 3], |matrix| matrix.solve(right));
            while sample < n && self.time[sample] < end {
                out[sample] = s + dot(stage_weights((self.time[sample] - step.start) * per_h), rises);
                sample += 1;
            }
            s = if step.ends_shortest { shortest } else { s + rises[2] };
            if sample < n && self.time[sample] <= end {
                out[sample] = s;
                sample += 1;
            }
        }
        out[sample..].fill(s);
        out
    }
}
