//! What else could be: the candidates, which of them are alike, what would tell them apart, and what would have been
//! found.

use std::collections::BTreeMap;

use super::names::name;
use crate::diagnosis::{CandidateResult, DiagnosisResult};
use crate::intervals::with_validity;
use crate::number::{percent, plain, significant};
use crate::story_figures::{probability_bar, separation};
use carpus_effects::answers::{RULED_OUT, SEPARABLE_Z};
use carpus_effects::catalogue::effect;

/// A candidate in the ranking.
pub struct CandidateRow {
    pub name: String,
    pub id: String,
    pub status: &'static str,
    pub survives: bool,
    pub svg: String,
    pub probability: String,
    pub score: String,
    pub kept: String,
    pub held_out: String,
    pub estimate: String,
}

/// Two effects and how far they are apart.
pub struct ConfusionRow {
    pub pair: String,
    pub z: String,
    pub svg: String,
    pub apart: bool,
}

/// An experiment that would help.
pub struct ExperimentRow {
    pub trials: String,
    pub pair: String,
    pub now: String,
    pub then: String,
    pub svg: String,
    pub enough: bool,
}

/// Smallest size that would have been found.
pub struct DetectableRow {
    pub name: String,
    pub sizes: String,
    pub plausible: String,
    pub kept: String,
}

/// Amplitudes before shapes, each in the catalogue's order.
pub(super) fn amplitude_first(id: &str, key: &str) -> usize {
    let name = key.split_once('.').map_or(key, |(_, name)| name);
    let description = effect(id).map(|e| e.description());
    description.and_then(|d| d.parameters.iter().position(|p| p.name == name)).unwrap_or(usize::MAX)
}

/// All candidates, what is named first, then by probability.
pub(super) fn candidates(diagnosis: &DiagnosisResult) -> Vec<CandidateRow> {
    let survives = |id: &str| diagnosis.explanations.iter().any(|e| e.effects.len() == 1 && e.effects[0] == id);
    let in_pair =
        |id: &str| diagnosis.explanations.iter().any(|e| e.effects.len() > 1 && e.effects.iter().any(|x| x == id));
    let is_missing = |id: &str| diagnosis.effects.iter().any(|e| e.effect == id);
    let named = |id: &str| survives(id) || in_pair(id) || is_missing(id);
    let row = |c: &CandidateResult| {
        let testable = !diagnosis.not_testable.contains(&c.effect);
        let status = match () {
            () if survives(&c.effect) => "explains the data",
            () if in_pair(&c.effect) => "part of a pair",
            () if !testable => "not testable",
            () if is_missing(&c.effect) => "missing",
            () if c.probability < RULED_OUT => "ruled out",
            () => "less likely",
        };
        CandidateRow {
            name: name(&c.effect),
            id: c.effect.clone(),
            status,
            survives: named(&c.effect),
            svg: probability_bar(c.probability, RULED_OUT, named(&c.effect)),
            probability: significant(c.probability, 2),
            score: c.score.map(|s| significant(s, 3)).unwrap_or_default(),
            kept: c.kept.map(|k| format!("{:.0}\u{202f}%", 100.0 * k)).unwrap_or_default(),
            held_out: c.held_out_error.map(percent).unwrap_or_default(),
            estimate: c
                .parameters
                .iter()
                .min_by_key(|(key, _)| amplitude_first(&c.effect, key))
                .map(|(_, e)| {
                    let [low, high] = e.ci95.map(|v| significant(v, 2));
                    let interval = with_validity(format!("{low} to {high}"), e.ci95, e.value);
                    format!("{} ({interval}) {}", significant(e.value, 2), if e.unit == "1" { "" } else { &e.unit })
                })
                .unwrap_or_default(),
        }
    };
    // What is named is shown whatever its probability.
    let explains = |c: &&CandidateResult| named(&c.effect);
    let (first, others): (Vec<_>, Vec<_>) = diagnosis.candidates.iter().partition(explains);
    first.into_iter().chain(others).map(row).collect()
}

/// Pairs of effects, the least separable first; each pair once, at its smaller z.
pub(super) fn confusion(diagnosis: &DiagnosisResult) -> Vec<ConfusionRow> {
    let mut pairs: BTreeMap<[String; 2], f64> = BTreeMap::new();
    for c in &diagnosis.confusion {
        let Some(z) = c.z else { continue };
        let mut pair = [c.truth.clone(), c.rival.clone()];
        pair.sort();
        let least = pairs.entry(pair).or_insert(f64::INFINITY);
        *least = least.min(z);
    }
    let most = pairs.values().copied().fold(10.0, f64::max);
    let mut rows: Vec<([String; 2], f64)> = pairs.into_iter().collect();
    rows.sort_by(|a, b| a.1.total_cmp(&b.1));
    rows.truncate(10);
    rows.into_iter()
        .map(|([a, b], z)| ConfusionRow {
            pair: format!("{} | {}", name(&a), name(&b)),
            z: significant(z, 2),
            svg: separation(z, None, SEPARABLE_Z, most),
            apart: z >= SEPARABLE_Z,
        })
        .collect()
}

pub(super) fn experiments(diagnosis: &DiagnosisResult) -> Vec<ExperimentRow> {
    let most = diagnosis.separating_experiments.iter().map(|e| e.z_then).fold(10.0, f64::max);
    diagnosis
        .separating_experiments
        .iter()
        .map(|e| ExperimentRow {
            trials: e.trials.clone(),
            pair: e.separates.iter().map(|id| name(id)).collect::<Vec<_>>().join(" | "),
            now: significant(e.z_now, 2),
            then: significant(e.z_then, 2),
            svg: separation(e.z_now, Some(e.z_then), SEPARABLE_Z, most),
            enough: e.z_then >= SEPARABLE_Z,
        })
        .collect()
}

pub(super) fn detectable(diagnosis: &DiagnosisResult) -> Vec<DetectableRow> {
    let row = |c: &CandidateResult| {
        let description = effect(&c.effect)?.description();
        let mut sizes = Vec::new();
        let mut plausible = Vec::new();
        for p in description.parameters {
            let Some(size) = c.detectable_size.get(p.name).copied().flatten() else { continue };
            let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
            sizes.push(format!("{} {}{unit}", p.name.replace('_', " "), significant(size, 2)));
            let [low, high] = c.plausible.get(p.name).copied().unwrap_or(p.plausible);
            plausible.push(format!("{} to {}", plain(low), plain(high)));
        }
        let kept = c.kept.map(|k| format!("{:.0}\u{202f}%", 100.0 * k)).unwrap_or_default();
        (!sizes.is_empty()).then(|| DetectableRow {
            name: description.name.to_owned(),
            sizes: sizes.join("; "),
            plausible: plausible.join("; "),
            kept,
        })
    };
    let testable = diagnosis.candidates.iter().filter(|c| !diagnosis.not_testable.contains(&c.effect));
    testable.filter_map(row).collect()
}
