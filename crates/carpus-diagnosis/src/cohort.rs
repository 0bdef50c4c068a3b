//! What a cohort's participants say together: effects that they share, in other sizes (`docs/src/theory/cohort.md`).
//!
//! In: of every participant the likelihood of the amplitudes of all effects ([`ParticipantEvidence`]). Out: of every
//! effect the probability that the cohort has it, how many have it, the mean size and the spread; of every participant
//! whether it has the effect, and its size with the others' as prior knowledge.
//!
//! # References
//! Higgins, Thompson & Spiegelhalter (2009), A re-evaluation of random-effects meta-analysis,
//! doi:10.1111/j.1467-985X.2008.00552.x. Efron (2010), Large-Scale Inference, doi:10.1017/CBO9780511761362.

mod population;

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use carpus_numerics::numerics::cholesky;
use population::{Likelihood, Population};

/// Prior odds that a cohort does not have an effect: those of one participant, `theory/many-small-errors.md`,
/// equation (4).
const ODDS: f64 = 20.0;
/// A cohort has an effect if that is more probable than not, as one participant does …
const NAMED: f64 = 0.5;
/// … and so many effects at most.
const MOST_EFFECTS: usize = 8;
/// An effect may stand in another's place where the cohort has it instead with more than this share of the probability.
const STANDS_IN: f64 = 0.1;

/// An amplitude, and the unit in which evidence about it is given: what is plausible.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Amplitude {
    /// Identifier of its effect.
    pub effect: String,
    /// Its name.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// Value without the effect.
    pub start: f64,
    /// Change of the value, or of its logarithm, by one standard deviation of what is plausible.
    pub size: f64,
    /// Whether it is the logarithm that changes.
    pub is_ratio: bool,
    /// Sign that the change must have, if it must.
    pub sign: Option<f64>,
}

impl Amplitude {
    /// The value at so many standard deviations of what is plausible.
    pub fn value(&self, x: f64) -> f64 {
        if self.is_ratio { self.start * (self.size * x).exp() } else { self.start + self.size * x }
    }
}

/// What one participant's trials say of the amplitudes of all effects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticipantEvidence {
    /// `carpus.evidence/1`.
    pub schema: String,
    /// Its name.
    pub participant: String,
    /// The amplitudes.
    pub amplitudes: Vec<Amplitude>,
    /// Λ of the likelihood exp(−½ xᵀ Λ x + hᵀ x), x in shares of what is plausible.
    pub information: Vec<Vec<f64>>,
    /// h.
    pub score: Vec<f64>,
    /// κ: what this participant has of every effect, as a share of what is plausible.
    pub everything: f64,
    /// Effects that are named for this participant alone.
    pub named: Vec<String>,
}

impl ParticipantEvidence {
    /// Schema of the file.
    pub const SCHEMA: &'static str = "carpus.evidence/1";

    /// Places of the amplitudes of an effect.
    fn places(&self, effect: &str) -> Vec<usize> {
        (0..self.amplitudes.len()).filter(|i| self.amplitudes[*i].effect == effect).collect()
    }

    /// The likelihood of an effect's amplitudes, equation (C1), those of other effects integrated out.
    ///
    /// - `wide`: effects that may have any plausible size
    fn likelihood(&self, effect: &str, wide: &[&str]) -> Option<Likelihood> {
        let own = self.places(effect);
        if own.is_empty() {
            return None;
        }
        let others: Vec<usize> = (0..self.amplitudes.len()).filter(|i| !own.contains(i)).collect();
        let is_wide = |i: &usize| {
            let id = self.amplitudes[*i].effect.as_str();
            wide.contains(&id) || self.named.iter().any(|named| named == id)
        };
        let sd: Vec<f64> = others.iter().map(|i| if is_wide(i) { 1.0 } else { self.everything }).collect();
        let (n, k) = (others.len(), own.len());
        let mut m = DMatrix::identity(n, n);
        for i in 0..n {
            for j in 0..n {
                m[(i, j)] += sd[i] * self.information[others[i]][others[j]] * sd[j];
            }
        }
        let cross = DMatrix::from_fn(n, k + 1, |i, j| {
            let row = others[i];
            sd[i] * own.get(j).map_or(self.score[row], |column| self.information[row][*column])
        });
        let mut information = DMatrix::from_fn(k, k, |i, j| self.information[own[i]][own[j]]);
        let mut score = DVector::from_fn(k, |i, _| self.score[own[i]]);
        let solved = cholesky(m)?.solve(&cross);
        let taken = cross.columns(0, k).tr_mul(&solved);
        information -= taken.columns(0, k);
        score -= taken.column(k);
        Some(Likelihood { information, score, small: self.everything })
    }
}

/// A mean with a 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WithInterval {
    /// Expected value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// An amplitude over the participants that have the effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PopulationSize {
    /// Its unit.
    pub unit: String,
    /// Mean over the population.
    pub mean: WithInterval,
    /// Standard deviation over the population.
    pub spread: WithInterval,
}

/// One participant's size of an effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MemberSize {
    /// By this participant's trials alone, what is plausible being the only prior knowledge.
    pub alone: WithInterval,
    /// With the population as prior knowledge, should the participant have the effect.
    pub pooled: WithInterval,
}

/// One participant and an effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Its name.
    pub participant: String,
    /// Probability that this participant has the effect.
    pub probability: f64,
    /// Whether the effect is named for this participant alone.
    pub named_alone: bool,
    /// Distance of the size by its own trials from the population's mean, in standard deviations of both; largest
    /// amplitude.
    pub deviation: f64,
    /// By amplitude.
    pub parameters: BTreeMap<String, MemberSize>,
}

/// An effect that the cohort has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CohortEffect {
    /// Its identifier.
    pub effect: String,
    /// It, and those that may stand in its place, the most probable first.
    pub group: Vec<String>,
    /// Probability that the cohort has it, or one of its group.
    pub probability: f64,
    /// Natural logarithm of the Bayes factor for it, beside the other effects of the cohort.
    pub log_bayes_factor: f64,
    /// Share of the population that has it.
    pub prevalence: WithInterval,
    /// By amplitude.
    pub parameters: BTreeMap<String, PopulationSize>,
    /// The participants, in the study's order.
    pub participants: Vec<Member>,
}

/// What the participants say together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CohortDiagnosis {
    /// `carpus.cohort_diagnosis/1`.
    pub schema: String,
    /// The participants, in the study's order.
    pub participants: Vec<String>,
    /// Effects that the cohort has, the most certain first.
    pub effects: Vec<CohortEffect>,
    /// Probability of every other effect, beside those.
    pub others: BTreeMap<String, f64>,
    /// Effects that cannot be pooled: with more than two amplitudes, or of which no trial says anything.
    pub not_pooled: Vec<String>,
}

/// Probability that a cohort has an effect.
///
/// - `log_bayes_factor`: for it
fn probability(log_bayes_factor: f64) -> f64 {
    1.0 / (1.0 + ODDS * (-log_bayes_factor).exp())
}

/// Pools what the participants say.
///
/// - `all`: of every participant, in the study's order
pub fn pooled(all: &[ParticipantEvidence]) -> CohortDiagnosis {
    let mut ids: Vec<&str> = Vec::new();
    for amplitude in all.iter().flat_map(|p| &p.amplitudes) {
        if !ids.contains(&amplitude.effect.as_str()) {
            ids.push(&amplitude.effect);
        }
    }
    let (ids, not_pooled): (Vec<&str>, Vec<&str>) =
        ids.into_iter().partition(|id| all.iter().all(|p| p.places(id).len() <= population::MOST_AMPLITUDES));
    // Forwards, the most probable first; then those are taken back that the others make superfluous.
    let mut set: Vec<&str> = Vec::new();
    while set.len() < MOST_EFFECTS {
        let absent = ids.iter().filter(|id| !set.contains(id));
        let found: Vec<(f64, &str)> = absent.filter_map(|id| Some((evidence(all, id, &set)?, *id))).collect();
        let Some((factor, id)) = found.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        if probability(factor) < NAMED {
            break;
        }
        set.push(id);
    }
    loop {
        let beside = |id: &str| without(&set, id);
        let weakest = set.iter().filter_map(|id| Some((evidence(all, id, &beside(id))?, *id)));
        match weakest.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((factor, id)) if probability(factor) < NAMED => set = without(&set, id),
            _ => break,
        }
    }
    let mut effects: Vec<CohortEffect> = set.iter().filter_map(|id| effect_of(all, id, &set, &ids)).collect();
    effects.sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    let others = ids.iter().filter(|id| !set.contains(id));
    let others = others.filter_map(|id| Some(((*id).to_owned(), probability(evidence(all, id, &set)?)))).collect();
    CohortDiagnosis {
        schema: "carpus.cohort_diagnosis/1".to_owned(),
        participants: all.iter().map(|p| p.participant.clone()).collect(),
        effects,
        others,
        not_pooled: not_pooled.into_iter().map(str::to_owned).collect(),
    }
}

fn without<'a>(set: &[&'a str], id: &str) -> Vec<&'a str> {
    set.iter().copied().filter(|other| *other != id).collect()
}

/// What all participants say of an effect beside others; a participant of whose trials nothing follows is left out.
fn likelihoods<'a>(
    all: &'a [ParticipantEvidence],
    id: &str,
    beside: &[&str],
) -> Vec<(&'a ParticipantEvidence, Likelihood)> {
    all.iter().filter_map(|p| Some((p, p.likelihood(id, beside)?))).collect()
}

/// The population of an effect beside others.
fn population(all: &[ParticipantEvidence], id: &str, beside: &[&str]) -> Option<Population> {
    let found = likelihoods(all, id, beside);
    let (first, _) = found.first()?;
    let signs: Vec<Option<f64>> = first.places(id).into_iter().map(|i| first.amplitudes[i].sign).collect();
    Some(Population::of(&found.into_iter().map(|(_, l)| l).collect::<Vec<_>>(), &signs))
}

/// Natural logarithm of the Bayes factor for an effect beside others.
fn evidence(all: &[ParticipantEvidence], id: &str, beside: &[&str]) -> Option<f64> {
    population(all, id, beside).map(|p| p.log_bayes_factor)
}

/// The account of an effect that the cohort has.
///
/// - `set`: all of them; `ids`: all effects
fn effect_of(all: &[ParticipantEvidence], id: &str, set: &[&str], ids: &[&str]) -> Option<CohortEffect> {
    let beside = without(set, id);
    let found = population(all, id, &beside)?;
    let mut in_place: Vec<(f64, &str)> = ids
        .iter()
        .filter(|other| !set.contains(other))
        .filter_map(|other| Some((evidence(all, other, &beside)?, *other)))
        .filter(|(factor, _)| (factor - found.log_bayes_factor).exp() > STANDS_IN)
        .collect();
    in_place.push((found.log_bayes_factor, id));
    in_place.sort_by(|a, b| b.0.total_cmp(&a.0));
    let together = in_place.iter().map(|(factor, _)| factor.exp()).fold(0.0, f64::max);
    let together = in_place.iter().map(|(f, _)| (f - together.ln()).exp()).sum::<f64>().ln() + together.ln();
    let of = likelihoods(all, id, &beside);
    // Sizes are reported for the mean joint: what is plausible goes with a joint's strength.
    let amplitudes = mean_amplitudes(&of, id);
    let parameters = amplitudes.iter().enumerate().map(|(i, a)| {
        let at = |x: f64| a.value(x);
        let mean = found.mean(i).map(at);
        let spread = found.spread().map(|spread| {
            let [value, _, _] = found.mean(i);
            0.5 * (at(value + spread) - at(value - spread)).abs()
        });
        let size = PopulationSize { unit: a.unit.clone(), mean: ordered(mean), spread: ordered(spread) };
        (a.parameter.clone(), size)
    });
    let parameters = parameters.collect();
    let member = |(i, (p, likelihood)): (usize, &(&ParticipantEvidence, Likelihood))| {
        let (alone, pooled) = (likelihood.alone(), found.member(i));
        let sizes = p.places(id).into_iter().enumerate().map(|(j, place)| {
            let amplitude = &p.amplitudes[place];
            let value = |ends: [f64; 3]| ordered(ends.map(|x| amplitude.value(x)));
            (amplitude.parameter.clone(), MemberSize { alone: value(alone[j]), pooled: value(pooled.sizes[j]) })
        });
        Member {
            participant: p.participant.clone(),
            probability: pooled.probability,
            named_alone: p.named.iter().any(|named| named == id),
            deviation: pooled.deviation,
            parameters: sizes.collect(),
        }
    };
    Some(CohortEffect {
        effect: id.to_owned(),
        group: in_place.iter().map(|(_, id)| (*id).to_owned()).collect(),
        probability: probability(together),
        log_bayes_factor: found.log_bayes_factor,
        prevalence: ordered(found.prevalence()),
        parameters,
        participants: of.iter().enumerate().map(member).collect(),
    })
}

/// The amplitudes of an effect, of the size that is plausible on average over the participants.
fn mean_amplitudes(of: &[(&ParticipantEvidence, Likelihood)], id: &str) -> Vec<Amplitude> {
    let Some((first, _)) = of.first() else { return Vec::new() };
    let mean = |(i, place): (usize, usize)| {
        let over = |value: fn(&Amplitude) -> f64| {
            let values = of.iter().filter_map(|(p, _)| Some(value(&p.amplitudes[*p.places(id).get(i)?])));
            let values: Vec<f64> = values.collect();
            values.iter().sum::<f64>() / values.len().max(1) as f64
        };
        Amplitude { start: over(|a| a.start), size: over(|a| a.size), ..first.amplitudes[place].clone() }
    };
    first.places(id).into_iter().enumerate().map(mean).collect()
}

/// - `[value, low, high]`: in either order
fn ordered([value, a, b]: [f64; 3]) -> WithInterval {
    WithInterval { value, ci95: [a.min(b), a.max(b)] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carpus_effects::random::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// What everybody has of everything, as a share of what is plausible.
    const SMALL: f64 = 0.1;
    /// Standard deviation of the estimates of one participant.
    const ERROR: f64 = 0.25;
    const EFFECTS: usize = 12;

    /// Participants of whom some have the first effect.
    ///
    /// - `sizes`: of the first effect
    fn cohort(sizes: &[f64], rng: &mut ChaCha8Rng) -> Vec<ParticipantEvidence> {
        let of = |(i, size): (usize, &f64)| {
            let truth = (0..EFFECTS).map(|e| SMALL * normal(rng) + if e == 0 { *size } else { 0.0 });
            let truth: Vec<f64> = truth.collect();
            // Neighbours are estimated with correlated errors.
            let covariance =
                DMatrix::from_fn(EFFECTS, EFFECTS, |a, b| ERROR * ERROR * 0.4_f64.powi(a.abs_diff(b) as i32));
            let information = covariance.clone().try_inverse().unwrap();
            let root = covariance.cholesky().unwrap().l();
            let found = DVector::from_vec(truth) + root * DVector::from_fn(EFFECTS, |_, _| normal(rng));
            let amplitude = |e: usize| Amplitude {
                effect: format!("e{e}"),
                parameter: "size".to_owned(),
                unit: "N·m".to_owned(),
                start: 0.0,
                size: 2.0,
                is_ratio: false,
                sign: None,
            };
            ParticipantEvidence {
                schema: ParticipantEvidence::SCHEMA.to_owned(),
                participant: format!("P{i:02}"),
                amplitudes: (0..EFFECTS).map(amplitude).collect(),
                score: (&information * &found).as_slice().to_vec(),
                information: (0..EFFECTS).map(|r| information.row(r).iter().copied().collect()).collect(),
                everything: SMALL,
                named: Vec::new(),
            }
        };
        sizes.iter().enumerate().map(of).collect()
    }

    #[test]
    fn verif_a_cohort_has_what_no_participant_shows() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut named, mut nearer, mut covered, mut alone, mut count) = (0, 0, 0, 0, 0);
        for _ in 0..20 {
            let sizes: Vec<f64> = (0..10).map(|_| 0.5 + 0.1 * normal(&mut rng)).collect();
            let all = cohort(&sizes, &mut rng);
            // By itself a participant needs −2 log of a Bayes factor of 20.
            let single = |p: &ParticipantEvidence| evidence(std::slice::from_ref(p), "e0", &[]).unwrap() > ODDS.ln();
            alone += all.iter().filter(|p| single(p)).count();
            let found = pooled(&all);
            let Some(effect) = found.effects.first().filter(|e| e.effect == "e0") else { continue };
            named += 1;
            let size = &effect.parameters["size"].mean;
            covered += usize::from(size.ci95[0] <= 1.0 && 1.0 <= size.ci95[1]);
            let error = |of: fn(&MemberSize) -> f64| -> f64 {
                let one = |(m, x): (&Member, &f64)| (of(&m.parameters["size"]) - 2.0 * x).powi(2);
                effect.participants.iter().zip(&sizes).map(one).sum()
            };
            count += 1;
            nearer += usize::from(error(|s| s.pooled.value) < error(|s| s.alone.value));
        }
        println!("{named} of 20 named, {alone} of 200 alone, mean in its interval in {covered}, nearer in {nearer}");
        assert!(alone < 70, "{alone}");
        assert!(named >= 18, "{named}");
        assert!(covered * 10 >= count * 9, "{covered} of {count}");
        assert!(nearer * 10 >= count * 9, "{nearer} of {count}");
    }

    #[test]
    fn verif_a_clean_cohort_has_nothing() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let false_alarms = (0..40).filter(|_| !pooled(&cohort(&[0.0; 10], &mut rng)).effects.is_empty()).count();
        println!("{false_alarms} of 40");
        assert!(false_alarms <= 2, "{false_alarms}");
    }

    #[test]
    fn verif_an_effect_of_three_is_found_in_those_three() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut named, mut right, mut count) = (0, 0, 0);
        for _ in 0..10 {
            let sizes = [1.2, 0.0, 0.0, 1.2, 0.0, 0.0, 0.0, 1.2, 0.0, 0.0];
            let found = pooled(&cohort(&sizes, &mut rng));
            let Some(effect) = found.effects.iter().find(|e| e.effect == "e0") else { continue };
            named += 1;
            for (member, size) in effect.participants.iter().zip(sizes) {
                count += 1;
                right += usize::from((member.probability > 0.5) == (size > 0.0));
            }
        }
        println!("{named} of 10 named, {right} of {count} participants right");
        assert!(named >= 9 && right * 20 >= count * 19, "{named}, {right} of {count}");
    }
}
