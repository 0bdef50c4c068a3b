//! `carpus merge`: the command that tasks were parts of, in the folder that they share.

use std::ffi::OsString;

use clap::FromArgMatches;

use crate::args::{Cli, Command, Global, MergeArgs};
use crate::commands::{diagnose, study};
use crate::failure::{Diagnostic, Failure};
use crate::{help, provenance};
use carpus_session::shared_work::SharedWork;

/// Runs the command.
///
/// # Errors
/// The folder holds no tasks, or tasks of different commands; whatever the command itself fails of.
pub fn run(args: &MergeArgs, global: &Global) -> Result<(), Failure> {
    let shared = SharedWork::of(&args.folder)?;
    let none = || {
        let hint = "run parts first: carpus study STUDY --out DIR --task I/N, or carpus diagnose in its place";
        Failure::from(Diagnostic::error("no tasks share this folder").in_file(&args.folder).hint(hint))
    };
    let record = shared.asked(&args.folder)?.ok_or_else(none)?;
    let words: Vec<OsString> =
        std::iter::once("carpus").chain(record.arguments.iter().map(String::as_str)).map(OsString::from).collect();
    let unreadable = |why: String| {
        let text = format!("what its tasks were asked is not understood: {why}");
        Failure::from(Diagnostic::error(text).in_file(&args.folder).hint("run the study without --task instead"))
    };
    let parsed = help::command().try_get_matches_from(&words).and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = parsed.map_err(|e| unreadable(e.to_string()))?;
    // Paths are relative to where the tasks began.
    if std::env::current_dir().ok().as_deref() != Some(record.directory.as_path()) {
        std::env::set_current_dir(&record.directory).map_err(|e| {
            let text = format!("the folder in which the tasks began cannot be entered: {e}");
            Failure::from(Diagnostic::error(text).in_file(&record.directory))
        })?;
    }
    provenance::set_words(words);
    let global = Global { seed: cli.global.seed, ..*global };
    match cli.command {
        Command::Study(asked) => study::run(&asked, &global),
        Command::Diagnose(asked) => diagnose::run(&asked, &global),
        _ => Err(unreadable("it is no command with tasks".to_owned())),
    }
}
