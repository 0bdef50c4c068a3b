//! The command line, as results name what made them.

use std::ffi::OsString;
use std::sync::{PoisonError, RwLock};

static WORDS: RwLock<Option<Vec<OsString>>> = RwLock::new(None);

/// Says what the command was, where it is not what the process was started with.
///
/// - `words`: the name of the program, then its arguments
pub fn set_words(words: Vec<OsString>) {
    *WORDS.write().unwrap_or_else(PoisonError::into_inner) = Some(words);
}

/// The name of the program, then its arguments.
pub fn words() -> Vec<OsString> {
    let set = WORDS.read().unwrap_or_else(PoisonError::into_inner).clone();
    set.unwrap_or_else(|| std::env::args_os().collect())
}

/// The command as it was typed, quoted for a shell where needed.
pub fn command_line() -> String {
    let quoted = |word: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@".contains(c);
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    };
    let words = words().into_iter().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    std::iter::once("carpus".to_string()).chain(words).collect::<Vec<_>>().join(" ")
}

/// Options that results do not depend on, and whether a value follows.
const OF_ONE_RUN: [(&str, bool); 5] =
    [("--task", true), ("--threads", true), ("--json", false), ("--quiet", false), ("-q", false)];

/// What the command was asked, without what is of one task or one run alone.
pub fn arguments_of_task() -> Vec<String> {
    let words = words().into_iter().skip(1).map(|w| w.to_string_lossy().into_owned());
    without_those_of_one_run(words)
}

fn without_those_of_one_run(words: impl Iterator<Item = String>) -> Vec<String> {
    let mut out = Vec::new();
    let mut is_value = false;
    for word in words {
        if std::mem::take(&mut is_value) {
            continue;
        }
        match OF_ONE_RUN.iter().find(|(name, _)| word == *name) {
            Some((_, has_value)) => is_value = *has_value,
            None if OF_ONE_RUN.iter().any(|(n, v)| *v && word.strip_prefix(n).is_some_and(|w| w.starts_with('='))) => {}
            None => out.push(word),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_what_is_of_one_task_alone_is_left_out() {
        let words = ["study", "s.toml", "--task", "1/2", "--out", "o", "--threads=3", "-q", "--starts", "4", "--json"];
        let left = without_those_of_one_run(words.into_iter().map(str::to_owned));
        assert_eq!(left, ["study", "s.toml", "--out", "o", "--starts", "4"]);
    }
}
