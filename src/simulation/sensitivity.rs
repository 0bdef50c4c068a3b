//! How a muscle's force changes with anything that changes a trial: excitation, angle, properties of the muscle.
//!
//! The fibre's length obeys R(x, ẋ; drive, properties) = 0. Along a solution x(t) a change in a direction d obeys
//!
//! ```text
//! (∂R/∂x) s + (∂R/∂ẋ) ṡ + ∂R/∂d = 0,   s = dx/dd
//! ```
//! which is solved in the steps in which x was found, so that s is the derivative of the numbers computed. Only ∂R/∂d is a
//! difference, of closed formulas on both sides at the same x: its error is that of rounding and of the step squared.

use std::sync::Arc;

use super::error::SimulationError;
use super::fiber::equation::{Drive, Fiber};
use super::fiber::integrate::{Cursor, DriveSource, StepTaken};
use super::fiber::radau::{INVERSE_BUTCHER, NewtonMatrix, STAGES, dot, stage_weights};
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
    pub(crate) parameters: MuscleParameters,
    /// Normalized fibre length, and its rate [1/s].
    pub(crate) fiber_length: Vec<f64>,
    pub(crate) fiber_rate: Vec<f64>,
    pub(super) steps: Vec<StepTaken>,
}

/// One side of a difference.
struct Side<'a> {
    fiber: Fiber,
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

    fn side(&self, like: &PreparedTrial, muscle: usize, parameters: &MuscleParameters) -> Side<'_> {
        let (own, known) = (&self.muscles[muscle], &like.muscles[muscle]);
        let kinematics = &self.kinematics.muscles[muscle];
        let source = Source { activation: &own.activation, motion: &self.motion, path: &self.tables.muscles[muscle] };
        Side {
            fiber: own.muscle.fiber(parameters),
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
        let parameters = &solution.parameters;
        let mut sides = sides.map(|side| side.side(self, muscle, parameters));
        let n = self.len();
        let Some(plan) = &self.muscles[muscle].plan else {
            let force = |side: &Side, k: usize| {
                side.fiber.rigid_tendon(side.activation[k], side.length[k], side.speed[k]).force
            };
            return Some((0..n).map(|k| per * (force(&sides[0], k) - force(&sides[1], k))).collect());
        };
        let fiber = self.muscles[muscle].muscle.fiber(parameters);
        let lengths = self.fiber_length_derivative(&fiber, solution, plan.initial, &mut sides, per);
        let path = &self.kinematics.muscles[muscle].length;
        let [up, down] = &sides;
        let series = (0..n).map(|k| {
            let x = solution.fiber_length[k];
            let direct =
                up.fiber.tendon_force(x, up.length[k]).value - down.fiber.tendon_force(x, down.length[k]).value;
            fiber.tendon_force(x, path[k]).by_x * lengths[k] + per * direct
        });
        Some(series.collect())
    }

    /// s at every sample.
    ///
    /// - `initial`: what drives the fibre at the first sample
    fn fiber_length_derivative(
        &self,
        fiber: &Fiber,
        solution: &MuscleSolution,
        initial: Drive,
        sides: &mut [Side; 2],
        per: f64,
    ) -> Vec<f64> {
        let n = self.len();
        let shortest = per * (sides[0].fiber.shortest - sides[1].fiber.shortest);
        let x = solution.fiber_length[0];
        let mut out = vec![shortest; n];
        let mut s = shortest;
        if x > fiber.shortest {
            let [up, down] = [0, 1].map(|i| {
                let side = &mut sides[i];
                let drive = side.drive(self.time[0], initial);
                side.fiber.static_residual(x, drive)[0]
            });
            s = -per * (up - down) / fiber.static_residual(x, initial)[1];
        }
        out[0] = s;
        let mut sample = 1;
        for step in &solution.steps {
            let h = step.input.h;
            let end = step.start + h;
            let Some((from, z)) = step.path else {
                s = shortest;
                while sample < n && self.time[sample] <= end {
                    sample += 1;
                }
                continue;
            };
            let per_h = 1.0 / h;
            let (mut by_x, mut by_u, mut direct) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            for i in 0..3 {
                let (x, rate) = (from + z[i], per_h * dot(INVERSE_BUTCHER[i], z));
                let drive = step.input.drive[i];
                let own = fiber.residual(x, rate / fiber.curves.max_velocity, drive);
                (by_x[i], by_u[i]) = (own.by_x, own.by_u);
                let time = if i == 2 { end } else { step.start + STAGES[i] * h };
                let [up, down] = [0, 1].map(|i| {
                    let side = &mut sides[i];
                    let drive = side.drive(time, drive);
                    side.fiber.residual(x, rate / side.fiber.curves.max_velocity, drive).r
                });
                direct[i] = per * (up - down);
            }
            let right = [0, 1, 2].map(|i| -(by_x[i] * s + direct[i]));
            let rises = NewtonMatrix::new(by_x, by_u, per_h / fiber.curves.max_velocity)
                .map_or([0.0; 3], |matrix| matrix.solve(right));
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
