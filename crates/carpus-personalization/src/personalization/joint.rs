//! All parameters together, by nonlinear least squares with exact derivatives.
//!
//! ```text
//! minimize  Σ_trials w_t² Σ_k (τ_sim(k) − τ_exp(k))²  +  Σ_i ((θ_i − θ_i⁰) / s_i)²     within the bounds
//! ```
//! and, where a study says so, fascicle lengths of images ([`super::fibers`]).
//! θ are the factors of optimal fibre and tendon slack lengths and the logarithms of the factors of forces; θ⁰ is the
//! model itself. This is the most probable parameter set (maximum a posteriori) when
//! - parameters scatter about the model's by s_i, a third of the way to their bounds, which is how the bounds came about
//!   (dissertation, table 3.2: three standard deviations);
//! - a trial's error has a standard deviation of σ_t = s (σ_0² + (0.1 max|τ_exp|)²)^½: noise of the sensor, and an error in
//!   proportion to the effort, as that of EMG; the common scale s is estimated from the fit itself;
//! - errors stay alike for about 0.3 s, so that a trial of duration T counts as T/0.3 s independent values, however
//!   densely it is sampled: w_t² = (T/0.3 s) / (M σ_t²) with M samples.
//!
//! What the data determine they decide; the rest stays near the model. No trial dominates because it is weak or strong
//! or densely sampled.

use std::cell::{Cell, RefCell};

use basin::{
    BoxBounds, ConstraintDescription, ConstraintSet, Constraints, CostFunction, DenseMatrix, Executor, Jacobian,
    Residual, TrustRegionReflective,
};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::moments::TrainingSet;
use super::parameters::{Determination, ParameterSpace};
use super::{PersonalizationError, Run, Stage};
use carpus_simulation::simulation::{MuscleParameters, SimulationError, UnitMoment};

const STAGE: &str = "all parameters, least squares";
/// About how many parameter sets the stage takes.
pub(super) const EXPECTED_EVALUATIONS: usize = 60;
/// Iterations of each least-squares fit.
const MOST_ITERATIONS: u64 = 40;
/// Gradient, times the distance to the bounds, at which a fit ends: moving a parameter by a tenth of its range then
/// changes the sum of squares by less than a hundredth of the standard error's unit.
const GRADIENT_TOLERANCE: f64 = 1e-2;
/// Fits, each with the scale of the errors that the one before left.
const PASSES: usize = 3;

/// How long errors of the moment stay alike [s].
const ERROR_CORRELATION: f64 = 0.3;
/// Error in proportion to a trial's largest moment, before scaling.
const PROPORTIONAL_ERROR: f64 = 0.1;
/// Error that every trial has, over the largest moment of all trials, before scaling.
const COMMON_ERROR: f64 = 0.01;

/// The least-squares problem for given weights of trials.
struct LeastSquares<'a> {
    space: &'a ParameterSpace,
    set: &'a TrainingSet<'a>,
    weights: Vec<f64>,
    prior_deviation: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    evaluations: &'a Cell<usize>,
    /// The last point evaluated: the solver asks for residual and derivatives of the same point one after the other.
    last: RefCell<Option<(Vec<f64>, Reduced)>>,
}

/// The linear least-squares problem at a point, reduced to as many rows as there are parameters and one more.
///
/// With J = QR, the rows Qᵀr and (‖r‖² − ‖Qᵀr‖²)^½ have the same sum of squares as r, and with R the same gradient and the
/// same Gauss–Newton matrix: to a trust-region method they are the same problem.
#[derive(Clone, Debug)]
struct Reduced {
    residual: Vec<f64>,
    /// Row by row.
    jacobian: Vec<f64>,
    /// JᵀJ.
    information: DMatrix<f64>,
    /// Σ r² of the data alone.
    data_square: f64,
}

impl Run<'_> {
    /// Factors of all parameters, and how far the data determine each.
    pub(super) fn joint(&mut self, two_stage: &[f64]) -> Result<(Vec<f64>, Vec<Determination>), PersonalizationError> {
        let evaluations = Cell::new(0);
        let mut problem = LeastSquares::new(self.space, self.set, &evaluations);
        let failed = |reason: String| PersonalizationError::Search { stage: STAGE, reason };
        // From the model itself and from where the two stages ended: the better one goes on.
        let starts = [self.space.unchanged(), two_stage.to_vec()].map(|factors| problem.to_theta(&factors));
        let mut best: Option<(Vec<f64>, f64)> = None;
        let mut reason = String::new();
        for start in starts {
            self.go_on()?;
            match problem.fit(start) {
                Ok(found) if best.as_ref().is_none_or(|(_, cost)| found.1 < *cost) => best = Some(found),
                Ok(_) => {}
                Err(error) => reason = error,
            }
        }
        let (mut theta, _) = best.ok_or_else(|| failed(reason))?;
        for _ in 1..PASSES {
            self.go_on()?;
            problem.rescale(&theta)?;
            theta = problem.fit(theta).map_err(failed)?.0;
        }
        let known = problem.determination(&theta)?;
        let factors = problem.to_factors(&theta);
        let before = self.set.objective(&self.space.parameters(two_stage))?;
        let after = self.set.objective(&self.space.parameters(&factors))?;
        self.finish_stage(Stage {
            name: STAGE,
            evaluations: evaluations.get() + 2,
            objective_before: before,
            objective_after: after,
        });
        Ok((factors, known))
    }
}

impl<'a> LeastSquares<'a> {
    fn new(space: &'a ParameterSpace, set: &'a TrainingSet<'a>, evaluations: &'a Cell<usize>) -> LeastSquares<'a> {
        let first_force = 2 * space.n_muscles();
        let (mut lower, mut upper, mut prior_deviation) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..space.len() {
            let bounds = space.bounds(i);
            let [low, high] =
                if i < first_force { [bounds.lower, bounds.upper] } else { [bounds.lower.ln(), bounds.upper.ln()] };
            lower.push(low);
            upper.push(high);
            prior_deviation.push((high - low) / 6.0);
        }
        let largest: Vec<f64> =
            set.trials.iter().map(|t| t.measured.iter().fold(0.0_f64, |m, v| m.max(v.abs()))).collect();
        let common = COMMON_ERROR * largest.iter().fold(0.0_f64, |a, b| a.max(*b));
        let weights = set
            .trials
            .iter()
            .zip(&largest)
            .map(|(trial, largest)| {
                let time = &trial.prepared.kinematics().time;
                let independent = ((time[time.len() - 1] - time[0]) / ERROR_CORRELATION).max(1.0);
                let variance =
                    sample_scatter(trial.measured).powi(2) + common.powi(2) + (PROPORTIONAL_ERROR * largest).powi(2);
                (independent / (time.len() as f64 * variance)).sqrt()
            })
            .collect();
        let last = RefCell::new(None);
        LeastSquares { space, set, weights, prior_deviation, lower, upper, evaluations, last }
    }

    fn to_theta(&self, factors: &[f64]) -> Vec<f64> {
        let first_force = 2 * self.space.n_muscles();
        factors.iter().enumerate().map(|(i, f)| if i < first_force { *f } else { f.ln() }).collect()
    }

    fn to_factors(&self, theta: &[f64]) -> Vec<f64> {
        let first_force = 2 * self.space.n_muscles();
        theta
            .iter()
            .enumerate()
            .map(|(i, t)| if i < first_force { *t } else { t.exp() })
            .enumerate()
            .map(|(i, f)| f.clamp(self.space.bounds(i).lower, self.space.bounds(i).upper))
            .collect()
    }

    /// θ of the model itself.
    fn prior(&self, index: usize) -> f64 {
        if index < 2 * self.space.n_muscles() { 1.0 } else { 0.0 }
    }

    fn fit(&self, start: Vec<f64>) -> Result<(Vec<f64>, f64), String> {
        // The solver starts inside the box.
        let inside = |(i, t): (usize, f64)| {
            let margin = 1e-3 * (self.upper[i] - self.lower[i]);
            t.clamp(self.lower[i] + margin, self.upper[i] - margin)
        };
        let start: Vec<f64> = start.into_iter().enumerate().map(inside).collect();
        let solver = TrustRegionReflective::new().with_absolute_scaled_gradient_tolerance(GRADIENT_TOLERANCE);
        let result = Executor::from_start(self, solver, start)
            .max_iter(MOST_ITERATIONS)
            .run()
            .map_err(|error| error.to_string())?;
        Ok((result.best_param().clone(), result.best_cost()))
    }

    /// Scales the weights so that the errors left at `theta` are as large as the weights say.
    fn rescale(&mut self, theta: &[f64]) -> Result<(), SimulationError> {
        let square = self.reduced(theta)?.data_square;
        let independent: f64 = self
            .set
            .trials
            .iter()
            .map(|t| {
                let time = &t.prepared.kinematics().time;
                ((time[time.len() - 1] - time[0]) / ERROR_CORRELATION).max(1.0)
            })
            .sum();
        // Not below a fifth: a model that fits its training data too well has not become exact.
        let scale = (square / independent).sqrt().clamp(0.2, 5.0);
        self.weights.iter_mut().for_each(|w| *w /= scale);
        self.last.take();
        Ok(())
    }

    fn determination(&self, theta: &[f64]) -> Result<Vec<Determination>, SimulationError> {
        let n = theta.len();
        let information = self.reduced(theta)?.information;
        let covariance = information.cholesky().map(|c| c.inverse());
        let factors = self.to_factors(theta);
        Ok((0..n)
            .map(|i| {
                let prior = self.prior_deviation[i].powi(2);
                // The prior's rows make the matrix definite; should rounding say otherwise, nothing is claimed.
                let variance = covariance.as_ref().map_or(prior, |c| c[(i, i)]);
                let to_factor = if i < 2 * self.space.n_muscles() { 1.0 } else { factors[i] };
                Determination {
                    relative_deviation: variance.sqrt() * to_factor,
                    share_from_data: (1.0 - variance / prior).clamp(0.0, 1.0),
                }
            })
            .collect())
    }

    /// The reduced problem at `theta`, from memory if it is the point asked for last.
    fn reduced(&self, theta: &[f64]) -> Result<Reduced, SimulationError> {
        if let Some((_, reduced)) = self.last.borrow().as_ref().filter(|(point, _)| point == theta) {
            return Ok(reduced.clone());
        }
        let reduced = self.evaluate(theta)?;
        self.last.replace(Some((theta.to_vec(), reduced.clone())));
        Ok(reduced)
    }

    fn evaluate(&self, theta: &[f64]) -> Result<Reduced, SimulationError> {
        self.evaluations.set(self.evaluations.get() + 1);
        let n = theta.len();
        let factors = self.to_factors(theta);
        let parameters = self.space.parameters(&factors);
        let m = parameters.len();
        let (set, weights) = (self.set, &self.weights);
        let units: Vec<Result<UnitMoment, SimulationError>> = (0..set.trials.len() * m)
            .into_par_iter()
            .map(|i| set.trials[i / m].prepared.unit_moment_with_derivatives(i % m, &parameters[i % m]))
            .collect();
        let units: Vec<UnitMoment> = units.into_iter().collect::<Result<_, _>>()?;
        let sums: Vec<NormalEquations> = (0..set.trials.len())
            .into_par_iter()
            .map(|t| sum_trial(set, t, weights[t], &units[t * m..(t + 1) * m], &parameters, &factors))
            .collect();
        let mut total = NormalEquations::new(n);
        sums.iter().for_each(|s| total.add(s));
        let data_square = total.square;
        set.fibers.iter().for_each(|f| f.add_row(&parameters, &factors, &mut total));
        for i in 0..n {
            let deviation = self.prior_deviation[i];
            let r = (theta[i] - self.prior(i)) / deviation;
            total.square += r * r;
            total.gradient[i] += r / deviation;
            total.information[(i, i)] += 1.0 / (deviation * deviation);
        }
        Ok(total.reduce(data_square))
    }
}

/// One trial's part of JᵀJ, Jᵀr and Σ r².
fn sum_trial(
    set: &TrainingSet,
    trial: usize,
    weight: f64,
    units: &[UnitMoment],
    parameters: &[MuscleParameters],
    factors: &[f64],
) -> NormalEquations {
    let m = parameters.len();
    let mut sums = NormalEquations::new(3 * m);
    let mut row = vec![0.0; 3 * m];
    for (k, measured) in set.trials[trial].measured.iter().enumerate() {
        let mut moment = set.fixed[trial][k];
        for (muscle, unit) in units.iter().enumerate() {
            let p = &parameters[muscle];
            moment += p.max_isometric_force * unit.moment[k];
            // By factor of the model's value; by the logarithm for forces.
            let by = weight * p.max_isometric_force;
            row[muscle] = by * unit.by_optimal_fiber_length[k] * p.optimal_fiber_length / factors[muscle];
            row[m + muscle] = by * unit.by_tendon_slack_length[k] * p.tendon_slack_length / factors[m + muscle];
            row[2 * m + muscle] = by * unit.moment[k];
        }
        sums.add_row(weight * (moment - measured), &row);
    }
    sums
}

/// JᵀJ (lower triangle), Jᵀr and Σ r².
#[derive(Clone, Debug)]
pub(super) struct NormalEquations {
    pub(super) information: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
    pub(super) square: f64,
}

impl NormalEquations {
    pub(super) fn new(n: usize) -> NormalEquations {
        NormalEquations { information: DMatrix::zeros(n, n), gradient: DVector::zeros(n), square: 0.0 }
    }

    pub(super) fn add_row(&mut self, r: f64, row: &[f64]) {
        self.square += r * r;
        for (j, &b) in row.iter().enumerate() {
            self.gradient[j] += r * b;
            for (i, &a) in row.iter().enumerate().skip(j) {
                self.information[(i, j)] += a * b;
            }
        }
    }

    fn add(&mut self, other: &NormalEquations) {
        self.information += &other.information;
        self.gradient += &other.gradient;
        self.square += other.square;
    }

    fn reduce(mut self, data_square: f64) -> Reduced {
        let n = self.gradient.len();
        self.information.fill_upper_triangle_with_lower_triangle();
        // The prior makes the matrix definite; a fit whose numbers overflow is not worth a step.
        let lower = self.information.clone().cholesky().map_or_else(|| DMatrix::identity(n, n), |c| c.l());
        let projected = lower.solve_lower_triangular(&self.gradient).unwrap_or_else(|| DVector::zeros(n));
        let rest = (self.square - projected.norm_squared()).max(0.0).sqrt();
        let mut jacobian = vec![0.0; (n + 1) * n];
        for i in 0..n {
            for j in i..n {
                jacobian[i * n + j] = lower[(j, i)];
            }
        }
        let residual = projected.iter().copied().chain([rest]).collect();
        Reduced { residual, jacobian, information: self.information, data_square }
    }
}

impl Constraints for &LeastSquares<'_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl CostFunction for &LeastSquares<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = SimulationError;
    fn cost(&self, theta: &Vec<f64>) -> Result<f64, SimulationError> {
        Ok(0.5 * self.reduced(theta)?.residual.iter().map(|r| r * r).sum::<f64>())
    }
}

impl Residual for &LeastSquares<'_> {
    type Param = Vec<f64>;
    type Output = Vec<f64>;
    type Error = SimulationError;
    fn residual(&self, theta: &Vec<f64>) -> Result<Vec<f64>, SimulationError> {
        Ok(self.reduced(theta)?.residual)
    }
}

impl Jacobian for &LeastSquares<'_> {
    type Jacobian = DenseMatrix;
    fn jacobian(&self, theta: &Vec<f64>) -> Result<DenseMatrix, SimulationError> {
        Ok(self.residual_and_jacobian(theta)?.1)
    }
    fn residual_and_jacobian(&self, theta: &Vec<f64>) -> Result<(Vec<f64>, DenseMatrix), SimulationError> {
        let reduced = self.reduced(theta)?;
        let matrix = DenseMatrix::from_row_slice(theta.len() + 1, theta.len(), &reduced.jacobian);
        Ok((reduced.residual, matrix))
    }
}

/// Standard deviation of white noise in a smooth signal, from its second differences; robust against bursts.
fn sample_scatter(values: &[f64]) -> f64 {
    let mut second: Vec<f64> = values.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()).collect();
    second.sort_by(f64::total_cmp);
    // Median of |N(0, 1)| is 0.6745; a second difference has six times the variance.
    second.get(second.len() / 2).map_or(0.0, |median| median / 0.6745 / 6.0_f64.sqrt())
}
