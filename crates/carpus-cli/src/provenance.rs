//! The command line, as results name what made them.

use std::ffi::OsString;
use std::sync::{PoisonError, RwLock};

use carpus_session::provenance;
use carpus_session::shared_arguments::shared_arguments;

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
    provenance::command_line(words().into_iter().skip(1).map(|word| word.to_string_lossy().into_owned()))
}

/// What the command was asked, without what is of one task or one run alone.
pub fn arguments_of_task() -> Vec<String> {
    shared_arguments(words().into_iter().skip(1).map(|w| w.to_string_lossy().into_owned()))
}
