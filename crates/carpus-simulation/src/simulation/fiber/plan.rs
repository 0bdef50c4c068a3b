//! The steps of one muscle over one trial, chosen once by error control, and the solution that choosing them gave.

use super::equation::{Drive, Fiber, PARAMETERS};

use super::radau::{FiberState, Reference, StepInput, Work, stage_weights};
use super::step::{Attempt, Cursor, DriveSource, FiberAccuracy, FiberSample, StepTaken, Stuck, step_input, within};

/// Ticks per sample interval: steps start and end at multiples of 1/1024 of an interval.
const TICK_BITS: u32 = 10;
/// The plan is made for this part of the tolerance, so that most other parameter sets meet the tolerance without
/// halving.
const PLAN_TOLERANCE: f64 = 0.25;

/// One planned step.
#[derive(Clone, Debug)]
pub(super) struct PlannedStep {
    pub(super) start: f64,
    pub(super) input: StepInput,
    /// Samples in the half-open interval from after the start to the end: one past the last.
    pub(super) samples_end: usize,
}

/// Steps of one muscle over one trial.
#[derive(Clone, Debug)]
pub(crate) struct StepPlan {
    /// What drives the fibre at the first sample.
    pub(crate) initial: Drive,
    /// Speed of the path there [m/s].
    pub(crate) initial_speed: f64,
    pub(super) steps: Vec<PlannedStep>,
    /// Weights of the stage increments at each sample, within the step that the sample falls in.
    pub(super) weights: Vec<[f64; 3]>,
    pub(super) times: Vec<f64>,
    /// The solution that the steps were chosen with; `None` if they are driven otherwise since.
    solution: Option<PlannedSolution>,
}

/// A fibre that was followed through its planned steps. The stage increments are the references of the steps.
#[derive(Clone, Debug)]
struct PlannedSolution {
    fiber: Fiber,
    /// At the first sample, then at the end of every step.
    ends: Vec<PlannedEnd>,
}

/// State at the end of a planned step.
#[derive(Clone, Copy, Debug)]
struct PlannedEnd {
    x: f64,
    rate: f64,
    /// The fibre rested at its shortest length during the step.
    rests: bool,
}

impl PlannedEnd {
    fn of(state: &FiberState, rests: bool) -> PlannedEnd {
        PlannedEnd { x: state.x, rate: state.rate, rests }
    }
}

impl StepPlan {
    /// Chooses steps for the samples `times` (strictly increasing, at least two) by error control.
    ///
    /// # Errors
    /// [`Stuck`] where Newton's method fails in the smallest step.
    pub(crate) fn build(
        fiber: &Fiber,
        source: &impl DriveSource,
        times: &[f64],
        accuracy: &FiberAccuracy,
    ) -> Result<StepPlan, Stuck> {
        let mut cursor = Cursor::default();
        let initial = source.drive(times[0], &mut cursor);
        let initial_speed = source.speed(times[0]);
        let mut plan = StepPlan {
            initial,
            initial_speed,
            steps: Vec::new(),
            weights: vec![[0.0, 0.0, 1.0]; times.len()],
            times: times.to_vec(),
            solution: None,
        };
        let mut work = Work::default();
        let mut state = fiber.initial_state::<false>(initial, initial_speed, &mut work);
        let mut ends = vec![PlannedEnd::of(&state, false)];
        let last = (times.len() - 1) << TICK_BITS;
        let time_of = |tick: usize| {
            let (k, part) = (tick >> TICK_BITS, tick & ((1 << TICK_BITS) - 1));
            if part == 0 {
                times[k]
            } else {
                times[k] + (times[k + 1] - times[k]) * part as f64 / f64::from(1 << TICK_BITS)
            }
        };
        let tolerance = PLAN_TOLERANCE * accuracy.tolerance;
        let (mut tick, mut exponent, mut sample) = (0_usize, TICK_BITS, 1_usize);
        while tick < last {
            exponent = fitting(tick, exponent, last, |t| time_of(t) - time_of(tick) <= accuracy.max_step);
            let (start, next) = (time_of(tick), tick + (1 << exponent));
            let end = time_of(next);
            let mut input = step_input(source, start, end, &mut cursor);
            let mut rests = false;
            let growth = match fiber.attempt::<false>(&mut state, &input, tolerance, exponent == 0, &mut work) {
                Attempt::Divide if exponent == 0 => return Err(Stuck { time: start }),
                Attempt::Divide => {
                    exponent -= 1;
                    continue;
                }
                Attempt::Stays => {
                    rests = true;
                    1
                }
                Attempt::Moves(solution) => {
                    input.reference = Reference { z: solution.z, rate: state.rate };
                    state = solution.end;
                    // The error of a step of twice the size would be about 16 times as large.
                    u32::from(solution.error < tolerance / 32.0)
                }
            };
            while sample < times.len() && times[sample] <= end {
                if times[sample] < end {
                    plan.weights[sample] = stage_weights((times[sample] - start) / input.h);
                }
                sample += 1;
            }
            plan.steps.push(PlannedStep { start, input, samples_end: sample });
            ends.push(PlannedEnd::of(&state, rests));
            tick = next;
            exponent += growth;
        }
        plan.steps.shrink_to_fit();
        ends.shrink_to_fit();
        plan.solution = Some(PlannedSolution { fiber: fiber.clone(), ends });
        Ok(plan)
    }

    /// The same steps, driven otherwise.
    pub(crate) fn driven_by(&self, source: &impl DriveSource) -> StepPlan {
        let mut cursor = Cursor::default();
        let initial = source.drive(self.times[0], &mut cursor);
        let steps = self.steps.iter().map(|step| PlannedStep {
            input: StepInput {
                drive: step_input(source, step.start, step.start + step.input.h, &mut cursor).drive,
                ..step.input
            },
            ..step.clone()
        });
        StepPlan {
            initial,
            initial_speed: source.speed(self.times[0]),
            steps: steps.collect(),
            weights: self.weights.clone(),
            times: self.times.clone(),
            solution: None,
        }
    }

    /// Whether the steps were chosen with this fibre and what drives it now, so that they are solved already.
    pub(super) fn is_solved_for(&self, fiber: &Fiber) -> bool {
        self.solution.as_ref().is_some_and(|solution| solution.fiber.is_same(fiber))
    }

    /// Hands out the solution that the steps were chosen with, as [`Fiber::follow`] does.
    pub(super) fn replay(&self, mut emit: impl FnMut(usize, FiberSample), mut observe: impl FnMut(StepTaken)) -> Work {
        let ends = self.solution.as_ref().map_or(&[][..], |solution| &solution.ends);
        let sample_at = |end: &PlannedEnd| FiberSample { x: end.x, rate: end.rate, by_parameters: [0.0; PARAMETERS] };
        if let Some(first) = ends.first() {
            emit(0, sample_at(first));
        }
        let mut sample = 1;
        for (step, pair) in self.steps.iter().zip(ends.windows(2)) {
            let (from, end) = (&pair[0], &pair[1]);
            let (input, z) = (&step.input, step.input.reference.z);
            observe(if end.rests {
                StepTaken::resting(step.start, input)
            } else {
                StepTaken::moving(step.start, input, from.x, z, end.x)
            });
            while sample < step.samples_end {
                let weights = self.weights[sample];
                let at_end = end.rests || weights == [0.0, 0.0, 1.0];
                emit(sample, if at_end { sample_at(end) } else { within(from.x, z, weights, input.h) });
                sample += 1;
            }
        }
        Work { steps: self.steps.len(), ..Work::default() }
    }

    /// Number of planned steps.
    pub(crate) fn len(&self) -> usize {
        self.steps.len()
    }
}

/// Largest exponent up to `wanted` for which a step of 2^exponent ticks starts at a multiple of itself (within a sample
/// interval), ends within the trial, and is allowed.
fn fitting(tick: usize, wanted: u32, last: usize, allowed: impl Fn(usize) -> bool) -> u32 {
    let mut exponent = wanted.min(usize::BITS - 2);
    while exponent > 0 {
        let size = 1_usize << exponent;
        let alignment = size.min(1 << TICK_BITS);
        if tick.is_multiple_of(alignment) && tick + size <= last && (allowed(tick + size) || exponent <= 1) {
            break;
        }
        exponent -= 1;
    }
    exponent
}
