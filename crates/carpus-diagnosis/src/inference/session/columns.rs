//! Columns of the linear model, and their priors (`docs/src/theory/many-small-errors.md`, equation (14)).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::super::discrepancy;
use super::super::linear_model::{LinearModel, Prior, SizePriors};
use super::state::Session;
use crate::fit::linearization::Linear;
use crate::fit::{Point, block_means, block_starts, product, whiten};
use carpus_effects::effect::{Effect, Role};
use carpus_effects::forward_model::FITTED_PER_MUSCLE;
use carpus_effects::forward_model::recorded_changes::Change;

/// Prior scale of κ: what a laboratory has of every effect, as a share of what is plausible, equation (5).
const EVERYTHING: f64 = 0.15;
/// Prior scale of the relative error of a muscle's moment, equations (5) and (6).
const OF_MUSCLES: f64 = 0.08;
/// Prior scale of the moment that is left beside the muscles, in tenths of a newton metre at a wrist, equations (5) and
/// (7).
const OF_MOMENT: f64 = 0.5;

/// Directions of a trial with the noise whitened, and their products.
pub(super) struct WhitenedDirections {
    pub(super) columns: DMatrix<f64>,
    pub(super) products: DMatrix<f64>,
}

/// An effect's columns in the linear model.
pub(super) struct EffectColumns {
    pub(super) amplitudes: Vec<usize>,
}

impl Session<'_> {
    /// Places of the effects that may be named and of which the data can speak.
    pub(super) fn testable(&self) -> Vec<usize> {
        let testable = |i: &usize| self.analysis.candidates[*i].description().unidentifiable.is_none();
        self.nameable.iter().copied().filter(testable).collect()
    }

    /// Standard deviation of what is plausible of an amplitude, in units of its scale, and the sign that it
    /// must have: equation (3).
    pub(crate) fn plausible(&self, effect: &'static dyn Effect, parameter: usize) -> (f64, Option<f64>) {
        let forward = self.forward();
        let p = &effect.description().parameters[parameter];
        let scale = forward.joint.scale(p);
        let [low, high] = forward.joint.plausible(p);
        let ends = if effect.has_log_ratios() {
            let absent = forward.joint.absent(effect).values;
            let usual = effect.reported(&absent, &forward.muscles)[parameter].max(f64::MIN_POSITIVE);
            [low.max(f64::MIN_POSITIVE) / usual, high / usual].map(f64::ln)
        } else {
            [low, high]
        };
        let largest = ends[0].abs().max(ends[1].abs());
        let sign = match ends {
            [low, _] if low >= 0.0 => Some(1.0),
            [_, high] if high <= 0.0 => Some(-1.0),
            _ => None,
        };
        (0.5 * largest / scale, sign)
    }

    /// Columns of the discrepancy of the muscles in a trial, equation (6), averaged over blocks.
    pub(super) fn of_muscles(&self, position: usize, point: &Point, linear: &Linear) -> DMatrix<f64> {
        let (forward, g) = (self.forward(), self.analysis.train[position]);
        let starts = block_starts(&forward.trials[g].time);
        let kinematics = linear.core.prepared.kinematics();
        let of_muscle = |m: usize| {
            let moment = &linear.core.by_parameters[m * FITTED_PER_MUSCLE];
            discrepancy::columns(&self.ranges, kinematics, m, moment)
        };
        let mut columns: Vec<Vec<f64>> = (0..self.analysis.n_muscles()).flat_map(of_muscle).collect();
        if forward.reshapes_moment(&point.effects) {
            let changes = columns.iter().map(|c| Change::Moment(c));
            columns = forward.recorded_changes(g, &linear.core, &point.effects, changes);
        }
        DMatrix::from_columns(&columns.iter().map(|c| block_means(c, &starts)).collect::<Vec<_>>())
    }

    /// Priors of the columns [nuisance | effects that are on | directions | muscles' discrepancy] and the
    /// point's distance from their means.
    pub(super) fn priors(&self, point: &Point) -> (Vec<Prior>, DVector<f64>) {
        let mut priors = Vec::new();
        let mut offset = Vec::new();
        let forward = self.forward();
        priors
            .extend((0..self.analysis.n_muscles() * FITTED_PER_MUSCLE).map(|j| Prior::Known(self.muscle_prior(j)[1])));
        for (p, nominal) in point.parameters.iter().zip(forward.nominal_parameters()) {
            offset.push((p.max_isometric_force / nominal.max_isometric_force).ln());
            offset.push((p.optimal_fiber_length / nominal.optimal_fiber_length).ln());
            offset.push((p.tendon_slack_length / nominal.tendon_slack_length).ln());
        }
        offset.iter_mut().enumerate().for_each(|(j, o)| *o -= self.muscle_prior(j)[0]);
        priors.extend(point.baseline.iter().map(|_| Prior::Known(1.0)));
        offset.extend(&point.baseline);
        let place = |e: &'static dyn Effect| {
            self.analysis.candidates.iter().position(|c| c.description().id == e.description().id).unwrap_or(usize::MAX)
        };
        for setting in &point.effects {
            let effect = place(setting.effect);
            for (i, (p, value)) in setting.effect.description().parameters.iter().zip(&setting.values).enumerate() {
                priors.push(match p.role {
                    Role::Shape => Prior::Shape { effect, sd: 1.0 },
                    Role::Amplitude => {
                        let (plausible, sign) = self.plausible(setting.effect, i);
                        Prior::Amplitude { effect, plausible, sign }
                    }
                });
                offset.push((value - forward.joint.start(p)) / forward.joint.scale(p));
            }
        }
        let is_on = |id: &str| point.effects.iter().any(|s| s.effect.description().id == id);
        for (effect, candidate) in self.analysis.candidates.iter().enumerate() {
            for i in candidate.description().amplitudes() {
                let (plausible, sign) = self.plausible(*candidate, i);
                let absent = is_on(candidate.description().id) || candidate.description().unidentifiable.is_some();
                priors.push(if absent { Prior::Known(0.0) } else { Prior::Amplitude { effect, plausible, sign } });
            }
        }
        let moment = self.analysis.n_muscles();
        let of_axes =
            self.analysis.blocks.iter().filter(|b| b.name.starts_with("axis:")).map(|b| b.columns.len()).sum();
        priors.extend(std::iter::repeat_n(Prior::Discrepancy { size: moment, weight: 1.0 }, of_axes));
        for m in 0..self.analysis.n_muscles() {
            priors.extend(
                (0..discrepancy::PER_MUSCLE).map(|j| Prior::Discrepancy { size: m, weight: discrepancy::weight(j) }),
            );
        }
        offset.resize(priors.len(), 0.0);
        (priors, DVector::from_vec(offset))
    }

    /// Mean and standard deviation of the logarithm of a muscle parameter's factor before the data.
    pub(super) fn muscle_prior(&self, column: usize) -> [f64; 2] {
        let known = self.muscle_priors.get(column).copied();
        known.unwrap_or([0.0, self.analysis.prior_sd[column % FITTED_PER_MUSCLE]])
    }

    pub(super) fn size_priors(&self) -> SizePriors {
        let mut discrepancy = vec![OF_MUSCLES; self.analysis.n_muscles()];
        discrepancy.push(OF_MOMENT);
        SizePriors { everything: EVERYTHING, discrepancy }
    }

    /// All columns of a trial, and the residual.
    pub(super) fn columns(
        &self,
        position: usize,
        point: &Point,
        linear: &Linear,
        directions: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let of_muscles = self.of_muscles(position, point, linear);
        let parts = [&linear.nuisance, &linear.effects, directions, &of_muscles];
        let total: usize = parts.iter().map(|p| p.ncols()).sum();
        let mut all = DMatrix::zeros(linear.residual.len(), total + 1);
        let mut next = 0;
        for part in parts {
            all.columns_mut(next, part.ncols()).copy_from(part);
            next += part.ncols();
        }
        all.set_column(total, &linear.residual);
        all
    }

    pub(super) fn all_columns(
        &self,
        point: &Point,
        linear: &[Linear],
        directions: &[DMatrix<f64>],
    ) -> Vec<DMatrix<f64>> {
        let of = |(i, (l, d)): (usize, (&Linear, &DMatrix<f64>))| self.columns(i, point, l, d);
        linear.par_iter().zip(directions).enumerate().map(of).collect()
    }

    pub(super) fn model(&self, point: &Point, columns: &[DMatrix<f64>], factors: &[Cholesky<f64, Dyn>]) -> LinearModel {
        let (priors, offset) = self.priors(point);
        let products = |(columns, factor): (&DMatrix<f64>, &Cholesky<f64, Dyn>)| {
            let w = whiten(factor, columns);
            product(&w, &w)
        };
        let by_trial: Vec<_> = columns.par_iter().zip(factors).map(products).collect();
        self.with_image_rows(point, LinearModel::new(priors, offset, by_trial, self.size_priors()))
    }

    fn with_image_rows(&self, point: &Point, model: LinearModel) -> LinearModel {
        let columns = model.len();
        model.with_rows(self.images.iter().filter_map(|image| image.row(&point.parameters, columns)))
    }

    /// As [`Session::model`], directions being whitened already.
    pub(super) fn model_beside(
        &self,
        point: &Point,
        linear: &[Linear],
        whitened: &[WhitenedDirections],
        factors: &[Cholesky<f64, Dyn>],
    ) -> LinearModel {
        let (priors, offset) = self.priors(point);
        let of_trial =
            |(position, ((l, d), factor)): (usize, ((&Linear, &WhitenedDirections), &Cholesky<f64, Dyn>))| {
                let of_muscles = self.of_muscles(position, point, l);
                let (own, directions) = (l.nuisance.ncols() + l.effects.ncols(), d.columns.ncols());
                let rest = of_muscles.ncols() + 1;
                let mut moving = DMatrix::zeros(l.residual.len(), own + rest);
                moving.columns_mut(0, l.nuisance.ncols()).copy_from(&l.nuisance);
                moving.columns_mut(l.nuisance.ncols(), l.effects.ncols()).copy_from(&l.effects);
                moving.columns_mut(own, rest - 1).copy_from(&of_muscles);
                moving.set_column(own + rest - 1, &l.residual);
                let moving = whiten(factor, &moving);
                let squares = product(&moving, &moving);
                let cross = product(&moving, &d.columns);
                let n = own + directions + rest;
                let mut out = DMatrix::zeros(n, n);
                let at = own + directions;
                out.view_mut((0, 0), (own, own)).copy_from(&squares.view((0, 0), (own, own)));
                out.view_mut((0, at), (own, rest)).copy_from(&squares.view((0, own), (own, rest)));
                out.view_mut((at, 0), (rest, own)).copy_from(&squares.view((own, 0), (rest, own)));
                out.view_mut((at, at), (rest, rest)).copy_from(&squares.view((own, own), (rest, rest)));
                out.view_mut((own, own), (directions, directions)).copy_from(&d.products);
                out.view_mut((0, own), (own, directions)).copy_from(&cross.rows(0, own));
                out.view_mut((own, 0), (directions, own)).copy_from(&cross.rows(0, own).transpose());
                out.view_mut((at, own), (rest, directions)).copy_from(&cross.rows(own, rest));
                out.view_mut((own, at), (directions, rest)).copy_from(&cross.rows(own, rest).transpose());
                out
            };
        let by_trial: Vec<_> = linear.par_iter().zip(whitened).zip(factors).enumerate().map(of_trial).collect();
        self.with_image_rows(point, LinearModel::new(priors, offset, by_trial, self.size_priors()))
    }

    /// What the variances of the noise are estimated beside: columns in units of their prior standard
    /// deviations, and the residual at the priors' means.
    pub(super) fn regressors(
        model: &LinearModel,
        columns: &[DMatrix<f64>],
        sd: &DVector<f64>,
    ) -> Vec<(DMatrix<f64>, DVector<f64>)> {
        let p = model.len();
        let used: Vec<usize> = (0..p).filter(|j| sd[*j] > 0.0).collect();
        columns
            .iter()
            .map(|c| {
                let residual = c.column(p) + c.columns(0, p) * &model.offset;
                let mut x = c.select_columns(&used);
                for (mut column, j) in x.column_iter_mut().zip(&used) {
                    column *= sd[*j];
                }
                (x, residual)
            })
            .collect()
    }

    pub(super) fn amplitude_columns(&self, model: &LinearModel) -> Vec<EffectColumns> {
        let of = |effect: usize| {
            let own = |(_, p): &(usize, &Prior)| matches!(p, Prior::Amplitude { effect: e, .. } if *e == effect);
            EffectColumns { amplitudes: model.priors.iter().enumerate().filter(own).map(|(j, _)| j).collect() }
        };
        (0..self.analysis.candidates.len()).map(of).collect()
    }
}
