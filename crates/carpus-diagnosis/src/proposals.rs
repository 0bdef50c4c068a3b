//! Short formulas for what a model leaves: sparse regression of residuals on a library of terms, selected where halves
//! of the trials agree.
//!
//! In: residuals of trials, what was recorded in them, and how noise is whitened. Out: at most three formulas, each
//! with the share of the mean square that it explains in trials that were left out, and as the text of a
//! `my_effect.toml` ([`carpus_effects::own_effect`]). Muscle parameters are fitted beside the terms, to first order; other
//! effects are taken as they are.
//!
//! ```text
//! W_g r_g ≈ β₀ W_g 1 + Σ_j β_j W_g φ_j(q, q̇, q̈, t, a; k_j) + columns of the muscle parameters   (1)
//! share = 1 − Σ_g |W_g (r_g − φ β^(−g))|² / Σ_g |W_g (r_g − β₀^(−g))|²                        (2)
//! ```
//!
//! # References
//! Meinshausen & Bühlmann (2010), *Stability selection*, doi:10.1111/j.1467-9868.2010.00740.x; Brunton, Proctor & Kutz
//! (2016), doi:10.1073/pnas.1517384113 (sparse regression on a library of terms).

mod library;
mod proposal;
mod search;
mod trial_table;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use library::{library, variables};
pub use proposal::{Proposal, ProposedTerm};
use search::{MOST_TERMS, Search, WORTH_A_TERM};
pub use trial_table::TrialTable;

/// Formulas, at most.
const MOST_PROPOSALS: usize = 3;

/// Another formula must explain at least this part of what the best one explains.
const COMPARABLE: f64 = 0.5;
/// Trials that are needed: fewer cannot be halved.
const LEAST_TRIALS: usize = 4;

/// At most three formulas for what remains in these trials; none where it is like noise.
///
/// - `muscles`: the active muscles, as the trials' activations have them
/// - `whiten`: a series of a trial as it is where noise is white and of one size; a linear map
/// - `seed`: of the halves and signs that are drawn
pub fn propose(
    trials: &[TrialTable],
    muscles: &[String],
    whiten: &dyn Fn(usize, &[f64]) -> Vec<f64>,
    seed: u64,
) -> Vec<Proposal> {
    if trials.len() < LEAST_TRIALS {
        return Vec::new();
    }
    let library = library(muscles);
    let variables = variables(muscles);
    let search = Search::new(trials, library, &variables, whiten);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let all: Vec<usize> = (0..trials.len()).collect();
    // What chance lets one explain is found where what can be explained is gone: with it in, draws of signs that are
    // nearly all alike would explain as much.
    let (rest, left) = search.without_its_best_formula();
    let limit = left * rest.share_by_chance(&all, &mut rng);
    let halves = search.selected_in_halves(&mut rng);
    let mut excluded = vec![false; search.library.len()];
    let mut found: Vec<Proposal> = Vec::new();
    while found.len() < MOST_PROPOSALS {
        let path = search.greedy(&search.total, &excluded, MOST_TERMS);
        let Some(&lead) = path.first() else { break };
        for (other, excluded) in excluded.iter_mut().enumerate() {
            *excluded |= search.are_alike(lead, other);
        }
        let Some((terms, stability)) = search.short(&path, &halves) else { break };
        let least = found.first().map_or(0.0, |best| COMPARABLE * best.share);
        let proposal = search.proposal(&terms, stability, trials, &variables, whiten);
        if !(proposal.share > limit.max(WORTH_A_TERM) && proposal.share >= least) {
            break;
        }
        found.push(proposal);
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rand::RngExt;

    use super::*;
    use carpus_effects::own_effect::Definition;

    const SAMPLES: usize = 200;
    const TRIALS: usize = 12;

    struct Recorded {
        time: Vec<f64>,
        session: f64,
        angle: Vec<f64>,
        speed: Vec<f64>,
        acceleration: Vec<f64>,
        activation: Vec<Vec<f64>>,
        residual: Vec<f64>,
    }

    /// Sweeps and holds, with a residual and slow and white noise.
    fn recorded(noise: f64, seed: u64, residual: impl Fn(&Recorded, usize) -> f64) -> Vec<Recorded> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = move || -> f64 { (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0 };
        let trial = |g: usize| {
            let time: Vec<f64> = (0..SAMPLES).map(|i| 0.02 * i as f64).collect();
            let (size, rate, phase) = (0.9 - 0.05 * g as f64, 1.5 + 0.2 * g as f64, g as f64);
            let wave = |f: fn(f64) -> f64, n: i32| -> Vec<f64> {
                time.iter().map(|t| size * rate.powi(n) * f(rate * t + phase)).collect()
            };
            let (angle, speed) = (wave(f64::sin, 0), wave(f64::cos, 1));
            let acceleration: Vec<f64> = angle.iter().map(|q| -rate * rate * q).collect();
            let activation = vec![
                time.iter().map(|t| 0.3 + 0.2 * (0.9 * t + phase).sin()).collect(),
                time.iter().map(|t| 0.2 + 0.1 * (1.3 * t - phase).cos()).collect(),
            ];
            let session = g as f64 / (TRIALS - 1) as f64;
            let mut trial = Recorded { time, session, angle, speed, acceleration, activation, residual: Vec::new() };
            let mut slow = draw();
            trial.residual = (0..SAMPLES)
                .map(|i| {
                    slow = 0.9 * slow + 0.436 * draw();
                    residual(&trial, i) + noise * (slow + 0.5 * draw())
                })
                .collect();
            trial
        };
        (0..TRIALS).map(trial).collect()
    }

    fn proposals(recorded: &[Recorded]) -> Vec<Proposal> {
        let trials: Vec<TrialTable> = recorded.iter().map(table_of).collect();
        let muscles = ["FCR", "ECU"].map(String::from);
        propose(&trials, &muscles, &|_, series| series.to_vec(), 1)
    }

    fn table_of(r: &Recorded) -> TrialTable<'_> {
        TrialTable {
            residual: &r.residual,
            time: &r.time,
            session: r.session,
            angle: &r.angle,
            speed: &r.speed,
            acceleration: &r.acceleration,
            activation: &r.activation,
            beside: None,
        }
    }

    /// The text of a proposal is an effect.
    fn defined(proposal: &Proposal) -> Definition {
        let text = proposal.to_toml("proposed");
        Definition::parse(&text, Path::new("proposed.toml")).unwrap_or_else(|p| panic!("{text}\n{p:?}"))
    }

    #[test]
    fn verif_a_wave_of_the_angle_is_found_with_its_number() {
        let found = proposals(&recorded(0.1, 2, |r, i| 0.4 * (14.2 * r.angle[i]).sin()));
        let best = &found[0];
        println!("{found:#?}");
        assert!(best.terms.len() == 1 && best.terms[0].term == "sin(k*q)", "{}", best.formula);
        let (k, unit) = best.terms[0].shape.unwrap();
        assert!(
            (k - 14.2).abs() < 0.1 && (best.terms[0].coefficient - 0.4).abs() < 0.03 && unit == "1/rad",
            "{}",
            best.formula
        );
        // 0.08 of a mean square of 0.08 and that of the noise, 0.0125.
        assert!((0.75..0.95).contains(&best.share), "{}", best.share);
        let effect = defined(best);
        assert_eq!(effect.formula, "A*sin(k*q)");
        assert!(effect.parameters[1].plausible[0] < 14.2 && 14.2 < effect.parameters[1].plausible[1]);
    }

    #[test]
    fn verif_a_friction_that_grows_with_the_angle_is_found() {
        let found = proposals(&recorded(0.1, 3, |r, i| -0.3 * r.speed[i].signum() * (1.0 + r.angle[i])));
        let best = &found[0];
        println!("{found:#?}");
        let mut terms: Vec<(&str, f64)> = best.terms.iter().map(|t| (t.term.as_str(), t.coefficient)).collect();
        terms.sort_by(|a, b| a.0.cmp(b.0));
        assert!(terms.len() == 2 && terms[0].0 == "q*sign(qdot)" && terms[1].0 == "sign(qdot)", "{}", best.formula);
        assert!(terms.iter().all(|(_, c)| (c + 0.3).abs() < 0.05), "{}", best.formula);
        let units: Vec<&str> = best.terms.iter().map(|t| t.unit.as_str()).collect();
        assert!(units.contains(&"N·m/rad") && units.contains(&"N·m"), "{units:?}");
        assert_eq!(defined(best).parameters.len(), 2);
    }

    #[test]
    fn verif_a_damper_that_works_one_way_is_found() {
        let found = proposals(&recorded(0.1, 4, |r, i| -0.2 * r.speed[i].max(0.0)));
        let best = &found[0];
        println!("{found:#?}");
        assert!(best.terms.len() == 1 && best.terms[0].term == "hinge(qdot)", "{}", best.formula);
        assert!(
            (best.terms[0].coefficient + 0.2).abs() < 0.02 && best.terms[0].unit == "N·m·s/rad",
            "{}",
            best.formula
        );
        assert_eq!(defined(best).formula, "A*hinge(qdot)");
    }

    #[test]
    fn verif_a_stiffness_of_an_active_muscle_is_found() {
        let found = proposals(&recorded(0.05, 5, |r, i| -r.activation[0][i] * r.angle[i]));
        println!("{found:#?}");
        assert_eq!(found[0].terms[0].term, "a_FCR*q", "{}", found[0].formula);
        defined(&found[0]);
    }

    #[test]
    fn verif_of_noise_alone_hardly_anything_is_proposed() {
        // The level is 1 in 40; twelve studies.
        let raised = (0..12).filter(|seed| !proposals(&recorded(0.1, 100 + seed, |_, _| 0.0)).is_empty()).count();
        println!("{raised} of 12");
        assert!(raised <= 1, "{raised} of 12");
    }

    #[test]
    fn verif_whitening_does_not_change_what_is_found_and_few_trials_give_nothing() {
        let recorded = recorded(0.05, 6, |r, i| 0.4 * r.angle[i].powi(2));
        let trials: Vec<TrialTable> = recorded.iter().map(table_of).collect();
        // Differences of neighbours whiten slow noise.
        let whiten = |_: usize, series: &[f64]| -> Vec<f64> {
            let first = series.first().map(|first| first * 0.436);
            first.into_iter().chain(series.windows(2).map(|w| w[1] - 0.9 * w[0])).collect()
        };
        let muscles = ["FCR", "ECU"].map(String::from);
        let propose = |trials: &[TrialTable]| propose(trials, &muscles, &whiten, 1);
        let found = propose(&trials);
        assert_eq!(found[0].terms[0].term, "q^2", "{found:?}");
        assert!((found[0].terms[0].coefficient - 0.4).abs() < 0.05);
        assert!(found.len() <= MOST_PROPOSALS);
        assert!(propose(&trials[..3]).is_empty());
        assert_eq!(propose(&trials), found, "the same seed, the same proposals");
    }
}
