//! Integration of stiff differential equations by numerical differentiation formulas of order 1 to 5, with variable
//! step and a Jacobian that is kept as long as Newton's method converges with it.
//!
//! # References
//! Shampine LF, Reichelt MW (1997), The MATLAB ODE suite, doi:10.1137/S1064827594276424. Byrne GD, Hindmarsh AC (1975),
//! A polyalgorithm for the numerical solution of ordinary differential equations, doi:10.1145/355626.355636.

use super::grouped::Grouped;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

const MAX_ORDER: usize = 5;
const NEWTON_ITERATIONS: usize = 4;
/// Newton's method has converged when what is left is this share of the error allowed.
const NEWTON_SHARE: f64 = 0.03;
const LEAST_FACTOR: f64 = 0.2;
const LARGEST_FACTOR: f64 = 10.0;
/// Of the rate at which earlier iterations with the same factors converged, so much is expected of later ones at least.
const RATE_KEPT: f64 = 0.9;
/// κ of the formulas, by order.
const KAPPA: [f64; MAX_ORDER + 1] = [0.0, -0.1850, -1.0 / 9.0, -0.0823, -0.0415, 0.0];

/// ẋ = f(t, x).
pub trait StiffSystem {
    /// What can go wrong.
    type Error;

    /// Computes ẋ.
    ///
    /// # Errors
    /// A state at which there is no derivative; the integrator then tries a smaller step.
    fn derivative(&mut self, time: f64, x: &[f64], derivative: &mut [f64]) -> Result<(), Self::Error>;

    /// Trailing states in groups, ascending and without gaps, that act on the states before all groups and on their own
    /// group, but not on one another: ∂ẋ_i/∂x_j is 0 for i and j of different groups.
    fn groups(&self) -> Vec<Range<usize>> {
        Vec::new()
    }

    /// Computes ∂ẋ/∂x; an approximation only costs steps.
    ///
    /// # Errors
    /// As [`StiffSystem::derivative`].
    fn jacobian(&mut self, time: f64, x: &[f64], jacobian: &mut DMatrix<f64>) -> Result<(), Self::Error>;
}

/// Why integration ended early.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError<E> {
    /// No step is small enough.
    #[error("the step became smaller than rounding at t = {time} s")]
    TooSmall {
        /// Time [s].
        time: f64,
    },
    /// There is no solution at the end of the shortest step allowed.
    #[error("a step of {least} s, the least allowed, is too long at t = {time} s")]
    BelowLeast {
        /// Time [s].
        time: f64,
        /// Least step [s].
        least: f64,
    },
    /// The derivative failed at an accepted state.
    #[error("at t = {time} s: {source}")]
    System {
        /// Time [s].
        time: f64,
        /// What went wrong.
        source: E,
    },
}

/// What an integration cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Accepted steps.
    pub steps: usize,
    /// Steps tried again.
    pub rejected: usize,
    /// Steps of the least length allowed, taken although their error is larger than allowed.
    pub forced: usize,
    /// Derivatives, without those for Jacobians.
    pub derivatives: usize,
    /// Jacobians.
    pub jacobians: usize,
    /// Factorizations.
    pub factorizations: usize,
}

impl Cost {
    /// Adds what another integration cost.
    pub fn add(&mut self, other: &Cost) {
        self.steps += other.steps;
        self.rejected += other.rejected;
        self.forced += other.forced;
        self.derivatives += other.derivatives;
        self.jacobians += other.jacobians;
        self.factorizations += other.factorizations;
    }
}

/// An integration under way.
pub struct Bdf {
    /// Time [s].
    pub time: f64,
    /// What it cost so far.
    pub cost: Cost,
    /// Error allowed per component: `absolute + relative · |x|`.
    absolute: DVector<f64>,
    relative: f64,
    order: usize,
    step: f64,
    last_step: f64,
    equal_steps: usize,
    /// Backward differences of the state, from order 0.
    differences: Vec<DVector<f64>>,
    jacobian: DMatrix<f64>,
    jacobian_is_current: bool,
    groups: Vec<Range<usize>>,
    factors: Option<Grouped>,
    /// Least and largest step allowed [s].
    step_range: [f64; 2],
    /// By how much an iteration with these factors has shortened the corrections, if that is known.
    convergence_rate: Option<f64>,
}

impl Bdf {
    /// Starts from a state.
    ///
    /// - `absolute`, `relative`: error allowed per component and step
    /// - `largest_step`: of the first step [s]
    ///
    /// # Errors
    /// A state at which there is no derivative.
    pub fn new<S: StiffSystem>(
        system: &mut S,
        time: f64,
        x: &[f64],
        absolute: &[f64],
        relative: f64,
        largest_step: f64,
    ) -> Result<Bdf, StepError<S::Error>> {
        let n = x.len();
        let failed = |source| StepError::System { time, source };
        let (state, absolute) = (DVector::from_column_slice(x), DVector::from_column_slice(absolute));
        let mut rate = DVector::zeros(n);
        system.derivative(time, x, rate.as_mut_slice()).map_err(failed)?;
        let scale = scale(&absolute, relative, &state);
        // Hairer, Nørsett & Wanner, Solving ordinary differential equations I, section II.4.
        let (d0, d1) = (norm(&state, &scale), norm(&rate, &scale));
        let h0 = if d0 < 1e-5 || d1 < 1e-5 { 1e-6 } else { 0.01 * d0 / d1 };
        let mut rate1 = DVector::zeros(n);
        system.derivative(time + h0, (&state + &rate * h0).as_slice(), rate1.as_mut_slice()).map_err(failed)?;
        let d2 = norm(&(rate1 - &rate), &scale) / h0;
        let h1 = if d1.max(d2) <= 1e-15 { (1e-3 * h0).max(1e-6) } else { (0.01 / d1.max(d2)).sqrt() };
        let step = (100.0 * h0).min(h1).min(largest_step);
        let mut jacobian = DMatrix::zeros(n, n);
        system.jacobian(time, x, &mut jacobian).map_err(failed)?;
        let mut differences = vec![DVector::zeros(n); MAX_ORDER + 3];
        differences[1] = rate * step;
        differences[0] = state;
        Ok(Bdf {
            time,
            cost: Cost { derivatives: 2, jacobians: 1, ..Cost::default() },
            absolute,
            relative,
            order: 1,
            step,
            last_step: 0.0,
            equal_steps: 0,
            differences,
            jacobian,
            jacobian_is_current: true,
            groups: system.groups(),
            factors: None,
            step_range: [0.0, f64::INFINITY],
            convergence_rate: None,
        })
    }

    /// Keeps steps within a range. A step of the least length is taken whatever its error, as in Simbody's integrators;
    /// the last step before an end may be shorter.
    ///
    /// - `range`: least and largest step [s]
    pub fn with_step_range(mut self, range: [f64; 2]) -> Bdf {
        self.step_range = range;
        let [least, largest] = range;
        let factor = self.step.max(least).min(largest) / self.step;
        if factor != 1.0 {
            self.rescale(factor);
        }
        self
    }

    /// The state at [`Bdf::time`].
    pub fn state(&self) -> &[f64] {
        self.differences[0].as_slice()
    }

    /// One step, which ends at `end` at the latest.
    ///
    /// # Errors
    /// No step is small enough, or the system fails wherever it is asked.
    pub fn step<S: StiffSystem>(&mut self, system: &mut S, end: f64) -> Result<(), StepError<S::Error>> {
        loop {
            if self.step < 10.0 * f64::EPSILON * self.time.abs().max(1e-3) {
                return Err(StepError::TooSmall { time: self.time });
            }
            if self.step > self.step_range[1] {
                self.rescale(self.step_range[1] / self.step);
            }
            let mut next = self.time + self.step;
            if next > end {
                self.rescale((end - self.time) / self.step);
                next = end;
            }
            let order = self.order;
            let predicted = self.differences[..=order].iter().fold(DVector::zeros(self.absolute.len()), |s, d| s + d);
            let size = scale(&self.absolute, self.relative, &predicted);
            let mut psi = DVector::zeros(predicted.len());
            for k in 1..=order {
                psi += &self.differences[k] * (gamma(k) / alpha(order));
            }
            let c = self.step / alpha(order);
            let Some((x, change, iterations)) = self.solve(system, next, &predicted, &size, &psi, c) else {
                self.shorten(0.5)?;
                continue;
            };
            let safety = 0.9 * (2 * NEWTON_ITERATIONS + 1) as f64 / (2 * NEWTON_ITERATIONS + iterations) as f64;
            let size = scale(&self.absolute, self.relative, &x);
            let error = error_constant(order) * norm(&change, &size);
            let is_least = self.step <= self.step_range[0] * (1.0 + 1e-9);
            if is_least && error > 1.0 && error.is_finite() {
                self.cost.forced += 1;
            } else if !(error <= 1.0) {
                self.shorten((safety * error.powf(-1.0 / (order + 1) as f64)).max(LEAST_FACTOR))?;
                continue;
            }
            self.accept(next, &change);
            if self.equal_steps > order {
                self.choose_order(error, safety, &size);
            }
            return Ok(());
        }
    }

    /// A step that was rejected becomes shorter.
    fn shorten<E>(&mut self, factor: f64) -> Result<(), StepError<E>> {
        self.cost.rejected += 1;
        let least = self.step_range[0];
        if self.step <= least * (1.0 + 1e-9) {
            return Err(StepError::BelowLeast { time: self.time, least });
        }
        self.rescale(factor.max(least / self.step));
        Ok(())
    }

    /// Solves for the state at the end of a step: state, change from the prediction, iterations.
    fn solve<S: StiffSystem>(
        &mut self,
        system: &mut S,
        time: f64,
        predicted: &DVector<f64>,
        size: &DVector<f64>,
        psi: &DVector<f64>,
        c: f64,
    ) -> Option<(DVector<f64>, DVector<f64>, usize)> {
        let n = predicted.len();
        let tolerance = (10.0 * f64::EPSILON / self.relative).max(NEWTON_SHARE);
        loop {
            if self.factors.is_none() {
                self.factors = Grouped::new(&self.jacobian, c, &self.groups);
                self.convergence_rate = None;
                self.cost.factorizations += 1;
            }
            let factors = self.factors.as_ref()?;
            let (mut x, mut change) = (predicted.clone(), DVector::zeros(n));
            let mut rate_of_change = DVector::zeros(n);
            let mut last: Option<f64> = None;
            for k in 0..NEWTON_ITERATIONS {
                self.cost.derivatives += 1;
                if system.derivative(time, x.as_slice(), rate_of_change.as_mut_slice()).is_err() {
                    break;
                }
                let mut correction = &rate_of_change * c - psi - &change;
                factors.solve_mut(&mut correction);
                let length = norm(&correction, size);
                if let Some(last) = last {
                    let slowest = self.convergence_rate.map_or(0.0, |rate| RATE_KEPT * rate);
                    self.convergence_rate = Some(slowest.max(length / last));
                }
                let rate = self.convergence_rate;
                let remaining = (NEWTON_ITERATIONS - k) as i32;
                // One correction that a Jacobian by differences gets wrong, and the next puts right, is no divergence.
                let is_first = k == 1 && self.jacobian_is_current && rate.is_some_and(|r| r < 2.0);
                let diverges = k > 0
                    && !is_first
                    && rate.is_some_and(|r| r >= 1.0 || r.powi(remaining) / (1.0 - r) * length > tolerance);
                if !length.is_finite() || diverges {
                    break;
                }
                x += &correction;
                change += &correction;
                if length == 0.0 || rate.is_some_and(|r| r < 1.0 && r / (1.0 - r) * length < tolerance) {
                    return Some((x, change, k + 1));
                }
                last = Some(length);
            }
            if self.jacobian_is_current || system.jacobian(time, predicted.as_slice(), &mut self.jacobian).is_err() {
                return None;
            }
            self.cost.jacobians += 1;
            self.jacobian_is_current = true;
            self.factors = None;
        }
    }

    fn accept(&mut self, time: f64, change: &DVector<f64>) {
        self.cost.steps += 1;
        self.time = time;
        self.last_step = self.step;
        self.equal_steps += 1;
        self.jacobian_is_current = false;
        let order = self.order;
        self.differences[order + 2] = change - &self.differences[order + 1];
        self.differences[order + 1] = change.clone();
        for k in (0..=order).rev() {
            let (low, high) = self.differences.split_at_mut(k + 1);
            low[k] += &high[0];
        }
    }

    fn choose_order(&mut self, error: f64, safety: f64, size: &DVector<f64>) {
        let order = self.order;
        let lower =
            if order > 1 { error_constant(order - 1) * norm(&self.differences[order], size) } else { f64::INFINITY };
        let higher = if order < MAX_ORDER {
            error_constant(order + 1) * norm(&self.differences[order + 2], size)
        } else {
            f64::INFINITY
        };
        let factor = |error: f64, order: usize| error.max(1e-30).powf(-1.0 / order as f64);
        let choices = [
            (factor(lower, order), order - 1),
            (factor(error, order + 1), order),
            (factor(higher, order + 2), order + 1),
        ];
        let best = choices.into_iter().fold(choices[1], |best, choice| if choice.0 > best.0 { choice } else { best });
        let factor = (safety * best.0).min(LARGEST_FACTOR).min(self.step_range[1] / self.step);
        let factor = factor.max((self.step_range[0] / self.step).min(1.0));
        // At its bound a step stays, with all that belongs to it.
        if best.1.max(1) == self.order && factor == 1.0 {
            return;
        }
        self.order = best.1.max(1);
        self.rescale(factor);
    }

    /// Changes the step and, with it, the differences.
    fn rescale(&mut self, factor: f64) {
        let order = self.order;
        let transform = differences_matrix(order, factor) * differences_matrix(order, 1.0);
        let old = self.differences[..=order].to_vec();
        for k in 0..=order {
            self.differences[k] = old.iter().enumerate().fold(DVector::zeros(old[0].len()), |sum, (j, d)| {
                if transform[(j, k)] == 0.0 { sum } else { sum + d * transform[(j, k)] }
            });
        }
        self.step *= factor;
        self.equal_steps = 0;
        self.factors = None;
    }

    /// The state at a time within the last step, by the step's own polynomial.
    pub fn interpolate(&self, time: f64, x: &mut [f64]) {
        x.copy_from_slice(self.differences[0].as_slice());
        // Differences belong to the present step, which may have been changed since.
        let h = self.step;
        let mut product = 1.0;
        for k in 1..=self.order {
            product *= (time - (self.time - h * (k - 1) as f64)) / (h * k as f64);
            for (x, d) in x.iter_mut().zip(self.differences[k].iter()) {
                *x += product * d;
            }
        }
    }

    /// Rates of the states over the last step.
    pub fn slope(&self) -> Vec<f64> {
        self.differences[1].iter().map(|d| d / self.step).collect()
    }

    /// Length of the last step [s].
    pub fn last_step(&self) -> f64 {
        self.last_step
    }
}

fn gamma(order: usize) -> f64 {
    (1..=order).map(|k| 1.0 / k as f64).sum()
}

fn alpha(order: usize) -> f64 {
    (1.0 - KAPPA[order]) * gamma(order)
}

fn error_constant(order: usize) -> f64 {
    KAPPA[order] * gamma(order) + 1.0 / (order + 1) as f64
}

/// Differences for a step of `factor` times the length (Shampine & Reichelt, section 3.2).
fn differences_matrix(order: usize, factor: f64) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(order + 1, order + 1);
    matrix.row_mut(0).fill(1.0);
    for i in 1..=order {
        for j in 1..=order {
            matrix[(i, j)] = matrix[(i - 1, j)] * (i as f64 - 1.0 - factor * j as f64) / i as f64;
        }
    }
    matrix
}

fn scale(absolute: &DVector<f64>, relative: f64, x: &DVector<f64>) -> DVector<f64> {
    absolute.zip_map(x, |a, x| a + relative * x.abs())
}

/// Root mean square of the ratios.
fn norm(x: &DVector<f64>, scale: &DVector<f64>) -> f64 {
    (x.iter().zip(scale.iter()).map(|(x, s)| (x / s).powi(2)).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Robertson's reaction, the classical stiff problem.
    struct Robertson;

    impl StiffSystem for Robertson {
        type Error = std::convert::Infallible;

        fn derivative(&mut self, _: f64, x: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
            out[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
            out[2] = 3e7 * x[1] * x[1];
            out[1] = -out[0] - out[2];
            Ok(())
        }

        fn jacobian(&mut self, _: f64, x: &[f64], j: &mut DMatrix<f64>) -> Result<(), Self::Error> {
            let rows = [
                [-0.04, 1e4 * x[2], 1e4 * x[1]],
                [0.04, -1e4 * x[2] - 6e7 * x[1], -1e4 * x[1]],
                [0.0, 6e7 * x[1], 0.0],
            ];
            for (i, row) in rows.iter().enumerate() {
                row.iter().enumerate().for_each(|(k, value)| j[(i, k)] = *value);
            }
            Ok(())
        }
    }

    /// Reference at t = 40 of Hairer & Wanner, Solving ordinary differential equations II, section IV.1.
    #[test]
    fn verif_robertson_problem() {
        let mut bdf = Bdf::new(&mut Robertson, 0.0, &[1.0, 0.0, 0.0], &[1e-9, 1e-13, 1e-9], 1e-8, 1.0).expect("start");
        while bdf.time < 40.0 {
            bdf.step(&mut Robertson, 40.0).expect("step");
        }
        let expected = [0.715_827_068_719_4, 9.185_534_764_5e-6, 0.284_163_745_745_8];
        for (found, expected) in bdf.state().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6 * expected, "{found} instead of {expected}");
        }
        assert!(bdf.cost.steps < 1000, "{:?}", bdf.cost);
        assert!(bdf.cost.jacobians < bdf.cost.steps / 3, "Jacobians are kept: {:?}", bdf.cost);
        assert!(5 * bdf.cost.derivatives < 11 * bdf.cost.steps, "rates of convergence are kept: {:?}", bdf.cost);
    }

    /// sin and cos, between steps too.
    #[test]
    fn verif_interpolation_within_a_step() {
        struct Oscillator;
        impl StiffSystem for Oscillator {
            type Error = std::convert::Infallible;
            fn derivative(&mut self, _: f64, x: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
                (out[0], out[1]) = (x[1], -x[0]);
                Ok(())
            }
            fn jacobian(&mut self, _: f64, _: &[f64], j: &mut DMatrix<f64>) -> Result<(), Self::Error> {
                j.fill(0.0);
                (j[(0, 1)], j[(1, 0)]) = (1.0, -1.0);
                Ok(())
            }
        }
        let mut bdf = Bdf::new(&mut Oscillator, 0.0, &[0.0, 1.0], &[1e-9, 1e-9], 1e-9, 0.1).expect("start");
        let mut x = [0.0; 2];
        while bdf.time < 3.0 {
            bdf.step(&mut Oscillator, 3.0).expect("step");
            for part in [0.25, 0.5, 0.75] {
                let at = bdf.time - part * bdf.last_step();
                bdf.interpolate(at, &mut x);
                assert!((x[0] - at.sin()).abs() < 1e-6, "{} at {at}", x[0]);
            }
        }
        assert!((bdf.state()[0] - 3f64.sin()).abs() < 1e-6);
    }
}
