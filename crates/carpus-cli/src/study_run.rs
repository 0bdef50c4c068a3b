//! What commands about a study have in common: open it, take the folder of the results, go through the participants.

use std::path::Path;

use super::args::{EffectsFile, Global, StudyArgs, StudyInput};
use super::bars::Bars;
use super::failure::{self, Diagnostic, Failure};
use super::provenance;
use super::stdout::print_result;
use carpus_session::json;
use carpus_session::loading::Purpose;
use carpus_session::outcomes::Outcomes;
use carpus_session::output::OutputFolder;
use carpus_session::participant::Session;
use carpus_session::study::{Opening, Study};
use carpus_session::task::TaskDone;

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
        StudyRun::opened(args, None, command)
    }

    /// As [`StudyRun::prepare`]; the model may have effects beside its file.
    ///
    /// # Errors
    /// As there; the file of the effects.
    pub fn prepare_with(args: &StudyArgs, effects: &EffectsFile, command: &str) -> Result<StudyRun, Failure> {
        StudyRun::opened(args, effects.file(), command)
    }

    fn opened(args: &StudyArgs, effects: Option<&Path>, command: &str) -> Result<StudyRun, Failure> {
        let study = Study::open_with(&args.input.study, opening(args, effects))?;
        let out = study.output_folder(&args.out, command)?;
        Ok(StudyRun { study, out })
    }

    /// Does the work for every participant, whose folder of results it is told; one that cannot be done does not keep
    /// the others from being done.
    ///
    /// - `what`: is done, for the bar
    /// - `purpose`: of the work
    ///
    /// # Errors
    /// A fault of this program; no participant that could be done.
    pub fn each<T>(
        &self,
        what: &str,
        purpose: Purpose,
        bars: &Bars,
        mut work: impl FnMut(&Session<'_>, &Path) -> Result<T, Failure>,
    ) -> Result<Outcomes<T>, Failure> {
        self.study.each(what, bars, |participant| {
            let session = participant.load_for(purpose)?.with_progress(bars);
            failure::print(&session.data.warnings);
            work(&session, Path::new(&participant.about().name))
        })
    }

    /// Where the report of a participant is.
    pub fn report_of(&self, participant: &str) -> String {
        self.out.path().join(participant).join("report.html").display().to_string()
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

/// Prints what came of a task, then fails with the reasons of what could not be done.
///
/// - `out`: the folder that the tasks share
///
/// # Errors
/// Writing to stdout; a unit that could not be done.
pub fn task_done(done: &TaskDone, out: &Path, global: &Global) -> Result<(), Failure> {
    let TaskDone { record, units_found_finished: found, units_computed: computed, failed } = done;
    if global.json {
        print_result(&json::line(record)?)?;
    } else {
        print_result(&format!(
            "task {}: {found} units were finished before, {computed} were computed\n\nwhen all tasks are done:\n  \
             carpus merge {}\n",
            record.task,
            out.display()
        ))?;
    }
    if failed.is_empty() { Ok(()) } else { Err(Failure::Input(failed.clone())) }
}

/// How a command opens a study.
pub fn opening(args: &StudyArgs, effects: Option<&Path>) -> Opening {
    Opening {
        effects: effects.map(Path::to_owned),
        command: Some(provenance::command_line()),
        ..reading(&args.input, args.allow_unsupported)
    }
}

/// What of a study is read.
pub fn reading(args: &StudyInput, allow_unsupported: bool) -> Opening {
    let (participants, model) = (args.participant.clone(), args.model.clone());
    Opening { participants, model, allow_unsupported, ..Opening::default() }
}
