//! What tasks that share a folder have to have in common: the command without what is of one of them alone.

/// Options that results do not depend on, and whether a value follows.
const OF_ONE_RUN: [(&str, bool); 5] =
    [("--task", true), ("--threads", true), ("--json", false), ("--quiet", false), ("-q", false)];

/// The arguments of `carpus study` without what is of one task or one run alone.
///
/// - `words`: behind the name of the program
pub fn shared_arguments(words: impl Iterator<Item = String>) -> Vec<String> {
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
        let left = shared_arguments(words.into_iter().map(str::to_owned));
        assert_eq!(left, ["study", "s.toml", "--out", "o", "--starts", "4"]);
    }
}
