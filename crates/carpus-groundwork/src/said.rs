//! Warnings that were said already: what holds for several participants is said once, and then for whom else.

use super::diagnostic::Diagnostic;

/// Stands for a participant's name in warnings that differ in it alone.
const NAME: &str = "\u{0}";
/// Names that are listed before the rest is counted.
const LISTED: usize = 6;
/// Characters of a warning that are quoted.
const QUOTED: usize = 100;

/// What was said.
#[derive(Debug, Default)]
pub struct Said {
    /// Whom the work is about now.
    participant: Option<String>,
    warnings: Vec<Warning>,
}

#[derive(Debug)]
struct Warning {
    /// With [`NAME`] for the participant's name.
    key: [String; 3],
    line: Option<usize>,
    /// As it was said.
    text: String,
    /// For whom.
    first: Option<String>,
    /// For whom it holds as well, since the last account.
    others: Vec<String>,
}

impl Said {
    /// Nothing yet.
    pub const fn new() -> Said {
        Said { participant: None, warnings: Vec::new() }
    }

    /// What is said from now on is about this participant.
    pub fn about(&mut self, participant: Option<&str>) {
        self.participant = participant.map(str::to_owned);
    }

    /// Whether a warning is new; one that is not is noted to hold for the present participant, too.
    pub fn is_new(&mut self, message: &Diagnostic) -> bool {
        let plain = |text: &str| match &self.participant {
            Some(name) => without_name(text, name),
            None => text.to_owned(),
        };
        let file = message.file.as_ref().map_or(String::new(), |file| file.display().to_string());
        let key = [&message.text, &file, message.hint.as_ref().unwrap_or(&String::new())].map(|text| plain(text));
        let participant = &self.participant;
        let known = self.warnings.iter_mut().find(|w| w.key == key && w.line == message.line);
        let Some(known) = known else {
            let (line, text, first) = (message.line, message.text.clone(), participant.clone());
            self.warnings.push(Warning { key, line, text, first, others: Vec::new() });
            return true;
        };
        if let Some(name) = participant.as_ref().filter(|name| known.first.as_ref() != Some(name))
            && !known.others.contains(name)
        {
            known.others.push(name.clone());
        }
        false
    }

    /// For whom else warnings hold that name a participant, a line for each set of participants. What is of a shared
    /// file and names nobody holds for all, and is not told again.
    pub fn account(&mut self) -> Vec<String> {
        self.participant = None;
        let mut groups: Vec<(Vec<String>, String, usize)> = Vec::new();
        for warning in &mut self.warnings {
            let others = std::mem::take(&mut warning.others);
            if others.is_empty() || !warning.key.iter().any(|text| text.contains(NAME)) {
                continue;
            }
            match groups.iter_mut().find(|(names, ..)| *names == others) {
                Some((_, _, count)) => *count += 1,
                None => groups.push((others, shortened(&warning.text), 1)),
            }
        }
        groups.into_iter().map(|(names, text, count)| told(&names, &text, count)).collect()
    }
}

fn told(names: &[String], text: &str, count: usize) -> String {
    let listed = names.iter().take(LISTED).map(String::as_str).collect::<Vec<_>>().join(", ");
    let listed = match names.len().saturating_sub(LISTED) {
        0 => listed,
        rest => format!("{listed} and {rest} more"),
    };
    match count {
        1 => format!("so it is with {listed}: {text}"),
        count => format!("so it is with {listed}: {text} (and {} further warnings above)", count - 1),
    }
}

/// The first line of a text, as far as it is quoted.
fn shortened(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    match line.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line.to_owned(),
    }
}

/// A text with [`NAME`] wherever a name stands as a word.
fn without_name(text: &str, name: &str) -> String {
    let is_part = |c: char| c.is_alphanumeric() || c == '-';
    let (mut found, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(at) = rest.find(name).filter(|_| !name.is_empty()) {
        let (before, after) = (&rest[..at], &rest[at + name.len()..]);
        let joined = found.chars().chain(before.chars()).next_back().is_some_and(is_part);
        let is_word = !joined && !after.starts_with(is_part);
        found.push_str(before);
        found.push_str(if is_word { NAME } else { name });
        rest = after;
    }
    found.push_str(rest);
    found
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn verif_a_warning_is_said_once_and_then_for_whom_else() {
        let mut said = Said::new();
        let of_trial = |name: &str| Diagnostic::warning("no angle").in_file(Path::new(&format!("data/{name}/t.csv")));
        let of_model = Diagnostic::warning("no mass").in_file(Path::new("arm.osim")).at_line(3);
        let of_person = |name: &str| Diagnostic::warning(format!("participant {name}: every trial is passive"));
        let mut new = Vec::new();
        for name in ["P1", "P2", "P10"] {
            said.about(Some(name));
            new.extend([of_trial(name), of_model.clone(), of_person(name)].map(|message| said.is_new(&message)));
        }
        assert_eq!(new, [true, true, true, false, false, false, false, false, false]);
        assert_eq!(said.account(), ["so it is with P2, P10: no angle (and 1 further warnings above)"]);
        assert!(said.account().is_empty(), "once");
        // Only for one more, and something else.
        said.about(Some("P2"));
        assert!(!said.is_new(&of_person("P2")) && said.is_new(&Diagnostic::warning("P1 is no name here")));
        assert_eq!(said.account(), ["so it is with P2: participant P1: every trial is passive"]);
        // Another line is another warning.
        assert!(said.is_new(&Diagnostic::warning("no mass").in_file(Path::new("arm.osim")).at_line(4)));
    }

    #[test]
    fn verif_names_are_words() {
        assert_eq!(without_name("P1/P1_a.csv of P10, P1", "P1"), "\u{0}/\u{0}_a.csv of P10, \u{0}");
        assert_eq!(without_name("aP1 P1", "P1"), "aP1 \u{0}");
    }
}
