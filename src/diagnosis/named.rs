//! Effects that are missing: what each takes of the error, and the error step by step
//! (`docs/src/theory/many-small-errors.md`, equations (22), (23) and (27)).

use std::collections::BTreeMap;

use serde::Serialize;

use super::diagnose::{ParameterEstimate, Request, simulate};
use super::forward_model::{ForwardModel, Setting};
use super::inference::session::{HandedOver, Session, State};
use crate::simulation::{MuscleParameters, SimulationError};
use crate::study::TrialUse;

/// An effect is dominant if there is positive evidence for it, odds of three to one (2 ln 3; Kass & Raftery 1995,
/// doi:10.1080/01621459.1995.10476572), beyond a little of everything …
const POSITIVE: f64 = 2.2;
/// … and if it takes at least this share of the mean square of the given model's error.
const DOMINANT: f64 = 0.05;

/// An effect that is missing.
#[derive(Clone, Debug, Serialize)]
pub struct NamedEffect {
    /// Effect.
    pub effect: &'static str,
    /// Effects that these trials cannot tell from it, itself first.
    pub group: Vec<&'static str>,
    /// Probability that one of the group is missing.
    pub probability: f64,
    /// How much larger −2 log posterior is without it, muscles, the other effects and a little of everything making up for it as they can.
    pub evidence: f64,
    /// Whether it takes more of the error than a little of everything does.
    pub dominant: bool,
    /// Share of the mean square of the error of the model as given that it takes beside the effects before it, muscles and these making
    /// up for what is missing as they can: value and 95 % interval over trials.
    pub share_of_error: Shares,
    /// Parameters by name, at the joint mode.
    pub parameters: BTreeMap<String, ParameterEstimate>,
}

/// Shares of training and held-out trials.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Shares {
    /// Training trials.
    pub train: [f64; 3],
    /// Held-out trials.
    pub held_out: Option<[f64; 3]>,
}

/// A step of the account of the error: RMSE / session MVC moment.
#[derive(Clone, Debug, Serialize)]
pub struct AccountStep {
    /// What the model has: `as_given`, `recalibrated`, an effect, or `noise`.
    pub step: String,
    /// Training trials.
    pub train: f64,
    /// Held-out trials.
    pub held_out: Option<f64>,
}

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

/// (Σ without − Σ with) / Σ given over trials, and its 95 % interval by the jackknife; `None` without two trials.
fn share(given: &[[f64; 2]], with: &[[f64; 2]], without: &[[f64; 2]]) -> Option<[f64; 3]> {
    let n = given.len();
    let total = |all: &[[f64; 2]], left_out: Option<usize>| -> f64 {
        all.iter().enumerate().filter(|(i, _)| Some(*i) != left_out).map(|(_, s)| s[0]).sum()
    };
    let value = |left_out| {
        let of_given = total(given, left_out).max(f64::MIN_POSITIVE);
        (total(without, left_out) - total(with, left_out)) / of_given
    };
    let all = (n > 1).then(|| value(None))?;
    let others: Vec<f64> = (0..n).map(|i| value(Some(i))).collect();
    let mean = others.iter().sum::<f64>() / n as f64;
    let spread = others.iter().map(|v| (v - mean).powi(2)).sum::<f64>() * (n as f64 - 1.0) / n as f64;
    let half = 1.96 * spread.sqrt();
    Some([all, all - half, all + half])
}

/// Estimates of one effect, by parameter.
fn own(estimates: &BTreeMap<String, ParameterEstimate>, id: &str) -> BTreeMap<String, ParameterEstimate> {
    let of = |(name, e): (&String, &ParameterEstimate)| {
        let name = name.strip_prefix(id)?.strip_prefix('.')?;
        Some((name.to_owned(), e.clone()))
    };
    estimates.iter().filter_map(of).collect()
}

/// Mean squares of training and held-out trials.
type Squares = [Vec<[f64; 2]>; 2];

/// Effects of the joint mode, that with the strongest evidence first, and the error step by step as one after the other comes in.
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
    let with_some = |kept: &[usize]| {
        let (parameters, effects) = session.with_some(state, kept, handed_over.part);
        squares_of(&parameters, &effects)
    };
    let step = |name: &str, squares: &Squares| {
        let [train, held_out] = squares.each_ref().map(|s| rms(s).map(|e| e / request.mvc));
        AccountStep { step: name.to_owned(), train: train.unwrap_or(0.0), held_out }
    };
    let given = squares_of(&forward.nominal_parameters(), &[])?;
    let mut account = vec![
        step("as_given", &given),
        step("recalibrated", &squares_of(&recalibrated.parameters, &recalibrated.effects)?),
    ];
    let estimates = session.estimates(state);
    let places: Vec<usize> = evidence.iter().map(|e| e.0).collect();
    let mut out = Vec::new();
    let mut before = with_some(&[])?;
    for (count, (place, evidence)) in evidence.iter().enumerate() {
        let now = match count + 1 == places.len() {
            true => squares_of(&handed_over.parameters, &handed_over.effects)?,
            false => with_some(&places[..=count])?,
        };
        let id = session.analysis.candidates[*place].description().id;
        let (group, probability) = session.group(state, *place);
        let shares = [0, 1].map(|i| share(&given[i], &now[i], &before[i]));
        let train = shares[0].unwrap_or([0.0; 3]);
        out.push(NamedEffect {
            effect: id,
            group: group.into_iter().map(|e| session.analysis.candidates[e].description().id).collect(),
            probability,
            evidence: *evidence,
            dominant: train[0] >= DOMINANT && train[1] > 0.0 && *evidence >= POSITIVE,
            share_of_error: Shares { train, held_out: shares[1] },
            parameters: own(&estimates, id),
        });
        account.push(step(id, &now));
        before = now;
    }
    Ok((out, account))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_shares_are_of_the_mean_square_and_their_interval_of_trials() {
        let given = [[4.0, 10.0], [6.0, 10.0], [5.0, 10.0]];
        let with = [[1.0, 10.0], [1.5, 10.0], [1.25, 10.0]];
        let without = [[2.0, 10.0], [3.0, 10.0], [2.5, 10.0]];
        let [value, low, high] = share(&given, &with, &without).unwrap();
        assert!((value - 0.25).abs() < 1e-12 && (high - low).abs() < 1e-12, "{low} {high}");
        let [value, low, high] = share(&given, &with, &[[2.0, 10.0], [1.5, 10.0], [4.0, 10.0]]).unwrap();
        assert!(low < value && value < high);
        assert!(share(&[], &[], &[]).is_none() && share(&given[..1], &with[..1], &given[..1]).is_none());
    }
}
