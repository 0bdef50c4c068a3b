//! A step from its beginning to its end in the ledger.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use carpus_session::diagnostic::{Diagnostic, Failure};
use carpus_session::output::OutputFolder;
use carpus_session::progress_lines::Tick;

use crate::asked::{Asked, Planned};
use crate::ledger::{Outcome, StepModel};
use crate::process::{self, Ended, GRACE, Line};
use crate::state::{Job, Live};

/// Why a step was not begun.
#[derive(Debug)]
pub(crate) enum NotBegun {
    /// Another one is under way, or the server ends.
    Busy,
    /// What is wrong with it.
    Refused(Failure),
}

/// Begins a step; its number. The work goes on by itself.
///
/// # Errors
/// Another step is under way; the step does not fit the study; the ledger cannot be written.
pub(crate) fn begin(live: &Arc<Live>, asked: &Asked) -> Result<usize, NotBegun> {
    let mut state = live.state();
    if state.job.is_some() || live.is_ended() {
        return Err(NotBegun::Busy);
    }
    let study = &state.study;
    let planned = asked
        .planned(&live.settings, &state.ledger, &study.participants, &study.own_effects)
        .map_err(NotBegun::Refused)?;
    let folder = live.settings.out.join(&planned.step.folder);
    if folder.exists() {
        let text = "is there already, and is no step of the ledger";
        return Err(NotBegun::Refused(Diagnostic::error(text).in_file(&folder).hint("move it away").into()));
    }
    let (id, stop) = (planned.step.id, Arc::new(AtomicBool::new(false)));
    state.ledger.steps.push(planned.step.clone());
    if let Err(failure) = state.ledger.write(&live.settings.out) {
        state.ledger.steps.pop();
        return Err(NotBegun::Refused(failure));
    }
    let at = Tick { what: "starting".to_owned(), done: 0, steps: 0 };
    state.job = Some(Job { step: id, at, messages: Vec::new(), stop: stop.clone(), is_stopping: false });
    drop(state);
    live.change(|_| ());
    let live = live.clone();
    std::thread::spawn(move || work(&live, &planned, &stop));
    Ok(id)
}

/// Does the work of a step, and enters its end into the ledger.
fn work(live: &Live, planned: &Planned, stop: &AtomicBool) {
    let messages = Mutex::new(Vec::new());
    let ended = copied(live, planned).and_then(|()| {
        process::run(&live.settings.program, &planned.words, stop, GRACE, |line| match line {
            Line::Tick(tick) => live.tick(tick),
            Line::Message(text) => {
                messages.lock().unwrap_or_else(PoisonError::into_inner).push(text.clone());
                live.say(text);
            }
        })
    });
    let mut messages = messages.into_inner().unwrap_or_else(PoisonError::into_inner);
    let folder = live.settings.out.join(&planned.step.folder);
    let pages = pages(&folder, &planned.step.folder);
    let (outcome, said) = match ended {
        Ok(Ended { code: Some(0), output, .. }) => (Outcome::Done, output),
        Ok(Ended { was_stopped: true, output, .. }) => (Outcome::Cancelled, output),
        // The command's own message says which participants could not be done.
        Ok(Ended { code: Some(1), output, .. }) if !output.is_empty() && !pages.is_empty() => (Outcome::Partly, output),
        Ok(Ended { output, .. }) => (Outcome::Failed, output),
        Err(failure) => {
            messages.push(failure.to_string());
            (Outcome::Failed, String::new())
        }
    };
    live.change(|state| {
        if let Some(step) = state.ledger.steps.iter_mut().find(|step| step.id == planned.step.id) {
            (step.outcome, step.said, step.pages, step.messages) = (outcome, said, pages, messages);
            if outcome.has_results() && ["personalize", "effect"].contains(&step.writer.as_str()) {
                step.models.extend(models(&folder, &step.folder, &state.study.participants));
            }
        }
        // Whoever walked elsewhere meanwhile stays there.
        if outcome.has_results() && state.ledger.current == planned.step.parent {
            state.ledger.current = planned.step.id;
        }
        state.job = None;
        if let Err(failure) = state.ledger.write(&live.settings.out)
            && let Some(step) = state.ledger.steps.last_mut()
        {
            step.messages.push(failure.to_string());
        }
    });
}

/// Copies the folder that the command goes on in.
fn copied(live: &Live, planned: &Planned) -> Result<(), Failure> {
    let Some(id) = planned.step.copy_of else { return Ok(()) };
    let from = live.state().ledger.step(id).map(|step| live.settings.out.join(&step.folder));
    let Some(from) = from else { return Ok(()) };
    let to = OutputFolder::create(&live.settings.out.join(&planned.step.folder), &[])?;
    let mut folders = vec![PathBuf::new()];
    while let Some(inside) = folders.pop() {
        let unreadable =
            |e: std::io::Error| Diagnostic::error(format!("cannot be read: {e}")).in_file(&from.join(&inside));
        for entry in std::fs::read_dir(from.join(&inside)).map_err(unreadable)? {
            let entry = entry.map_err(unreadable)?;
            let (kind, name) = (entry.file_type().map_err(unreadable)?, inside.join(entry.file_name()));
            if kind.is_dir() {
                folders.push(name);
            } else if kind.is_file() {
                let bytes = carpus_numerics::regular_file::read(&entry.path()).map_err(unreadable)?;
                to.put(&name, &bytes)?;
            }
        }
    }
    Ok(())
}

/// Pages of a step: of the study, then of each participant.
fn pages(folder: &Path, name: &str) -> Vec<String> {
    let listed = |inside: &Path| {
        let entries = std::fs::read_dir(folder.join(inside)).into_iter().flatten().flatten();
        let mut names: Vec<PathBuf> = entries.map(|entry| inside.join(entry.file_name())).collect();
        names.sort();
        names
    };
    let top = listed(Path::new(""));
    let below = top.iter().filter(|path| folder.join(path).is_dir()).flat_map(|path| listed(path));
    let files: Vec<PathBuf> = top.iter().cloned().chain(below).collect();
    let is_page = |path: &&PathBuf| path.extension().is_some_and(|e| e == "html") && folder.join(path).is_file();
    files.iter().filter(is_page).map(|path| format!("{name}/{}", with_slashes(path))).collect()
}

/// Models that a command wrote, by participant.
fn models(folder: &Path, name: &str, participants: &[String]) -> BTreeMap<String, StepModel> {
    let model = |participant: &String| {
        let is_there = |file: &str| folder.join(participant).join(file).is_file();
        let path = |file: &str| format!("{name}/{participant}/{file}");
        let effects = is_there("effects.toml").then(|| path("effects.toml"));
        is_there("model.osim").then(|| (participant.clone(), StepModel { model: path("model.osim"), effects }))
    };
    participants.iter().filter_map(model).collect()
}

fn with_slashes(path: &Path) -> String {
    path.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}
