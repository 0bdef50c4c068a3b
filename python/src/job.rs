//! Long work: on a thread of its own, while the caller's thread shows progress and looks for Ctrl-C.
//!
//! The caller's thread does not hold the interpreter's lock but for the moments in which it looks. Work that is to stop
//! does so when it next tells how far it is, or asks; the caller waits a moment for that, then leaves it alone: its
//! result is thrown away.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carpus::session::diagnostic::{Diagnostic, Failure};
use carpus::session::progress::Progress;
use pyo3::prelude::*;

use crate::effect;
use crate::failure::{OrRaise, diagnostic};

/// How often the caller's thread looks.
const LOOKS: Duration = Duration::from_millis(50);
/// How long work that is to stop is waited for.
const PATIENCE: Duration = Duration::from_secs(2);

/// What is unwound where work is to stop at a place that cannot return a failure.
struct Stopped;

/// What work tells, for whoever shows it.
#[derive(Default)]
struct Told {
    what: String,
    done: usize,
    steps: usize,
    changed: bool,
    warnings: Vec<Diagnostic>,
}

/// A piece of work, as the thread that waits for it sees it.
#[derive(Default)]
struct Job {
    told: Mutex<Told>,
    is_cancelled: AtomicBool,
}

thread_local! {
    /// The work of this thread. Threads that help it have none: what they tell is of the newest piece of work.
    static OWN: RefCell<Option<Arc<Job>>> = const { RefCell::new(None) };
}

/// Takes what work on a study tells to the thread that waits for it.
#[derive(Default)]
pub struct Relay {
    newest: Mutex<Arc<Job>>,
}

impl Relay {
    fn job(&self) -> Arc<Job> {
        OWN.with_borrow(Option::clone).unwrap_or_else(|| Arc::clone(&locked(&self.newest)))
    }
}

/// What a lock protects, whatever became of the thread that held it last: all of it is replaced as a whole.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Progress for Relay {
    fn at(&self, what: &str, done: usize, steps: usize) {
        let job = self.job();
        if job.is_cancelled.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
        let mut told = locked(&job.told);
        (told.what, told.done, told.steps, told.changed) = (what.to_owned(), done, steps, true);
    }

    fn warning(&self, warning: &Diagnostic) {
        locked(&self.job().told).warnings.push(warning.clone());
    }

    fn is_cancelled(&self) -> bool {
        self.job().is_cancelled.load(Ordering::Relaxed)
    }
}

/// What became of work.
enum End<T> {
    Done(Result<T, Failure>),
    Panicked(Box<dyn Any + Send>),
}

/// Does long work and returns what came of it.
///
/// - `relay`: that the work tells its progress to
///
/// # Errors
/// The exception for its failure; `KeyboardInterrupt`; what a function of Python that the work calls raised.
pub fn long<T: Send + 'static>(
    py: Python<'_>,
    relay: &Arc<Relay>,
    work: impl FnOnce() -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let bar = py.import("carpus._progress")?.call_method0("bar")?;
    let (send, receive) = channel();
    let job = Arc::<Job>::default();
    *locked(&relay.newest) = Arc::clone(&job);
    let of_thread = Arc::clone(&job);
    std::thread::spawn(move || {
        OWN.set(Some(of_thread));
        let end = match catch_unwind(AssertUnwindSafe(work)) {
            Ok(result) => End::Done(result),
            Err(payload) => End::Panicked(payload),
        };
        // Nobody waits where the caller left.
        let _ = send.send(end);
    });
    let receive = Mutex::new(receive);
    let waited = wait(py, &job, &bar, &receive);
    let closed = bar.call_method0("close");
    let end = match waited {
        Ok(end) => end,
        Err(interrupt) => {
            job.is_cancelled.store(true, Ordering::Relaxed);
            let until = Instant::now() + PATIENCE;
            py.detach(|| {
                while matches!(locked(&receive).try_recv(), Err(TryRecvError::Empty)) && Instant::now() < until {
                    std::thread::sleep(Duration::from_millis(5));
                }
            });
            return Err(interrupt);
        }
    };
    closed?;
    warn(py, &std::mem::take(&mut locked(&job.told).warnings))?;
    match end {
        End::Done(result) => result.or_raise(py),
        End::Panicked(payload) => Err(unwound(py, payload)),
    }
}

/// How far work that borrows arrays of the caller is, and whether it is to stop.
#[derive(Default)]
pub struct Watch {
    is_cancelled: AtomicBool,
    done: AtomicUsize,
}

impl Watch {
    /// Whether the work goes on with its next step.
    ///
    /// # Errors
    /// It is to stop.
    pub fn go_on(&self) -> Result<(), Failure> {
        self.done.fetch_add(1, Ordering::Relaxed);
        if self.is_cancelled.load(Ordering::Relaxed) { Err(Failure::Cancelled) } else { Ok(()) }
    }

    /// Leaves the work where it is to stop, at a place that cannot return a failure.
    ///
    /// - `done`: steps so far
    pub fn look(&self, done: usize) {
        self.done.store(done, Ordering::Relaxed);
        if self.is_cancelled.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
    }
}

/// Does work on arrays that the caller holds, and returns what came of it. It is waited for at Ctrl-C.
///
/// - `what`: is done, in `steps` steps
/// - `work`: looks at its [`Watch`] again and again
///
/// # Errors
/// The exception for its failure; `KeyboardInterrupt`.
pub fn watched<T: Send>(
    py: Python<'_>,
    what: &str,
    steps: usize,
    work: impl FnOnce(&Watch) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    let bar = py.import("carpus._progress")?.call_method0("bar")?.unbind();
    let end = py.detach(|| {
        std::thread::scope(|scope| {
            let (send, receive) = channel();
            let watch = &watch;
            scope.spawn(move || {
                // Nobody waits where the caller left.
                let _ = send.send(catch_unwind(AssertUnwindSafe(|| work(watch))));
            });
            loop {
                match receive.recv_timeout(LOOKS) {
                    Ok(end) => return Ok(end),
                    Err(RecvTimeoutError::Disconnected) => {
                        return Ok(Err(Box::new("the thread of the work ended without a result")));
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
                let done = watch.done.load(Ordering::Relaxed).min(steps);
                let looked = Python::attach(|py| {
                    py.check_signals()?;
                    bar.call_method1(py, "at", (what, done, steps))
                });
                if let Err(interrupt) = looked {
                    watch.is_cancelled.store(true, Ordering::Relaxed);
                    return Err(interrupt);
                }
            }
        })
    });
    let closed = bar.call_method0(py, "close");
    let end = end?;
    closed?;
    match end {
        Ok(result) => result.or_raise(py),
        Err(payload) => Err(unwound(py, payload)),
    }
}

/// Waits for the end, shows progress on the way.
fn wait<T: Send>(
    py: Python<'_>,
    job: &Job,
    bar: &Bound<'_, PyAny>,
    receive: &Mutex<Receiver<End<T>>>,
) -> PyResult<End<T>> {
    loop {
        let looked = py.detach(|| locked(receive).recv_timeout(LOOKS));
        match looked {
            Ok(end) => return Ok(end),
            Err(RecvTimeoutError::Disconnected) => {
                return Ok(End::Done(Err(Failure::Internal(
                    "the thread of the work ended without a result".to_owned(),
                ))));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        py.check_signals()?;
        let shown = {
            let mut told = locked(&job.told);
            std::mem::take(&mut told.changed).then(|| (told.what.clone(), told.done, told.steps))
        };
        if let Some(shown) = shown {
            bar.call_method1("at", shown)?;
        }
    }
}

/// The exception for what was unwound.
fn unwound(py: Python<'_>, payload: Box<dyn Any + Send>) -> PyErr {
    if payload.is::<Stopped>() {
        return crate::failure::exception(py, &Failure::Cancelled);
    }
    if let Some(raised) = effect::take_raised(payload.as_ref()) {
        return raised;
    }
    let text = payload
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    crate::failure::exception(py, &Failure::Internal(text))
}

/// Warns, as `warnings.warn` does.
///
/// # Errors
/// The caller's filter makes warnings errors.
pub fn warn(py: Python<'_>, of: &[Diagnostic]) -> PyResult<()> {
    let errors = py.import("carpus.errors")?;
    for warning in of {
        errors.call_method1("warn", (diagnostic(py, warning)?,))?;
    }
    Ok(())
}
