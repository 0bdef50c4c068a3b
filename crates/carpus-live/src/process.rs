//! A command as a process: how far it is, what it says, and how it is stopped.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use carpus_session::diagnostic::Failure;
use carpus_session::progress_lines::{Tick, VARIABLE};

use crate::settings::Program;

/// How often it is looked whether a command has ended or is to stop.
const LOOK: Duration = Duration::from_millis(30);

/// Time that a step has to stop by itself, before its next piece of work; then it is ended. Files are written whole or
/// not at all in any case.
pub(crate) const GRACE: Duration = Duration::from_secs(3);

/// The variable with the number of threads of a command, which is not to stand in its words.
const THREADS: &str = "RAYON_NUM_THREADS";

/// What a process says while it works.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Line {
    /// How far it is.
    Tick(Tick),
    /// A line of a message for people.
    Message(String),
}

/// A process that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Ended {
    /// Exit code; `None`: it was ended from outside.
    pub code: Option<i32>,
    /// Standard output.
    pub output: String,
    /// Whether it was asked to stop.
    pub was_stopped: bool,
}

/// Runs a command of the program and waits for its end.
///
/// - `stop`: becomes true when it is to stop
/// - `grace`: time that it has to stop by itself
/// - `tell`: is told what the command says on the way
///
/// # Errors
/// The program cannot be started.
pub(crate) fn run(
    program: &Program,
    words: &[impl AsRef<OsStr>],
    stop: &AtomicBool,
    grace: Duration,
    tell: impl Fn(Line) + Sync,
) -> Result<Ended, Failure> {
    let internal = |e: std::io::Error| Failure::Internal(format!("{}: {e}", program.file.display()));
    let mut command = Command::new(&program.file);
    command.args(words).env(VARIABLE, "1").env("NO_COLOR", "1");
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    if let Some(threads) = program.threads {
        command.env(THREADS, threads.to_string());
    }
    by_itself(&mut command);
    let mut child = command.spawn().map_err(internal)?;
    let (mut input, output, errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    std::thread::scope(|scope| {
        let said = scope.spawn(|| {
            let mut bytes = Vec::new();
            // What a process that was ended left unsaid is not there.
            let _ = output.map(|mut output| output.read_to_end(&mut bytes));
            String::from_utf8_lossy(&bytes).into_owned()
        });
        scope.spawn(|| {
            for line in
                errors.map(BufReader::new).into_iter().flat_map(|errors| errors.split(b'\n').map_while(Result::ok))
            {
                let line = String::from_utf8_lossy(&line).trim_end_matches('\r').to_owned();
                tell(Tick::of_line(&line).map_or(Line::Message(line), Line::Tick));
            }
        });
        let mut asked: Option<Instant> = None;
        let status = loop {
            match child.try_wait() {
                Ok(Some(status)) => break Ok(status),
                Ok(None) => {}
                Err(e) => break Err(internal(e)),
            }
            if asked.is_none() && stop.load(Ordering::Relaxed) {
                asked = Some(Instant::now());
                input = None;
            }
            if asked.is_some_and(|asked| asked.elapsed() > grace) {
                // It may have ended this moment.
                let _ = child.kill();
            }
            std::thread::sleep(LOOK);
        };
        drop(input);
        let output = said.join().unwrap_or_default();
        Ok(Ended { code: status?.code(), output, was_stopped: asked.is_some() })
    })
}

/// Ctrl-C in the terminal is for the server, which then stops the command.
#[cfg(unix)]
fn by_itself(command: &mut Command) {
    std::os::unix::process::CommandExt::process_group(command, 0);
}

/// Ctrl-C in the terminal is for the server, which then stops the command.
#[cfg(windows)]
fn by_itself(command: &mut Command) {
    /// CREATE_NEW_PROCESS_GROUP of the system's interface.
    const NEW_PROCESS_GROUP: u32 = 0x200;
    std::os::windows::process::CommandExt::creation_flags(command, NEW_PROCESS_GROUP);
}

/// Systems without groups of processes.
#[cfg(not(any(unix, windows)))]
fn by_itself(_command: &mut Command) {}
