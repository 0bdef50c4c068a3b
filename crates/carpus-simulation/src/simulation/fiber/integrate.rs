//! A fibre over a whole trial: a step plan made once per trial and muscle, then followed for every parameter set.
//!
//! The plan's steps are those that error control chose for the model's own parameters, and the plan holds activation
//! and path length at every stage, so that a further parameter set looks nothing up, and the solution for the model's
//! own parameters, which is the answer for these and where the search for another one starts from. The error is
//! estimated again in every run; a step that misses the tolerance is halved until it does not.

use super::equation::{Drive, Fiber, PARAMETERS};
use super::plan::{PlannedStep, StepPlan};
use super::radau::{FiberState, StepInput, StepSolution, Work, stage_weights};
use super::step::{Attempt, Cursor, DriveSource, FiberAccuracy, FiberSample, StepTaken, Stuck, step_input, within};

/// Halvings of a planned step before giving up.
const MOST_HALVINGS: usize = 14;

impl Fiber {
    /// Initial state: as OpenSim's `equilibrateMuscles` leaves it.
    ///
    /// - `speed`: of the path [m/s]
    pub(crate) fn initial_state<const DERIVATIVES: bool>(
        &self,
        drive: Drive,
        speed: f64,
        work: &mut Work,
    ) -> FiberState {
        let (x, at_limit) = self.start(drive, speed);
        let (rate, stiffness) = self.rate(x, drive, work);
        let clamped = at_limit && rate <= 0.0;
        let by_parameters = match DERIVATIVES {
            true => self.start_by_parameters(x, at_limit, drive, speed),
            false => [0.0; PARAMETERS],
        };
        FiberState {
            x,
            rate: if clamped { 0.0 } else { rate },
            stiffness,
            by_parameters,
            clamped,
            previous: ([0.0; 3], 0.0),
        }
    }

    /// One step with the rules of the shortest fibre length: a fibre at x_min whose velocity would be negative stays
    /// there until it is positive.
    pub(super) fn attempt<const DERIVATIVES: bool>(
        &self,
        state: &mut FiberState,
        input: &StepInput,
        tolerance: f64,
        last_resort: bool,
        work: &mut Work,
    ) -> Attempt {
        if state.clamped {
            let releases = input.drive.iter().any(|&drive| self.velocity(self.shortest, drive, 0.0) > 0.0);
            work.residual_evaluations += 9;
            if !releases {
                work.steps += 1;
                return Attempt::Stays;
            }
            if !last_resort {
                return Attempt::Divide;
            }
            state.clamped = false;
            (state.rate, state.stiffness) = self.rate(state.x, input.drive[0], work);
        }
        let collocation = self.step::<DERIVATIVES>(state, input, work);
        let robust = || if last_resort { self.euler_step(state, input, work) } else { None };
        let Some(mut solution) = collocation.or_else(robust) else {
            return Attempt::Divide;
        };
        let below = solution.end.x < self.shortest;
        if (solution.error > tolerance || below && solution.end.x < self.shortest - tolerance) && !last_resort {
            return Attempt::Divide;
        }
        if below {
            solution.end.x = self.shortest;
            solution.end.by_parameters = self.shortest_by_parameters();
            solution.end.previous.1 = 0.0;
            solution.end.clamped = self.velocity(self.shortest, input.drive[2], 0.0) <= 0.0;
            if solution.end.clamped {
                solution.end.rate = 0.0;
            }
        }
        Attempt::Moves(solution)
    }

    /// Follows the plan; `emit` receives the fibre's state at every sample, in order, `observe` every step taken,
    /// before its samples.
    ///
    /// # Errors
    /// [`Stuck`] where Newton's method fails in the smallest step.
    pub(crate) fn follow<const DERIVATIVES: bool>(
        &self,
        plan: &StepPlan,
        source: &impl DriveSource,
        accuracy: &FiberAccuracy,
        mut emit: impl FnMut(usize, FiberSample),
        mut observe: impl FnMut(StepTaken),
    ) -> Result<Work, Stuck> {
        if !DERIVATIVES && plan.is_solved_for(self) {
            return Ok(plan.replay(emit, observe));
        }
        let mut work = Work::default();
        let mut state = self.initial_state::<DERIVATIVES>(plan.initial, plan.initial_speed, &mut work);
        emit(0, FiberSample { x: state.x, rate: state.rate, by_parameters: state.by_parameters });
        let mut sample = 1;
        for planned in &plan.steps {
            match self.attempt::<DERIVATIVES>(&mut state, &planned.input, accuracy.tolerance, false, &mut work) {
                Attempt::Stays => {
                    observe(StepTaken::resting(planned.start, &planned.input));
                    while sample < planned.samples_end {
                        emit(sample, self.resting());
                        sample += 1;
                    }
                }
                Attempt::Moves(solution) => {
                    observe(StepTaken::moving(planned.start, &planned.input, state.x, solution.z, solution.end.x));
                    while sample < planned.samples_end {
                        let weights = plan.weights[sample];
                        emit(sample, at_weights::<DERIVATIVES>(&state, &solution, weights, planned.input.h));
                        sample += 1;
                    }
                    state = solution.end;
                }
                Attempt::Divide => {
                    work.divided_steps += 1;
                    let mut division = Division {
                        fiber: self,
                        source,
                        times: &plan.times,
                        tolerance: accuracy.tolerance,
                        planned,
                        sample,
                        cursor: Cursor::default(),
                        work: &mut work,
                    };
                    let half = 0.5 * planned.input.h;
                    let middle = planned.start + half;
                    let end = planned.start + planned.input.h;
                    division.run::<DERIVATIVES>(&mut state, planned.start, middle, 1, &mut emit, &mut observe)?;
                    division.run::<DERIVATIVES>(&mut state, middle, end, 1, &mut emit, &mut observe)?;
                    sample = division.sample;
                    // Rounding of the last division's end must not lose the sample at the end of the step.
                    while sample < planned.samples_end {
                        let by_parameters = state.by_parameters;
                        emit(sample, FiberSample { x: state.x, rate: state.rate, by_parameters });
                        sample += 1;
                    }
                }
            }
        }
        Ok(work)
    }

    /// Sample of a fibre held at its shortest length.
    fn resting(&self) -> FiberSample {
        FiberSample { x: self.shortest, rate: 0.0, by_parameters: self.shortest_by_parameters() }
    }
}

/// State within a step from the weights of the stage increments.
#[inline]
fn at_weights<const DERIVATIVES: bool>(
    start: &FiberState,
    solution: &StepSolution,
    weights: [f64; 3],
    h: f64,
) -> FiberSample {
    if weights == [0.0, 0.0, 1.0] {
        let end = &solution.end;
        return FiberSample { x: end.x, rate: end.rate, by_parameters: end.by_parameters };
    }
    let mut sample = within(start.x, solution.z, weights, h);
    if DERIVATIVES {
        for p in 0..PARAMETERS {
            sample.by_parameters[p] =
                start.by_parameters[p] + (0..3).map(|i| weights[i] * solution.z_by_parameters[i][p]).sum::<f64>();
        }
    }
    sample
}

/// A planned step that is being halved.
struct Division<'a, S> {
    fiber: &'a Fiber,
    source: &'a S,
    times: &'a [f64],
    tolerance: f64,
    planned: &'a PlannedStep,
    sample: usize,
    cursor: Cursor,
    work: &'a mut Work,
}

impl<S: DriveSource> Division<'_, S> {
    fn run<const DERIVATIVES: bool>(
        &mut self,
        state: &mut FiberState,
        start: f64,
        end: f64,
        depth: usize,
        emit: &mut impl FnMut(usize, FiberSample),
        observe: &mut impl FnMut(StepTaken),
    ) -> Result<(), Stuck> {
        let local = |time: f64| (time - self.planned.start) / self.planned.input.h;
        let reference = self.planned.input.reference.part(self.planned.input.h, local(start), local(end));
        let input = StepInput { reference, ..step_input(self.source, start, end, &mut self.cursor) };
        let last_resort = depth >= MOST_HALVINGS;
        match self.fiber.attempt::<DERIVATIVES>(state, &input, self.tolerance, last_resort, self.work) {
            Attempt::Stays => {
                observe(StepTaken::resting(start, &input));
                while self.sample < self.planned.samples_end && self.times[self.sample] <= end {
                    emit(self.sample, self.fiber.resting());
                    self.sample += 1;
                }
                Ok(())
            }
            Attempt::Moves(solution) => {
                observe(StepTaken::moving(start, &input, state.x, solution.z, solution.end.x));
                while self.sample < self.planned.samples_end && self.times[self.sample] <= end {
                    let theta = (self.times[self.sample] - start) / input.h;
                    let weights = if theta >= 1.0 { [0.0, 0.0, 1.0] } else { stage_weights(theta) };
                    emit(self.sample, at_weights::<DERIVATIVES>(state, &solution, weights, input.h));
                    self.sample += 1;
                }
                *state = solution.end;
                Ok(())
            }
            Attempt::Divide if last_resort => Err(Stuck { time: start }),
            Attempt::Divide => {
                self.work.divided_steps += 1;
                let middle = 0.5 * (start + end);
                self.run::<DERIVATIVES>(state, start, middle, depth + 1, emit, observe)?;
                self.run::<DERIVATIVES>(state, middle, end, depth + 1, emit, observe)
            }
        }
    }
}
