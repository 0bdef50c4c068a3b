//! The objective J itself, minimized over all parameters together with exact gradients, from several starts.
//!
//! J has corners: absolute values and maxima over samples. They are rounded off on a scale that shrinks from one pass
//! to the next, so that a method for smooth functions always sees a smooth one:
//!
//! ```text
//! |e| ≈ (e² + s²)^½ − s            max_k |e_k| ≈ s ln ½ Σ_k (exp(e_k/s) + exp(−e_k/s)) − s ln M
//! ```
//! with s a fraction of max|τ_exp|. What is returned is the best point by J as it is printed.

use std::cell::{Cell, RefCell};
use std::ops::Range;

use rayon::prelude::*;

use super::minimizers::Found;
use super::minimizers::minimize_with_gradient;
use super::moments::TrainingSet;
use super::objective::objective;
use super::parameters::ParameterSpace;
use super::search::latin_hypercube;
use carpus_simulation::simulation::{MuscleParameters, SimulationError, UnitMoment};

/// Rounding of corners, of max|τ_exp|, pass by pass, with the tolerance of J and the most iterations.
const PASSES: [(f64, f64, u64); 3] = [(0.05, 1e-4, 25), (0.01, 1e-5, 25), (0.002, 1e-6, 40)];

/// J of a training set as a function of a point of the unit box: of the free factors, all others as in `base`.
pub(super) struct SmoothObjective<'a> {
    space: &'a ParameterSpace,
    set: &'a TrainingSet<'a>,
    base: Vec<f64>,
    free: Range<usize>,
    evaluations: Cell<usize>,
    /// Where only forces are free: moments per unit of force, which do not depend on them.
    units: RefCell<Option<Vec<UnitMoment>>>,
    /// The best point by J itself among all that were evaluated, and its J.
    best: RefCell<(Vec<f64>, f64)>,
    /// The same of the start that is being gone on with.
    ending: RefCell<(Vec<f64>, f64)>,
    /// Where the starts led.
    ends: RefCell<Vec<Vec<f64>>>,
}

/// A trial's J, smooth and as printed, and the derivatives of the smooth one by all parameter values.
struct TrialObjective {
    smooth: f64,
    exact: f64,
    by_value: Vec<f64>,
}

impl<'a> SmoothObjective<'a> {
    pub(super) fn new(
        space: &'a ParameterSpace,
        set: &'a TrainingSet<'a>,
        base: Vec<f64>,
        free: Range<usize>,
    ) -> SmoothObjective<'a> {
        let best = RefCell::new((space.to_unit(&base)[free.clone()].to_vec(), f64::INFINITY));
        let (ending, ends) = (RefCell::new((Vec::new(), f64::INFINITY)), RefCell::new(Vec::new()));
        SmoothObjective {
            space,
            set,
            base,
            free,
            evaluations: Cell::new(0),
            units: RefCell::new(None),
            best,
            ending,
            ends,
        }
    }

    /// All factors at a point, and the derivatives of the free ones by the point's coordinates.
    fn factors(&self, point: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut factors = self.base.clone();
        let mut by_unit = Vec::with_capacity(point.len());
        for (i, x) in point.iter().enumerate() {
            let (factor, derivative) = self.space.at_unit(self.free.start + i, *x);
            factors[self.free.start + i] = factor;
            by_unit.push(derivative);
        }
        (factors, by_unit)
    }

    /// Smooth J and its gradient at a point of the unit box; a large value where it cannot be simulated.
    fn value_and_gradient(&self, point: &[f64], rounding: f64) -> (f64, Vec<f64>) {
        self.evaluations.set(self.evaluations.get() + 1);
        match self.evaluate(point, rounding) {
            Ok((smooth, exact, gradient)) => {
                for best in [&self.best, &self.ending] {
                    if exact < best.borrow().1 {
                        best.replace((point.to_vec(), exact));
                    }
                }
                (smooth, gradient)
            }
            // Uphill from the best point: a line search turns back.
            Err(_) => {
                let best = self.best.borrow();
                let away: Vec<f64> = point.iter().zip(&best.0).map(|(x, b)| x - b).collect();
                (super::search::UNUSABLE + away.iter().map(|d| d * d).sum::<f64>(), away)
            }
        }
    }

    fn evaluate(&self, point: &[f64], rounding: f64) -> Result<(f64, f64, Vec<f64>), SimulationError> {
        let (factors, by_unit) = self.factors(point);
        let parameters = self.space.parameters(&factors);
        let (set, m) = (self.set, parameters.len());
        let trials = &set.trials;
        let kept = self.units.borrow();
        let fresh = if kept.is_some() { None } else { Some(self.unit_moments(&parameters)?) };
        let units: &[UnitMoment] = kept.as_deref().or(fresh.as_deref()).unwrap_or_default();
        let forces: Vec<f64> = parameters.iter().map(|p| p.max_isometric_force).collect();
        let per_trial: Vec<TrialObjective> = (0..trials.len())
            .into_par_iter()
            .map(|t| trial_objective(set, t, &units[t * m..(t + 1) * m], &forces, rounding))
            .collect();
        let n = trials.len() as f64;
        // By parameter value, then by factor, then by coordinate of the unit box.
        let values: [fn(&MuscleParameters) -> f64; 3] =
            [|p| p.optimal_fiber_length, |p| p.tendon_slack_length, |p| p.max_isometric_force];
        let of_coordinate = |c: usize| {
            let i = self.free.start + c;
            let by_value: f64 = per_trial.iter().map(|t| t.by_value[i]).sum::<f64>() / n;
            by_value * values[i / m](&parameters[i % m]) / factors[i] * by_unit[c]
        };
        let gradient = (0..point.len()).map(of_coordinate).collect();
        let smooth = per_trial.iter().map(|t| t.smooth).sum::<f64>() / n;
        let exact = per_trial.iter().map(|t| t.exact).sum::<f64>() / n;
        drop(kept);
        if let (Some(fresh), true) = (fresh, self.free.start >= 2 * m) {
            self.units.replace(Some(fresh));
        }
        Ok((smooth, exact, gradient))
    }

    /// Unit moments of all muscles, trial by trial, with their derivatives.
    fn unit_moments(&self, parameters: &[MuscleParameters]) -> Result<Vec<UnitMoment>, SimulationError> {
        let (m, trials) = (parameters.len(), &self.set.trials);
        let units: Vec<Result<UnitMoment, SimulationError>> = (0..trials.len() * m)
            .into_par_iter()
            .map(|i| trials[i / m].prepared.unit_moment_with_derivatives(i % m, &parameters[i % m]))
            .collect();
        units.into_iter().collect()
    }

    /// The factors of a point that was found.
    pub(super) fn factors_of(&self, found: &Found) -> Vec<f64> {
        self.factors(&found.point).0
    }

    /// The factors of the points to which the starts led.
    pub(super) fn factors_of_ends(&self) -> Vec<Vec<f64>> {
        self.ends.borrow().iter().map(|point| self.factors(point).0).collect()
    }

    /// Minimizes J from the model itself and from the best of a Latin hypercube.
    ///
    /// - `screened`: points of the hypercube, `starts`: how many of them, the best ones, are gone on with
    pub(super) fn minimize(&self, screened: usize, starts: usize, seed: u64) -> Result<Found, String> {
        let n = self.free.len();
        let mut points = latin_hypercube(screened, n, seed, 3);
        let only_forces = self.free.start >= 2 * self.space.n_muscles();
        let cost = |point: &Vec<f64>| {
            if only_forces {
                return self.evaluate(point, PASSES[0].0).map_or(super::search::UNUSABLE, |(_, exact, _)| exact);
            }
            let (factors, _) = self.factors(point);
            self.set.objective(&self.space.parameters(&factors)).unwrap_or(super::search::UNUSABLE)
        };
        let costs: Vec<f64> = points.iter().map(cost).collect();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]));
        let mut begin = vec![self.space.to_unit(&self.base)[self.free.clone()].to_vec()];
        begin.extend(order.into_iter().take(starts).map(|i| std::mem::take(&mut points[i])));
        // All starts take the first pass; the best goes on.
        let (rounding, tolerance, iterations) = PASSES[0];
        let mut reason = String::from("no start");
        for start in &begin {
            self.ending.replace((Vec::new(), f64::INFINITY));
            let smooth = |x: &[f64]| self.value_and_gradient(x, rounding);
            if let Err(error) = minimize_with_gradient(&smooth, start, tolerance, iterations) {
                reason = error;
            }
            let (end, cost) = self.ending.take();
            if cost.is_finite() {
                self.ends.borrow_mut().push(end);
            }
        }
        if !self.best.borrow().1.is_finite() {
            return Err(reason);
        }
        self.refine();
        Ok(self.found(screened))
    }

    /// Minimizes J from `base` alone, which is near the minimum.
    pub(super) fn minimize_nearby(&self) -> Found {
        let start = self.best.borrow().0.clone();
        self.value_and_gradient(&start, PASSES[1].0);
        self.refine();
        self.found(0)
    }

    /// The passes after the first, from the best point.
    fn refine(&self) {
        for (rounding, tolerance, iterations) in &PASSES[1..] {
            let start = self.best.borrow().0.clone();
            let smooth = |x: &[f64]| self.value_and_gradient(x, *rounding);
            // The best point stays the best if the solver gives up.
            let _ = minimize_with_gradient(&smooth, &start, *tolerance, *iterations);
        }
    }

    fn found(&self, screened: usize) -> Found {
        let (point, cost) = self.best.borrow().clone();
        Found { point, cost, evaluations: self.evaluations.get() + screened }
    }
}

/// Derivatives are by optimal fibre length, tendon slack length and maximum isometric force, property by property.
fn trial_objective(set: &TrainingSet, t: usize, units: &[UnitMoment], forces: &[f64], rounding: f64) -> TrialObjective {
    let measured = set.trials[t].measured;
    let mut moment = set.fixed[t].clone();
    for (unit, force) in units.iter().zip(forces) {
        moment.iter_mut().zip(&unit.moment).for_each(|(total, u)| *total += force * u);
    }
    let largest = measured.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let square: f64 = measured.iter().map(|v| v * v).sum();
    let (m, count) = (units.len(), measured.len() as f64);
    let s = rounding * largest;
    let peak = moment.iter().zip(measured).fold(0.0_f64, |a, (sim, exp)| a.max((sim - exp).abs()));
    let weights: Vec<[f64; 2]> = moment
        .iter()
        .zip(measured)
        .map(|(sim, exp)| [((sim - exp - peak) / s).exp(), ((exp - sim - peak) / s).exp()])
        .collect();
    let total: f64 = weights.iter().map(|[a, b]| a + b).sum();
    let mut smooth = (peak + s * (0.5 * total).ln() - s * count.ln()) / largest + 1.0;
    let mut by_value = vec![0.0; 3 * m];
    for (k, (sim, exp)) in moment.iter().zip(measured).enumerate() {
        let error = sim - exp;
        let root = (error * error + s * s).sqrt();
        smooth += (root - s) / (count * largest) - exp * sim / square;
        let by_moment =
            error / root / (count * largest) + (weights[k][0] - weights[k][1]) / total / largest - exp / square;
        for (j, (unit, force)) in units.iter().zip(forces).enumerate() {
            by_value[j] += by_moment * force * unit.by_optimal_fiber_length[k];
            by_value[m + j] += by_moment * force * unit.by_tendon_slack_length[k];
            by_value[2 * m + j] += by_moment * unit.moment[k];
        }
    }
    TrialObjective { smooth, exact: objective(measured, &moment), by_value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::personalization::{FitProblem, TrainingTrial};
    use carpus_osim::osim::OsimFile;
    use carpus_simulation::simulation::{MusculoskeletalModel, Options, Recording, Setup};
    use carpus_study::study::{Study, TrialUse};

    #[test]
    fn verif_gradient_is_that_of_differences_and_rounding_vanishes() {
        let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("fixtures/demo_study");
        let study = Study::read(&folder).unwrap();
        let who = study.participants[0].clone();
        let file = OsimFile::read(&who.model).unwrap();
        let model = MusculoskeletalModel::compile(&file.spec, &Setup::from_settings(&study.settings)).unwrap();
        let train = study.trials_of(&who.name).filter(|t| t.usage == TrialUse::Train && t.effort_percent == Some(25.0));
        let trials: Vec<_> = train.step_by(3).map(|info| study.trial(info).unwrap()).collect();
        let recordings: Vec<Recording> = trials.iter().map(Recording::from).collect();
        let prepared = model.prepare_all(&recordings, &Options::default()).unwrap();
        let problem = FitProblem {
            trials: trials
                .iter()
                .zip(&prepared)
                .map(|(t, prepared)| TrainingTrial { prepared, measured: &t.moment })
                .collect(),
            muscles: model.muscle_names().map(str::to_owned).collect(),
            nominal: model.nominal_parameters(),
            bounds: study.settings.bounds,
        };
        let space = ParameterSpace::new(problem.muscles.clone(), problem.nominal.clone(), &problem.bounds).unwrap();
        let set = TrainingSet::new(&problem).unwrap();
        for free in [0..15, 10..15, 0..10] {
            let smooth = SmoothObjective::new(&space, &set, space.unchanged(), free.clone());
            let point: Vec<f64> = (0..free.len()).map(|i| 0.4 + 0.02 * i as f64).collect();
            let (_, exact, gradient) = smooth.evaluate(&point, 0.05).unwrap();
            let (value, exact_again, _) = smooth.evaluate(&point, 1e-6).unwrap();
            assert_eq!(exact, exact_again);
            assert!((value - exact).abs() < 1e-4, "{value} {exact}");
            for i in 0..point.len() {
                let at = |step: f64| {
                    let mut moved = point.clone();
                    moved[i] += step;
                    smooth.evaluate(&moved, 0.05).unwrap().0
                };
                let difference = (at(1e-4) - at(-1e-4)) / 2e-4;
                let scale = gradient.iter().fold(0.1_f64, |a, g| a.max(g.abs()));
                assert!((difference - gradient[i]).abs() < 2e-4 * scale, "{i}: {difference} {}", gradient[i]);
            }
        }
    }
}
