//! One step of Radau IIA collocation (three stages, order 5, stiffly accurate) for a single fibre.
//!
//! The fibre length obeys an implicit equation R(x, ẋ/v_max; a(t), l_MT(t)) = 0. Collocation asks for it at three
//! instants of a step at once; the fibre velocity is never solved for by itself. With the stages xᵢ = x₀ + zᵢ and the
//! inverse Butcher matrix B:
//!
//! ```text
//! Rᵢ = R(x₀ + zᵢ, (1/(h v_max)) Σⱼ Bᵢⱼ zⱼ; a(t₀ + cᵢ h), l_MT(t₀ + cᵢ h)) = 0,   i = 1, 2, 3
//! ```
//! # References
//! Hairer & Wanner (1996), Solving Ordinary Differential Equations II, section IV.8, doi:10.1007/978-3-642-05221-7.

use super::equation::{Drive, Fiber, PARAMETERS};

/// √6.
const ROOT_6: f64 = 2.449_489_742_783_178;
/// Where in the step the stages are.
pub(crate) const STAGES: [f64; 3] = [(4.0 - ROOT_6) / 10.0, (4.0 + ROOT_6) / 10.0, 1.0];
/// Inverse of the Butcher matrix.
pub(crate) const INVERSE_BUTCHER: [[f64; 3]; 3] = [
    [3.224_744_871_391_589, 1.167_840_084_690_405_6, -0.253_197_264_742_180_96],
    [-3.567_840_084_690_405_3, 0.775_255_128_608_411_1, 1.053_197_264_742_181],
    [5.531_972_647_421_811, -7.531_972_647_421_809, 5.0],
];
/// Real eigenvalue of [`INVERSE_BUTCHER`].
const GAMMA: f64 = 3.637_834_252_744_496;
/// Weights of the error estimate.
const ERROR_WEIGHTS: [f64; 3] = [-(13.0 + 7.0 * ROOT_6) / 3.0, (-13.0 + 7.0 * ROOT_6) / 3.0, -1.0 / 3.0];

/// Newton's method ends when a correction is below this. It converges quadratically: what is left changes forces by
/// about 1e-9 of their size (measured against 1e-7), ten thousand times less than the steps' own error.
const NEWTON_TOLERANCE: f64 = 1e-6;
const MOST_ITERATIONS: usize = 10;

/// Weights of the previous step's increments in those of a step of the same size that continues its polynomial.
const CONTINUED: [[f64; 3]; 3] = [continued(STAGES[0]), continued(STAGES[1]), continued(STAGES[2])];

/// State of a fibre between steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FiberState {
    /// Normalized fibre length.
    pub(crate) x: f64,
    /// Its rate [1/s].
    pub(crate) rate: f64,
    /// ∂ẋ/∂x of the differential equation [1/s].
    pub(crate) stiffness: f64,
    /// dx/dp.
    pub(crate) by_parameters: [f64; PARAMETERS],
    /// Held at its shortest length.
    pub(crate) clamped: bool,
    /// Stage increments beyond the reference, and size of the step that led here, for extrapolation; size 0 if there is
    /// none.
    pub(crate) previous: ([f64; 3], f64),
}

/// Inputs of a step: its size and what drives the fibre at the stages.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepInput {
    /// Step size [s].
    pub(crate) h: f64,
    /// Activation and path length at the stages.
    pub(crate) drive: [Drive; 3],
    /// What the step was for other parameters; zero if nothing is known.
    pub(crate) reference: Reference,
}

/// A solution for similar parameters: a step's solution differs from it by less, and more smoothly, than from zero, so
/// that Newton's method starts closer.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reference {
    /// Stage increments.
    pub(crate) z: [f64; 3],
    /// Rate at the start of the step [1/s].
    pub(crate) rate: f64,
}

impl Reference {
    /// The part of it between the local times `from` and `to` of its step of size `h`.
    pub(crate) fn part(&self, h: f64, from: f64, to: f64) -> Reference {
        let start = dot(stage_weights(from), self.z);
        let rate = if h > 0.0 { dot(stage_weight_slopes(from), self.z) / h } else { 0.0 };
        Reference { z: STAGES.map(|c| dot(stage_weights(from + c * (to - from)), self.z) - start), rate }
    }
}

/// A step's solution: the state as a cubic in the local time θ = 0…1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepSolution {
    /// State at the end.
    pub(crate) end: FiberState,
    /// Stage increments zᵢ.
    pub(crate) z: [f64; 3],
    /// dzᵢ/dp.
    pub(crate) z_by_parameters: [[f64; PARAMETERS]; 3],
    /// Estimate of the local error of x.
    pub(crate) error: f64,
}

/// Work done, for tests and reports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Steps accepted.
    pub steps: usize,
    /// Steps that had to be divided, because their error was too large or Newton's method failed.
    pub divided_steps: usize,
    /// Evaluations of the force equilibrium.
    pub residual_evaluations: usize,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Work) {
        self.steps += other.steps;
        self.divided_steps += other.divided_steps;
        self.residual_evaluations += other.residual_evaluations;
    }
}

/// Weights of the three stage increments in the collocation polynomial at local time θ.
pub(crate) const fn stage_weights(theta: f64) -> [f64; 3] {
    let [c1, c2, c3] = STAGES;
    let (d1, d2, d3) = (theta - c1, theta - c2, theta - c3);
    [
        theta * d2 * d3 / (c1 * (c1 - c2) * (c1 - c3)),
        theta * d1 * d3 / (c2 * (c2 - c1) * (c2 - c3)),
        theta * d1 * d2 / (c3 * (c3 - c1) * (c3 - c2)),
    ]
}

/// [`stage_weights`] at `theta` beyond the end, less those of the end.
const fn continued(theta: f64) -> [f64; 3] {
    let [w0, w1, w2] = stage_weights(1.0 + theta);
    [w0, w1, w2 - 1.0]
}

/// Derivatives of [`stage_weights`] by θ.
pub(crate) fn stage_weight_slopes(theta: f64) -> [f64; 3] {
    let c = STAGES;
    let slope = |a: f64, b: f64, own: f64| {
        let (da, db) = (theta - a, theta - b);
        (da * db + theta * (da + db)) / (own * (own - a) * (own - b))
    };
    [slope(c[1], c[2], c[0]), slope(c[0], c[2], c[1]), slope(c[0], c[1], c[2])]
}

#[inline(always)]
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// ∂Rᵢ/∂zⱼ, inverted: row i is sᵢ times that of B + diag(d), with sᵢ = ∂Rᵢ/∂u/(h v_max) and dᵢ = ∂Rᵢ/∂x / sᵢ.
#[derive(Clone, Debug)]
pub(crate) struct NewtonMatrix {
    /// Adjugate of B + diag(d).
    adjugate: [[f64; 3]; 3],
    per_determinant: f64,
    /// 1/sᵢ.
    per_scale: [f64; 3],
}

impl NewtonMatrix {
    /// `None` if the matrix is singular to rounding, or not finite.
    #[inline(always)]
    pub(crate) fn new(by_x: [f64; 3], by_u: [f64; 3], per_velocity: f64) -> Option<NewtonMatrix> {
        let b = &INVERSE_BUTCHER;
        let per_scale =
            [1.0 / (by_u[0] * per_velocity), 1.0 / (by_u[1] * per_velocity), 1.0 / (by_u[2] * per_velocity)];
        let d0 = b[0][0] + by_x[0] * per_scale[0];
        let d1 = b[1][1] + by_x[1] * per_scale[1];
        let d2 = b[2][2] + by_x[2] * per_scale[2];
        let adjugate = [
            [d1 * d2 - b[1][2] * b[2][1], b[0][2] * b[2][1] - b[0][1] * d2, b[0][1] * b[1][2] - b[0][2] * d1],
            [b[1][2] * b[2][0] - b[1][0] * d2, d0 * d2 - b[0][2] * b[2][0], b[1][0] * b[0][2] - b[1][2] * d0],
            [b[1][0] * b[2][1] - b[2][0] * d1, b[2][0] * b[0][1] - b[2][1] * d0, d0 * d1 - b[0][1] * b[1][0]],
        ];
        let determinant = d0 * adjugate[0][0] + b[0][1] * adjugate[1][0] + b[0][2] * adjugate[2][0];
        if !determinant.is_finite() || determinant == 0.0 {
            return None;
        }
        Some(NewtonMatrix { adjugate, per_determinant: 1.0 / determinant, per_scale })
    }

    /// The z for which the matrix times z is `right`.
    #[inline(always)]
    pub(crate) fn solve(&self, right: [f64; 3]) -> [f64; 3] {
        let (d, scale, a) = (self.per_determinant, &self.per_scale, &self.adjugate);
        let scaled = [right[0] * scale[0] * d, right[1] * scale[1] * d, right[2] * scale[2] * d];
        [dot(a[0], scaled), dot(a[1], scaled), dot(a[2], scaled)]
    }
}

impl Fiber {
    /// Rate and stiffness of the differential equation at `x`, ignoring the lower bound of the fibre length.
    pub(crate) fn rate(&self, x: f64, drive: Drive, work: &mut Work) -> (f64, f64) {
        let u = self.velocity(x, drive, 0.0);
        let residual = self.residual(x, u, drive);
        work.residual_evaluations += 4;
        (self.curves.max_velocity * u, -self.curves.max_velocity * residual.by_x / residual.by_u)
    }

    /// Attempts one step from `state`. `None`: Newton's method did not converge, the step must be divided.
    ///
    /// With `DERIVATIVES`, also differentiates the discrete solution by the parameters (implicit function theorem), so
    /// that the derivatives are those of the numbers computed, not of an ideal solution.
    #[inline]
    pub(crate) fn step<const DERIVATIVES: bool>(
        &self,
        state: &FiberState,
        input: &StepInput,
        work: &mut Work,
    ) -> Option<StepSolution> {
        let per_h = 1.0 / input.h;
        let per_velocity = per_h / self.curves.max_velocity;
        let mut z = predict(state, input);
        let mut by_x = [0.0; 3];
        let mut by_u = [0.0; 3];
        let mut converged = false;
        let mut last_correction = f64::INFINITY;
        for _ in 0..MOST_ITERATIONS {
            let mut r = [0.0; 3];
            for i in 0..3 {
                let u = per_velocity * dot(INVERSE_BUTCHER[i], z);
                let residual = self.residual_inline(state.x + z[i], u, input.drive[i]);
                (r[i], by_x[i], by_u[i]) = (residual.r, residual.by_x, residual.by_u);
            }
            work.residual_evaluations += 3;
            let dz = NewtonMatrix::new(by_x, by_u, per_velocity)?.solve(r);
            let mut correction = 0.0_f64;
            for i in 0..3 {
                z[i] -= dz[i];
                correction = correction.max(dz[i].abs());
            }
            if correction < NEWTON_TOLERANCE {
                converged = true;
                break;
            }
            // A correction as large as a fibre, or one that does not shrink, leads nowhere.
            if correction.is_nan() || correction > 1.0_f64.min(2.0 * last_correction) {
                return None;
            }
            last_correction = correction;
        }
        if !converged {
            return None;
        }
        let mut z_by_parameters = [[0.0; PARAMETERS]; 3];
        let mut end_by_parameters = [0.0; PARAMETERS];
        if DERIVATIVES {
            let mut by_p = [[0.0; PARAMETERS]; 3];
            for i in 0..3 {
                let x = state.x + z[i];
                let u = per_velocity * dot(INVERSE_BUTCHER[i], z);
                let residual = self.residual(x, u, input.drive[i]);
                (by_x[i], by_u[i]) = (residual.by_x, residual.by_u);
                by_p[i] = self.residual_by_parameters(x, u, input.drive[i]);
            }
            work.residual_evaluations += 3;
            let matrix = NewtonMatrix::new(by_x, by_u, per_velocity)?;
            for p in 0..PARAMETERS {
                let by = matrix.solve([0, 1, 2].map(|i| -(by_x[i] * state.by_parameters[p] + by_p[i][p])));
                for i in 0..3 {
                    z_by_parameters[i][p] = by[i];
                }
                end_by_parameters[p] = state.by_parameters[p] + z_by_parameters[2][p];
            }
        }
        let weighted = state.rate + per_h * dot(ERROR_WEIGHTS, z);
        let error = (weighted / (GAMMA * per_h - state.stiffness.min(0.5 * GAMMA * per_h))).abs();
        let reference = &input.reference.z;
        let beyond = [z[0] - reference[0], z[1] - reference[1], z[2] - reference[2]];
        work.steps += 1;
        Some(StepSolution {
            end: FiberState {
                x: state.x + z[2],
                rate: per_h * dot(INVERSE_BUTCHER[2], z),
                stiffness: -self.curves.max_velocity * by_x[2] / by_u[2],
                by_parameters: end_by_parameters,
                clamped: false,
                previous: (beyond, input.h),
            },
            z,
            z_by_parameters,
            error,
        })
    }
}

impl Fiber {
    /// One step of the implicit Euler method: for the smallest steps, where the path jumps and the fibre is torn along.
    ///
    /// The force balance at the end of the step rises with fibre length as long as the step is short, so that a bracket
    /// can be closed around its root. `None` only for inputs that are not finite.
    pub(crate) fn euler_step(&self, state: &FiberState, input: &StepInput, work: &mut Work) -> Option<StepSolution> {
        let drive = input.drive[2];
        let per_velocity = 1.0 / (input.h * self.curves.max_velocity);
        let balance = |x: f64| {
            let at = self.residual(x, (x - state.x) * per_velocity, drive);
            (at, at.by_x + at.by_u * per_velocity)
        };
        let (mut low, mut high) = (self.shortest, state.x.max(drive.length / self.optimal).max(1.0));
        if balance(high).0.r.is_nan() {
            return None;
        }
        let mut x = state.x.clamp(low, high);
        for _ in 0..200 {
            let (at, slope) = balance(x);
            work.residual_evaluations += 1;
            if at.r > 0.0 {
                high = x
            } else {
                low = x
            }
            let newton = x - at.r / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let change = (next - x).abs();
            x = next;
            if change < 1e-14 * (1.0 + x) {
                break;
            }
        }
        let (at, slope) = balance(x);
        let by_p = self.residual_by_parameters(x, (x - state.x) * per_velocity, drive);
        let mut by_parameters = [0.0; PARAMETERS];
        for p in 0..PARAMETERS {
            by_parameters[p] = (at.by_u * per_velocity * state.by_parameters[p] - by_p[p]) / slope;
        }
        let rise = x - state.x;
        let rise_by = [0, 1, 2].map(|p| by_parameters[p] - state.by_parameters[p]);
        work.steps += 1;
        Some(StepSolution {
            end: FiberState {
                x,
                rate: rise / input.h,
                stiffness: -self.curves.max_velocity * at.by_x / at.by_u,
                by_parameters,
                clamped: false,
                previous: ([0.0; 3], 0.0),
            },
            z: STAGES.map(|c| c * rise),
            z_by_parameters: STAGES.map(|c| rise_by.map(|r| c * r)),
            error: 0.0,
        })
    }
}

/// First guess of the stage increments: the reference, and on top of it the polynomial of the previous step's
/// difference from its reference continued, or the present difference of rates.
#[inline]
fn predict(state: &FiberState, input: &StepInput) -> [f64; 3] {
    let (z, previous_h) = state.previous;
    let (h, reference) = (input.h, &input.reference);
    let mut guess = reference.z;
    for i in 0..3 {
        guess[i] += if !(previous_h > 0.0 && h <= 2.01 * previous_h) {
            STAGES[i] * h * (state.rate - reference.rate)
        } else if h == previous_h {
            dot(CONTINUED[i], z)
        } else {
            dot(continued(STAGES[i] * h / previous_h), z)
        };
    }
    guess
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_inverse_butcher_matrix_is_the_slope_of_the_collocation_polynomial() {
        for (i, c) in STAGES.into_iter().enumerate() {
            let slopes = stage_weight_slopes(c);
            for j in 0..3 {
                assert!((slopes[j] - INVERSE_BUTCHER[i][j]).abs() < 1e-13);
            }
        }
        assert_eq!(stage_weights(0.0), [0.0; 3]);
        assert!((stage_weights(1.0)[2] - 1.0).abs() < 1e-14 && stage_weights(1.0)[0].abs() < 1e-14);
    }

    #[test]
    fn verif_newton_matrix_is_inverted() {
        let (by_x, by_u, per_velocity) = ([3.0, -0.4, 12.0], [0.5, 1.5, 0.2], 9.0);
        let (z, matrix) = ([0.3, -0.2, 0.7], NewtonMatrix::new(by_x, by_u, per_velocity).unwrap());
        let right = [0, 1, 2].map(|i| by_x[i] * z[i] + by_u[i] * per_velocity * dot(INVERSE_BUTCHER[i], z));
        for (found, expected) in matrix.solve(right).into_iter().zip(z) {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
        assert!(NewtonMatrix::new(by_x, [0.0; 3], per_velocity).is_none());
        assert!(NewtonMatrix::new([f64::NAN; 3], by_u, per_velocity).is_none());
    }

    #[test]
    fn verif_part_of_a_reference_is_the_same_polynomial() {
        // x(θ) = θ + 2θ² − θ³ in a step of 0.1 s.
        let (x, slope) = (|t: f64| t + 2.0 * t * t - t * t * t, |t: f64| 1.0 + 4.0 * t - 3.0 * t * t);
        let reference = Reference { z: STAGES.map(x), rate: slope(0.0) / 0.1 };
        let part = reference.part(0.1, 0.25, 0.5);
        for (found, c) in part.z.into_iter().zip(STAGES) {
            assert!((found - (x(0.25 + 0.25 * c) - x(0.25))).abs() < 1e-14);
        }
        assert!((part.rate - slope(0.25) / 0.1).abs() < 1e-12);
    }
}
