//! What explains the data, with estimates.

use std::collections::BTreeMap;

use super::names::{in_sentence, name, names};
use crate::axis_figures::p_words;
use crate::diagnosis::{DiagnosisResult, ExplanationResult, NamedEffectResult};
use crate::intervals::with_validity;
use crate::ledger::Estimate;
use crate::number::{percent, plain, significant};
use crate::results::Results;
use crate::story_figures::{interval, share_bar};
use crate::view::maybe;
use carpus_effects::answers::is_determined;
use carpus_effects::catalogue::effect;

/// One explanation.
pub struct ExplanationView {
    pub title: String,
    pub equation: String,
    pub p_value: String,
    pub held_out: String,
    pub parameters: Vec<EstimateRow>,
}

/// An effect that is missing where many things are a little wrong.
pub struct SeveralView {
    pub title: String,
    pub equation: String,
    /// Effects that these trials cannot tell from it.
    pub others: String,
    pub probability: String,
    pub train: String,
    pub unique: String,
    pub held_out: String,
    pub svg: String,
    pub parameters: Vec<EstimateRow>,
}

/// An estimated parameter.
pub struct EstimateRow {
    pub name: String,
    pub estimate: String,
    pub ci: String,
    pub plausible: String,
    pub svg: String,
    pub implausible: bool,
}

pub(super) fn estimates(parameters: &BTreeMap<String, Estimate>) -> Vec<EstimateRow> {
    let row = |(name, e): (&String, &Estimate)| {
        let unit = if e.unit == "1" { String::new() } else { format!("\u{202f}{}", e.unit) };
        EstimateRow {
            name: name.split_once('.').map_or(name.as_str(), |(_, p)| p).replace('_', " "),
            estimate: format!("{}{unit}", significant(e.value, 3)),
            ci: match is_determined(e.ci95) {
                true => {
                    let text = format!("{} to {}", significant(e.ci95[0], 3), significant(e.ci95[1], 3));
                    with_validity(text, e.ci95, e.value)
                }
                false => "not determined".to_owned(),
            },
            plausible: format!("{} to {}{unit}", plain(e.plausible[0]), plain(e.plausible[1])),
            svg: interval(e.value, e.ci95, e.plausible),
            implausible: !e.is_plausible(),
        }
    };
    parameters.iter().map(row).collect()
}

/// The explanations; after effects were added, first the one that is in the model.
pub(super) fn explanations(results: &Results, diagnosis: &DiagnosisResult) -> Vec<ExplanationView> {
    let view = |e: &ExplanationResult, title: String| ExplanationView {
        title,
        equation: e
            .effects
            .iter()
            .filter_map(|id| effect(id))
            .map(|e| e.description().equation)
            .collect::<Vec<_>>()
            .join("; "),
        p_value: maybe(e.p_value, p_words),
        held_out: maybe(e.held_out_error, percent),
        parameters: estimates(&e.parameters),
    };
    let now = results.ledger.as_ref().and_then(|l| l.now()).filter(|s| !s.parameters.is_empty());
    let mut all = Vec::new();
    if let Some(step) = now {
        let inside = ExplanationResult {
            effects: step.effects.clone(),
            p_value: step.p_value,
            held_out_error: step.held_out,
            parameters: step.parameters.clone(),
        };
        all.push(view(&inside, format!("{} (in the model now)", names(&step.effects))));
    }
    let other = |e: &&ExplanationResult| now.is_none_or(|s| s.effects != e.effects);
    all.extend(diagnosis.explanations.iter().filter(other).map(|e| view(e, names(&e.effects))));
    all
}

/// Effects that are missing where many things are a little wrong, in their order.
pub(super) fn several(diagnosis: &DiagnosisResult) -> Vec<SeveralView> {
    let most = diagnosis.effects.iter().map(|e| e.share_of_error.train[2]).fold(0.05, f64::max);
    let share = |[value, low, high]: [f64; 3]| {
        format!("{:.0}\u{202f}% ({:.0} to {:.0})", 100.0 * value, 100.0 * low, 100.0 * high)
    };
    let view = |e: &NamedEffectResult| {
        let parameters: BTreeMap<String, Estimate> =
            e.parameters.iter().map(|(name, p)| (format!("{}.{name}", e.effect), p.clone())).collect();
        SeveralView {
            title: name(&e.effect),
            equation: effect(&e.effect).map_or("", |known| known.description().equation).to_owned(),
            others: others(&e.group),
            probability: significant(e.probability, 2),
            train: share(e.share_of_error.train),
            unique: share(e.unique_share.train),
            held_out: e.share_of_error.held_out.map(share).unwrap_or_default(),
            svg: share_bar(e.share_of_error.train, most),
            parameters: estimates(&parameters),
        }
    };
    match diagnosis.verdict.as_str() {
        "dominant" | "several" => diagnosis.effects.iter().map(view).collect(),
        _ => Vec::new(),
    }
}

/// The effects of a group but the first, in a sentence; of many the first few.
pub(super) fn others(group: &[String]) -> String {
    const SHOWN: usize = 3;
    let listed: Vec<String> = group.iter().skip(1).take(SHOWN).map(|id| in_sentence(id)).collect();
    let more = group.len().saturating_sub(1 + SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", listed.join(", "))
}
