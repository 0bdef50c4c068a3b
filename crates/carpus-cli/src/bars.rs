//! Progress of the library's work as a bar on stderr.

use std::sync::{Mutex, PoisonError};

use indicatif::ProgressBar;

use super::args::Global;
use super::failure::{self, Diagnostic};
use super::study_run::progress;
use carpus_session::progress::Progress;

/// A bar for the piece of work that is under way.
pub struct Bars<'a> {
    global: &'a Global,
    shown: Mutex<Option<ProgressBar>>,
}

impl<'a> Bars<'a> {
    /// Nothing is under way.
    pub fn new(global: &'a Global) -> Bars<'a> {
        Bars { global, shown: Mutex::new(None) }
    }
}

impl Progress for Bars<'_> {
    fn at(&self, what: &str, done: usize, steps: usize) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        let bar = shown.get_or_insert_with(|| progress(self.global, steps as u64, what));
        bar.set_length(steps as u64);
        bar.set_position(done as u64);
        bar.set_message(what.to_string());
    }

    fn finished(&self) {
        if let Some(bar) = self.shown.lock().unwrap_or_else(PoisonError::into_inner).take() {
            bar.finish_and_clear();
        }
    }

    fn warning(&self, warning: &Diagnostic) {
        failure::print(std::slice::from_ref(warning));
    }
}
