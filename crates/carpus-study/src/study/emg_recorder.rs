//! `[emg_recorder]` of `study.toml`: EMG from a recorder of its own, and how its clock is set by the dynamometer's.
//!
//! In: a trial's file of the dynamometer and one of the EMG. Out: the EMG's samples at their own rate, with their times
//! on the dynamometer's clock.

use std::path::{Path, PathBuf};

use super::column_settings::column;
use super::columns::{Columns, Conversion};
use super::fault::Fault;
use super::problem::{Problem, StudyErrors};
use super::processing::recording::Recorded;
use super::table::named_file;
use super::toml_section::{Sections, TomlSection};
use super::trial_list::TrialInfo;
use crate::dynamometer::{Alignment, AlignmentError, align};
use carpus_numerics::plausible::Measured;

/// Largest delay that is looked for \[s\]: two people start two recorders within ten minutes. Each delay takes a pass
/// over the recordings.
const LONGEST_DELAY: f64 = 600.0;

/// A recorder that holds the EMG, in files of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct EmgRecorder {
    /// Its file beside a trial's: `{trial}` stands for the name of the trial's file without extension. `None`: every
    /// row of `trials.csv` names it in `emg_file`.
    pub file: Option<String>,
    /// The table in its files, by title or number; `None`: the one that has the channels.
    pub table: Option<String>,
    /// Its time column \[s\]; `None`: the column of time at or before the first channel that is read.
    pub time: Option<String>,
    /// How its numbers become seconds.
    pub time_conversion: Conversion,
    /// How its clock is set.
    pub clock: EmgClock,
}

/// How the clock of the EMG's recorder is set by the dynamometer's.
#[derive(Clone, Debug, PartialEq)]
pub enum EmgClock {
    /// A known delay; 0 where one trigger starts both.
    Delay {
        /// What is added to its clock \[s\].
        seconds: f64,
    },
    /// By a quantity that both recorded.
    Shared {
        /// Its column of the quantity, in any unit, of the same sign.
        shared: String,
        /// The dynamometer's column of it.
        shared_with: String,
        /// Largest delay looked for \[s\].
        max_delay: f64,
    },
}

/// EMG of a recorder of its own, on the dynamometer's clock.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RecordedEmg {
    /// The file.
    pub file: PathBuf,
    /// The columns of EMG, each once, with their times on the dynamometer's clock \[s\].
    pub recorded: Recorded,
    /// How the clock was set by a shared quantity; `None` by a known delay.
    pub alignment: Option<Alignment>,
}

/// Why EMG of another recorder cannot be used.
#[derive(Clone, Debug, thiserror::Error)]
pub(crate) enum EmgRecorderError {
    /// The files cannot be read.
    #[error(transparent)]
    Study(#[from] StudyErrors),
    /// The clocks cannot be aligned.
    #[error("{file}: {error}")]
    Alignment {
        /// The EMG's file.
        file: String,
        /// Why.
        error: AlignmentError,
    },
}

/// Reads `[emg_recorder]`.
pub(crate) fn settings(sections: &Sections<'_>, problems: &mut Vec<Problem>) -> Option<EmgRecorder> {
    let mut section = sections.section("emg_recorder");
    if section.is_empty() {
        section.finish(problems);
        return None;
    }
    let file = section.optional_string("file");
    if file.as_ref().is_some_and(|file| !file.contains("{trial}")) {
        section.bad_value("file", "a name that contains {trial}", "a name that is the same for every trial");
    }
    let time = column(&mut section, "time", Measured::Time);
    let time_conversion = time.as_ref().map(|(_, read)| read.conversion).unwrap_or_default();
    let table = section.optional_string("table");
    let clock = clock(&mut section);
    section.finish(problems);
    Some(EmgRecorder { file, table, time: time.map(|(name, _)| name), time_conversion, clock: clock? })
}

fn clock(section: &mut TomlSection<'_>) -> Option<EmgClock> {
    let expected = "a number of seconds, at most 600 in size";
    let delay = section.optional_number("delay_s", expected, |v| v.abs() <= LONGEST_DELAY);
    let expected = "a number of seconds above 0, at most 600";
    let max_delay = section.optional_number("max_delay_s", expected, |v| v > 0.0 && v <= LONGEST_DELAY);
    let shared = section.optional_string("shared");
    let shared_with = section.optional_string("shared_with");
    match (shared, shared_with) {
        (None, None) => Some(EmgClock::Delay { seconds: delay.unwrap_or(0.0) }),
        (Some(_), Some(_)) if delay.is_some() => {
            section.bad_value("delay_s", "either a known delay or a shared quantity", "both");
            None
        }
        (Some(shared), Some(shared_with)) => {
            Some(EmgClock::Shared { shared, shared_with, max_delay: max_delay.unwrap_or(2.0) })
        }
        (shared, _) => {
            let (key, meaning) = match shared {
                Some(_) => ("shared_with", "the trial's column of the quantity that both recorded"),
                None => ("shared", "its column of the quantity that both recorded"),
            };
            section.required_string(key, meaning)?;
            None
        }
    }
}

impl EmgRecorder {
    /// The file of a trial's EMG.
    pub fn file_of(&self, info: &TrialInfo) -> Option<PathBuf> {
        if let Some(file) = &info.emg_file {
            return Some(file.clone());
        }
        let stem = info.file.file_stem().unwrap_or_default().to_string_lossy();
        let beside = info.file.parent().unwrap_or(Path::new(""));
        self.file.as_ref().map(|file| named_file(beside, &file.replace("{trial}", &stem)))
    }

    /// The column of the trial's file that the clock is set by.
    pub fn shared_with(&self) -> Option<&str> {
        match &self.clock {
            EmgClock::Shared { shared_with, .. } => Some(shared_with),
            EmgClock::Delay { .. } => None,
        }
    }

    /// Reads the EMG of a trial and sets its clock.
    ///
    /// - `signal`: time \[s\] and samples of the dynamometer's column that both recorded; empty without one
    pub(crate) fn read(
        &self,
        info: &TrialInfo,
        columns: &Columns,
        named_at: &str,
        signal: (&[f64], &[f64]),
    ) -> Result<RecordedEmg, EmgRecorderError> {
        let Some(file) = self.file_of(info) else {
            let fault = Fault::MissingEmgFile;
            let trials_file = named_at.rsplit_once(':').map_or(named_at, |(file, _)| file);
            let errors = vec![Problem::error(Path::new(trials_file), info.line, fault)];
            return Err(StudyErrors { errors, ..StudyErrors::default() }.into());
        };
        let mut required: Vec<&str> = columns.emg.iter().map(String::as_str).collect();
        if let EmgClock::Shared { shared, .. } = &self.clock {
            required.push(shared);
        }
        let table = info.emg_table.as_deref().or(self.table.as_deref());
        let recorded = Recorded::read(&file, table, Some(named_at), self.time.as_deref(), &required, &[])?;
        let mut recorded = recorded.in_seconds(self.time_conversion, &file)?;
        let (shift, alignment) = match &self.clock {
            EmgClock::Delay { seconds } => (*seconds, None),
            EmgClock::Shared { shared, max_delay, .. } => {
                let theirs = recorded.column(shared).unwrap_or_default();
                let found = align(signal, (&recorded.time, theirs), *max_delay);
                let failed = |error| EmgRecorderError::Alignment { file: file.display().to_string(), error };
                let found = found.map_err(failed)?;
                (found.shift, Some(found))
            }
        };
        recorded.time.iter_mut().for_each(|t| *t += shift);
        recorded.columns.retain(|(name, _)| columns.emg.contains(name));
        Ok(RecordedEmg { file, recorded, alignment })
    }
}
