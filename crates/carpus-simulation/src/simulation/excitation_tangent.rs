//! How a muscle's activation and force follow a small change of its excitation, or of its time constants of activation,
//! for many changes along one simulated trial.
//!
//! The steps in which activation and fibre length were found are linearized once; a change is then passed through them
//! with a few multiplications per step. It is the derivative of the numbers computed, as
//! [`PreparedTrial::force_derivative`] gives it, except that between the ends of a step of activation a cubic stands
//! for the quintic.

use super::activation_trajectory::tangent::{ActivationTangent, Interpolation};
use super::fiber::equation::Drive;
use super::fiber::radau::{NewtonMatrix, STAGES, dot, stage_weights};
use super::sensitivity::{LinearStep, MuscleSolution};
use super::trial::PreparedTrial;

/// Change of activation for differences of the fibre's equation, in which it is nearly linear.
const SMALL_ACTIVATION: f64 = 1e-4;

/// Linearization of one muscle's activation and force along a trial.
#[derive(Clone, Debug)]
pub struct ExcitationTangent {
    activation: ActivationTangent,
    /// Of activation, at the samples.
    at_samples: Vec<Interpolation>,
    /// Change of the fibre's length at the first sample per change of activation.
    initial: f64,
    /// `None` where the fibre rests at its shortest length.
    steps: Vec<Option<Step>>,
    /// Per sample: the step that it falls into, and weights of the change of length at its start and of the rises
    /// within it.
    samples: Vec<Sample>,
}

/// One step of the fibre.
#[derive(Clone, Debug)]
struct Step {
    /// Of activation, at the stages.
    stages: [Interpolation; 3],
    /// ∂R/∂x and ∂R/∂a at the stages.
    by_x: [f64; 3],
    by_activation: [f64; 3],
    matrix: Option<NewtonMatrix>,
    ends_shortest: bool,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// `None` after the last step.
    step: Option<usize>,
    rises: [f64; 3],
    /// At the end of the step.
    at_end: bool,
    /// Tendon force over maximum isometric force, per normalized fibre length.
    force: f64,
}

/// What a change of excitation or of time constants does, per sample.
#[derive(Clone, Debug)]
pub struct ForceChange {
    /// To activation.
    pub activation: Vec<f64>,
    /// To tendon force over maximum isometric force.
    pub force: Vec<f64>,
}

impl PreparedTrial {
    /// Linearizes a muscle along the trial; `None` for a rigid tendon.
    ///
    /// - `solution`: of this trial and muscle
    pub fn excitation_tangent(&self, muscle: usize, solution: &MuscleSolution) -> Option<ExcitationTangent> {
        let prepared = &self.muscles[muscle];
        let plan = prepared.plan.as_ref()?;
        let fiber = prepared.muscle.fiber(&solution.parameters);
        let activation = prepared.activation.tangent(&prepared.muscle.activation, &self.time, &prepared.excitation);
        let mut cursor = 0;
        let at_samples = self.time.iter().map(|t| prepared.activation.interpolation(*t, &mut cursor)).collect();
        let mut cursor = 0;
        let mut steps = Vec::with_capacity(solution.steps.len());
        let known = solution.linearization(&fiber, &self.kinematics.muscles[muscle].length);
        for (step, linear) in solution.steps.iter().zip(&known.steps) {
            let Some(LinearStep { undriven, by_x, matrix }) = linear else {
                steps.push(None);
                continue;
            };
            let h = step.input.h;
            let mut stages = [Interpolation::default(); 3];
            let mut by_activation = [0.0; 3];
            for i in 0..3 {
                let time = step.start + if i == 2 { h } else { STAGES[i] * h };
                stages[i] = prepared.activation.interpolation(time, &mut cursor);
                let Drive { activation, length } = step.input.drive[i];
                let pull = fiber.pull(&undriven[i], length);
                let imbalance = |activation| fiber.imbalance(&undriven[i], activation, pull);
                by_activation[i] = slope_by_activation(activation, imbalance);
            }
            let (by_x, matrix, ends_shortest) = (*by_x, matrix.clone(), step.ends_shortest);
            steps.push(Some(Step { stages, by_x, by_activation, matrix, ends_shortest }));
        }
        let x = solution.fiber_length[0];
        let initial = if !fiber.starts_at_rest(plan.initial_speed) {
            slope_by_activation(plan.initial.activation, |activation| {
                fiber.start(Drive { activation, ..plan.initial }, plan.initial_speed).0
            })
        } else if x > fiber.shortest {
            let by_activation = slope_by_activation(plan.initial.activation, |activation| {
                fiber.static_residual(x, Drive { activation, ..plan.initial })[0]
            });
            -by_activation / fiber.static_residual(x, plan.initial)[1]
        } else {
            0.0
        };
        let samples = self.samples(&known.force, solution);
        Some(ExcitationTangent { activation, at_samples, initial, steps, samples })
    }

    /// - `force`: tendon force per normalized fibre length, per sample
    fn samples(&self, force: &[f64], solution: &MuscleSolution) -> Vec<Sample> {
        let mut step = 0;
        let of = |(time, force): (&f64, &f64)| {
            let force = *force;
            while solution.steps.get(step).is_some_and(|s| s.start + s.input.h < *time) {
                step += 1;
            }
            let Some(taken) = solution.steps.get(step) else {
                return Sample { step: None, rises: [0.0; 3], at_end: true, force };
            };
            let part = (time - taken.start) / taken.input.h;
            let at_end = *time >= taken.start + taken.input.h;
            Sample { step: Some(step), rises: stage_weights(part), at_end, force }
        };
        self.time.iter().zip(force).map(of).collect()
    }
}

/// Derivative by activation.
fn slope_by_activation(activation: f64, residual: impl Fn(f64) -> f64) -> f64 {
    let [up, down] = [SMALL_ACTIVATION, -SMALL_ACTIVATION].map(|by| residual(activation + by));
    (up - down) / (2.0 * SMALL_ACTIVATION)
}

impl ExcitationTangent {
    /// What a change of the excitation does to activation and force.
    ///
    /// - `change`: at the samples, linear between them
    pub fn follow(&self, change: &[f64]) -> ForceChange {
        self.follow_activation(&self.activation.follow(change))
    }

    /// What a change of its time constants does.
    ///
    /// - `change`: of the logarithms of the activation and the deactivation time constant
    pub fn follow_time_constants(&self, change: [f64; 2]) -> ForceChange {
        self.follow_activation(&self.activation.follow_time_constants(change))
    }

    /// - `pieces`: changes of activation, per step of it
    fn follow_activation(&self, pieces: &[[f64; 4]]) -> ForceChange {
        let activation: Vec<f64> = self.at_samples.iter().map(|at| at.of(pieces)).collect();
        let mut s = activation[0] * self.initial;
        let mut force = Vec::with_capacity(self.samples.len());
        let mut samples = self.samples.iter().peekable();
        // The trial starts at the first sample.
        force.extend(samples.next().map(|first| first.force * s));
        for (i, step) in self.steps.iter().enumerate() {
            let (end, rises) = match step {
                None => (0.0, [0.0; 3]),
                Some(Step { stages, by_x, by_activation, matrix, ends_shortest }) => {
                    let right = [0, 1, 2].map(|i| -(by_x[i] * s + by_activation[i] * stages[i].of(pieces)));
                    let rises = matrix.as_ref().map_or([0.0; 3], |matrix| matrix.solve(right));
                    (if *ends_shortest { 0.0 } else { s + rises[2] }, rises)
                }
            };
            while let Some(sample) = samples.next_if(|sample| sample.step == Some(i)) {
                let here = if sample.at_end || step.is_none() { end } else { s + dot(sample.rises, rises) };
                force.push(sample.force * here);
            }
            s = end;
        }
        force.extend(samples.map(|sample| sample.force * s));
        ForceChange { activation, force }
    }
}
