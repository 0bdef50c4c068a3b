//! What commands about a study have in common: open it, take the folder of the results, go through the participants.

use std::path::Path;

use super::args::StudyArgs;
use super::bars::Bars;
use super::failure::{self, Diagnostic, Failure};
use super::{print_result, provenance};
use carpus_session::outcomes::Outcomes;
use carpus_session::output::OutputFolder;
use carpus_session::participant::StudyParticipant;
use carpus_session::study::{Opening, Study};

/// A study that was opened, and the folder that its results go to.
#[derive(Debug)]
pub struct StudyRun {
    /// The study.
    pub study: Study,
    /// Where results go.
    pub out: OutputFolder,
}

impl StudyRun {
    /// Reads the study's tables and makes the output folder.
    ///
    /// - `command`: the command whose results come into the folder
    ///
    /// # Errors
    /// The study; an unknown participant; the output folder.
    pub fn prepare(args: &StudyArgs, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_with(args, None, command)
    }

    /// As [`StudyRun::prepare`]; the model has the effects of a side-car.
    ///
    /// # Errors
    /// The study; the side-car; an unknown participant; the output folder.
    pub fn prepare_with(args: &StudyArgs, effects: Option<&Path>, command: &str) -> Result<StudyRun, Failure> {
        let study = Study::open_with(&args.study, opening(args, effects))?;
        let out = study.output_folder(&args.out, command)?;
        Ok(StudyRun { study, out })
    }

    /// Does the work for every participant; one that cannot be done does not keep the others from being done.
    ///
    /// - `what`: is done, for the bar
    ///
    /// # Errors
    /// A fault of this program; no participant that could be done.
    pub fn each<'s, T>(
        &'s self,
        what: &str,
        bars: &Bars,
        work: impl FnMut(StudyParticipant<'s>) -> Result<T, Failure>,
    ) -> Result<Outcomes<T>, Failure> {
        self.study.each(what, bars, work)
    }

    /// Closes the output folder, prints the result of those participants that could be done, then fails with the
    /// reasons of those that could not.
    ///
    /// - `command`: its name
    ///
    /// # Errors
    /// The disk; writing to stdout; any participant that could not be done.
    pub fn print(&self, command: &str, text: &str, failed: Vec<Diagnostic>) -> Result<(), Failure> {
        self.close(command)?;
        print_result(text)?;
        if failed.is_empty() { Ok(()) } else { Err(Failure::Input(failed)) }
    }

    /// Ends the work in the output folder: what an earlier run of the command left there goes, and is said.
    ///
    /// # Errors
    /// The disk.
    pub fn close(&self, command: &str) -> Result<(), Failure> {
        failure::print(&self.out.close(command, &self.study.others())?);
        Ok(())
    }
}

/// How a command opens a study.
pub fn opening(args: &StudyArgs, effects: Option<&Path>) -> Opening {
    Opening {
        participants: args.participant.clone(),
        model: args.model.clone(),
        effects: effects.map(Path::to_owned),
        allow_unsupported: args.allow_unsupported,
        command: Some(provenance::command_line()),
        ..Opening::default()
    }
}
