//! Minimizers in a box, through the crate `basin`, which no other file uses: Powell's BOBYQA, and sequential quadratic
//! programming (SLSQP) with differences of the cost, as the dissertation's `fmincon`, or with exact gradients.

use std::cell::{Cell, RefCell};
use std::convert::Infallible;

use basin::{
    Bobyqa, BoundedFiniteDiff, BoxBounds, ConstraintDescription, ConstraintSet, Constraints, CostFunction, Executor,
    Gradient, Method, PointState, SelectedFirstOrderState, Slsqp,
};

/// A point found, its cost, and the evaluations that it took.
pub(super) struct Found {
    pub(super) point: Vec<f64>,
    pub(super) cost: f64,
    pub(super) evaluations: usize,
}

/// Step of difference quotients, of the box's width: far above the simulations' error, far below what matters.
const DIFFERENCE_STEP: f64 = 1e-4;

/// A cost in the unit box.
struct InBox<'a> {
    cost: &'a dyn Fn(&[f64]) -> f64,
    evaluations: &'a Cell<usize>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Constraints for InBox<'_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl CostFunction for InBox<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Infallible> {
        self.evaluations.set(self.evaluations.get() + 1);
        Ok((self.cost)(x))
    }
}

/// Minimizes a cost in the unit box without derivatives, from `start` with a trust region of `radius`.
///
/// # References
/// Powell (2009), The BOBYQA algorithm, Cambridge NA Report NA2009/06.
pub(super) fn minimize_in_unit_box(
    cost: &dyn Fn(&[f64]) -> f64,
    start: &[f64],
    radius: f64,
    most_evaluations: usize,
) -> Result<Found, String> {
    let n = start.len();
    let evaluations = Cell::new(0);
    let problem = InBox { cost, evaluations: &evaluations, lower: vec![0.0; n], upper: vec![1.0; n] };
    let solver = Bobyqa::new().with_initial_radius(radius).with_final_radius(1e-5);
    let result = Executor::new(problem, solver, PointState::new(start.to_vec()))
        .max_cost_evals(most_evaluations as u64)
        .run()
        .map_err(|error| error.to_string())?;
    Ok(Found { point: result.best_param().clone(), cost: result.best_cost(), evaluations: evaluations.get() })
}

/// A cost in the unit box that remembers the best point it was asked for: the objective has corners, at which a method
/// for smooth functions may end elsewhere than at the best point that it saw.
struct Remembering<'a> {
    cost: &'a dyn Fn(&[f64]) -> f64,
    evaluations: Cell<usize>,
    best: RefCell<(Vec<f64>, f64)>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Constraints for &Remembering<'_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl CostFunction for &Remembering<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Infallible> {
        self.evaluations.set(self.evaluations.get() + 1);
        let cost = (self.cost)(x);
        if cost < self.best.borrow().1 {
            self.best.replace((x.clone(), cost));
        }
        Ok(cost)
    }
}

/// Minimizes a cost in the unit box by SLSQP with difference quotients.
pub(super) fn minimize_by_differences(
    cost: &dyn Fn(&[f64]) -> f64,
    start: &[f64],
    most_iterations: u64,
) -> Result<Found, String> {
    let n = start.len();
    let problem = Remembering {
        cost,
        evaluations: Cell::new(0),
        best: RefCell::new((start.to_vec(), f64::INFINITY)),
        lower: vec![0.0; n],
        upper: vec![1.0; n],
    };
    let differences = BoundedFiniteDiff::new(&problem, vec![0.0; n], vec![1.0; n])
        .gradient_method(Method::Forward)
        .with_step(DIFFERENCE_STEP);
    Executor::new(differences, Slsqp::new(), SelectedFirstOrderState::new(start.to_vec()))
        .max_iter(most_iterations)
        .run()
        .map_err(|error| error.to_string())?;
    let evaluations = problem.evaluations.get();
    let (point, cost) = problem.best.into_inner();
    Ok(Found { point, cost, evaluations })
}

/// A smooth cost with its gradient, from memory if the point asked for is that of the last time.
struct WithGradient<'a> {
    both: &'a dyn Fn(&[f64]) -> (f64, Vec<f64>),
    last: RefCell<Option<(Vec<f64>, f64, Vec<f64>)>>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl WithGradient<'_> {
    fn at(&self, x: &[f64]) -> (f64, Vec<f64>) {
        if let Some((_, cost, gradient)) = self.last.borrow().as_ref().filter(|(point, ..)| point == x) {
            return (*cost, gradient.clone());
        }
        let (cost, gradient) = (self.both)(x);
        self.last.replace(Some((x.to_vec(), cost, gradient.clone())));
        (cost, gradient)
    }
}

impl Constraints for &WithGradient<'_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl CostFunction for &WithGradient<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Infallible> {
        Ok(self.at(x).0)
    }
}

impl Gradient for &WithGradient<'_> {
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Infallible> {
        Ok(self.at(x).1)
    }
}

/// Minimizes a smooth cost in the unit box by SLSQP with its exact gradient; where it ended.
///
/// - `tolerance`: of the cost
pub(super) fn minimize_with_gradient(
    both: &dyn Fn(&[f64]) -> (f64, Vec<f64>),
    start: &[f64],
    tolerance: f64,
    most_iterations: u64,
) -> Result<Vec<f64>, String> {
    let n = start.len();
    let problem = WithGradient { both, last: RefCell::new(None), lower: vec![0.0; n], upper: vec![1.0; n] };
    let solver = Slsqp::new().with_absolute_accuracy_tolerance(tolerance);
    let result = Executor::new(&problem, solver, SelectedFirstOrderState::new(start.to_vec()))
        .max_iter(most_iterations)
        .run()
        .map_err(|error| error.to_string())?;
    Ok(result.best_param().clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_bobyqa_finds_a_minimum_inside_and_at_a_bound() {
        let cost = |x: &[f64]| (x[0] - 0.3).powi(2) + 2.0 * (x[1] - 1.4).powi(2) + 0.5 * x[0] * x[1];
        let found = minimize_in_unit_box(&cost, &[0.5, 0.5], 0.1, 400).unwrap();
        // At x1 = 1: x0 = 0.3 - 0.25.
        assert!((found.point[0] - 0.05).abs() < 1e-4 && (found.point[1] - 1.0).abs() < 1e-6);
        assert!(found.evaluations <= 400 && (found.cost - cost(&found.point)).abs() < 1e-12);
    }

    /// Minimum 0 at (0.3, 1) on the upper bound of the second coordinate, in a curved valley.
    fn valley(x: &[f64]) -> f64 {
        (x[0] - 0.3).powi(2) + 20.0 * (x[1] - 1.0 + 0.5 * (x[0] - 0.3)).powi(2)
    }

    #[test]
    fn verif_both_variants_find_the_minimum() {
        let found = minimize_by_differences(&valley, &[0.9, 0.2], 60).unwrap();
        assert!((found.point[0] - 0.3).abs() < 1e-3 && (found.point[1] - 1.0).abs() < 1e-3, "{:?}", found.point);
        assert!((found.cost - valley(&found.point)).abs() < 1e-15);
        let both = |x: &[f64]| {
            let inner = x[1] - 1.0 + 0.5 * (x[0] - 0.3);
            (valley(x), vec![2.0 * (x[0] - 0.3) + 20.0 * inner, 40.0 * inner])
        };
        let point = minimize_with_gradient(&both, &[0.9, 0.2], 1e-10, 60).unwrap();
        assert!((point[0] - 0.3).abs() < 1e-4 && (point[1] - 1.0).abs() < 1e-4, "{point:?}");
    }
}
