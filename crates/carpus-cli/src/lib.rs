//! Command line: one file per command. The only module that prints.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 done, 1 the input (arguments, model, study, disk) is at
//! fault, 2 carpus is at fault.

mod args;
mod bars;
mod book;
mod commands;
mod failure;
mod help;
mod next_steps;
mod own_effects;
mod provenance;
mod stdout;
mod study_run;
mod table;

use std::ffi::OsString;
use std::io::Write;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::FromArgMatches;
use clap::error::ErrorKind;

use args::{Cli, Command, Global};
use failure::{Diagnostic, Failure};

/// Exit code for faults of the input.
const INPUT_FAULT: u8 = 1;
/// Exit code for faults of this program.
const OWN_FAULT: u8 = 2;

/// Runs the command that the process was started with.
pub fn main() -> ExitCode {
    ExitCode::from(run_caught())
}

/// Runs a command in a process that was started with other words, as Python's interpreter is; once in a process.
/// Returns the exit code.
///
/// - `words`: the name of the program, then its arguments
pub fn run_words(words: Vec<OsString>) -> u8 {
    provenance::set_words(words);
    run_caught()
}

fn run_caught() -> u8 {
    std::panic::set_hook(Box::new(report_panic));
    catch_unwind(AssertUnwindSafe(run)).unwrap_or(OWN_FAULT)
}

fn run() -> u8 {
    let matches = help::command().try_get_matches_from(provenance::words());
    let parsed = matches.and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = match parsed {
        Ok(cli) => cli,
        Err(error) => {
            let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            let printed = error.print().and_then(|()| std::io::stdout().flush());
            // A reader that has read enough is no fault; a full disk is one.
            let lost = printed.err().filter(|e| asked && e.kind() != std::io::ErrorKind::BrokenPipe);
            if let Some(e) = &lost {
                failure::say(&format!("error: cannot write to standard output: {e}"));
            }
            return if asked && lost.is_none() { 0 } else { INPUT_FAULT };
        }
    };
    match start_threads(&cli.global).and_then(|()| execute(&cli)) {
        Ok(()) => 0,
        Err(Failure::Input(messages)) => {
            failure::print(&messages);
            INPUT_FAULT
        }
        Err(Failure::Cancelled) => {
            failure::say(&Failure::Cancelled.to_string());
            INPUT_FAULT
        }
        Err(Failure::Internal(what)) => {
            failure::say(&defect(&what));
            OWN_FAULT
        }
    }
}

fn execute(cli: &Cli) -> Result<(), Failure> {
    let global = &cli.global;
    own_effects::register_those_of(&cli.command)?;
    match &cli.command {
        Command::Demo(args) => commands::demo::run(args, global),
        Command::Init(args) => commands::init::run(args, global),
        Command::Check(args) => commands::check::run(args, global),
        Command::Info(args) => commands::info::run(args, global),
        Command::Audit(args) => commands::audit::run(args, global),
        Command::Paths(args) => commands::paths::run(args, global),
        Command::View(args) => commands::view::run(args, global),
        Command::Equilibrium(args) => commands::equilibrium::run(args, global),
        Command::Simulate(args) => commands::simulate::run(args, global),
        Command::Compare(args) => commands::compare::run(args, global),
        Command::Diagnose(args) => commands::diagnose::run(args, global),
        Command::Identify(args) => commands::identify::run(args, global),
        Command::Groups(args) => commands::groups::run(args, global),
        Command::Priors(args) => commands::priors::run(args, global),
        Command::Ultrasound(args) => commands::ultrasound::run(args, global),
        Command::Sensitivity(args) => commands::sensitivity::run(args, global),
        Command::Emg(args) => commands::emg::run(args, global),
        Command::Dynamometer(args) => commands::dynamometer::run(args, global),
        Command::DynamometerDrag(args) => commands::dynamometer_drag::run(args, global),
        Command::Scale(args) => commands::scale::run(args, global),
        Command::RunTool(args) => commands::run_tool::run(args, global),
        Command::StrengthScale(args) => commands::strength_scale::run(args, global),
        Command::Power(args) => commands::power::run(args, global),
        Command::C3d(args) => commands::c3d::run(args, global),
        Command::Upgrade(args) => commands::upgrade::run(args, global),
        Command::Effects(args) => commands::effects::run(args, global),
        Command::Evaluate(args) => commands::evaluate::run(args, global),
        Command::Study(args) => commands::study::run(args, global),
        #[cfg(feature = "live")]
        Command::Live(args) => commands::live::run(args, global),
        Command::Units(args) => commands::units::run(args, global),
        Command::Merge(args) => commands::merge::run(args, global),
        Command::Effect(args) => commands::effect::run(args, global),
        Command::Plan(args) => commands::plan::run(args, global),
        Command::Synth(args) => commands::synth::run(args, global),
        Command::Personalize(args) => commands::personalize::run(args, global),
        Command::Completions(args) => commands::completions::run(args),
        Command::Man(args) => commands::man::run(args),
        Command::Book(args) => commands::book::run(args),
    }
}

/// The variable by which the number of threads is set where `--threads` is not given.
const THREADS_VARIABLE: &str = "RAYON_NUM_THREADS";

/// Starts as many threads as are asked for, or as there are cores. More would only take memory and turns.
fn start_threads(global: &Global) -> Result<(), Failure> {
    let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let of_variable = || std::env::var(THREADS_VARIABLE).ok()?.parse().ok().filter(|n| *n > 0);
    let (asked, by) = match global.threads {
        Some(threads) => (threads.get(), "--threads"),
        None => (of_variable().unwrap_or(cores), THREADS_VARIABLE),
    };
    let threads = asked.min(cores);
    if threads < asked {
        let text = format!("{by} {asked}: there are {cores} cores; {threads} threads are started");
        failure::print(&[Diagnostic::warning(text)]);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build_global().map_err(|e| Failure::Internal(format!("cannot start {threads} threads: {e}")))
}

/// What is said about a fault of this program.
fn defect(what: &str) -> String {
    let command = provenance::command_line();
    format!(
        "internal error: {what}\n  This is a defect of carpus {}, not of your files. Please report it with the \
         command:\n  {command}",
        env!("CARGO_PKG_VERSION")
    )
}

fn report_panic(panic: &std::panic::PanicHookInfo<'_>) {
    let payload = panic.payload();
    let text = payload
        .downcast_ref::<&str>()
        .map(|s| (*s).to_string())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_string());
    let at = panic.location().map(|l| format!(" ({}:{})", l.file(), l.line())).unwrap_or_default();
    failure::say(&defect(&format!("{text}{at}")));
}
