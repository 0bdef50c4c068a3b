//! Which effects are added to a model: those that a person names, or those that the diagnosis does.

use super::candidates::{known, names_of};
use super::diagnosis_file::KnownDiagnosis;
use super::diagnostic::{Diagnostic, Failure};
use carpus_effects::effect::Effect;
use carpus_report::diagnosis::DiagnosisResult;

/// The effects of these identifiers, each once.
///
/// # Errors
/// An unknown effect; one that is named twice.
pub fn chosen(ids: &[String]) -> Result<Vec<&'static dyn Effect>, Failure> {
    let mut effects = Vec::new();
    for (i, id) in ids.iter().enumerate() {
        if ids[..i].contains(id) {
            return Err(Diagnostic::error(format!("the effect `{id}` is named twice")).into());
        }
        effects.push(known(id)?);
    }
    Ok(effects)
}

/// Whether these effects are one of the explanations.
pub fn is_explanation(explanations: &[Vec<String>], chosen: &[String]) -> bool {
    explanations.iter().any(|e| e.len() == chosen.len() && e.iter().all(|id| chosen.contains(id)))
}

/// Whether the diagnosis supports these effects: one of its explanations, or some of those that are missing where many
/// things are a little wrong, or effects that cannot be told from these.
pub fn is_supported(diagnosis: &DiagnosisResult, chosen: &[String]) -> bool {
    let explanations: Vec<Vec<String>> = diagnosis.explanations.iter().map(|e| e.effects.clone()).collect();
    let is_missing = |id: &String| diagnosis.effects.iter().any(|e| e.group.contains(id));
    is_explanation(&explanations, chosen) || !diagnosis.effects.is_empty() && chosen.iter().all(is_missing)
}

/// What the diagnosis has against the choice: errors unless a person insists.
pub fn objections(participant: &str, diagnosis: &KnownDiagnosis, chosen: &[String], i_choose: bool) -> Vec<Diagnostic> {
    let result = &diagnosis.result;
    let explanations: Vec<Vec<String>> = result.explanations.iter().map(|e| e.effects.clone()).collect();
    let listed: Vec<String> = explanations.iter().map(|e| names_of(e)).collect();
    let text = match result.verdict.as_str() {
        "unknown" => "something is missing, and no effect of the catalogue explains it".to_owned(),
        "cannot_tell" => format!("the data are consistent with any of: {}; they cannot tell which", listed.join("; ")),
        _ if is_supported(result, chosen) => return Vec::new(),
        "dominant" | "several" => {
            let missing: Vec<String> = result.effects.iter().map(|e| e.effect.clone()).collect();
            format!(
                "beyond a little of everything the data call for {}, not for {}",
                names_of(&missing),
                names_of(chosen)
            )
        }
        "nothing_detectable" => "the data call for no effect: muscle parameters and noise explain them".to_owned(),
        _ => format!("the data are consistent with {}, not with {}", listed.join("; "), names_of(chosen)),
    };
    let text = format!("participant {participant}: {text}");
    let must_choose = matches!(result.verdict.as_str(), "unknown" | "cannot_tell");
    match (must_choose, i_choose) {
        (true, false) => vec![Diagnostic::error(text).hint(match result.verdict.as_str() {
            "cannot_tell" => {
                "`carpus plan` says which further trials would tell; --i-choose adds it all the same and \
                              records that you chose"
            }
            _ => "--i-choose adds it all the same and records that you chose",
        })],
        (_, true) => vec![Diagnostic::warning(format!("{text}; added because you chose so (--i-choose)"))],
        (false, false) => vec![Diagnostic::warning(text)],
    }
}

/// The effects to add, and why none is if none is.
///
/// # Errors
/// A diagnosis that names an effect which is not known.
pub fn decide(diagnosis: &DiagnosisResult) -> Result<(Vec<&'static dyn Effect>, Option<String>), Failure> {
    let none = |why: &str| Ok((Vec::new(), Some(format!("no effect is added: {why}"))));
    match (diagnosis.verdict.as_str(), diagnosis.explanations.as_slice()) {
        ("identified" | "two_effects", [only, ..]) => {
            let effects = only.effects.iter().map(|id| known(id)).collect::<Result<Vec<_>, _>>()?;
            Ok((effects, None))
        }
        ("dominant" | "several", _) => {
            let ids = diagnosis.effects.iter().map(|e| e.effect.as_str());
            Ok((ids.map(known).collect::<Result<Vec<_>, _>>()?, None))
        }
        ("cannot_tell", all) => {
            let sets: Vec<String> = all.iter().map(|e| names_of(&e.effects)).collect();
            none(&format!(
                "the data are consistent with any of: {}; `carpus plan` says what would tell",
                sets.join("; ")
            ))
        }
        ("nothing_detectable", _) => none("muscle parameters and noise explain the data"),
        ("negligible", _) => none("what is missing hardly matters"),
        ("implausible", _) => none("only implausible sizes explain the data"),
        _ => none("something is missing, and no effect of the catalogue explains it"),
    }
}
