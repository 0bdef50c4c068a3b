//! Progress as lines of text, for a program that runs a command and waits for it.
//!
//! Where the environment variable [`VARIABLE`] is set, the command writes how far it is to stderr, a line each, between
//! the messages for people, and stops when its standard input ends. The results do not depend on it.

use serde::{Deserialize, Serialize};

/// The environment variable that asks for lines.
pub const VARIABLE: &str = "CARPUS_PROGRESS_LINES";

/// Begins a line of progress: the record separator of JSON text sequences (RFC 7464), which no message has.
const MARK: char = '\u{1e}';

/// How far work is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tick {
    /// What is done, in the field's words.
    pub what: String,
    /// Steps that are done.
    pub done: usize,
    /// Steps of this piece of work; 0: not known.
    pub steps: usize,
}

impl Tick {
    /// As a line, without its end.
    pub fn to_line(&self) -> String {
        format!("{MARK}{}", serde_json::to_string(self).unwrap_or_default())
    }

    /// Of a line; `None`: it is a message for people.
    pub fn of_line(line: &str) -> Option<Tick> {
        serde_json::from_str(line.strip_prefix(MARK)?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::Tick;

    #[test]
    fn verif_a_tick_is_one_line_and_comes_back() {
        let tick = Tick { what: "fitting \"P01\"\n\u{1e}".to_owned(), done: 3, steps: 7 };
        let line = tick.to_line();
        assert!(!line.contains('\n'));
        assert_eq!(Tick::of_line(&line), Some(tick));
        assert_eq!(Tick::of_line("warning: fitting"), None);
        assert_eq!(Tick::of_line("\u{1e}broken"), None);
    }
}
