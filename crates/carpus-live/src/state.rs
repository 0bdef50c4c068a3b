//! What the page shows, and who is told when it changes.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use serde_json::Value;
use tokio::sync::watch;

use carpus_session::diagnostic::Failure;
use carpus_session::progress_lines::Tick;

use crate::ledger::Ledger;
use crate::settings::Settings;

/// Lines of a running command's messages that are held: of more the first ones go.
const MOST_LINES: usize = 200;

/// A study that is worked on.
#[derive(Debug)]
pub(crate) struct Live {
    /// What is asked for.
    pub settings: Settings,
    /// What whoever asks has to know.
    pub token: String,
    /// The port that is listened on.
    pub port: u16,
    state: Mutex<State>,
    changed: watch::Sender<Version>,
    /// Whether the server ends.
    ended: Arc<AtomicBool>,
}

/// What the page shows.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct State {
    /// Every step, and the current one.
    pub ledger: Ledger,
    /// The command that is under way.
    pub job: Option<Job>,
    /// What is known of the study.
    pub study: StudyState,
}

/// A command that is under way.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Job {
    /// Number of its step.
    pub step: usize,
    /// How far it is.
    pub at: Tick,
    /// What it said.
    pub messages: Vec<String>,
    /// Becomes true when it is to stop.
    #[serde(skip)]
    pub stop: Arc<AtomicBool>,
    /// Whether it was asked to stop.
    pub is_stopping: bool,
}

/// What is known of the study.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct StudyState {
    /// Its name.
    pub name: String,
    /// Its participants, as far as the tables can be read.
    pub participants: Vec<String>,
    /// Files of effects that the study names.
    pub own_effects: Vec<String>,
    /// Whether the files are being checked.
    pub is_checking: bool,
    /// What `carpus check --json` prints; `None`: not yet known.
    pub check: Option<Value>,
    /// Why there is no check.
    pub fault: Option<String>,
    /// The catalogue, with the study's own effects.
    pub effects: Vec<EffectName>,
    /// How many times the files have been checked.
    pub checks: usize,
}

/// An effect that can be added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct EffectName {
    /// Its identifier.
    pub id: String,
    /// Its name.
    pub name: String,
}

/// Counts changes, so that who looks again sees what is new.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Version {
    /// Changes of anything but the progress of a command.
    pub state: u64,
    /// Steps of the progress of a command.
    pub tick: u64,
    /// Whether the server ends.
    pub is_ended: bool,
}

impl Live {
    /// Nothing is known of the study yet.
    pub fn new(settings: Settings, token: String, port: u16, ledger: Ledger) -> Live {
        let state = Mutex::new(State { ledger, job: None, study: StudyState::default() });
        Live { settings, token, port, state, changed: watch::Sender::default(), ended: Arc::default() }
    }

    /// The state as it is now. A lock whose holder panicked holds whole values all the same.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and tells it.
    pub fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let value = change(&mut self.state());
        self.changed.send_modify(|version| version.state += 1);
        value
    }

    /// The running command came to a step.
    pub fn tick(&self, at: Tick) {
        if let Some(job) = &mut self.state().job {
            job.at = at;
        }
        self.changed.send_modify(|version| version.tick += 1);
    }

    /// The running command said something.
    pub fn say(&self, line: String) {
        if let Some(job) = &mut self.state().job {
            if job.messages.len() >= MOST_LINES {
                job.messages.remove(0);
            }
            job.messages.push(line);
        }
        self.changed.send_modify(|version| version.tick += 1);
    }

    /// Makes a step the current one; 0: the study as it is.
    ///
    /// # Errors
    /// No such step, one without results, or the disk.
    pub fn go_to(&self, step: usize) -> Result<Result<(), String>, Failure> {
        let mut state = self.state();
        if step > 0 {
            match state.ledger.step(step) {
                None => return Ok(Err(format!("there is no step {step}"))),
                Some(found) if !found.outcome.has_results() => {
                    return Ok(Err(format!("step {step} has no results to go on with")));
                }
                Some(_) => {}
            }
        }
        state.ledger.current = step;
        let written = state.ledger.write(&self.settings.out);
        drop(state);
        self.changed.send_modify(|version| version.state += 1);
        written.map(Ok)
    }

    /// Asks the running command to stop. Whether there is one.
    pub fn stop_job(&self) -> bool {
        self.change(|state| {
            let Some(job) = &mut state.job else { return false };
            job.is_stopping = true;
            job.stop.store(true, Ordering::Relaxed);
            true
        })
    }

    /// The server ends: nothing new begins, and what is under way stops.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
        self.stop_job();
        self.changed.send_modify(|version| version.is_ended = true);
    }

    /// Whether the server ends.
    pub fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// Becomes true when the server ends.
    pub fn ended(&self) -> &AtomicBool {
        &self.ended
    }

    /// Is told of changes.
    pub fn subscribe(&self) -> watch::Receiver<Version> {
        self.changed.subscribe()
    }
}
