//! What the data say, in words: headline, lead, verdict, choice.

use super::names::{in_sentence, listed, named_in_sentence};
use crate::diagnosis::DiagnosisResult;
use crate::number::percent;
use crate::results::Results;
use crate::story_figures::WaterfallStep;

pub(super) fn verdict_words(verdict: &str) -> (&'static str, &'static str) {
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
pub(super) fn proposed(diagnosis: &DiagnosisResult) -> Option<String> {
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
pub(super) fn considered(diagnosis: &DiagnosisResult) -> String {
    match diagnosis.restricted_to.as_slice() {
        [] => "Every effect of the catalogue was considered.".to_owned(),
        some => format!("Of the catalogue no more was considered than {}.", listed(some)),
    }
}

/// What is said of effects that are less likely than what is named, but not ruled out.
pub(super) fn runners_up(diagnosis: &DiagnosisResult) -> String {
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
pub(super) fn told(
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

/// Who chose the effects.
pub(super) fn choice_words(results: &Results) -> String {
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
