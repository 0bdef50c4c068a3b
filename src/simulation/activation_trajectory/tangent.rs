//! How activation follows a small change of the excitation, or of its time constants.

use super::super::piecewise::{locate, polynomial};
use super::{ActivationDynamics, ActivationTrajectory, Branch, Piece};

/// How activation follows a small change of the excitation or of its time constants, in the steps of a trajectory.
///
/// Columns of derivatives are by activation and excitation at the start of a step, by the excitation's slope, and by the logarithm
/// of the time constant of the step's branch.
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
            let (end, rates) = dynamics.step_tangent(piece.coefficients[0], e, slope, h, piece.branch);
            PieceTangent { sample: k, elapsed, per_second, h, branch: piece.branch, end, rates }
        };
        ActivationTangent {
            pieces: self.pieces.iter().enumerate().map(of).collect(),
            ignored: dynamics.ignored,
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
    /// Derivatives of [`ActivationDynamics::step`]: of the new activation, and of ȧ at both ends.
    fn step_tangent(
        &self,
        a: f64,
        e: f64,
        slope: f64,
        h: f64,
        branch: Branch,
    ) -> ([f64; COLUMNS], [[f64; COLUMNS]; 2]) {
        let mut k = [0.0; 7];
        let mut by = [[0.0; COLUMNS]; 7];
        let mut end = [0.0; COLUMNS];
        for (i, (row, c)) in TABLEAU.iter().zip(NODES).enumerate() {
            let mut stage = [a, 1.0, 0.0, 0.0, 0.0];
            for (weight, (k, by)) in row.iter().zip(k.iter().zip(&by)).take(i) {
                let weight = h * weight;
                stage[0] += weight * k;
                (0..COLUMNS).for_each(|d| stage[d + 1] += weight * by[d]);
            }
            let [a, by_start @ ..] = stage;
            let e = e + slope * c * h;
            k[i] = self.rate(a, e, branch);
            let (by_e, by_a) = self.derivatives(a, e, branch);
            let by_a = if a < self.minimum_activation || a > 1.0 { 0.0 } else { by_a };
            // Rates are inversely proportional to the time constant.
            let direct = [0.0, by_e, by_e * c * h, -k[i]];
            by[i] = [0, 1, 2, 3].map(|d| by_a * by_start[d] + direct[d]);
            // The last stage is the step's end.
            end = by_start;
        }
        (end, [by[0], by[6]])
    }
}

/// Dormand and Prince's method; the last row gives the step of order 5.
const TABLEAU: [[f64; 6]; 7] = [
    [0.0; 6],
    [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
const NODES: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];
