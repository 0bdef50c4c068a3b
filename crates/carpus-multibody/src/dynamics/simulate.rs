//! Forward simulation: from a state and excitations to a trajectory.

use super::error::{DynamicsError, PlantError};
use super::path_jump::path_jump;
use super::plant::states::PlantState;
use super::plant::{DrivenPlant, Plant};
use carpus_numerics::numerics::{Bdf, Cost, Grouped, StiffSystem};
use nalgebra::{DMatrix, DVector};

/// Distance from the pole of a bushing's angles at which the motion through it is straight: |cos θy|.
const POLE: f64 = 1e-5;
/// Where the distance was larger at the last derivative, which differs from the step's end by Newton's last correction
/// only, the step does not end near the pole.
const FAR_FROM_POLE: f64 = 1e-3;
/// Length of a step after it, over that of the passage, and how many.
const SETTLING: f64 = 1e-5;
const SETTLING_STEPS: usize = 3;

/// How a simulation is made.
#[derive(Clone, Debug)]
pub struct ForwardOptions {
    /// Times at which the state is wanted, ascending, the first one being the start [s].
    pub times: Vec<f64>,
    /// Error allowed per step, relative to 1 rad, 1 m/s or rad/s, an activation of 1, or an optimal fibre length.
    pub accuracy: f64,
    /// Largest first step [s].
    pub first_step: f64,
    /// Least and largest step [s]: one that would have to be shorter ends the simulation.
    pub step_range: [f64; 2],
    /// Steps at most, rejected ones among them.
    pub most_steps: usize,
}

/// What a simulation gives.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Times [s].
    pub times: Vec<f64>,
    /// State at every time.
    pub states: Vec<PlantState>,
    /// What it cost.
    pub cost: Cost,
}

/// Simulates a plant forward.
///
/// - `excite`: excitation of every muscle at a time
///
/// # Errors
/// [`PlantError::Stopped`] where no step is small enough, [`PlantError::StepLimit`] where the end is not reached in as
/// many steps as are allowed.
pub fn simulate_forward(
    plant: &Plant,
    start: &PlantState,
    excite: impl FnMut(f64, &mut [f64]),
    options: &ForwardOptions,
) -> Result<Trajectory, PlantError> {
    let Some((&first, &last)) = options.times.first().zip(options.times.last()) else {
        return Ok(Trajectory { times: Vec::new(), states: Vec::new(), cost: Cost::default() });
    };
    let mut system = DrivenPlant::new(plant, excite);
    let mut x = plant.pack(start);
    if x.is_empty() {
        let states = vec![start.clone(); options.times.len()];
        return Ok(Trajectory { times: options.times.clone(), states, cost: Cost::default() });
    }
    let absolute = tolerances(plant, options.accuracy);
    let begin = |system: &mut DrivenPlant<_>, time: f64, x: &[f64], first_step: f64| {
        Bdf::new(system, time, x, &absolute, options.accuracy, first_step)
            .map(|bdf| bdf.with_step_range(options.step_range))
            .map_err(|error| PlantError::Stopped { time, reason: error.to_string(), jump: None })
    };
    let mut bdf = begin(&mut system, first, &x, options.first_step)?;
    let mut states = Vec::with_capacity(options.times.len());
    loop {
        while let Some(&at) = options.times.get(states.len()).filter(|at| **at <= bdf.time) {
            if at == bdf.time {
                x.copy_from_slice(bdf.state())
            } else {
                bdf.interpolate(at, &mut x)
            }
            push(&mut states, at, &x, &mut system);
        }
        if states.len() == options.times.len() {
            return Ok(Trajectory { times: options.times.clone(), states, cost: bdf.cost });
        }
        if bdf.cost.steps + bdf.cost.rejected >= options.most_steps {
            return Err(PlantError::StepLimit { most_steps: options.most_steps, time: bdf.time, end: last });
        }
        if let Err(error) = bdf.step(&mut system, last) {
            let jump = path_jump(plant, bdf.time, bdf.state(), &bdf.slope());
            return Err(PlantError::Stopped { time: bdf.time, reason: error.to_string(), jump });
        }
        if let Some(passage) = Passage::ahead(&bdf, &mut system) {
            let (end, after) = passage.through(&bdf, &mut system).map_err(|error| PlantError::Stopped {
                time: bdf.time,
                reason: format!("passing the pole of a bushing's angles: {error}"),
                jump: None,
            })?;
            let end = end.min(last);
            while let Some(&at) = options.times.get(states.len()).filter(|at| **at < end) {
                passage.state(at - bdf.time, bdf.state(), &mut x);
                push(&mut states, at, &x, &mut system);
            }
            let mut cost = bdf.cost;
            bdf = begin(&mut system, end, &after, options.first_step)?;
            cost.add(&bdf.cost);
            bdf.cost = cost;
        }
    }
}

fn push<E: FnMut(f64, &mut [f64])>(states: &mut Vec<PlantState>, at: f64, x: &[f64], system: &mut DrivenPlant<E>) {
    let excitation = system.excitation(at).to_vec();
    states.push(system.plant.unpack(at, x, &excitation, &mut system.work));
}

/// The passage through the pole of a bushing's angles, θy = ±π/2.
///
/// A bushing's damper D against rotation about x acts with D/cos² θy against all that would turn the motion aside, so
/// that a motion that comes near the pole goes straight through it, and θx changes by π. The equations have no value
/// there; steps towards it become ever shorter. Within [`POLE`] of it the motion is therefore straight.
struct Passage {
    /// Rates of all states.
    slope: Vec<f64>,
    /// Time until the pole is as far behind as it is now ahead [s].
    duration: f64,
}

impl Passage {
    /// The passage that is due, if any.
    fn ahead<E: FnMut(f64, &mut [f64])>(bdf: &Bdf, system: &mut DrivenPlant<E>) -> Option<Passage> {
        let plant = system.plant;
        if plant.pole_margin(&system.work) > FAR_FROM_POLE {
            return None;
        }
        let margin = plant.pole_margin_at(bdf.time, bdf.state(), &mut system.work);
        if margin > POLE {
            return None;
        }
        let mut passage = Passage { slope: bdf.slope(), duration: 0.0 };
        let mut x = bdf.state().to_vec();
        let mut squared = |after: f64| {
            passage.state(after, bdf.state(), &mut x);
            plant.pole_margin_at(bdf.time + after, &x, &mut system.work).powi(2)
        };
        // On a straight line the square of the distance is a parabola.
        let h = bdf.last_step();
        let (s0, s1, s2) = (margin * margin, squared(h), squared(2.0 * h));
        let curvature = (s2 - 2.0 * s1 + s0) / (2.0 * h * h);
        let slope = (s1 - s0) / h - curvature * h;
        let duration = -slope / curvature;
        let is_passage = curvature > 0.0 && slope < 0.0 && squared(duration).sqrt() < 2.0 * POLE;
        passage.duration = duration;
        is_passage.then_some(passage)
    }

    fn state(&self, after: f64, from: &[f64], x: &mut [f64]) {
        x.iter_mut().zip(from).zip(&self.slope).for_each(|((x, from), slope)| *x = from + after * slope);
    }

    /// Time and state behind the pole: speeds that the damper opposes have settled.
    fn through<E: FnMut(f64, &mut [f64])>(
        &self,
        bdf: &Bdf,
        system: &mut DrivenPlant<E>,
    ) -> Result<(f64, Vec<f64>), DynamicsError> {
        let n = self.slope.len();
        let (mut time, mut x) = (bdf.time + self.duration, vec![0.0; n]);
        self.state(self.duration, bdf.state(), &mut x);
        // Linearly implicit Euler steps.
        let step = SETTLING * self.duration;
        let (mut jacobian, mut change) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for _ in 0..SETTLING_STEPS {
            system.jacobian(time, &x, &mut jacobian)?;
            system.derivative(time, &x, change.as_mut_slice())?;
            change *= step;
            let factors = Grouped::new(&jacobian, step, &system.groups()).ok_or(DynamicsError::NotFinite)?;
            factors.solve_mut(&mut change);
            x.iter_mut().zip(change.iter()).for_each(|(x, change)| *x += change);
            time += step;
        }
        Ok((time, x))
    }
}

/// Error allowed for every state.
fn tolerances(plant: &Plant, accuracy: f64) -> Vec<f64> {
    let mut absolute = vec![accuracy; plant.n_states()];
    for muscle in &plant.muscles {
        if let Some(i) = muscle.fiber_length {
            absolute[i] = accuracy * muscle.muscle.equilibrium_state_scale();
        }
    }
    absolute
}
