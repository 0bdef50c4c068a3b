//! What a diagnosis says, in a sentence.

use super::candidates::names_of;
use carpus_diagnosis::diagnose::{Diagnosis, NamedEffect, Verdict};
use carpus_effects::catalogue::with_own;

/// Effects of a group that are listed.
const IN_GROUP: usize = 3;

/// A verdict in words.
pub fn in_words(diagnosis: &Diagnosis) -> String {
    let sets: Vec<String> = diagnosis.explanations.iter().map(|e| names_of(&e.effects)).collect();
    match diagnosis.verdict {
        Verdict::Identified => format!("consistent with one missing effect: {}", sets.join("")),
        Verdict::TwoEffects => format!("no single effect explains the data; consistent with {}", sets.join("")),
        Verdict::CannotTell => format!("cannot tell; consistent with any of: {}", sets.join("; ")),
        Verdict::NothingDetectable => "nothing detectable beyond muscle parameters and noise".to_string(),
        Verdict::Negligible => format!("detectable but negligible; consistent with {}", sets.join("; ")),
        Verdict::Unknown if diagnosis.candidates.len() < with_own().len() => {
            "something is missing, and no effect that was considered explains it".to_string()
        }
        Verdict::Unknown => "something is missing, and no effect of the catalogue explains it".to_string(),
        Verdict::Implausible => format!("only implausible sizes explain the data: {}", sets.join("; ")),
        Verdict::Dominant => format!("many things are a little wrong; missing beyond that: {}", groups(diagnosis)),
        Verdict::Several if diagnosis.effects.iter().all(|e| !e.dominant) => {
            format!("many things are a little wrong, and none stands out; the largest first: {}", groups(diagnosis))
        }
        Verdict::Several => {
            format!("many things are a little wrong; missing beyond that, the largest first: {}", groups(diagnosis))
        }
    }
}

/// Effects that are missing where many things are a little wrong, each with those that cannot be told from it.
fn groups(diagnosis: &Diagnosis) -> String {
    let name = |e: &NamedEffect| match e.group.as_slice() {
        [_] => names_of(&[e.effect]),
        group => {
            let listed: Vec<String> = group.iter().take(IN_GROUP).map(|id| names_of(&[*id])).collect();
            let more = match group.len().saturating_sub(IN_GROUP) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("one of {}{more}", listed.join(" / "))
        }
    };
    diagnosis.effects.iter().map(name).collect::<Vec<_>>().join("; ")
}
