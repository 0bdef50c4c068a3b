//! Files of the study: looked at now and then, checked when they change.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde_json::Value;

use carpus_study::study::Study;

use crate::process::{self, Line};
use crate::state::{EffectName, Live};

/// How often files are looked at.
const LOOK: Duration = Duration::from_millis(500);
/// How often it is looked whether the server ends.
const NAP: Duration = Duration::from_millis(50);

/// A file as far as a look tells: when it was changed, and how long it is; `None`: not there.
type Seen = Vec<(PathBuf, Option<(SystemTime, u64)>)>;

/// What the tables of a study name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Named {
    name: String,
    participants: Vec<String>,
    own_effects: Vec<PathBuf>,
    files: Vec<PathBuf>,
}

/// Checks the study, and again whenever one of its files has changed, until the server ends.
pub(crate) fn watch(live: &Live) {
    let mut named = Named::default();
    let mut seen = Seen::new();
    while !live.is_ended() {
        let now = look(&live.settings.study, &named);
        if now != seen || live.state().study.checks == 0 {
            named = read(&live.settings.study).unwrap_or(named);
            // Files that the tables have come to name are looked at before the check reads them.
            seen = look(&live.settings.study, &named);
            check(live, &named);
        }
        let mut napped = Duration::ZERO;
        while napped < LOOK && !live.is_ended() {
            std::thread::sleep(NAP);
            napped += NAP;
        }
    }
}

/// What the tables name; `None`: they cannot be read.
fn read(study: &Path) -> Option<Named> {
    let own_effects = Study::settings_of(study).map(|(_, settings)| settings.own_effects).unwrap_or_default();
    let tables = Study::read_tables_for(study, |_| false).ok()?;
    let participants = tables.participants.iter().map(|p| p.name.clone()).collect();
    Some(Named { name: tables.settings.name.clone(), participants, own_effects, files: tables.input_files() })
}

/// The study's own tables and what they name.
fn look(study: &Path, named: &Named) -> Seen {
    let folder = if study.is_dir() { study } else { study.parent().unwrap_or(study) };
    let file = if study.is_dir() { study.join("study.toml") } else { study.to_owned() };
    let tables = ["participants.csv", "trials.csv", "ultrasound.csv"].map(|name| folder.join(name));
    let all = std::iter::once(file).chain(tables).chain(named.files.iter().chain(&named.own_effects).cloned());
    all.map(|path| {
        let data = path.metadata().ok();
        let at = data.and_then(|data| Some((data.modified().ok()?, data.len())));
        (path, at)
    })
    .collect()
}

/// Checks the study by the command, whose findings are what it prints.
fn check(live: &Live, named: &Named) {
    live.change(|state| {
        state.study.is_checking = true;
        state.study.name.clone_from(&named.name);
        state.study.participants.clone_from(&named.participants);
        state.study.own_effects = named.own_effects.iter().map(|file| file.display().to_string()).collect();
    });
    let checked = live.settings.study_word().map_err(|e| e.to_string()).and_then(|study| {
        let allow = live.settings.allow_unsupported.then_some("--allow-unsupported");
        let words = ["check", &study, "--json"].into_iter().chain(allow).collect::<Vec<_>>();
        json_of(live, &words)
    });
    let own: Vec<String> = live.state().study.own_effects.clone();
    let words = ["effects", "--json"].into_iter().map(str::to_owned);
    let words: Vec<String> = words.chain(own.into_iter().flat_map(|file| ["--own-effect".to_owned(), file])).collect();
    // Where an effect of the study's own is at fault, the check says so.
    let effects = json_of(live, &words).ok().map(|catalogue| names(&catalogue));
    live.change(|state| {
        state.study.is_checking = false;
        state.study.checks += 1;
        state.study.effects = effects.unwrap_or_else(|| std::mem::take(&mut state.study.effects));
        (state.study.check, state.study.fault) = match checked {
            Ok(found) => (Some(found), None),
            Err(fault) => (None, Some(fault)),
        };
    });
}

/// Effects of a catalogue, as `carpus effects --json` prints it.
fn names(catalogue: &Value) -> Vec<EffectName> {
    let text = |effect: &Value, key: &str| effect.get(key).and_then(Value::as_str).map(str::to_owned);
    let all = catalogue.get("effects").and_then(Value::as_array).into_iter().flatten();
    all.filter_map(|effect| Some(EffectName { id: text(effect, "id")?, name: text(effect, "name")? })).collect()
}

/// What a command prints as JSON; else its messages.
fn json_of(live: &Live, words: &[impl AsRef<std::ffi::OsStr>]) -> Result<Value, String> {
    let messages = std::sync::Mutex::new(String::new());
    let ended = process::run(&live.settings.program, words, live.ended(), Duration::ZERO, |line| {
        if let (Line::Message(text), Ok(mut messages)) = (line, messages.lock()) {
            messages.push_str(&(text + "\n"));
        }
    });
    let ended = ended.map_err(|failure| failure.to_string())?;
    serde_json::from_str(&ended.output).map_err(|_| messages.into_inner().unwrap_or_default().trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_file_that_changes_or_comes_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let trial = folder.path().join("trial.csv");
        std::fs::write(folder.path().join("study.toml"), "").unwrap();
        std::fs::write(&trial, "1\n").unwrap();
        let named = Named { files: vec![trial.clone()], ..Named::default() };
        let before = look(folder.path(), &named);
        assert_eq!(before, look(folder.path(), &named));
        std::fs::write(&trial, "1\n2\n").unwrap();
        let after = look(folder.path(), &named);
        assert_ne!(before, after);
        std::fs::write(folder.path().join("ultrasound.csv"), "").unwrap();
        assert_ne!(after, look(folder.path(), &named));
        std::fs::remove_file(&trial).unwrap();
        assert_ne!(after, look(folder.path(), &named));
    }
}
