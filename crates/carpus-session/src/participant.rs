//! One participant of an open study: who it is, and a session with the model and the trials in memory.

use std::fmt;
use std::path::Path;

use super::diagnostic::{Diagnostic, Failure};
use super::loading::{LoadedParticipant, Purpose};
use super::output::OutputFolder;
use super::progress::{Progress, Silent, go_on};
use super::study::Study;
use carpus_study::study::Participant;

impl Study {
    /// The participants that are asked for; their models and trials are read by [`StudyParticipant::load`].
    pub fn participants(&self) -> impl Iterator<Item = StudyParticipant<'_>> {
        self.chosen().iter().map(|participant| StudyParticipant { study: self, participant })
    }
}

/// A participant of an open study.
#[derive(Clone, Copy, Debug)]
pub struct StudyParticipant<'s> {
    study: &'s Study,
    participant: &'s Participant,
}

impl<'s> StudyParticipant<'s> {
    /// What `participants.csv` says.
    pub fn about(&self) -> &'s Participant {
        self.participant
    }

    /// Reads the model and the trials, with all checks that a command makes.
    ///
    /// # Errors
    /// The model, one of its components that matters and is not supported among its faults; the trials; or one does not
    /// suit the other.
    pub fn load(&self) -> Result<Session<'s>, Failure> {
        self.load_for(Purpose::Simulation)
    }

    /// As [`StudyParticipant::load`]; what the purpose asks for is done once, at the beginning.
    ///
    /// # Errors
    /// As there; trials that are too long for the purpose.
    pub fn load_for(&self, purpose: Purpose) -> Result<Session<'s>, Failure> {
        let data = self.study.load(self.participant, purpose)?;
        Ok(Session { study: self.study, data, purpose, progress: &Silent })
    }
}

/// A participant's model and trials in memory. Each use case is a method that takes a request and gives a result.
pub struct Session<'s> {
    /// The study.
    pub study: &'s Study,
    /// Model, trials, and warnings that a person should read before trusting results.
    pub data: LoadedParticipant,
    purpose: Purpose,
    progress: &'s dyn Progress,
}

impl fmt::Debug for Session<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (participant, trials) = (&self.data.participant.name, self.data.trials.len());
        f.debug_struct("Session").field("participant", participant).field("trials", &trials).finish_non_exhaustive()
    }
}

impl<'s> Session<'s> {
    /// The same session; work tells `progress` how far it is.
    pub fn with_progress(self, progress: &'s dyn Progress) -> Session<'s> {
        Session { progress, ..self }
    }

    /// Who is told how far work is.
    ///
    /// # Errors
    /// Work is to stop.
    pub(super) fn progress(&self) -> Result<&'s dyn Progress, Failure> {
        go_on(self.progress)?;
        Ok(self.progress)
    }

    /// The same participant, read for a purpose; `None` where that was done.
    ///
    /// # Errors
    /// Trials that are too long for the purpose.
    pub(super) fn read_for(&self, purpose: Purpose) -> Result<Option<Session<'s>>, Failure> {
        if self.purpose == purpose {
            return Ok(None);
        }
        let data = self.study.load(&self.data.participant, purpose)?;
        Ok(Some(Session { study: self.study, data, purpose, progress: self.progress }))
    }

    /// The same participant with the trials as fits see them; `None` where that was done.
    ///
    /// # Errors
    /// Trials that are too long for fits.
    pub(super) fn read_for_fits(&self) -> Result<Option<Session<'s>>, Failure> {
        match self.purpose {
            Purpose::Simulation => self.read_for(Purpose::Identification),
            Purpose::Identification | Purpose::Diagnosis => Ok(None),
        }
    }

    /// Writes results of this participant into a folder of results, as the command does for `--participant`. Returns
    /// what a person should know about files of earlier runs.
    ///
    /// - `command`: the command that makes such results
    /// - `write`: writes them into the participant's folder, whose path in the folder of results it is given
    ///
    /// # Errors
    /// The folder cannot be written to, or holds what is not of the study and the command.
    pub fn write_results(
        &self,
        path: &Path,
        command: &str,
        write: impl FnOnce(&OutputFolder, &Path) -> Result<(), Failure>,
    ) -> Result<Vec<Diagnostic>, Failure> {
        let name = self.data.participant.name.as_str();
        let out = self.study.output_folder(path, command)?;
        write(&out, Path::new(name))?;
        let all = self.study.tables.participants.iter().map(|p| p.name.as_str());
        out.close(command, &all.filter(|other| *other != name).collect::<Vec<_>>())
    }
}
