//! How activation follows a small change of the excitation, or of its time constants.

use super::super::activation_dynamics::{ActivationDynamics, Branch};
use super::super::piecewise::{locate, polynomial};
use super::{ActivationTrajectory, Piece};

/// How activation follows a small change of the excitation or of its time constants, in the steps of a trajectory.
///
/// Columns of derivatives are by activation and excitation at the start of a step, by the excitation's slope, and by
/// the logarithm of the time constant of the step's branch.
#[derive(Clone, Debug)]
pub(crate) struct ActivationTangent {
    pieces: Vec<PieceTangent>,
    /// Activation is the excitation.
    ignored: bool,
    /// Whether the first activation is the first excitation, within the bounds.
    starts_free: bool,
}

/// One step.
#[derive(Clone, Copy, Debug)]
struct PieceTangent {
    /// Sample before it, time from there to its start, and samples per second there.
    sample: usize,
    elapsed: f64,
    per_second: f64,
    h: f64,
    branch: Branch,
    /// Derivatives of activation at the end, and of its rates at start and end.
    end: [f64; COLUMNS],
    rates: [[f64; COLUMNS]; 2],
}

const COLUMNS: usize = 4;

/// Activation's change at a time, from the changes of its step: of value and rate times the step's size at both ends.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Interpolation {
    piece: usize,
    weights: [f64; 4],
}

impl Interpolation {
    /// - `pieces`: from [`ActivationTangent::follow`]
    #[inline]
    pub(crate) fn of(&self, pieces: &[[f64; 4]]) -> f64 {
        let (w, p) = (&self.weights, &pieces[self.piece]);
        w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + w[3] * p[3]
    }
}

impl ActivationTrajectory {
    /// - `dynamics`, `time`, `excitation`: from which this trajectory was integrated
    pub(crate) fn tangent(&self, dynamics: &ActivationDynamics, time: &[f64], excitation: &[f64]) -> ActivationTangent {
        let mut k = 0;
        let of = |(j, piece): (usize, &Piece)| {
            let end = self.pieces.get(j + 1).map_or(time[time.len() - 1], |next| next.start);
            while k + 2 < time.len() && piece.start >= time[k + 1] {
                k += 1;
            }
            let h = end - piece.start;
            let (per_second, elapsed) = (1.0 / (time[k + 1] - time[k]), piece.start - time[k]);
            let slope = (excitation[k + 1] - excitation[k]) * per_second;
            let e = excitation[k] + slope * elapsed;
            let (end, rates) = dynamics.step_tangent(piece, e, slope, h);
            PieceTangent { sample: k, elapsed, per_second, h, branch: piece.branch, end, rates }
        };
        ActivationTangent {
            pieces: self.pieces.iter().enumerate().map(of).collect(),
            ignored: dynamics.is_ignored(),
            starts_free: dynamics.clamp(excitation[0]) == excitation[0],
        }
    }

    /// How changes at a time follow from those of its step: not at all where activation is at a bound.
    pub(crate) fn interpolation(&self, time: f64, cursor: &mut usize) -> Interpolation {
        let i = locate(self.pieces.len(), |i| self.pieces[i].start, time, cursor);
        let piece = &self.pieces[i];
        let t = (time - piece.start) * piece.per_second;
        let value = polynomial(&piece.coefficients, t);
        let weights = if value < self.bounds[0] || value > self.bounds[1] {
            [0.0; 4]
        } else {
            let rest = 1.0 - t;
            [rest * rest * (1.0 + 2.0 * t), rest * rest * t, t * t * (3.0 - 2.0 * t), -t * t * rest]
        };
        Interpolation { piece: i, weights }
    }
}

impl ActivationTangent {
    /// Per step, the changes of activation and of its rate times the step's size at the start, then at the end.
    ///
    /// - `change`: of the excitation, at the samples
    pub(crate) fn follow(&self, change: &[f64]) -> Vec<[f64; 4]> {
        let mut a = if self.starts_free { change[0] } else { 0.0 };
        let of = |piece: &PieceTangent| {
            let slope = (change[piece.sample + 1] - change[piece.sample]) * piece.per_second;
            let e = change[piece.sample] + slope * piece.elapsed;
            if self.ignored {
                let rise = slope * piece.h;
                return [e, rise, e + rise, rise];
            }
            let out = piece.change(a, |columns| columns[1] * e + columns[2] * slope);
            a = out[2];
            out
        };
        self.pieces.iter().map(of).collect()
    }

    /// The same when the time constants change.
    ///
    /// - `change`: of the logarithms of the activation and the deactivation time constant
    pub(crate) fn follow_time_constants(&self, change: [f64; 2]) -> Vec<[f64; 4]> {
        // Activation starts at the excitation, or at its bound.
        let mut a = 0.0;
        let of = |piece: &PieceTangent| {
            if self.ignored {
                return [0.0; 4];
            }
            let change = match piece.branch {
                Branch::Activating => change[0],
                Branch::Deactivating => change[1],
            };
            let out = piece.change(a, |columns| columns[3] * change);
            a = out[2];
            out
        };
        self.pieces.iter().map(of).collect()
    }
}

impl PieceTangent {
    /// Changes of activation and of its rate times the step's size at the start, then at the end.
    ///
    /// - `a`: change of activation at the start; `by`: what all else that changes adds, from the columns
    #[inline]
    fn change(&self, a: f64, by: impl Fn(&[f64; COLUMNS]) -> f64) -> [f64; 4] {
        let of = |columns: &[f64; COLUMNS]| columns[0] * a + by(columns);
        [a, self.h * of(&self.rates[0]), of(&self.end), self.h * of(&self.rates[1])]
    }
}

impl ActivationDynamics {
    /// Derivatives of a step: of the new activation, and of ȧ at both ends. Dormand and Prince's method, as in
    /// [`ActivationDynamics::step`], but along the trajectory that was found, so that no stage waits for another.
    fn step_tangent(&self, piece: &Piece, e: f64, slope: f64, h: f64) -> ([f64; COLUMNS], [[f64; COLUMNS]; 2]) {
        let at = NODES.map(|c| {
            let a = polynomial(&piece.coefficients, c);
            let gap = e + slope * c * h - self.clamp(a);
            let moves = !(a < self.minimum_activation || a > 1.0);
            self.derivatives_of_rate(gap, self.clamp(a), moves, piece.branch)
        });
        // ȧ by the columns, where activation has changed by these.
        let rate = |i: usize, [start, e, slope, tau]: [f64; COLUMNS]| {
            let [by_a, by_e, rate] = at[i];
            [by_a * start, by_a * e + by_e, by_a * slope + by_e * (NODES[i] * h), by_a * tau - rate]
        };
        let moved = |by: [f64; COLUMNS]| [1.0 + h * by[0], h * by[1], h * by[2], h * by[3]];
        let columns = |of: &dyn Fn(usize) -> f64| [of(0), of(1), of(2), of(3)];
        let k1 = rate(0, [1.0, 0.0, 0.0, 0.0]);
        let k2 = rate(1, moved(columns(&|d| 0.2 * k1[d])));
        let k3 = rate(2, moved(columns(&|d| 3.0 / 40.0 * k1[d] + 9.0 / 40.0 * k2[d])));
        let by_k3 = |d: usize| 44.0 / 45.0 * k1[d] - 56.0 / 15.0 * k2[d] + 32.0 / 9.0 * k3[d];
        let k4 = rate(3, moved(columns(&by_k3)));
        let by_k4 = |d: usize| {
            19372.0 / 6561.0 * k1[d] - 25360.0 / 2187.0 * k2[d] + 64448.0 / 6561.0 * k3[d] - 212.0 / 729.0 * k4[d]
        };
        let k5 = rate(4, moved(columns(&by_k4)));
        let by_k5 = |d: usize| {
            9017.0 / 3168.0 * k1[d] - 355.0 / 33.0 * k2[d] + 46732.0 / 5247.0 * k3[d] + 49.0 / 176.0 * k4[d]
                - 5103.0 / 18656.0 * k5[d]
        };
        let k6 = rate(5, moved(columns(&by_k5)));
        let by_k6 = |d: usize| {
            35.0 / 384.0 * k1[d] + 500.0 / 1113.0 * k3[d] + 125.0 / 192.0 * k4[d] - 2187.0 / 6784.0 * k5[d]
                + 11.0 / 84.0 * k6[d]
        };
        let end = moved(columns(&by_k6));
        (end, [k1, rate(5, end)])
    }
}

/// Nodes of Dormand and Prince's method; the last two stages share one.
const NODES: [f64; 6] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0];
