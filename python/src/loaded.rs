//! An open study and the sessions of its participants.

use std::path::PathBuf;
use std::sync::Arc;

use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::loading::Purpose;
use carpus::session::participant::Session as LibrarySession;
use carpus::session::study::{Opening, Study as OpenStudy};
use self_cell::self_cell;
use tempfile::TempDir;

use crate::job::Relay;

/// A study that is open, and who is told how far work on it is.
pub struct Opened {
    /// The study.
    pub study: OpenStudy,
    /// Who is told.
    pub relay: Arc<Relay>,
    /// How it was opened; `None`: it is in memory.
    pub again: Option<(PathBuf, Opening)>,
    /// The folder of the bundled study, for as long as the study is open.
    pub _folder: Option<TempDir>,
}

impl Opened {
    /// The session of a participant.
    ///
    /// # Errors
    /// No such participant; its model and trials.
    pub fn load(self: &Arc<Opened>, participant: &str, purpose: Purpose) -> Result<Arc<LoadedSession>, Failure> {
        LoadedSession::try_new(Arc::clone(self), |opened| {
            let found = opened.study.participants().find(|p| p.about().name == participant).ok_or_else(|| {
                let names: Vec<&str> = opened.study.chosen().iter().map(|p| p.name.as_str()).collect();
                let text = format!("there is no participant `{participant}`");
                Failure::from(Diagnostic::error(text).hint(format!("the study has: {}", names.join(", "))))
            })?;
            Ok(found.load_for(purpose)?.with_progress(&*opened.relay))
        })
        .map(Arc::new)
    }
}

self_cell!(
    /// A session and the study that it is of.
    pub struct LoadedSession {
        owner: Arc<Opened>,
        #[covariant]
        dependent: LibrarySession,
    }
);
