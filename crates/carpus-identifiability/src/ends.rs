//! Ends of intervals by simulation itself: polynomials find them, simulation says how far −2 log likelihood really rose
//! there, and the ends move until it rose by what the level asks for.
//!
//! All other parameters are at their best by a Gauss–Newton step from where the polynomials have them:
//!
//! ```text
//! D_i(c) ≈ D − g_Sᵀ I_SS⁻¹ g_S,   S: all but parameter i and those held at a bound
//! ```

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::likelihood::Fit;
use super::parameters::FreeParameter;
use super::problem::Problem;
use super::profile::{End, Profiles, constrained};
use super::surrogate::Surrogate;
use carpus_simulation::simulation::SimulationError;

/// An end is found when √ΔD is this near, relative.
const NEAR: f64 = 0.04;
/// Simulations of all trials for one end, at most.
const TRIES: usize = 4;
/// A Gauss–Newton step longer than this share of a parameter's bounds is not believed.
const LONGEST_STEP: f64 = 0.1;

/// Moves the ends that the data set to where simulation has them; what is left of the difference of −2 log likelihood
/// at the worst of them.
///
/// - `drops`: of every parameter
///
/// # Errors
/// A trial that cannot be simulated at the best parameters; an end that cannot be simulated stays where it is.
pub(super) fn simulate_ends(
    problem: &Problem,
    fit: &Fit,
    surrogate: &Surrogate,
    free: &[FreeParameter],
    profiles: &mut Profiles,
    drops: &[f64],
) -> Result<f64, SimulationError> {
    let exact = Exact { problem, fit, free };
    let least = exact.deviance(&profiles.best, None)?;
    let best = profiles.best.clone();
    let jobs: Vec<(usize, usize)> = (0..free.len())
        .flat_map(|i| [0, 1].map(|side| (i, side)))
        .filter(|(i, s)| profiles.each[*i].ends[*s].by_data)
        .collect();
    let found: Vec<(End, DVector<f64>, f64)> = jobs
        .par_iter()
        .map(|(i, side)| {
            let profile = &profiles.each[*i];
            let start = (profile.ends[*side], profile.points[*side].clone());
            moved(&exact, surrogate, *i, *side, &best, start, least, drops[*i])
        })
        .collect();
    let mut largest = 0.0_f64;
    for ((i, side), (end, point, left)) in jobs.into_iter().zip(found) {
        profiles.each[i].ends[side] = end;
        profiles.each[i].points[side] = point;
        largest = largest.max(left);
    }
    Ok(largest)
}

/// An end, all parameters there, and what is left of the difference.
fn moved(
    exact: &Exact,
    surrogate: &Surrogate,
    i: usize,
    side: usize,
    best: &DVector<f64>,
    (mut end, mut point): (End, DVector<f64>),
    least: f64,
    drop: f64,
) -> (End, DVector<f64>, f64) {
    let bound = exact.free[i].log_bounds()[side];
    let sign = if side == 0 { -1.0 } else { 1.0 };
    let (room, wanted) = ((bound - best[i]) * sign, drop.sqrt());
    let mut reach = (end.at - best[i]) * sign;
    // √ΔD is nearly a straight line from the best point on.
    let (mut low, mut high) = ((0.0, 0.0), None::<(f64, f64)>);
    // Unknown until simulated: as if nothing were right.
    let mut left = drop;
    for attempt in 0..TRIES {
        let Ok(deviance) = exact.deviance(&point, Some(i)) else { break };
        let root = (deviance - least).max(0.0).sqrt();
        left = (root * root - drop).abs();
        end = End { at: best[i] + sign * reach, by_data: true };
        if (root - wanted).abs() < NEAR * wanted || attempt + 1 == TRIES {
            break;
        }
        if root < wanted {
            if reach >= room {
                // Simulation does not set this end.
                return (End { at: bound, by_data: false }, point, 0.0);
            }
            low = (reach, root);
        } else {
            high = Some((reach, root));
        }
        reach = match high {
            Some((h, hr)) => low.0 + ((wanted - low.1) / (hr - low.1)).clamp(0.05, 0.95) * (h - low.0),
            None => (reach * (wanted / root.max(0.4 * wanted)).clamp(1.05, 2.5)).min(room),
        };
        let mut start = point.clone();
        start[i] = best[i] + sign * reach;
        point = constrained(surrogate, exact.free, start, i);
    }
    (end, point, left)
}

struct Exact<'a> {
    problem: &'a Problem,
    fit: &'a Fit,
    free: &'a [FreeParameter],
}

impl Exact<'_> {
    /// −2 log likelihood at parameters, baselines and, near the point, all parameters but one (or none) at their best.
    fn deviance(&self, theta: &DVector<f64>, but: Option<usize>) -> Result<f64, SimulationError> {
        let (p, n) = (theta.len(), self.fit.at.len());
        let mut at = self.fit.at.clone();
        at.rows_mut(0, p).copy_from(theta);
        let (_, q) = self.problem.account(&self.fit.held, &at, false)?;
        let bounds: Vec<[f64; 2]> = self.free.iter().map(FreeParameter::log_bounds).collect();
        let held_at_bound = |i: usize| {
            let [lower, upper] = bounds[i];
            let near = 1e-6 * (upper - lower);
            (theta[i] <= lower + near && q.gradient[i] > 0.0) || (theta[i] >= upper - near && q.gradient[i] < 0.0)
        };
        let moving: Vec<usize> = (0..n).filter(|i| *i >= p || (Some(*i) != but && !held_at_bound(*i))).collect();
        let gradient = DVector::from_fn(moving.len(), |k, _| q.gradient[moving[k]]);
        let mut information =
            DMatrix::from_fn(moving.len(), moving.len(), |k, l| q.information[(moving[k], moving[l])]);
        // A trust region: no parameter goes far in one step.
        for (k, i) in moving.iter().enumerate().filter(|(_, i)| **i < p) {
            let longest = LONGEST_STEP * (bounds[*i][1] - bounds[*i][0]);
            information[(k, k)] += (gradient[k].abs() / longest).max(1e-9);
        }
        let gain = information.cholesky().map_or(0.0, |factor| gradient.dot(&factor.solve(&gradient)));
        Ok(q.value - gain)
    }
}
