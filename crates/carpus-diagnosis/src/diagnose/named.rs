//! Effects that are missing: what each takes of the error, and the error step by step
//! (`docs/src/theory/many-small-errors.md`, equations (22), (23) and (27)).

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::account::{AccountStep, NamedEffect, ParameterEstimate, Shares};
use super::request::Request;
use super::simulated::simulate;
use crate::ONE_BY_ONE;
use crate::inference::session::{HandedOver, Session, State};
use carpus_effects::forward_model::{ForwardModel, Setting};
use carpus_simulation::simulation::{MuscleParameters, SimulationError};
use carpus_study::study::TrialUse;

/// An effect is dominant if it is at least this large, in units of the larger end of its plausible range …
const LARGE: f64 = 1.0 / 3.0;
/// … and if nothing else takes what it does of at least this share of the mean square of the error that the refitted
/// muscles leave.
const DOMINANT: f64 = 0.2;

/// Mean squares of the residuals of every trial of a use [(N·m)²], weighted by samples.
fn squares(
    forward: &ForwardModel,
    parameters: &[MuscleParameters],
    effects: &[Setting],
    usage: TrialUse,
) -> Result<Vec<[f64; 2]>, SimulationError> {
    let of = |(g, moment): (usize, Vec<f64>)| {
        let left = forward.trials[g].moment.iter().zip(&moment).map(|(y, m)| (y - m).powi(2)).sum();
        [left, moment.len() as f64]
    };
    Ok(simulate(forward, parameters, effects, usage)?.into_iter().map(of).collect())
}

/// Root mean square over trials [N·m].
fn rms(squares: &[[f64; 2]]) -> Option<f64> {
    let count: f64 = squares.iter().map(|s| s[1]).sum();
    (count > 0.0).then(|| (squares.iter().map(|s| s[0]).sum::<f64>() / count).sqrt())
}

/// Σ taken / Σ given over trials, and its 95 % interval by the jackknife, equation (28); `None` without two trials.
///
/// - `taken`: of the square of every trial
fn share(given: &[[f64; 2]], taken: &[f64]) -> Option<[f64; 3]> {
    let n = given.len();
    let value = |left_out: Option<usize>| {
        let kept = given.iter().zip(taken).enumerate().filter(|(i, _)| Some(*i) != left_out);
        let (given, taken) = kept.fold((0.0, 0.0), |sum, (_, (g, t))| (sum.0 + g[0], sum.1 + t));
        taken / given.max(f64::MIN_POSITIVE)
    };
    let all = (n > 1).then(|| value(None))?;
    let others: Vec<f64> = (0..n).map(|i| value(Some(i))).collect();
    let mean = others.iter().sum::<f64>() / n as f64;
    let spread = others.iter().map(|v| (v - mean).powi(2)).sum::<f64>() * (n as f64 - 1.0) / n as f64;
    let half = 1.96 * spread.sqrt();
    Some([all, all - half, all + half])
}

/// Orders in which effects come in: forwards and backwards, each of them first once. Of up to three effects these are
/// all orders.
fn orders(count: usize) -> Vec<Vec<usize>> {
    let from = |first: usize| -> Vec<usize> { (first..count).chain(0..first).collect() };
    let forwards = (0..count).map(from);
    let mut out: Vec<Vec<usize>> = forwards.flat_map(|o| [o.clone(), o.into_iter().rev().collect()]).collect();
    out.sort();
    out.dedup();
    out
}

/// All sets of players that come up in [`orders`], ascending, each once.
fn coalitions(count: usize) -> Vec<Vec<usize>> {
    let prefixes = |order: Vec<usize>| {
        (0..=order.len()).map(move |n| {
            let mut some = order[..n].to_vec();
            some.sort_unstable();
            some
        })
    };
    let mut out: Vec<Vec<usize>> = orders(count).into_iter().flat_map(prefixes).collect();
    out.sort();
    out.dedup();
    out
}

/// What each of several players takes of the squares, the mean over [`orders`]: Shapley's division of what all take
/// together.
///
/// - `squares`: of every trial with some of the players, ascending
/// - returns: per player, of every trial
fn divided(count: usize, squares: impl Fn(&[usize]) -> Vec<f64>) -> Vec<Vec<f64>> {
    let orders = orders(count);
    let weight = 1.0 / orders.len().max(1) as f64;
    let mut taken: Vec<Vec<f64>> = vec![Vec::new(); count];
    for order in &orders {
        let mut some: Vec<usize> = Vec::new();
        let mut before = squares(&some);
        for player in order {
            some.push(*player);
            some.sort_unstable();
            let now = squares(&some);
            let taken = &mut taken[*player];
            taken.resize(now.len(), 0.0);
            for ((taken, before), now) in taken.iter_mut().zip(&before).zip(&now) {
                *taken += weight * (before - now);
            }
            before = now;
        }
    }
    taken
}

/// Estimates of one effect, by parameter.
fn own(estimates: &BTreeMap<String, ParameterEstimate>, id: &str) -> BTreeMap<String, ParameterEstimate> {
    let of = |(name, e): (&String, &ParameterEstimate)| {
        let name = name.strip_prefix(id)?.strip_prefix('.')?;
        Some((name.to_owned(), e.clone()))
    };
    estimates.iter().filter_map(of).collect()
}

/// Squares of training and held-out trials.
type Squares = [Vec<[f64; 2]>; 2];

/// Effects of the joint mode, the dominant ones first, each part by what they alone take of the error, and the error
/// step by step as one after the other comes in.
///
/// - `evidence`: their places and by how much −2 log posterior is larger without each, the strongest first
/// - `[handed_over, recalibrated]`: with these effects, and without any
///
/// # Errors
/// A trial that cannot be simulated.
pub(super) fn named(
    request: &Request,
    session: &Session,
    state: &State,
    evidence: &[(usize, f64)],
    [handed_over, recalibrated]: [&HandedOver; 2],
) -> Result<(Vec<NamedEffect>, Vec<AccountStep>), SimulationError> {
    let forward = request.forward;
    let squares_of = |parameters: &[MuscleParameters], effects: &[Setting]| -> Result<Squares, SimulationError> {
        let of = |usage| squares(forward, parameters, effects, usage);
        Ok([of(TrialUse::Train)?, of(TrialUse::Test)?])
    };
    // The effects, and the muscles as the last of the players.
    let muscles = evidence.len();
    let players = if evidence.is_empty() { 0 } else { muscles + 1 };
    let with_some = |some: &Vec<usize>| -> Result<(Vec<usize>, Squares), SimulationError> {
        let places: Vec<usize> = some.iter().filter(|i| **i < muscles).map(|i| evidence[*i].0).collect();
        let (parameters, effects) = session.with_some(state, &places, some.contains(&muscles), handed_over.part)?;
        Ok((some.clone(), squares_of(&parameters, &effects)?))
    };
    let found: Vec<Result<_, SimulationError>> =
        coalitions(players).par_iter().with_max_len(ONE_BY_ONE).map(with_some).collect();
    let known: BTreeMap<Vec<usize>, Squares> = found.into_iter().collect::<Result<_, _>>()?;
    let of_use = |usage: usize| divided(players, |some| known[some][usage].iter().map(|s| s[0]).collect::<Vec<f64>>());
    let taken = [of_use(0), of_use(1)];
    let all: Vec<usize> = (0..players).collect();
    let unique = |player: usize, usage: usize| -> Vec<f64> {
        let others: Vec<usize> = all.iter().copied().filter(|p| *p != player).collect();
        let (without, with) = (&known[&others][usage], &known[&all][usage]);
        without.iter().zip(with).map(|(without, with)| without[0] - with[0]).collect()
    };
    let given = squares_of(&forward.nominal_parameters(), &[])?;
    let estimates = session.estimates(state);
    let of_effect = |(i, (place, evidence)): (usize, &(usize, f64))| {
        let id = session.analysis.candidates[*place].description().id;
        let (group, probability) = session.group(state, *place);
        let [train, held_out] = [0, 1].map(|usage| share(&given[usage], &taken[usage][i]));
        let train = train.unwrap_or([0.0; 3]);
        let [by_itself, by_itself_held_out] = [0, 1].map(|usage| share(&given[usage], &unique(i, usage)));
        let of_refit = share(&known[&vec![muscles]][0], &unique(i, 0)).unwrap_or([0.0; 3]);
        let effect = NamedEffect {
            effect: id,
            group: group.into_iter().map(|e| session.analysis.candidates[e].description().id).collect(),
            probability: probability.max(1.0 / (1.0 + (-0.5 * evidence).exp())).min(1.0),
            evidence: *evidence,
            dominant: of_refit[0] >= DOMINANT
                && of_refit[1] > 0.0
                && session.share_of_plausible(state, *place) >= LARGE,
            share_of_error: Shares { train, held_out },
            unique_share: Shares { train: by_itself.unwrap_or([0.0; 3]), held_out: by_itself_held_out },
            parameters: own(&estimates, id),
        };
        (i, effect)
    };
    let mut effects: Vec<(usize, NamedEffect)> = evidence.iter().enumerate().map(of_effect).collect();
    let share_of = |e: &(usize, NamedEffect)| e.1.unique_share.train[0];
    effects.sort_by(|a, b| b.1.dominant.cmp(&a.1.dominant).then(share_of(b).total_cmp(&share_of(a))));
    let step = |name: &str, squares: &Squares| {
        let [train, held_out] = squares.each_ref().map(|s| rms(s).map(|e| e / request.mvc));
        AccountStep { step: name.to_owned(), train: train.unwrap_or(0.0), held_out }
    };
    let mut account = vec![
        step("as_given", &given),
        step("recalibrated", &squares_of(&recalibrated.parameters, &recalibrated.effects)?),
    ];
    let mut some = vec![muscles];
    for (i, effect) in &effects {
        some.push(*i);
        some.sort_unstable();
        account.push(match some.len() == players {
            true => step(effect.effect, &squares_of(&handed_over.parameters, &handed_over.effects)?),
            false => step(effect.effect, &with_some(&some)?.1),
        });
    }
    let [train, held_out] = session.beside_discrepancy(state, handed_over)?.map(|e| e.map(|e| e / request.mvc));
    account.push(AccountStep { step: "generic_discrepancy".to_owned(), train: train.unwrap_or(0.0), held_out });
    Ok((effects.into_iter().map(|e| e.1).collect(), account))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_shares_are_of_the_mean_square_and_their_interval_of_trials() {
        let given = [[4.0, 10.0], [6.0, 10.0], [5.0, 10.0]];
        let [value, low, high] = share(&given, &[1.0, 1.5, 1.25]).unwrap();
        assert!((value - 0.25).abs() < 1e-12 && (high - low).abs() < 1e-12, "{low} {high}");
        let [value, low, high] = share(&given, &[1.0, 0.0, 2.75]).unwrap();
        assert!((value - 0.25).abs() < 1e-12 && low < value && value < high);
        assert!(share(&[], &[]).is_none() && share(&given[..1], &[1.0]).is_none());
    }

    #[test]
    fn verif_what_effects_take_adds_up_in_whatever_order_they_come() {
        // Two that do the same, and one of its own.
        let squares = |some: &[usize]| {
            let either = some.contains(&0) || some.contains(&1);
            let both = some.contains(&0) && some.contains(&1);
            let other = if some.contains(&2) { 5.0 } else { 0.0 };
            vec![20.0 - if either { 8.0 } else { 0.0 } - if both { 2.0 } else { 0.0 } - other]
        };
        let taken = divided(3, squares);
        assert_eq!(taken.iter().map(|t| t[0]).sum::<f64>(), 15.0);
        assert!((taken[0][0] - 5.0).abs() < 1e-12 && (taken[1][0] - 5.0).abs() < 1e-12, "{taken:?}");
        assert!(divided(0, squares).is_empty());
        assert_eq!(orders(1), [[0]]);
        assert_eq!((orders(2).len(), orders(3).len(), orders(4).len()), (2, 6, 8));
        assert_eq!(coalitions(2), [vec![], vec![0], vec![0, 1], vec![1]]);
        assert_eq!(coalitions(3).len(), 8);
    }
}
