//! What commands about a study have in common: open it, take the folder of the results, go through the participants.

use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};

use super::args::{Global, StudyArgs};
use super::failure::{self, Diagnostic, Failure};
use super::{print_result, provenance};
use carpus_session::loading::{LoadedParticipant, Purpose};
use carpus_session::output::OutputFolder;
use carpus_session::participant::StudyParticipant;
use carpus_session::study::{Opening, Study};
use carpus_study::study::Participant;

/// A study that was opened, and the folder that its results go to.
#[derive(Debug)]
pub struct StudyRun {
    /// The study.
    pub study: Study,
    /// Where results go.
    pub out: OutputFolder,
}

/// What came of a run over all participants.
pub struct Outcomes<T> {
    /// Of the participants that could be done, in the study's order.
    pub done: Vec<T>,
    /// Why the others could not.
    failed: Vec<Diagnostic>,
}

impl<T> Outcomes<T> {
    /// What was done, and why the rest could not be.
    pub fn into_parts(self) -> (Vec<T>, Vec<Diagnostic>) {
        (self.done, self.failed)
    }

    /// Closes the output folder, prints the result of those that could be done, then fails with the reasons of those that could
    /// not.
    ///
    /// - `command`: its name
    ///
    /// # Errors
    /// The disk; writing to stdout; any participant that could not be done.
    pub fn print(self, study: &StudyRun, command: &str, text: &str) -> Result<(), Failure> {
        study.close(command)?;
        print_result(text)?;
        if self.failed.is_empty() { Ok(()) } else { Err(Failure::Input(self.failed)) }
    }
}

impl StudyRun {
    /// Does the work for every participant; one that cannot be done does not keep the others from being done.
    ///
    /// # Errors
    /// A fault of this program; no participant that could be done.
    pub fn each<T>(&self, mut work: impl FnMut(&Participant) -> Result<T, Failure>) -> Result<Outcomes<T>, Failure> {
        self.each_of(|participant| work(participant.about()))
    }

    /// As [`StudyRun::each`], of participants of the open study.
    ///
    /// # Errors
    /// As there.
    pub fn each_of<'s, T>(
        &'s self,
        mut work: impl FnMut(StudyParticipant<'s>) -> Result<T, Failure>,
    ) -> Result<Outcomes<T>, Failure> {
        let mut outcomes = Outcomes { done: Vec::new(), failed: Vec::new() };
        for participant in self.study.participants() {
            failure::about(&participant.about().name);
            match work(participant) {
                Ok(done) => outcomes.done.push(done),
                Err(Failure::Input(messages)) => outcomes.failed.extend(messages),
                Err(other) => return Err(other),
            }
        }
        failure::account();
        if outcomes.done.is_empty() && !outcomes.failed.is_empty() {
            return Err(Failure::Input(outcomes.failed));
        }
        Ok(outcomes)
    }

    /// Ends the work in the output folder: what an earlier run of the command left there goes, and is said.
    ///
    /// # Errors
    /// The disk.
    pub fn close(&self, command: &str) -> Result<(), Failure> {
        failure::print(&self.out.close(command, &self.study.others())?);
        Ok(())
    }

    /// Reads the study's tables and makes the output folder.
    ///
    /// - `command`: the command whose results come into the folder
    ///
    /// # Errors
    /// The study; an unknown participant; the output folder.
    pub fn prepare(args: &StudyArgs, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_for(args, opening(args), None, command)
    }

    /// As [`StudyRun::prepare`]; the model has the effects of a side-car.
    ///
    /// # Errors
    /// The study; the side-car; an unknown participant; the output folder.
    pub fn prepare_with(args: &StudyArgs, effects: Option<&Path>, command: &str) -> Result<StudyRun, Failure> {
        let opening = Opening { effects: effects.map(Path::to_owned), ..opening(args) };
        StudyRun::prepare_for(args, opening, None, command)
    }

    /// As [`StudyRun::prepare`], of a study that was made of another, whose results these are.
    ///
    /// # Errors
    /// As there.
    pub fn prepare_processed(args: &StudyArgs, of: &Study, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::prepare_for(args, opening(args), Some(of), command)
    }

    fn prepare_for(args: &StudyArgs, opening: Opening, of: Option<&Study>, command: &str) -> Result<StudyRun, Failure> {
        let study = Study::open_with(&args.study, opening)?;
        let out = study.output_folder_of(of.unwrap_or(&study), &args.out, command)?;
        Ok(StudyRun { study, out })
    }

    /// The same study, with models scaled to the participants where `[scaling]` says how.
    pub fn scaling_models(self) -> StudyRun {
        StudyRun { study: self.study.scaling_models(), ..self }
    }

    /// Participants asked for.
    pub fn participants(&self) -> &[Participant] {
        self.study.chosen()
    }

    /// A participant's model and trials.
    ///
    /// # Errors
    /// The model, the trials, or one does not suit the other.
    pub fn participant(&self, participant: &Participant) -> Result<LoadedParticipant, Failure> {
        self.study.load(participant, Purpose::Simulation)
    }
}

fn opening(args: &StudyArgs) -> Opening {
    Opening {
        participants: args.participant.clone(),
        model: args.model.clone(),
        allow_unsupported: args.allow_unsupported,
        command: Some(provenance::command_line()),
        ..Opening::default()
    }
}

/// A progress bar on stderr; nothing where stderr is no terminal or silence was asked for.
pub fn progress(global: &Global, steps: u64, what: &str) -> ProgressBar {
    if global.quiet || global.json {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(steps).with_message(what.to_string());
    if let Ok(style) = ProgressStyle::with_template("{msg:<28} {wide_bar} {pos}/{len} {elapsed}") {
        bar.set_style(style);
    }
    bar
}
