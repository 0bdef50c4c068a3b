//! How far long work is, for whoever waits for it; and how it is stopped.

use super::diagnostic::{Diagnostic, Failure};

/// Who is told how far work is, and may stop it. Every method has a default: nothing is shown, nothing is stopped.
pub trait Progress: Sync {
    /// Work came to a step.
    ///
    /// - `what`: is done, in the field's words
    /// - `done`, `steps`: of this piece of work; of how many is not known where `steps` is 0
    fn at(&self, _what: &str, _done: usize, _steps: usize) {}

    /// A piece of work ended.
    fn finished(&self) {}

    /// Work turns to a participant; `None`: all participants are done. Their warnings may differ in the name alone.
    fn about(&self, _participant: Option<&str>) {}

    /// Something that a person should know came up on the way.
    fn warning(&self, _warning: &Diagnostic) {}

    /// Several such things at once.
    fn warnings(&self, warnings: &[Diagnostic]) {
        warnings.iter().for_each(|warning| self.warning(warning));
    }

    /// Whether work is to stop. Asked before each piece of work (a diagnosis, the intervals of a
    /// fit) and between the searches of a fit.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Shows nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {}

/// Fails where work is to stop.
///
/// # Errors
/// It is.
pub fn go_on(progress: &dyn Progress) -> Result<(), Failure> {
    if progress.is_cancelled() { Err(Failure::Cancelled) } else { Ok(()) }
}
