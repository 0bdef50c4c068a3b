//! Which sets of effects the data call for: best first over all sets, by their posterior probability
//! (`docs/src/theory/many-small-errors.md`, equations (18) and (19)).
//!
//! A set's neighbours have one effect more, one less, or one exchanged. The most probable set whose
//! neighbours are not known yet is expanded next, until the budget is spent or no set near the best is left.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::linear_model::{LinearModel, Sizes};

/// Sets this much less probable than the best (in −2 log) are neither expanded nor reported: together they
/// have less than 1 %.
pub(super) const NEGLIGIBLE: f64 = 14.0;
/// Neighbours of a set whose own sizes are estimated; the others keep the set's.
const REFINED: usize = 6;

/// How much is looked for.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Sets whose neighbours are looked at.
    pub expansions: usize,
}

impl Budget {
    /// Nothing is looked for.
    pub fn none() -> Budget {
        Budget { expansions: 0 }
    }
}

/// A set of effects.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Places of its effects, ascending.
    pub effects: Vec<usize>,
    /// −2 log posterior, up to a constant: equation (18).
    pub deviance: f64,
    /// Sizes that go with it.
    pub sizes: Sizes,
    refined: bool,
}

impl Candidate {
    /// A set that was not looked at.
    pub fn of(effects: &[usize], sizes: &Sizes) -> Candidate {
        Candidate { effects: effects.to_vec(), deviance: f64::INFINITY, sizes: sizes.clone(), refined: false }
    }
}

/// The sets that were looked at, most probable first.
#[derive(Clone, Debug)]
pub struct Sets {
    /// Most probable first.
    pub found: Vec<Candidate>,
    /// Their probabilities, equation (19).
    pub probability: Vec<f64>,
}

impl Sets {
    /// Before anything was looked at.
    pub fn none() -> Sets {
        Sets { found: Vec::new(), probability: Vec::new() }
    }

    /// The most probable set.
    pub fn best(&self) -> &Candidate {
        &self.found[0]
    }

    /// Probability that an effect is missing from the model.
    pub fn of_effect(&self, effect: usize) -> f64 {
        self.found.iter().zip(&self.probability).filter(|(s, _)| s.effects.contains(&effect)).map(|(_, p)| p).sum()
    }

    /// Probability that one of some effects is, equation (23).
    pub fn of_any(&self, effects: &[usize]) -> f64 {
        let any = |s: &Candidate| s.effects.iter().any(|e| effects.contains(e));
        self.found.iter().zip(&self.probability).filter(|(s, _)| any(s)).map(|(_, p)| p).sum()
    }
}

/// Searches.
///
/// - `effects`: places of those that may be missing; `always`: of those that are in every set
/// - `cost`: −2 log of the prior odds that an effect is missing, equation (4)
pub fn search(
    model: &LinearModel,
    effects: &[usize],
    always: &[usize],
    cost: f64,
    starts: &[Vec<usize>],
    sizes: &Sizes,
    budget: Budget,
) -> Sets {
    let prior = |set: &[usize]| cost * set.len() as f64;
    let refined = |set: Vec<usize>, from: &Sizes| {
        let (sizes, deviance) = model.sizes_for(&set, from);
        Candidate { deviance: deviance + prior(&set), effects: set, sizes, refined: true }
    };
    let mut known: BTreeMap<Vec<usize>, Candidate> = BTreeMap::new();
    let mut expanded: Vec<Vec<usize>> = Vec::new();
    let none = sorted(always.to_vec());
    for start in std::iter::once(&none).chain(starts) {
        let start = sorted([always, start].concat());
        known.entry(start.clone()).or_insert_with(|| refined(start, sizes));
    }
    for _ in 0..budget.expansions {
        let best = known.values().map(|c| c.deviance).fold(f64::INFINITY, f64::min);
        let open =
            known.values().filter(|c| c.refined && !expanded.contains(&c.effects) && c.deviance < best + NEGLIGIBLE);
        let Some(next) = open.min_by(|a, b| a.deviance.total_cmp(&b.deviance)).cloned() else { break };
        expanded.push(next.effects.clone());
        let others: Vec<usize> = effects.iter().copied().filter(|e| !next.effects.contains(e)).collect();
        let free: Vec<usize> = next.effects.iter().copied().filter(|e| !always.contains(e)).collect();
        let without = |e: usize| -> Vec<usize> { next.effects.iter().copied().filter(|x| *x != e).collect() };
        let mut neighbours: Vec<Vec<usize>> =
            others.iter().map(|e| sorted([&next.effects[..], &[*e]].concat())).collect();
        neighbours.extend(free.iter().map(|e| without(*e)));
        for e in &free {
            neighbours.extend(others.iter().map(|other| sorted([&without(*e)[..], &[*other]].concat())));
        }
        neighbours.retain(|n| !known.contains_key(n));
        let mut found: Vec<Candidate> = neighbours
            .into_par_iter()
            .map(|set| {
                let deviance = model.posterior(&set, &next.sizes).deviance + prior(&set);
                Candidate { effects: set, deviance, sizes: next.sizes.clone(), refined: false }
            })
            .collect();
        found.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        let rest = found.split_off(REFINED.min(found.len()));
        let found: Vec<Candidate> = found.into_par_iter().map(|c| refined(c.effects, &c.sizes)).collect();
        known.extend(found.into_iter().chain(rest).map(|c| (c.effects.clone(), c)));
    }
    let mut found: Vec<Candidate> = known.into_values().collect();
    found.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
    let best = found[0].deviance;
    let mut is_best = true;
    found.retain(|c| std::mem::take(&mut is_best) || c.deviance < best + NEGLIGIBLE);
    let weights: Vec<f64> = found.iter().map(|c| (-0.5 * (c.deviance - best)).exp()).collect();
    let total: f64 = weights.iter().sum();
    Sets { found, probability: weights.into_iter().map(|w| w / total).collect() }
}

fn sorted(mut set: Vec<usize>) -> Vec<usize> {
    set.sort_unstable();
    set.dedup();
    set
}
