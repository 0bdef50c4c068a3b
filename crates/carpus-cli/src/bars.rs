//! Progress of the library's work on stderr: as a bar for people, as lines for a program that runs the command.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

use super::args::Global;
use super::failure::{self, Diagnostic};
use carpus_session::progress::Progress;
use carpus_session::progress_lines::{Tick, VARIABLE};

/// A bar for the piece of work that is under way.
pub struct Bars<'a> {
    global: &'a Global,
    shown: Mutex<Option<ProgressBar>>,
    /// Whether a program that runs this command asks it to stop; `None`: people watch.
    is_ended: Option<&'static AtomicBool>,
}

impl<'a> Bars<'a> {
    /// Nothing is under way.
    pub fn new(global: &'a Global) -> Bars<'a> {
        let is_ended = std::env::var_os(VARIABLE).is_some().then(end_of_input);
        Bars { global, shown: Mutex::new(None), is_ended }
    }
}

impl Progress for Bars<'_> {
    fn at(&self, what: &str, done: usize, steps: usize) {
        if self.is_ended.is_some() {
            failure::say(&Tick { what: what.to_owned(), done, steps }.to_line());
            return;
        }
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

    fn is_cancelled(&self) -> bool {
        self.is_ended.is_some_and(|ended| ended.load(Ordering::Relaxed))
    }
}

/// Becomes true when standard input ends: whoever runs this command closes it, or is gone.
fn end_of_input() -> &'static AtomicBool {
    static ENDED: AtomicBool = AtomicBool::new(false);
    static WATCHED: OnceLock<()> = OnceLock::new();
    WATCHED.get_or_init(|| {
        std::thread::spawn(|| {
            // An input that cannot be read has ended, too.
            let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
            ENDED.store(true, Ordering::Relaxed);
        });
    });
    &ENDED
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
