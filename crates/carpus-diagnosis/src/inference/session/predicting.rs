//! Where the ways of what is handed over end: the joint mode, and what predicts best as if nothing else were wrong
//! (`docs/src/theory/many-small-errors.md`, equations (24) and (25)).

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::linear_model::Prior;
use super::state::{Session, State};
use crate::fit::linearization::Linear;
use crate::fit::{Point, block_means, block_starts};
use carpus_effects::forward_model::{FITTED_PER_MUSCLE, Setting};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};

/// Weights λ of the prior: what is systematic in a trial counts as one observation, or as ten.
pub(super) const PRIOR_WEIGHTS: [f64; 2] = [1.0, 0.1];
/// Half width of the box of effects, in prior standard deviations; that of muscles are the study's bounds.
const BOUNDS: f64 = 3.0;
/// Gauss–Newton steps within it, at most.
const STEPS: usize = 8;
/// Share of the objective by which a step must lower it for another to follow.
const WORTH_IT: f64 = 0.01;
/// Sweeps over the coordinates of a quadratic form in a box, at most.
const SWEEPS: usize = 200;
/// A sweep that moves no coordinate by more than this share of its width is the last.
const STILL: f64 = 1e-4;

/// A point, and what it would say of every training trial had that not been there.
pub(super) struct End {
    /// EMG as recorded.
    pub(super) point: Point,
    /// What leaving the trial out adds to its simulated moment, to first order.
    pub(super) left_out: Vec<DVector<f64>>,
}

/// A trial around a point: block means, weighted so that all samples count alike.
struct Rows {
    /// Columns of nuisance and effects.
    columns: DMatrix<f64>,
    residual: DVector<f64>,
}

/// The prior of a point in a box.
struct Bounded {
    low: DVector<f64>,
    high: DVector<f64>,
    precision: DVector<f64>,
}

/// Products of the rows of all trials.
struct Products {
    of_trial: Vec<(DMatrix<f64>, DVector<f64>)>,
    all: (DMatrix<f64>, DVector<f64>),
}

impl Session<'_> {
    /// The joint mode.
    pub(super) fn joint_mode(&self, state: &State) -> End {
        let set = self.places(&state.point.effects);
        let sizes = self.sizes(state);
        let own = self.columns_of_point(&state.point);
        let mut point = self.as_recorded(state);
        let posterior = state.model.posterior(&set, sizes);
        self.put_within_bounds(&mut point.parameters, &posterior, own - self.analysis.n_nuisance());
        let at_all = &posterior.mean;
        let left_out = |((position, linear), of_trial): ((usize, &Linear), &DMatrix<f64>)| {
            let without = &state.model.products - of_trial;
            let change = state.model.posterior_of(&without, &set, sizes).mean - at_all;
            self.of_change(&self.rows(position, linear).columns, &change.rows(0, own).into_owned())
        };
        let left_out = state.linear.par_iter().enumerate().zip(&state.model.by_trial).map(left_out).collect();
        End { point, left_out }
    }

    /// The least error with the effects of a state, equation (24).
    ///
    /// - `weight`: λ of the prior
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub(super) fn least_error(&self, state: &State, weight: f64) -> Result<End, SimulationError> {
        let joint = self.as_recorded(state);
        // From the joint mode, and with the muscles as given: the muscles of one may make up for what the other finds.
        let as_given = Point { parameters: self.forward().nominal_parameters(), ..joint.clone() };
        let from = |start: Point| self.least_error_from(start, weight, self.baselines());
        let (a, b) = (from(joint)?, from(as_given));
        let objective = |(point, rows): &(Point, Vec<Rows>)| {
            let place = self.bounds_of(point, self.baselines());
            let unit = weight * unit(rows);
            square(rows) + unit * self.penalty(&place, point)
        };
        let (point, rows) = match b {
            Ok(b) if objective(&b) < objective(&a) => b,
            _ => a,
        };
        let place = self.bounds_of(&point, self.baselines());
        let (unit, from) = (weight * unit(&rows), self.displacement(&point));
        let products = Products::of(&rows, &self.image_rows(&point), unit);
        let at_all = place.least(&products, None, unit, &from);
        let left_out = |(i, rows): (usize, &Rows)| {
            self.of_change(&rows.columns, &(place.least(&products, Some(i), unit, &from) - &at_all))
        };
        let left_out = rows.par_iter().enumerate().map(left_out).collect();
        Ok(End { point, left_out })
    }

    /// The least error with some of the effects of a state, and with the muscles as given or fitted: these
    /// take all that they can.
    ///
    /// - `kept`: places of the effects that stay; `part`: of the way that is taken
    ///
    /// # Errors
    /// A trial that cannot be simulated.
    pub fn with_some(
        &self,
        state: &State,
        kept: &[usize],
        muscles: bool,
        part: f64,
    ) -> Result<(Vec<MuscleParameters>, Vec<Setting>), SimulationError> {
        let mut point = self.as_recorded(state);
        point.effects.retain(|s| self.places(std::slice::from_ref(s)).iter().all(|place| kept.contains(place)));
        if !muscles {
            point.parameters = self.forward().nominal_parameters();
        }
        let held = if muscles { self.baselines() } else { 0..self.analysis.n_nuisance() };
        let found = self.least_error_from(point, PRIOR_WEIGHTS[0], held)?.0;
        Ok(self.part_of_the_way(&found, part))
    }

    /// Muscles and effects with the least squares of the residuals beside their prior, as if nothing else
    /// were wrong, equation (24).
    ///
    /// - `held`: columns of nuisance that stay where they are
    fn least_error_from(
        &self,
        mut point: Point,
        weight: f64,
        held: Range<usize>,
    ) -> Result<(Point, Vec<Rows>), SimulationError> {
        let place = self.bounds_of(&point, held);
        let mut rows = self.all_rows(&point)?;
        for _ in 0..STEPS {
            let (unit, from) = (weight * unit(&rows), self.displacement(&point));
            let here = square(&rows) + unit * self.penalty(&place, &point);
            let step = place.least(&Products::of(&rows, &self.image_rows(&point), unit), None, unit, &from) - &from;
            let mut goes_on = false;
            for part in [1.0, 0.3] {
                let moved = self.analysis.moved(&point, &(&step * part));
                let Ok(next) = self.all_rows(&moved) else { continue };
                let there = square(&next) + unit * self.penalty(&place, &moved);
                if there < here {
                    goes_on = there < here * (1.0 - WORTH_IT);
                    (point, rows) = (moved, next);
                    break;
                }
            }
            if !goes_on {
                break;
            }
        }
        Ok((point, rows))
    }

    /// What a point costs beside the trials, in units of a trial: its prior, and the fascicle lengths of images.
    fn penalty(&self, place: &Bounded, point: &Point) -> f64 {
        let images = self.image_rows(point);
        place.penalty(&self.displacement(point)) + images.iter().map(|row| row[row.len() - 1].powi(2)).sum::<f64>()
    }

    /// Distance of muscles, baselines and effects from the prior's mean.
    fn displacement(&self, point: &Point) -> DVector<f64> {
        self.priors(point).1.rows(0, self.columns_of_point(point)).into_owned()
    }

    /// Fascicle lengths of images at a point: derivatives by the point's columns and the residual, the last,
    /// in standard deviations.
    fn image_rows(&self, point: &Point) -> Vec<DVector<f64>> {
        let own = self.columns_of_point(point);
        self.images.iter().filter_map(|image| image.row(&point.parameters, own)).collect()
    }

    /// Measured minus simulated moments of the training trials with the EMG as recorded, as in [`Rows`].
    pub(super) fn residuals(
        &self,
        parameters: &[MuscleParameters],
        effects: &[Setting],
    ) -> Result<Vec<DVector<f64>>, SimulationError> {
        let forward = self.forward();
        let variant = forward.variant(effects)?;
        let of = |g: &usize| {
            let record = &forward.trials[*g];
            let core = forward.core(&variant, *g, &forward.recorded_input(*g), parameters, effects, false)?;
            let moment = forward.recorded_moment(*g, &core, effects);
            let left: Vec<f64> = record.moment.iter().zip(&moment).map(|(y, m)| y - m).collect();
            Ok(block_means(&left, &block_starts(&record.time)) * self.weight(*g))
        };
        self.analysis.train.par_iter().map(of).collect::<Vec<_>>().into_iter().collect()
    }

    /// Root of the samples in a block of a trial.
    fn weight(&self, trial: usize) -> f64 {
        let time = &self.forward().trials[trial].time;
        (time.len() as f64 / (block_starts(time).len() - 1) as f64).sqrt()
    }

    fn rows(&self, position: usize, linear: &Linear) -> Rows {
        let (n, e) = (linear.nuisance.ncols(), linear.effects.ncols());
        let mut columns = DMatrix::zeros(linear.bare.len(), n + e);
        columns.columns_mut(0, n).copy_from(&linear.nuisance);
        columns.columns_mut(n, e).copy_from(&linear.effects);
        let weight = self.weight(self.analysis.train[position]);
        Rows { columns: columns * weight, residual: &linear.bare * weight }
    }

    fn all_rows(&self, point: &Point) -> Result<Vec<Rows>, SimulationError> {
        let linear = self.analysis.linearize(point, &[])?;
        Ok(linear.iter().enumerate().map(|(position, linear)| self.rows(position, linear)).collect())
    }

    /// A state's point with the EMG as recorded.
    fn as_recorded(&self, state: &State) -> Point {
        let Point { parameters, effects, .. } = state.point.clone();
        Point { parameters, effects, ..self.analysis.nominal_point() }
    }

    /// What a change of muscles and effects does to a trial's moment, to first order.
    fn of_change(&self, columns: &DMatrix<f64>, change: &DVector<f64>) -> DVector<f64> {
        let mut change = change.clone();
        self.baselines().for_each(|j| change[j] = 0.0);
        columns * change
    }

    /// Columns of the EMG's baselines.
    fn baselines(&self) -> Range<usize> {
        self.analysis.n_muscles() * FITTED_PER_MUSCLE..self.analysis.n_nuisance()
    }

    fn bounds_of(&self, point: &Point, held: Range<usize>) -> Bounded {
        let own = self.columns_of_point(point);
        let priors = self.priors(point).0;
        let sd = |j: usize| match priors[j] {
            _ if held.contains(&j) => 0.0,
            Prior::Known(sd) | Prior::Amplitude { plausible: sd, .. } | Prior::Shape { sd, .. } => sd,
            Prior::Discrepancy { .. } => 0.0,
        };
        let sign = |j: usize| match priors[j] {
            Prior::Amplitude { sign, .. } => sign,
            _ => None,
        };
        let muscles = self.analysis.n_muscles() * FITTED_PER_MUSCLE;
        let end = |side: f64| {
            let of = |j: usize| match sign(j) {
                _ if sd(j) <= 0.0 => 0.0,
                _ if j < muscles => {
                    let [low, high] = self.analysis.log_bounds[j % FITTED_PER_MUSCLE];
                    (if side < 0.0 { low } else { high }) - self.muscle_prior(j)[0]
                }
                Some(sign) if sign != side => 0.0,
                _ => side * BOUNDS * sd(j),
            };
            DVector::from_fn(own, |j, _| of(j))
        };
        let precision = |j: usize| if sd(j) > 0.0 { 1.0 / (sd(j) * sd(j)) } else { 0.0 };
        Bounded { low: end(-1.0), high: end(1.0), precision: DVector::from_fn(own, |j, _| precision(j)) }
    }
}

/// Sum of squares of the residuals.
fn square(rows: &[Rows]) -> f64 {
    rows.iter().map(|r| r.residual.norm_squared()).sum()
}

/// A trial's part of it, which counts as one.
fn unit(rows: &[Rows]) -> f64 {
    square(rows) / rows.len().max(1) as f64
}

impl Products {
    /// - `further`: rows of data that belong to no trial, in standard deviations, the residual last; `unit`:
    ///   their weight
    fn of(rows: &[Rows], further: &[DVector<f64>], unit: f64) -> Products {
        let of = |r: &Rows| (r.columns.tr_mul(&r.columns), r.columns.tr_mul(&r.residual));
        let of_trial: Vec<(DMatrix<f64>, DVector<f64>)> = rows.par_iter().map(of).collect();
        let count = of_trial.first().map_or(0, |t| t.1.len());
        let none = (DMatrix::zeros(count, count), DVector::zeros(count));
        let mut all = of_trial.iter().fold(none, |(a, b), (more_a, more_b)| (a + more_a, b + more_b));
        for row in further {
            let by = row.rows(0, count).into_owned();
            all.0.ger(unit, &by, &by, 1.0);
            all.1.axpy(unit * row[count], &by, 1.0);
        }
        Products { of_trial, all }
    }
}

impl Bounded {
    fn penalty(&self, displacement: &DVector<f64>) -> f64 {
        displacement.component_mul(displacement).dot(&self.precision)
    }

    /// The displacement d from the prior's mean within the box with the least |r − Z (d − from)|² + unit Σ
    /// precision d², coordinate by coordinate.
    ///
    /// - `without`: a trial that is left out
    fn least(&self, products: &Products, without: Option<usize>, unit: f64, from: &DVector<f64>) -> DVector<f64> {
        let (mut a, mut b) = products.all.clone();
        if let Some((of_a, of_b)) = without.map(|i| &products.of_trial[i]) {
            a -= of_a;
            b -= of_b;
        }
        b += &a * from;
        for (j, precision) in self.precision.iter().enumerate() {
            a[(j, j)] += unit * precision;
        }
        let mut d = DVector::from_fn(from.len(), |j, _| from[j].clamp(self.low[j], self.high[j]));
        let free: Vec<usize> = (0..d.len()).filter(|j| self.high[*j] > self.low[*j] && a[(*j, *j)] > 0.0).collect();
        for _ in 0..SWEEPS {
            let mut largest = 0.0_f64;
            for &j in &free {
                let slope = b[j] - a.column(j).dot(&d);
                let moved = (d[j] + slope / a[(j, j)]).clamp(self.low[j], self.high[j]);
                largest = largest.max((moved - d[j]).abs() / (self.high[j] - self.low[j]));
                d[j] = moved;
            }
            if largest < STILL {
                break;
            }
        }
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_least_in_a_box_is_that_of_a_fine_grid() {
        let a = DMatrix::from_row_slice(2, 2, &[3.0, 1.2, 1.2, 0.9]);
        let b = DVector::from_vec(vec![2.0, -1.5]);
        let products = Products { of_trial: Vec::new(), all: (a.clone(), b.clone()) };
        let place = Bounded {
            low: DVector::from_vec(vec![-0.8, 0.0]),
            high: DVector::from_vec(vec![0.8, 0.5]),
            precision: DVector::from_vec(vec![0.1, 0.2]),
        };
        let from = DVector::from_vec(vec![0.3, 0.1]);
        let value = |d: &DVector<f64>| {
            let step = d - &from;
            step.dot(&(&a * &step)) - 2.0 * b.dot(&step) + 1.5 * place.penalty(d)
        };
        let found = place.least(&products, None, 1.5, &from);
        let grid = |i: usize, j: usize| DVector::from_vec(vec![0.004 * i as f64 - 0.8, 0.00125 * j as f64]);
        let points = (0..=400).flat_map(|i| (0..=400).map(move |j| (i, j)));
        let least = points.map(|(i, j)| value(&grid(i, j))).fold(f64::INFINITY, f64::min);
        assert!((-0.8..=0.8).contains(&found[0]) && (0.0..=0.5).contains(&found[1]), "{found}");
        assert!((value(&found) - least).abs() < 1e-3, "{} {least} at {found}", value(&found));
    }
}
