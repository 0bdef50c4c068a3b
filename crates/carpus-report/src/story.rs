//! The story of a missing effect on one page: what the data say, how the error fell, what else could be, what would
//! tell.

use std::collections::BTreeMap;

use super::axis_figures::{AxisPanel, axis_panels, p_words, repetition_words};
use super::diagnosis::{CandidateResult, DiagnosisResult, ExplanationResult, NamedEffectResult};
use super::intervals::with_validity;
use super::ledger::Estimate;
use super::number::{percent, plain, significant};
use super::residuals::{FrequencyBand, ResidualResult};
use super::results::{Kind, Results};
use super::sentence::within_sentence;
use super::story_figures::{WaterfallStep, interval, probability_bar, separation, share_bar, waterfall};
use super::view::{Fact, Group, Pair, ParameterGroup, facts, groups, maybe, parameter_groups};
use super::warnings::{self, WarningGroup};
use carpus_diagnosis::catalogue::effect;
use carpus_diagnosis::diagnose::{RULED_OUT, is_determined};
use carpus_diagnosis::separation::SEPARABLE_Z;

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

/// A number of the summary.
pub struct StoryCard {
    pub label: &'static str,
    pub value: String,
    pub note: String,
    pub tone: &'static str,
}

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

/// Smallest size that would have been found.
pub struct DetectableRow {
    pub name: String,
    pub sizes: String,
    pub plausible: String,
    pub kept: String,
}

/// The name of an effect.
fn name(id: &str) -> String {
    effect(id).map_or_else(|| id.replace('_', " "), |e| e.description().name.to_owned())
}

fn in_sentence(id: &str) -> String {
    within_sentence(&name(id))
}

fn names(ids: &[String]) -> String {
    ids.iter().map(|id| name(id)).collect::<Vec<_>>().join(" + ")
}

pub(super) fn named_in_sentence(ids: &[String]) -> String {
    ids.iter().map(|id| in_sentence(id)).collect::<Vec<_>>().join(" and ")
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

/// The steps of the error: those of the ledger up to the one that is current, else those of the diagnosis.
fn steps(results: &Results, diagnosis: &DiagnosisResult) -> Vec<WaterfallStep> {
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
fn beside_discrepancy(diagnosis: &DiagnosisResult) -> Option<WaterfallStep> {
    let step = diagnosis.account.iter().find(|s| s.step == "generic_discrepancy")?;
    let label = "A smooth error of any cause would take".to_owned();
    Some(WaterfallStep { label, train: step.train, held_out: step.held_out, current: false })
}

fn verdict_words(verdict: &str) -> (&'static str, &'static str) {
    match verdict {
        "identified" => ("one explanation", "good"),
        "two_effects" => ("two effects together", "good"),
        "cannot_tell" => ("cannot tell", "warn"),
        "nothing_detectable" => ("nothing detectable", "good"),
        "negligible" => ("negligible", "good"),
        "implausible" => ("implausible", "bad"),
        "dominant" => ("one effect beyond a little of everything", "good"),
        "several" => ("several effects", "good"),
        _ => ("unknown cause", "bad"),
    }
}

/// What remains, as a formula.
fn proposed(diagnosis: &DiagnosisResult) -> Option<String> {
    let first = diagnosis.proposals.first()?;
    let others: Vec<&str> = diagnosis.proposals[1..].iter().map(|p| p.formula.as_str()).collect();
    let others =
        if others.is_empty() { String::new() } else { format!(" Nearly as much takes {}.", others.join(" or ")) };
    Some(format!(
        "What remains looks like a moment of {} N·m, which takes {} of its mean square in trials that were left \
         out.{others} The files proposal_1.toml and so on beside this page hold each as an effect of your own, to be \
         added with --own-effect.",
        first.formula,
        percent(first.share_of_error)
    ))
}

/// Which effects were considered.
fn considered(diagnosis: &DiagnosisResult) -> String {
    match diagnosis.restricted_to.as_slice() {
        [] => "Every effect of the catalogue was considered.".to_owned(),
        some => format!("Of the catalogue no more was considered than {}.", listed(some)),
    }
}

fn listed(ids: &[String]) -> String {
    ids.iter().map(|id| name(id)).collect::<Vec<_>>().join(", ")
}

/// What is said of effects that are less likely than what is named, but not ruled out.
fn runners_up(diagnosis: &DiagnosisResult) -> String {
    let considered = diagnosis.candidates.len();
    let likely = |id: &String| diagnosis.candidates.iter().find(|c| c.effect == *id).map_or(0.0, |c| c.probability);
    let mut others: Vec<&String> = diagnosis.less_likely.iter().collect();
    others.sort_by(|a, b| likely(b).total_cmp(&likely(a)));
    let listed: Vec<String> = others.iter().take(3).map(|id| in_sentence(id)).collect();
    match listed.as_slice() {
        [] => format!("Of {considered} effects that were considered, all others are ruled out."),
        _ => format!(
            "Of {considered} effects that were considered, the most likely to be missing beside it: {}.",
            listed.join(", ")
        ),
    }
}

/// Headline and lead.
fn told(
    results: &Results,
    diagnosis: &DiagnosisResult,
    steps: &[WaterfallStep],
    floor: Option<f64>,
) -> (String, Vec<String>) {
    let sets: Vec<String> = diagnosis.explanations.iter().map(|e| named_in_sentence(&e.effects)).collect();
    let verdict = match diagnosis.verdict.as_str() {
        "identified" => format!("The recordings are consistent with one missing effect: {}", sets.join("")),
        "two_effects" => format!("The recordings are consistent with two missing effects together: {}", sets.join("")),
        "cannot_tell" => format!("Something is missing; these trials cannot tell which of {} causes it is", sets.len()),
        "nothing_detectable" => "Nothing is missing that these trials could show".to_owned(),
        "negligible" => "Something is missing, but it hardly matters for the moment".to_owned(),
        "implausible" => "Only effects of an implausible size would explain the recordings".to_owned(),
        "dominant" | "several" => {
            let of = |dominant: bool| -> Vec<String> {
                let those = diagnosis.effects.iter().filter(|e| e.dominant == dominant);
                those.map(|e| in_sentence(&e.effect)).collect()
            };
            match (of(true).join(", "), of(false).join(", ")) {
                (large, small) if small.is_empty() => {
                    format!("Many things are a little wrong; beyond that the model lacks {large}")
                }
                (large, small) if large.is_empty() => {
                    format!("Many things are a little wrong, and none stands out; the largest: {small}")
                }
                (large, small) => {
                    format!("Many things are a little wrong; beyond that the model lacks {large}, and a little {small}")
                }
            }
        }
        _ if diagnosis.restricted_to.is_empty() => {
            "Something is missing that no effect of the catalogue explains".to_owned()
        }
        _ => "Something is missing that none of the effects that were considered explains".to_owned(),
    };
    let leaves = "nothing systematic is left";
    let planned = !diagnosis.separating_experiments.is_empty();
    let teller = if planned { "The table of further trials says" } else { "`carpus plan` says" };
    let mut lead = vec![match diagnosis.verdict.as_str() {
        "identified" => format!(
            "With {} fitted together with the muscles, {leaves} in the training trials. {} An effect outside the \
             catalogue that acts alike cannot be told from it.",
            sets.join(""),
            runners_up(diagnosis)
        ),
        "two_effects" => format!(
            "Whatever single effect was fitted together with the muscles, something systematic is left; with {} \
             {leaves}.",
            sets.join("")
        ),
        "cannot_tell" => format!(
            "With each of these fitted together with the muscles {leaves}: {}. {} what would tell.",
            sets.join("; "),
            teller
        ),
        "nothing_detectable" => {
            "With the muscles' strengths and lengths fitted, what is left looks like noise of EMG, angle and moment. \
             An effect smaller than the sizes listed below would have gone unnoticed."
                .to_owned()
        }
        "negligible" => {
            format!("The trials are consistent with {}, but the error falls by very little.", sets.join("; or with "))
        }
        "implausible" => format!(
            "With {} {leaves}, but at a size outside of what is plausible: a cause that is not in the catalogue, or a \
             fault of the recordings, is more likely.",
            sets.join(" or ")
        ),
        "dominant" | "several" => {
            "As in most laboratories, no single effect leaves nothing. Muscles, EMG errors, every effect of the \
             catalogue and a smooth discrepancy of each muscle's moment were estimated together; the effects below are \
             larger than the little that a laboratory has of everything."
                .to_owned()
        }
        _ => "Whatever effect was fitted together with the muscles, something systematic is left. The figures below \
              show what it depends on."
            .to_owned(),
    }];
    lead.extend(proposed(diagnosis));
    if let (Some(first), Some(last)) = (steps.first(), steps.last()) {
        let (what, a, b) = match (first.held_out, last.held_out) {
            (Some(a), Some(b)) => ("held-out trials, which no fit has seen,", a, b),
            _ => ("training trials", first.train, last.train),
        };
        let floor = floor.map(|f| format!("; noise alone would leave about {}", percent(f))).unwrap_or_default();
        lead.push(format!(
            "The error on {what} went from {} to {} of the session's largest moment{floor}.",
            percent(a),
            percent(b)
        ));
    }
    match results.ledger.as_ref().and_then(|l| Some((l, l.now()?))) {
        Some((_, now)) if now.effects.is_empty() => {
            lead.insert(0, format!("{verdict}."));
            let what = if now.id.ends_with("base") {
                "The model as it was given"
            } else {
                "The muscles refitted, no effect added"
            };
            (what.to_owned(), lead)
        }
        Some((ledger, now)) => {
            let error = |s: &WaterfallStep| s.held_out.unwrap_or(s.train);
            let fell = steps.first().zip(steps.last()).map(|(a, b)| (error(a), error(b)));
            let which = if now.held_out.is_some() { "held-out error" } else { "training error" };
            lead.insert(0, format!("{verdict}."));
            let effects = named_in_sentence(&now.effects);
            let verb = if ledger.choice.supported { "With" } else { "With (your choice)" };
            let headline = fell.map_or(effects.clone(), |(a, b)| {
                format!("{verb} {effects} the {which} goes from {} to {}", percent(a), percent(b))
            });
            (headline, lead)
        }
        None => (verdict, lead),
    }
}

fn cards(diagnosis: &DiagnosisResult, steps: &[WaterfallStep], floor: Option<f64>) -> Vec<StoryCard> {
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

fn estimates(parameters: &BTreeMap<String, Estimate>) -> Vec<EstimateRow> {
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
fn explanations(results: &Results, diagnosis: &DiagnosisResult) -> Vec<ExplanationView> {
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
fn several(diagnosis: &DiagnosisResult) -> Vec<SeveralView> {
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
fn others(group: &[String]) -> String {
    const SHOWN: usize = 3;
    let listed: Vec<String> = group.iter().skip(1).take(SHOWN).map(|id| in_sentence(id)).collect();
    let more = group.len().saturating_sub(1 + SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", listed.join(", "))
}

/// Amplitudes before shapes, each in the catalogue's order.
fn amplitude_first(id: &str, key: &str) -> usize {
    let name = key.split_once('.').map_or(key, |(_, name)| name);
    let description = effect(id).map(|e| e.description());
    description.and_then(|d| d.parameters.iter().position(|p| p.name == name)).unwrap_or(usize::MAX)
}

/// All candidates, what is named first, then by probability.
fn candidates(diagnosis: &DiagnosisResult) -> Vec<CandidateRow> {
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
fn confusion(diagnosis: &DiagnosisResult) -> Vec<ConfusionRow> {
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

fn experiments(diagnosis: &DiagnosisResult) -> Vec<ExperimentRow> {
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

fn bands(before: Option<&ResidualResult>, after: Option<&ResidualResult>) -> Vec<BandRow> {
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

fn band_share(band: &FrequencyBand) -> String {
    let in_percent = |share: f64| format!("{:.0}", 100.0 * share);
    let interval = band.interval.map(|[low, high]| format!(" ({} to {})", in_percent(low), in_percent(high)));
    format!("{}\u{202f}%{}", in_percent(band.share_of_error), interval.unwrap_or_default())
}

fn detectable(diagnosis: &DiagnosisResult) -> Vec<DetectableRow> {
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

/// Who chose the effects.
fn choice_words(results: &Results) -> String {
    let Some(choice) = results.ledger.as_ref().map(|l| &l.choice) else { return String::new() };
    if choice.chosen.is_empty() || choice.supported && !choice.i_choose {
        return String::new();
    }
    let chosen = named_in_sentence(&choice.chosen);
    let (words, _) = verdict_words(&choice.verdict);
    match choice.supported {
        true => format!("The diagnosis said “{words}”; a person chose {chosen}, one of its explanations."),
        false => format!("The diagnosis said “{words}” and does not support {chosen}: a person chose it."),
    }
}
