//! The story of a missing effect on one page: what the data say, how the error fell, what else could be, what would
//! tell.

mod candidates;
mod errors;
mod explanations;
mod names;
mod words;

use super::axis_figures::{AxisPanel, axis_panels, repetition_words};
use super::results::{Kind, Results};
use super::sentence::within_sentence;
use super::story_figures::{WaterfallStep, waterfall};
use super::view::parameters::{ParameterGroup, parameter_groups};
use super::view::{Fact, Group, Pair, facts, groups};
use super::warnings::{self, WarningGroup};
use candidates::{
    CandidateRow, ConfusionRow, DetectableRow, ExperimentRow, candidates, confusion, detectable, experiments,
};
use errors::{BandRow, StoryCard, bands, beside_discrepancy, cards, steps};
use explanations::{ExplanationView, SeveralView, explanations, several};
use names::listed;
pub(super) use names::named_in_sentence;
use words::{choice_words, considered, told, verdict_words};

/// Candidates that the ranking shows in full.
const SHOWN_CANDIDATES: usize = 14;

/// The page.
pub struct Story {
    pub kicker: String,
    pub title: String,
    pub headline: String,
    pub lead: Vec<String>,
    pub verdict: &'static str,
    /// `good`, `bad` or empty.
    pub tone: &'static str,
    pub cards: Vec<StoryCard>,
    pub facts: Vec<Fact>,
    pub warnings: Vec<WarningGroup>,
    pub waterfall: String,
    pub measure: String,
    pub explanations: Vec<ExplanationView>,
    /// Effects that are missing where many things are a little wrong.
    pub several: Vec<SeveralView>,
    /// Which effects were considered.
    pub considered: String,
    pub candidates: Vec<CandidateRow>,
    pub more_candidates: usize,
    pub confusion: Vec<ConfusionRow>,
    pub experiments: Vec<ExperimentRow>,
    pub axes: Vec<AxisPanel>,
    pub has_before: bool,
    pub before_label: String,
    pub after_label: String,
    pub repetition_noise: String,
    pub bands: Vec<BandRow>,
    pub groups: Vec<Group>,
    pub detectable: Vec<DetectableRow>,
    pub ruled_out: String,
    pub not_testable: String,
    pub choice: String,
    pub parameters: Vec<ParameterGroup>,
}

impl Story {
    /// Works out the page; `None` for results that have no diagnosis.
    pub fn new(results: &Results) -> Option<Story> {
        let diagnosis = results.diagnosis.as_ref()?;
        let steps = steps(results, diagnosis);
        // The ledger's steps are of other models than the account's last one.
        let discrepancy = beside_discrepancy(diagnosis).filter(|_| results.ledger.is_none());
        let drawn: Vec<WaterfallStep> = steps.iter().cloned().chain(discrepancy).collect();
        let floor = results.ledger.as_ref().map(|l| l.noise_floor).or(diagnosis.error.noise_floor);
        let shown = steps.len().min(results.models.len());
        let models = &results.models[..shown];
        let after = models.last();
        let before = if shown > 2 { models.get(1) } else { None };
        let before = before.or(if shown == 2 { models.first() } else { None });
        let residual = |id: Option<&str>| results.residuals.iter().find(|r| Some(r.model.as_str()) == id);
        let (old, new) = (residual(before.map(|m| m.id.as_str())), residual(after.map(|m| m.id.as_str())));
        let pair = Pair { before, after };
        let (headline, lead) = told(results, diagnosis, &steps, floor);
        let (verdict, tone) = verdict_words(&diagnosis.verdict);
        let found_nothing = matches!(diagnosis.verdict.as_str(), "nothing_detectable" | "unknown" | "negligible");
        Some(Story {
            kicker: if results.kind == Kind::Effects { "Missing effects" } else { "Diagnosis" }.to_owned(),
            title: format!("{} · {}", results.study.name, results.participant.id),
            headline,
            lead,
            verdict,
            tone,
            cards: cards(diagnosis, &steps, floor),
            facts: facts(results),
            warnings: warnings::groups(&results.warnings),
            waterfall: waterfall(&drawn, floor),
            measure: diagnosis.error.measure.clone(),
            explanations: explanations(results, diagnosis),
            several: several(diagnosis),
            candidates: candidates(diagnosis).into_iter().take(SHOWN_CANDIDATES).collect(),
            considered: considered(diagnosis),
            more_candidates: diagnosis.candidates.len().saturating_sub(SHOWN_CANDIDATES),
            confusion: confusion(diagnosis),
            experiments: experiments(diagnosis),
            axes: axis_panels(old, new, &diagnosis.where_it_fails),
            has_before: before.is_some(),
            before_label: before.map(|m| within_sentence(&m.label)).unwrap_or_default(),
            after_label: after.map(|m| within_sentence(m.label.trim_start_matches("+ "))).unwrap_or_default(),
            repetition_noise: repetition_words(new),
            bands: bands(old, new),
            groups: groups(results, &pair),
            detectable: if found_nothing { detectable(diagnosis) } else { Vec::new() },
            ruled_out: listed(&diagnosis.ruled_out),
            not_testable: listed(&diagnosis.not_testable),
            choice: choice_words(results),
            parameters: parameter_groups(&results.parameters),
        })
    }
}
