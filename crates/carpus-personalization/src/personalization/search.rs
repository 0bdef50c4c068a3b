//! Searches within a box: Latin hypercubes, and Powell's BOBYQA through `basin`.

use std::cell::Cell;
use std::convert::Infallible;

use basin::{Bobyqa, BoxBounds, ConstraintDescription, ConstraintSet, Constraints, CostFunction, Executor, PointState};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Objective of a parameter set that cannot be simulated: worse than any that can.
pub(super) const UNUSABLE: f64 = 1e3;

/// `count` points of a Latin hypercube in the unit box of dimension `n`: every coordinate is stratified.
pub(super) fn latin_hypercube(count: usize, n: usize, seed: u64, stream: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    let mut points = vec![vec![0.0; n]; count];
    for k in 0..n {
        let mut strata: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            strata.swap(i, rng.random_range(0..=i));
        }
        for (point, stratum) in points.iter_mut().zip(strata) {
            point[k] = (stratum as f64 + rng.random::<f64>()) / count as f64;
        }
    }
    points
}

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

/// A point found, its cost, and the evaluations that it took.
pub(super) struct Found {
    pub(super) point: Vec<f64>,
    pub(super) cost: f64,
    pub(super) evaluations: usize,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_latin_hypercube_is_stratified_and_repeatable() {
        let points = latin_hypercube(16, 5, 7, 1);
        for k in 0..5 {
            let mut strata: Vec<usize> = points.iter().map(|p| (p[k] * 16.0) as usize).collect();
            strata.sort_unstable();
            assert_eq!(strata, (0..16).collect::<Vec<_>>());
        }
        assert_eq!(points, latin_hypercube(16, 5, 7, 1));
        assert_ne!(points, latin_hypercube(16, 5, 8, 1));
    }

    #[test]
    fn verif_bobyqa_finds_a_minimum_inside_and_at_a_bound() {
        let cost = |x: &[f64]| (x[0] - 0.3).powi(2) + 2.0 * (x[1] - 1.4).powi(2) + 0.5 * x[0] * x[1];
        let found = minimize_in_unit_box(&cost, &[0.5, 0.5], 0.1, 400).unwrap();
        // At x1 = 1: x0 = 0.3 - 0.25.
        assert!((found.point[0] - 0.05).abs() < 1e-4 && (found.point[1] - 1.0).abs() < 1e-6);
        assert!(found.evaluations <= 400 && (found.cost - cost(&found.point)).abs() < 1e-12);
    }
}
