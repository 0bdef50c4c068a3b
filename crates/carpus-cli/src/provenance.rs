//! The command line, and what of it goes into results.

use super::args::Global;
use carpus_report::results::{InputFile, Provenance};

/// The command as it was typed, quoted for a shell where needed.
pub fn command_line() -> String {
    let quoted = |word: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./=:,+%@".contains(c);
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    std::iter::once("carpus".to_string()).chain(words).collect::<Vec<_>>().join(" ")
}

/// Provenance of a command that read `inputs`.
pub fn provenance(global: &Global, inputs: Vec<InputFile>) -> Provenance {
    carpus_session::provenance::provenance(&command_line(), global.seed, inputs)
}
