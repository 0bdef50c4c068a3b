//! What to do next: one to three actions that follow from verdict, intervals and experiments, for pages and terminals
//! alike.

use std::path::Path;

use super::diagnosis::DiagnosisResult;
use super::identifiability::IdentifiabilityResult;
use super::results::{Kind, ParameterResult, Results};
use super::story::named_in_sentence;

/// Most actions that are named.
const MOST: usize = 3;

/// An action.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct NextStep {
    /// What to do and why, a sentence.
    pub what: String,
    /// The command that does it; `None`: something to record.
    pub command: Option<String>,
}

/// What to do after a command, the most useful first; at most three.
///
/// - `folder`: of the participant's files of results, as commands name it
pub fn next_steps(results: &Results, folder: &str) -> Vec<NextStep> {
    let study = study_of(&results.provenance.command);
    let mut steps = match (&results.diagnosis, results.kind) {
        (_, Kind::Effects) => after_effects(results, &study, folder),
        (Some(diagnosis), _) => after_diagnosis(diagnosis, &study, folder),
        (None, Kind::Personalization) => after_personalization(&results.parameters, &study),
        (None, Kind::Comparison) => vec![
            command("Fit the muscles to the trials.", format!("carpus personalize {study}")),
            command("Ask which physical effects the model lacks.", format!("carpus diagnose {study}")),
        ],
        (None, _) => vec![command("Compare with the measured moments.", format!("carpus compare {study}"))],
    };
    steps.truncate(MOST);
    steps
}

/// What to do after a command for all its participants, each action once; at most three.
///
/// - `out`: the command's folder of results
pub fn next_steps_of_all<'r>(all: impl IntoIterator<Item = &'r Results>, out: &Path) -> Vec<NextStep> {
    let mut steps: Vec<NextStep> = Vec::new();
    for results in all {
        let folder = format!("{}{}", out.join(&results.participant.id).display(), std::path::MAIN_SEPARATOR);
        for step in next_steps(results, &folder) {
            if !steps.contains(&step) {
                steps.push(step);
            }
        }
    }
    steps.truncate(MOST);
    steps
}

/// What to do after `carpus identify`.
pub fn after_identification(result: &IdentifiabilityResult) -> Vec<NextStep> {
    let study = study_of(&result.provenance.command);
    let open = result.parameters.iter().filter(|p| !p.is_determined()).count();
    let mut steps = Vec::new();
    if let Some(best) = result.next_trials.first().filter(|_| open > 0) {
        let (trial, all) = (&best.trial, result.parameters.len());
        let what = format!(
            "Record one more trial: {trial}. {open} of {all} parameters are not determined; it would narrow {} most, by \
             {:.0} %.",
            best.most, best.most_percent
        );
        steps.push(NextStep { what, command: None });
    }
    steps.push(command("Fit the muscles to the trials.", format!("carpus personalize {study}")));
    steps.push(command("Ask which physical effects the model lacks.", format!("carpus diagnose {study}")));
    steps
}

/// What to do after `carpus plan`.
///
/// - `line`: of the command; `best`: what to record and what it tells apart, if it does
pub fn after_plan(line: &str, best: Option<(&str, &[&str])>) -> Vec<NextStep> {
    let study = study_of(line);
    match best {
        Some((trials, separates)) => {
            let ids: Vec<String> = separates.iter().map(|id| (*id).to_owned()).collect();
            let what = format!("Record: {trials}. It tells {} apart.", named_in_sentence(&ids));
            let again = "Add the trials to the study and ask again which effects the model lacks.";
            vec![NextStep { what, command: None }, command(again, format!("carpus diagnose {study}"))]
        }
        None => {
            let what = "No single experiment tells these explanations apart. Add one of them and compare what is left.";
            vec![command(what, format!("carpus effect auto {study}"))]
        }
    }
}

/// An action that a command does.
pub fn command(what: impl Into<String>, command: String) -> NextStep {
    NextStep { what: what.into(), command: Some(command) }
}

/// The study as the command named it: what comes after the command's own words.
fn study_of(line: &str) -> String {
    const COMMANDS: [&str; 7] = ["simulate", "compare", "personalize", "diagnose", "identify", "plan", "effect"];
    let words = words(line);
    let own = words.iter().position(|word| COMMANDS.contains(word));
    let study = own.and_then(|i| words.get(if words[i] == "effect" { i + 2 } else { i + 1 }));
    study.filter(|word| !word.starts_with('-')).map_or("STUDY".to_owned(), |word| (*word).to_owned())
}

/// Words of a command line; what stands between quotes is one, with them.
fn words(line: &str) -> Vec<&str> {
    let mut out = Vec::new();
    let mut rest = line.trim_start();
    while let Some(first) = rest.chars().next() {
        let end = match first {
            '"' | '\'' => rest[1..].find(first).map_or(rest.len(), |i| i + 2),
            _ => rest.find(char::is_whitespace).unwrap_or(rest.len()),
        };
        out.push(&rest[..end]);
        rest = rest[end..].trim_start();
    }
    out
}

/// A word of a command, quoted for a shell where needed.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@\\".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

fn after_personalization(parameters: &[ParameterResult], study: &str) -> Vec<NextStep> {
    let on_bound: Vec<String> =
        parameters.iter().filter(|p| p.at_bound()).map(|p| format!("{} {}", p.muscle, p.property)).collect();
    let open = parameters.iter().filter(|p| p.interval.as_ref().is_some_and(|i| !i.is_determined())).count();
    let mut steps = vec![command("Ask which physical effects the model lacks.", format!("carpus diagnose {study}"))];
    if let Some(first) = on_bound.first() {
        let (more, what) = match on_bound.len() - 1 {
            0 => (String::new(), "is"),
            more => (format!(" and {more} more"), "are"),
        };
        let what = format!("{first}{more} {what} on a bound. Check units, signs and posture of the recordings.");
        steps.push(command(what, format!("carpus check {study}")));
    }
    if open > 0 {
        let what =
            format!("These trials do not determine {open} of {} parameters. See which trial would.", parameters.len());
        steps.push(command(what, format!("carpus identify {study}")));
    }
    steps
}

fn after_diagnosis(diagnosis: &DiagnosisResult, study: &str, folder: &str) -> Vec<NextStep> {
    let mut steps = Vec::new();
    match diagnosis.verdict.as_str() {
        "identified" | "two_effects" => {
            let effects = diagnosis.explanations.first().map(|e| e.effects.clone()).unwrap_or_default();
            let what = format!("Add {} to the model and fit the muscles with it.", named_in_sentence(&effects));
            steps.push(command(what, format!("carpus effect add {study} {}", effects.join(","))));
        }
        "dominant" | "several" => {
            let what = "Add the effects one after the other, as long as the error of left-out trials falls.";
            steps.push(command(what, format!("carpus effect auto {study}")));
            if let Some(unsure) = diagnosis.effects.iter().find(|e| e.group.len() > 1) {
                let what =
                    format!("These trials cannot tell {}. See which trial would.", named_in_sentence_or(&unsure.group));
                steps.push(command(what, format!("carpus plan {study}")));
            }
        }
        "cannot_tell" => {
            if let Some(best) = diagnosis.separating_experiments.iter().max_by(|a, b| a.z_then.total_cmp(&b.z_then)) {
                let what = format!("Record: {}. It tells {} apart.", best.trials, named_in_sentence(&best.separates));
                steps.push(NextStep { what, command: None });
            }
            steps.push(command("See all further trials that would tell.", format!("carpus plan {study}")));
        }
        "nothing_detectable" | "negligible" => {
            let what = "Use the model with its muscles refitted: no effect that these trials show is missing.";
            steps.push(command(what, format!("carpus personalize {study}")));
            let what = "See which effects and parameters further trials would determine.";
            steps.push(command(what, format!("carpus identify {study}")));
        }
        "implausible" => {
            let what = "A fault of the recordings is more likely than effects of this size. Look for it.";
            steps.push(command(what, format!("carpus check {study}")));
        }
        _ => {
            if !diagnosis.restricted_to.is_empty() {
                steps.push(command("Ask with the whole catalogue.", format!("carpus diagnose {study}")));
            }
            let what = "Look for faults of the recordings and of the study.";
            steps.push(command(what, format!("carpus check {study}")));
            if let Some(proposal) = diagnosis.proposals.first() {
                let what = format!("Try what remains as an effect of your own: {}.", proposal.formula);
                let file = quoted(&format!("{folder}proposal_1.toml"));
                steps.push(command(
                    what,
                    format!("carpus effect add {study} proposal_1 --own-effect {file} --i-choose"),
                ));
            }
        }
    }
    steps
}

fn after_effects(results: &Results, study: &str, folder: &str) -> Vec<NextStep> {
    let current = results.ledger.as_ref().and_then(|ledger| ledger.steps.get(ledger.current));
    let effects = match current.is_some_and(|step| step.side_car.is_some()) {
        true => format!(" --effects {}", quoted(&format!("{folder}effects.toml"))),
        false => String::new(),
    };
    let model = quoted(&format!("{folder}model.osim"));
    vec![
        command(
            "Ask what is still missing beside these effects.",
            format!("carpus diagnose {study} --model {model}{effects} --out again"),
        ),
        command(
            "Compare the model with other trials.",
            format!("carpus compare {study} --model {model}{effects} --out compared"),
        ),
    ]
}

fn named_in_sentence_or(ids: &[String]) -> String {
    named_in_sentence(ids).replace(" and ", " from ")
}

#[cfg(test)]
mod tests {
    use super::super::diagnosis::{ExplanationResult, ProposalResult, SeparatingExperiment};
    use super::*;

    fn commands(diagnosis: &DiagnosisResult) -> Vec<String> {
        after_diagnosis(diagnosis, "study", "out/P01/").into_iter().filter_map(|step| step.command).collect()
    }

    #[test]
    fn verif_every_verdict_has_something_to_do_next() {
        let verdicts = [
            "identified",
            "two_effects",
            "cannot_tell",
            "nothing_detectable",
            "negligible",
            "unknown",
            "implausible",
            "dominant",
            "several",
        ];
        for verdict in verdicts {
            let diagnosis = DiagnosisResult { verdict: verdict.to_owned(), ..DiagnosisResult::default() };
            assert!(!commands(&diagnosis).is_empty(), "{verdict}");
        }
    }

    #[test]
    fn verif_what_is_found_is_what_is_added() {
        let explanations = vec![ExplanationResult {
            effects: vec!["joint_stiffness".to_owned(), "gravity".to_owned()],
            ..ExplanationResult::default()
        }];
        let diagnosis =
            DiagnosisResult { verdict: "two_effects".to_owned(), explanations, ..DiagnosisResult::default() };
        assert_eq!(commands(&diagnosis), ["carpus effect add study joint_stiffness,gravity"]);
    }

    #[test]
    fn verif_the_trial_that_tells_most_is_to_be_recorded() {
        let experiment = |trials: &str, z_then: f64| SeparatingExperiment {
            trials: trials.to_owned(),
            separates: vec!["gravity".to_owned(), "torque_offset".to_owned()],
            z_then,
            ..SeparatingExperiment::default()
        };
        let separating_experiments = vec![experiment("two ramps", 3.0), experiment("three turns", 5.0)];
        let diagnosis =
            DiagnosisResult { verdict: "cannot_tell".to_owned(), separating_experiments, ..DiagnosisResult::default() };
        let steps = after_diagnosis(&diagnosis, "study", "");
        assert!(steps[0].what.contains("three turns") && steps[0].command.is_none(), "{steps:?}");
        assert_eq!(steps[1].command.as_deref(), Some("carpus plan study"));
    }

    #[test]
    fn verif_the_study_is_the_one_that_the_command_named() {
        assert_eq!(words("carpus compare \"my study\" --out x"), ["carpus", "compare", "\"my study\"", "--out", "x"]);
        assert_eq!(words(""), [""; 0]);
    }

    #[test]
    fn verif_names_with_spaces_are_one_word() {
        let proposals = vec![ProposalResult { formula: "0.4*q".to_owned(), ..ProposalResult::default() }];
        let diagnosis = DiagnosisResult { verdict: "unknown".to_owned(), proposals, ..DiagnosisResult::default() };
        let found = after_diagnosis(&diagnosis, &quoted("my study"), "an out/P01/");
        let last = found.last().and_then(|step| step.command.clone()).unwrap_or_default();
        assert!(last.contains("'my study'") && last.contains("'an out/P01/proposal_1.toml'"), "{last}");
    }
}
