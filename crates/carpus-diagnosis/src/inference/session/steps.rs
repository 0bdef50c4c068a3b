//! Steps: effects switched on and off, descents with the noise held, sets that are tried by simulation
//! (`docs/src/theory/many-small-errors.md`, equation (21)).

use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

use super::super::linear_model::{LinearModel, Posterior, Sizes};
use super::super::search::{NEGLIGIBLE, Sets};
use super::columns::WhitenedDirections;
use super::state::{Around, ODDS, Reached, Session, State};
use crate::fit::linearization::Linear;
use crate::fit::{Point, product, whiten};
use crate::noise::TrialNoise;
use carpus_numerics::numerics::cholesky;
use carpus_simulation::simulation::SimulationError;

/// Gauss–Newton steps with a set of effects.
pub(super) const STEPS: usize = 5;
/// Most probable sets beside the best that are tried by simulation in a round …
const OTHERS: usize = 3;
/// … effects that are tried beside those of the point …
const ADDITIONS: usize = 3;
/// … and sets in which an effect gives way to a rival.
const RIVALS: usize = 6;
/// Share of a promised fall with which derivatives are near enough.
const NEAR: f64 = 0.8;
/// A descent ends where the next step would lower Ψ by less: parameters are then within a quarter of a
/// standard deviation.
const SETTLED_DESCENT: f64 = 0.3;

impl Session<'_> {
    /// Where descents with several sets of effects come to from a state, with its noise: its own, the most probable of
    /// the linear model, and sets near them; the most probable first.
    pub(super) fn advanced(
        &self,
        state: &State,
        candidates: &[usize],
        always: &[usize],
    ) -> Result<Vec<Reached>, SimulationError> {
        let best = state.sets.best();
        let from = state.around(&best.sizes);
        let own = self.places(&state.point.effects);
        let mut sets = vec![own.clone()];
        let others = self.alternatives(&best.effects, &state.model, &state.sets, candidates, always);
        let further = std::iter::once(best.effects.clone()).chain(others).chain(self.additions(state, candidates));
        for set in further {
            if !sets.contains(&set) {
                sets.push(set);
            }
        }
        let found: Vec<_> = sets.par_iter().with_max_len(1).map(|set| self.reach(&from, set, STEPS)).collect();
        let mut reached: Vec<Reached> = found.into_iter().flatten().collect();
        reached.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        Ok(reached)
    }

    /// Directions with 0 for effects that are on at a point.
    pub(super) fn directions_without(&self, directions: &[DMatrix<f64>], point: &Point) -> Vec<DMatrix<f64>> {
        let mut out = directions.to_vec();
        for (block, effect) in self.analysis.blocks.iter().zip(&self.analysis.candidates) {
            if point.effects.iter().any(|s| s.effect.description().id == effect.description().id) {
                for d in &mut out {
                    block.columns.iter().for_each(|c| d.column_mut(*c).fill(0.0));
                }
            }
        }
        out
    }

    /// The point with the effects of a set on and all others off; those that are new at what the posterior expects.
    pub(super) fn switched(&self, point: &Point, model: &LinearModel, posterior: &Posterior, set: &[usize]) -> Point {
        let forward = self.forward();
        let columns = self.amplitude_columns(model);
        let of = |effect: &usize| {
            let candidate = self.analysis.candidates[*effect];
            let known = point.effects.iter().find(|s| s.effect.description().id == candidate.description().id);
            known.cloned().unwrap_or_else(|| {
                let mut setting = forward.joint.absent(candidate);
                let amplitudes: Vec<usize> = candidate.description().amplitudes().collect();
                for (i, column) in amplitudes.into_iter().zip(&columns[*effect].amplitudes) {
                    let p = &candidate.description().parameters[i];
                    let (plausible, sign) = self.plausible(candidate, i);
                    let size = posterior.mean[*column].clamp(-2.0 * plausible, 2.0 * plausible);
                    // On its side, and there at all, so that its shape matters.
                    let least = 0.02 * plausible;
                    let size = match sign {
                        Some(sign) => sign * (sign * size).max(least),
                        None if size.abs() < least => least.copysign(size),
                        None => size,
                    };
                    setting.values[i] += size * forward.joint.scale(p);
                }
                setting
            })
        };
        Point { effects: set.iter().map(of).collect(), ..point.clone() }
    }

    /// Sets that are tried by simulation beside the best: the most probable others that were looked at, and
    /// the most probable of those in which an effect gives way to a rival. Sets that are [`NEGLIGIBLE`] are
    /// not.
    pub(super) fn alternatives(
        &self,
        set: &[usize],
        model: &LinearModel,
        sets: &Sets,
        candidates: &[usize],
        always: &[usize],
    ) -> Vec<Vec<usize>> {
        let mut out: Vec<Vec<usize>> =
            sets.found.iter().map(|s| s.effects.clone()).filter(|s| s != set).take(OTHERS).collect();
        let sizes = &sets.best().sizes;
        let mut exchanged: Vec<(f64, Vec<usize>)> = Vec::new();
        for effect in set.iter().filter(|e| !always.contains(e)) {
            let rivals = self.analysis.candidates[*effect].description().rivals;
            let is_rival = |e: &&usize| rivals.contains(&self.analysis.candidates[**e].description().id);
            for rival in candidates.iter().filter(|e| !set.contains(e)).filter(is_rival) {
                let mut other: Vec<usize> = set.iter().copied().filter(|e| e != effect).chain([*rival]).collect();
                other.sort_unstable();
                if !out.contains(&other) && exchanged.iter().all(|e| e.1 != other) {
                    exchanged.push((model.posterior(&other, sizes).deviance, other));
                }
            }
        }
        let here = model.posterior(set, sizes).deviance;
        exchanged.retain(|(deviance, _)| deviance - here < NEGLIGIBLE);
        exchanged.sort_by(|a, b| a.0.total_cmp(&b.0));
        out.extend(exchanged.into_iter().take(RIVALS).map(|(_, set)| set));
        out
    }

    /// The effects of the point and one more, for each that the linear model asks for beside them: the most
    /// probable first. Where the linear model would rather do without an effect of the point, simulation
    /// decides.
    fn additions(&self, state: &State, candidates: &[usize]) -> Vec<Vec<usize>> {
        let set = self.places(&state.point.effects);
        let (sizes, here) = state.model.sizes_for(&set, self.sizes(state));
        let with = |e: &usize| {
            let mut more = [&set[..], &[*e]].concat();
            more.sort_unstable();
            (state.model.posterior(&more, &sizes).deviance + 2.0 * ODDS.ln() - here, more)
        };
        let absent = candidates.iter().filter(|e| !set.contains(e));
        let mut found: Vec<(f64, Vec<usize>)> = absent.map(with).filter(|(behind, _)| *behind < 0.0).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.into_iter().take(ADDITIONS).map(|(_, set)| set).collect()
    }

    /// Where the descent comes to with a set of effects, the noise held.
    pub(super) fn reach(&self, from: &Around, set: &[usize], steps: usize) -> Result<Reached, SimulationError> {
        let posterior = from.model.posterior(set, from.sizes);
        let point = self.switched(from.point, from.model, &posterior, set);
        self.reach_from(from, point, set, steps)
    }

    /// As [`Session::reach`], from a point with the effects of the set.
    pub(super) fn reach_from(
        &self,
        from: &Around,
        mut point: Point,
        set: &[usize],
        steps: usize,
    ) -> Result<Reached, SimulationError> {
        let mut linear = self.linearized(&point, from.noise, None)?;
        let mut directions = self.directions_without(from.directions, &point);
        let is_on = |id: &str| set.iter().any(|e| self.analysis.candidates[*e].description().id == id);
        let was_on = |id: &str| from.point.effects.iter().any(|s| s.effect.description().id == id);
        if from.point.effects.iter().any(|s| !is_on(s.effect.description().id)) {
            let (of_removed, blocks) =
                self.analysis.calc_directions_of(&linear, &point, &|id| was_on(id) && !is_on(id))?;
            for (block, effect) in blocks.iter().zip(&self.analysis.candidates) {
                let id = effect.description().id;
                for column in block.columns.iter().filter(|_| was_on(id) && !is_on(id)) {
                    for (to, from) in directions.iter_mut().zip(&of_removed) {
                        to.set_column(*column, &from.column(*column));
                    }
                }
            }
        }
        let model =
            self.descend(&mut point, &mut linear, from.noise, from.factors, &directions, set, from.sizes, steps)?;
        let (sizes, deviance) = model.sizes_for(set, from.sizes);
        let deviance = deviance + 2.0 * ODDS.ln() * set.len() as f64;
        Ok(Reached { set: set.to_vec(), point, sizes, deviance, directions })
    }

    /// Gauss–Newton steps of muscles, baselines and effects; directions and discrepancy are profiled out.
    pub(super) fn descend(
        &self,
        point: &mut Point,
        linear: &mut Vec<Linear>,
        noise: &[TrialNoise],
        factors: &[Cholesky<f64, Dyn>],
        directions: &[DMatrix<f64>],
        set: &[usize],
        sizes: &Sizes,
        steps: usize,
    ) -> Result<LinearModel, SimulationError> {
        let whitened: Vec<WhitenedDirections> = directions
            .par_iter()
            .zip(factors)
            .map(|(d, factor)| {
                let columns = whiten(factor, d);
                WhitenedDirections { products: product(&columns, &columns), columns }
            })
            .collect();
        let mut model = self.model_beside(point, linear, &whitened, factors);
        let mut radius = 1.0_f64;
        let mut is_near = true;
        for _ in 0..steps {
            let own = self.analysis.n_nuisance() + point.effects.iter().map(|s| s.values.len()).sum::<usize>();
            let posterior = model.posterior(set, sizes);
            let here = profiled(&model, own, set, sizes);
            let promised = here - posterior.squares;
            if promised < SETTLED_DESCENT {
                break;
            }
            let by = (&posterior.mean - &model.offset).rows(0, own) * radius;
            let moved = self.analysis.moved(point, &by.into_owned());
            // Derivatives by parameters of effects are computed anew once a step does not come to what it promised.
            let near = if is_near { Some(&linear[..]) } else { None };
            let next = self.linearized(&moved, noise, near).ok().map(|linear| {
                let model = self.model_beside(&moved, &linear, &whitened, factors);
                (profiled(&model, own, set, sizes), linear, model)
            });
            match next {
                Some((there, l, m)) if there < here - 0.05 * promised * radius => {
                    (*point, *linear, model) = (moved, l, m);
                    is_near = radius == 1.0 && here - there > NEAR * promised;
                    radius = (2.0 * radius).min(1.0);
                }
                _ => {
                    is_near = false;
                    radius *= 0.3;
                }
            }
        }
        Ok(model)
    }
}

/// Ψ of equation (21): penalized sum of squares at the point, directions and discrepancy profiled out.
///
/// - `own`: columns that the point itself has
pub(super) fn profiled(model: &LinearModel, own: usize, set: &[usize], sizes: &Sizes) -> f64 {
    let sd = model.sds(set, sizes);
    let p = model.len();
    let rest = p - own;
    let mut m = model.products.view((own, own), (rest, rest)).into_owned();
    let mut c = model.products.view((own, p), (rest, 1)).column(0).into_owned();
    for j in 0..rest {
        for i in 0..rest {
            m[(i, j)] *= sd[own + i] * sd[own + j];
        }
        m[(j, j)] += 1.0;
        c[j] *= sd[own + j];
    }
    let of_prior: f64 = (0..own).filter(|j| sd[*j] > 0.0).map(|j| (model.offset[j] / sd[j]).powi(2)).sum();
    let explained = cholesky(m).map_or(0.0, |f| c.dot(&f.solve(&c)));
    model.products[(p, p)] - explained + of_prior
}
