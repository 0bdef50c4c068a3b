//! Progress of the library's work as a bar on stderr.

use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

use super::args::Global;
use super::failure::{self, Diagnostic};
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

    fn about(&self, participant: Option<&str>) {
        match participant {
            Some(name) => failure::about(name),
            None => failure::account(),
        }
    }

    fn warning(&self, warning: &Diagnostic) {
        failure::print(std::slice::from_ref(warning));
    }

    fn warnings(&self, warnings: &[Diagnostic]) {
        failure::print(warnings);
    }
}

/// A progress bar on stderr; nothing where stderr is no terminal or silence was asked for.
fn progress(global: &Global, steps: u64, what: &str) -> ProgressBar {
    if global.quiet || global.json {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(steps).with_message(what.to_string());
    if let Ok(style) = ProgressStyle::with_template("{msg:<28} {wide_bar} {pos}/{len} {elapsed}") {
        bar.set_style(style);
    }
    bar
}
