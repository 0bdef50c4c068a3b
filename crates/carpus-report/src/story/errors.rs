//! How the error fell: step by step, and by frequency.

use super::names::name;
use crate::axis_figures::p_words;
use crate::diagnosis::DiagnosisResult;
use crate::number::{percent, plain, significant};
use crate::residuals::{FrequencyBand, ResidualResult};
use crate::results::Results;
use crate::story_figures::WaterfallStep;

/// A number of the summary.
pub struct StoryCard {
    pub label: &'static str,
    pub value: String,
    pub note: String,
    pub tone: &'static str,
}

/// Error by frequency.
pub struct BandRow {
    pub band: String,
    pub before: String,
    pub after: String,
    /// Of the mean squared error, with its 95 % band.
    pub share: String,
    pub width_before: String,
    pub width_after: String,
}

/// The steps of the error: those of the ledger up to the one that is current, else those of the diagnosis.
pub(super) fn steps(results: &Results, diagnosis: &DiagnosisResult) -> Vec<WaterfallStep> {
    if let Some(ledger) = &results.ledger {
        let upto = ledger.steps.iter().take(ledger.current + 1).enumerate();
        return upto
            .map(|(i, s)| WaterfallStep {
                label: s.label.clone(),
                train: s.train,
                held_out: s.held_out,
                current: i == ledger.current,
            })
            .collect();
    }
    let label = |step: &str| match step {
        "as_given" => "Model as given".to_owned(),
        "recalibrated" => "Muscles refitted".to_owned(),
        effect => format!("+ {}", name(effect)),
    };
    let mut steps: Vec<WaterfallStep> = diagnosis
        .account
        .iter()
        .filter(|s| !["generic_discrepancy", "noise"].contains(&s.step.as_str()))
        .map(|s| WaterfallStep { label: label(&s.step), train: s.train, held_out: s.held_out, current: false })
        .collect();
    if let Some(last) = steps.last_mut() {
        last.current = true;
    }
    steps
}

/// The error that a smooth error of every muscle and of the joint would leave beside what is in the model.
pub(super) fn beside_discrepancy(diagnosis: &DiagnosisResult) -> Option<WaterfallStep> {
    let step = diagnosis.account.iter().find(|s| s.step == "generic_discrepancy")?;
    let label = "A smooth error of any cause would take".to_owned();
    Some(WaterfallStep { label, train: step.train, held_out: step.held_out, current: false })
}

pub(super) fn cards(diagnosis: &DiagnosisResult, steps: &[WaterfallStep], floor: Option<f64>) -> Vec<StoryCard> {
    let mut cards = Vec::new();
    let chain = |of: &dyn Fn(&WaterfallStep) -> Option<f64>| {
        let values: Vec<String> = steps.iter().filter_map(of).map(|v| format!("{:.1}", 100.0 * v)).collect();
        (!values.is_empty()).then(|| format!("{}\u{202f}%", values.join(" → ")))
    };
    if let Some(value) = chain(&|s| s.held_out) {
        cards.push(StoryCard { label: "Held-out error", value, note: "step by step".to_owned(), tone: "" });
    }
    if let Some(value) = chain(&|s| Some(s.train)) {
        cards.push(StoryCard { label: "Training error", value, note: "step by step".to_owned(), tone: "" });
    }
    if let Some(floor) = floor {
        let note = "what noise alone would leave".to_owned();
        cards.push(StoryCard { label: "Noise floor", value: percent(floor), note, tone: "" });
    }
    if let Some(p) = diagnosis.null_p_value {
        let nothing = diagnosis.verdict == "nothing_detectable";
        let note = if nothing { "nothing is left but noise" } else { "something is left" };
        let (value, note, tone) = (p_words(p), note.to_owned(), if nothing { "good" } else { "bad" });
        cards.push(StoryCard { label: "Muscles refitted, no effect", value, note, tone });
    }
    cards
}

pub(super) fn bands(before: Option<&ResidualResult>, after: Option<&ResidualResult>) -> Vec<BandRow> {
    let Some(after) = after else { return Vec::new() };
    // Mean squares, so that a fall of the error shows, relative to the largest band.
    let power = |r: &ResidualResult, i: usize| r.bands.get(i).map(|b| b.share_of_error * r.rms_n_m.powi(2));
    let all = (0..after.bands.len()).flat_map(|i| [power(after, i), before.and_then(|b| power(b, i))]).flatten();
    let most = all.fold(1e-12, f64::max);
    let width =
        |p: Option<f64>| p.map(|p| format!("{:.1}", 200.0 * (p / most).sqrt())).unwrap_or_else(|| "0".to_owned());
    let rms = |p: Option<f64>| p.map(|p| significant(p.sqrt(), 2)).unwrap_or_default();
    let row = |i: usize| {
        let b = &after.bands[i];
        let (old, new) = (before.and_then(|r| power(r, i)), power(after, i));
        BandRow {
            band: match b.high_hz {
                Some(high) => format!("{} to {} Hz", plain(b.low_hz), plain(high)),
                None => format!("above {} Hz", plain(b.low_hz)),
            },
            before: rms(old),
            after: rms(new),
            share: band_share(b),
            width_before: width(old),
            width_after: width(new),
        }
    };
    (0..after.bands.len()).map(row).collect()
}

pub(super) fn band_share(band: &FrequencyBand) -> String {
    let in_percent = |share: f64| format!("{:.0}", 100.0 * share);
    let interval = band.interval.map(|[low, high]| format!(" ({} to {})", in_percent(low), in_percent(high)));
    format!("{}\u{202f}%{}", in_percent(band.share_of_error), interval.unwrap_or_default())
}
