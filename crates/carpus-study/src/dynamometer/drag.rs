//! The machine's own viscous drag, from runs at constant velocity without a participant.

use nalgebra::DMatrix;

use super::derivative::derivative;
use super::regression::{RegressionError, clustered_regression};

/// A phase is constant where the speed stays within this share of its median.
const CONSTANT: f64 = 0.05;
/// Speeds below this share of the largest are standstill and turning.
const MOVING: f64 = 0.05;
/// Shortest phase \[s\].
const SHORTEST: f64 = 0.1;
/// Speeds that differ by less than this share are one speed.
const SAME_SPEED: f64 = 0.1;
/// Confidence of the interval.
pub(super) const CONFIDENCE: f64 = 0.95;

/// A recording of the machine alone.
#[derive(Clone, Copy, Debug)]
pub struct MachineRun<'a> {
    /// Time \[s\], increasing.
    pub time: &'a [f64],
    /// Angle \[rad\].
    pub angle: &'a [f64],
    /// Angular velocity [rad/s]; `None`: the derivative of the angle.
    pub velocity: Option<&'a [f64]>,
    /// Measured moment [N·m].
    pub moment: &'a [f64],
}

/// The drag of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct DragEstimate {
    /// Viscous drag [N·m·s/rad].
    pub damping: f64,
    /// Its interval at 95 % confidence [N·m·s/rad].
    pub interval: [f64; 2],
    /// Coulomb friction [N·m] and its interval; `None` where the runs cannot tell it from the drag (one speed, or one
    /// direction).
    pub friction: Option<(f64, [f64; 2])>,
    /// Moment at rest, weight of the attachment apart [N·m].
    pub offset: f64,
    /// Weight of the attachment: factors of cos q and sin q [N·m].
    pub weight: [f64; 2],
    /// Root mean square of what is left [N·m].
    pub residual: f64,
    /// The phases that were used.
    pub phases: Vec<ConstantVelocityPhase>,
}

/// A stretch of a run at constant velocity.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstantVelocityPhase {
    /// Which run, from 0.
    pub run: usize,
    /// First and last sample.
    pub samples: [usize; 2],
    /// Start and end \[s\].
    pub time: [f64; 2],
    /// Median velocity [rad/s].
    pub velocity: f64,
    /// Mean measured moment [N·m].
    pub moment: f64,
}

/// Why there is no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DragError {
    /// Columns of different length, or too few samples.
    #[error("run {run}: {found} samples, expected at least 10 in every column")]
    Samples {
        /// The run, from 1.
        run: usize,
        /// Samples in the shortest column.
        found: usize,
    },
    /// Nothing moves at constant velocity.
    #[error("no phase of constant velocity of {SHORTEST} s or more in any run")]
    NoPhase,
    /// Drag cannot be told from an offset.
    #[error("all phases have the same velocity ({velocity_deg_per_s:.2} deg/s): drag cannot be told from an offset")]
    OneVelocity {
        /// The velocity [deg/s].
        velocity_deg_per_s: f64,
    },
    /// The regression.
    #[error(transparent)]
    Regression(#[from] RegressionError),
}

/// Estimates the viscous drag of a machine from runs without a participant, at two or more velocities.
///
/// ```text
/// measured = −damping·q̇ − friction·sign(q̇) + offset + weight₁ cos q + weight₂ sin q
/// ```
/// by least squares over all samples at constant velocity; the interval lets the errors within a phase be correlated in
/// any way.
///
/// # Errors
/// [`DragError`].
pub fn estimate_drag(runs: &[MachineRun<'_>]) -> Result<DragEstimate, DragError> {
    let mut phases = Vec::new();
    let mut velocities = Vec::with_capacity(runs.len());
    for (i, run) in runs.iter().enumerate() {
        let lengths =
            [run.time.len(), run.angle.len(), run.moment.len(), run.velocity.map_or(usize::MAX, <[f64]>::len)];
        let found = lengths.into_iter().min().unwrap_or(0);
        if found < 10 || run.time.len() != run.angle.len() || run.time.len() != run.moment.len() {
            return Err(DragError::Samples { run: i + 1, found });
        }
        let velocity = run.velocity.map_or_else(|| derivative(run.time, run.angle), <[f64]>::to_vec);
        phases.extend(constant_phases(i, run, &velocity));
        velocities.push(velocity);
    }
    let first = phases.first().ok_or(DragError::NoPhase)?;
    let differs = |a: f64, b: f64| (a - b).abs() > SAME_SPEED * a.abs().max(b.abs());
    if !phases.iter().any(|phase| differs(phase.velocity, first.velocity)) {
        return Err(DragError::OneVelocity { velocity_deg_per_s: first.velocity.to_degrees() });
    }
    let both_directions = phases.iter().any(|phase| phase.velocity * first.velocity < 0.0);
    let several_speeds = phases.iter().any(|phase| differs(phase.velocity.abs(), first.velocity.abs()));
    let with_friction = both_directions && several_speeds;
    let samples: Vec<(usize, usize, usize)> = phases
        .iter()
        .enumerate()
        .flat_map(|(g, phase)| (phase.samples[0]..=phase.samples[1]).map(move |i| (g, phase.run, i)))
        .collect();
    let columns = if with_friction { 5 } else { 4 };
    let design = DMatrix::from_fn(samples.len(), columns, |row, column| {
        let (_, run, i) = samples[row];
        let (v, q) = (velocities[run][i], runs[run].angle[i]);
        match column {
            0 => -v,
            1 => 1.0,
            2 => q.cos(),
            3 => q.sin(),
            _ => -v.signum(),
        }
    });
    let moment: Vec<f64> = samples.iter().map(|(_, run, i)| runs[*run].moment[*i]).collect();
    let cluster: Vec<usize> = samples.iter().map(|(g, ..)| *g).collect();
    let fit = clustered_regression(&design, &moment, &cluster)?;
    let c = &fit.coefficients;
    Ok(DragEstimate {
        damping: c[0],
        interval: fit.interval(0, CONFIDENCE),
        friction: with_friction.then(|| (c[4], fit.interval(4, CONFIDENCE))),
        offset: c[1],
        weight: [c[2], c[3]],
        residual: fit.residual,
        phases,
    })
}

/// Stretches of a run whose speed stays near its median, standstill and turning apart.
fn constant_phases(run: usize, samples: &MachineRun<'_>, velocity: &[f64]) -> Vec<ConstantVelocityPhase> {
    let largest = velocity.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let moving = |v: f64| if v.abs() > MOVING * largest { v.signum() as i8 } else { 0 };
    let mut phases = Vec::new();
    let mut start = 0;
    for stretch in velocity.chunk_by(|a, b| moving(*a) == moving(*b)) {
        let end = start + stretch.len();
        if moving(stretch[0]) != 0 {
            // Acceleration and braking are short: the median is the plateau.
            let mut sorted = stretch.to_vec();
            sorted.sort_by(f64::total_cmp);
            let median = sorted[sorted.len() / 2];
            let near = |i: &usize| (velocity[*i] - median).abs() <= CONSTANT * median.abs();
            if let (Some(first), Some(last)) = ((start..end).find(near), (start..end).rev().find(near))
                && samples.time[last] - samples.time[first] >= SHORTEST
            {
                let moment = samples.moment[first..=last].iter().sum::<f64>() / (last - first + 1) as f64;
                phases.push(ConstantVelocityPhase {
                    run,
                    samples: [first, last],
                    time: [samples.time[first], samples.time[last]],
                    velocity: median,
                    moment,
                });
            }
        }
        start = end;
    }
    phases
}
