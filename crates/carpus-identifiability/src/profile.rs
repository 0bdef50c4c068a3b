//! Confidence intervals by profile likelihood: for every value of a parameter the best that all others can do.
//!
//! ```text
//! D_i(c) = min { D(θ) : θ_i = c, bounds },   interval = { c : D_i(c) − min D ≤ t²(level) }
//! ```
//! # References
//! Raue et al. (2009), Structural and practical identifiability analysis of partially observed dynamical models by
//! exploiting the profile likelihood, doi:10.1093/bioinformatics/btp358.

use nalgebra::DVector;
use rayon::prelude::*;

use super::descent::{Limits, descend};
use super::parameters::FreeParameter;
use super::surrogate::Surrogate;

/// Evaluations of a constrained minimum.
const EVALUATIONS: usize = 40;
/// Decrease of D that a step must promise.
const CONVERGED: f64 = 1e-3;
/// An end is found when √ΔD is this near to what is wanted.
const NEAR: f64 = 0.01;
/// Points tried for an end.
const TRIES: usize = 14;

/// One end of an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct End {
    /// Logarithm of the factor.
    pub(super) at: f64,
    /// Whether the data set it, not the bound.
    pub(super) by_data: bool,
}

/// A parameter's profile.
#[derive(Clone, Debug)]
pub(super) struct Profile {
    pub(super) ends: [End; 2],
    /// All parameters at the ends.
    pub(super) points: [DVector<f64>; 2],
    /// Whether another parameter stands at a bound at an end: the interval then rests on that bound, too.
    pub(super) leans_on_bounds: bool,
}

/// The best parameters and the profiles of all.
#[derive(Clone, Debug)]
pub(super) struct Profiles {
    pub(super) best: DVector<f64>,
    pub(super) each: Vec<Profile>,
}

/// Minimizes D with some parameters fixed.
fn minimize(surrogate: &Surrogate, free: &[FreeParameter], start: DVector<f64>, fixed: &[bool]) -> (DVector<f64>, f64) {
    let bounds: Vec<[f64; 2]> = free.iter().map(FreeParameter::log_bounds).collect();
    let limits = Limits {
        lower: &bounds.iter().map(|b| b[0]).collect::<Vec<_>>(),
        upper: &bounds.iter().map(|b| b[1]).collect::<Vec<_>>(),
        fixed,
        step: &bounds.iter().map(|b| 0.2 * (b[1] - b[0])).collect::<Vec<_>>(),
        evaluations: EVALUATIONS,
        tolerance: CONVERGED,
    };
    let (x, q) = descend(&mut |x| Some(surrogate.evaluate(x.as_slice(), true)), start, &limits)
        .expect("polynomials can be evaluated everywhere");
    (x, q.value)
}

/// The best of all parameters but one, which stays where `start` has it.
pub(super) fn constrained(
    surrogate: &Surrogate,
    free: &[FreeParameter],
    start: DVector<f64>,
    stays: usize,
) -> DVector<f64> {
    let fixed: Vec<bool> = (0..free.len()).map(|k| k == stays).collect();
    minimize(surrogate, free, start, &fixed).0
}

/// Profiles of all parameters.
///
/// - `drops`: of every parameter; χ²₁ of the level, 2.706 for 90 %, or the square of Student's t
pub(super) fn profiles(surrogate: &Surrogate, free: &[FreeParameter], start: &DVector<f64>, drops: &[f64]) -> Profiles {
    let n = free.len();
    let mut start = start.rows(0, n).into_owned();
    // A profile may come upon a better optimum; then all are made anew from there.
    for _ in 0..3 {
        let (best, deviance) = minimize(surrogate, free, start, &vec![false; n]);
        let each: Vec<(Profile, Option<(DVector<f64>, f64)>)> =
            (0..n).into_par_iter().map(|i| profile(surrogate, free, &best, deviance, i, drops[i])).collect();
        let better = each
            .iter()
            .filter_map(|(_, b)| b.as_ref())
            .filter(|(_, d)| *d < deviance - 0.05)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match better {
            Some((x, _)) => start = x.clone(),
            None => return Profiles { best, each: each.into_iter().map(|(p, _)| p).collect() },
        }
    }
    let (best, deviance) = minimize(surrogate, free, start, &vec![false; n]);
    let each = (0..n).into_par_iter().map(|i| profile(surrogate, free, &best, deviance, i, drops[i]).0).collect();
    Profiles { best, each }
}

fn profile(
    surrogate: &Surrogate,
    free: &[FreeParameter],
    best: &DVector<f64>,
    deviance: f64,
    i: usize,
    drop: f64,
) -> (Profile, Option<(DVector<f64>, f64)>) {
    let n = free.len();
    let information = surrogate.evaluate(best.as_slice(), true).information;
    let mut better: Option<(DVector<f64>, f64)> = None;
    let mut fixed = vec![false; n];
    fixed[i] = true;
    let bounds = free[i].log_bounds();
    let wanted = drop.sqrt();
    // Of the parameter given all others at their best, to first order.
    let mut damped = information.clone();
    (0..n).for_each(|k| damped[(k, k)] += 1e-9 * information.diagonal().max() + 1e-12);
    let sd = damped.try_inverse().map_or(0.1, |c| c[(i, i)].max(0.0).sqrt()).clamp(1e-5, bounds[1] - bounds[0]);
    let mut leans = false;
    let ends = [-1.0, 1.0].map(|side: f64| {
        let bound = if side < 0.0 { bounds[0] } else { bounds[1] };
        let room = (bound - best[i]) * side;
        let mut at = |reach: f64, from: &DVector<f64>| {
            let mut start = from.clone();
            start[i] = best[i] + side * reach;
            let (x, d) = minimize(surrogate, free, start, &fixed);
            if d < deviance - 0.05 && better.as_ref().is_none_or(|b| d < b.1) {
                better = Some((x.clone(), d));
            }
            ((d - deviance).max(0.0).sqrt(), x)
        };
        let (mut low, mut low_root, mut from) = (0.0, 0.0, best.clone());
        let mut high: Option<(f64, f64)> = None;
        let mut reach = (sd * wanted).min(room);
        let mut point = best.clone();
        for _ in 0..TRIES {
            if room <= 0.0 {
                break;
            }
            let (root, x) = at(reach, &from);
            point.clone_from(&x);
            if (root - wanted).abs() < NEAR {
                leans |= at_bounds(free, &x, i);
                return (End { at: best[i] + side * reach, by_data: true }, x);
            }
            if root < wanted {
                (low, low_root, from) = (reach, root, x);
                if reach >= room {
                    break;
                }
            } else {
                high = Some((reach, root));
            }
            reach = match high {
                // √ΔD is nearly a straight line.
                Some((h, hr)) => {
                    let part = ((wanted - low_root) / (hr - low_root)).clamp(0.05, 0.95);
                    low + part * (h - low)
                }
                None => (reach * (1.1 * wanted / root.max(0.25 * wanted)).max(1.15)).min(room),
            };
        }
        if low >= room || room <= 0.0 {
            (End { at: bound, by_data: false }, point)
        } else {
            leans |= at_bounds(free, &point, i);
            (End { at: best[i] + side * reach, by_data: true }, point)
        }
    });
    let [(lower, low_point), (upper, high_point)] = ends;
    (Profile { ends: [lower, upper], points: [low_point, high_point], leans_on_bounds: leans }, better)
}

fn at_bounds(free: &[FreeParameter], x: &DVector<f64>, except: usize) -> bool {
    free.iter().enumerate().any(|(k, p)| {
        let [lower, upper] = p.log_bounds();
        let near = 1e-6 * (upper - lower);
        k != except && (x[k] <= lower + near || x[k] >= upper - near)
    })
}
