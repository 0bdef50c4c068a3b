//! The port, and the end.

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use carpus_session::diagnostic::{Diagnostic, Failure};
use carpus_session::output::OutputFolder;

use crate::guard::new_token;
use crate::ledger::Ledger;
use crate::routes::routes;
use crate::settings::Settings;
use crate::state::Live;
use crate::watch::watch;

/// The file that is locked while a server works in the folder.
const LOCK: &str = "live/lock";
/// How often it is looked whether the last command has ended.
const LOOK: Duration = Duration::from_millis(50);

/// A server that listens, and does not answer yet.
#[derive(Debug)]
pub struct Server {
    live: Arc<Live>,
    listener: TcpListener,
    /// Held until the server is gone.
    _lock: std::fs::File,
}

impl Server {
    /// Takes the folder of the steps and a port of this machine.
    ///
    /// # Errors
    /// A ledger of another study, a folder with other files, or one in which another server works; a port that is
    /// taken.
    pub fn new(settings: Settings) -> Result<Server, Failure> {
        let study_file = study_file(&settings)?;
        // A folder with other files is refused before anything is written there.
        let mut ledger = Ledger::open(&settings.study_word()?, &study_file, &settings.out)?;
        let lock = locked(&settings)?;
        // Another server may have written until now.
        if Ledger::is_in(&settings.out) {
            ledger = Ledger::open(&settings.study_word()?, &study_file, &settings.out)?;
        }
        ledger.write(&settings.out)?;
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, settings.port));
        let refused = |e: std::io::Error| {
            let text = format!("cannot listen on {address}: {e}");
            Failure::from(Diagnostic::error(text).hint("choose another port with --port, or none for a free one"))
        };
        let listener = TcpListener::bind(address).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let port = listener.local_addr().map_err(refused)?.port();
        let token = new_token().map_err(|e| Failure::Internal(format!("no random numbers: {e}")))?;
        let live = Arc::new(Live::new(settings, token, port, ledger));
        Ok(Server { live, listener, _lock: lock })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.live.port
    }

    /// The address to open, with the token.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.live.port, self.live.token)
    }

    /// Answers until the process is asked to end (Ctrl-C). A command that is under way is stopped then; a second Ctrl-C
    /// does not wait for it.
    ///
    /// # Errors
    /// The system.
    pub fn serve(self) -> Result<(), Failure> {
        let Server { live, listener, _lock } = self;
        let internal = |e: std::io::Error| Failure::Internal(e.to_string());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(internal)?;
        let watching = {
            let live = live.clone();
            std::thread::spawn(move || watch(&live))
        };
        let served = runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(listener).map_err(internal)?;
            let mut interrupts = Interrupts::new().map_err(internal)?;
            let answering = async { axum::serve(listener, routes(live.clone())).await.map_err(internal) };
            let ending = async {
                interrupts.next().await;
                live.end();
                tokio::select! {
                    () = finished(&live) => {}
                    () = interrupts.next() => {}
                }
                Ok(())
            };
            tokio::select! {
                answered = answering => answered,
                ended = ending => ended,
            }
        });
        live.end();
        // It ends its check first.
        let _ = watching.join();
        served
    }
}

/// Ends when no command is under way any more.
async fn finished(live: &Live) {
    while live.state().job.is_some() {
        tokio::time::sleep(LOOK).await;
    }
}

/// The study's file. It need not be without faults: the check tells them.
fn study_file(settings: &Settings) -> Result<PathBuf, Failure> {
    let study = &settings.study;
    let file = if study.is_dir() { study.join("study.toml") } else { study.clone() };
    if file.is_file() {
        return Ok(file);
    }
    let message = Diagnostic::error("expected a study: a study.toml, or the folder it is in").in_file(&file);
    Err(message.hint("`carpus init` makes one of a folder of exported files").into())
}

/// Locks the folder against other servers.
fn locked(settings: &Settings) -> Result<std::fs::File, Failure> {
    let out = OutputFolder::create(&settings.out, &[])?;
    let file = settings.out.join(LOCK);
    if !file.exists() {
        out.put(LOCK.as_ref(), b"")?;
    }
    let refused = |text: String| Failure::from(Diagnostic::error(text).in_file(&file));
    let lock = std::fs::File::open(&file).map_err(|e| refused(format!("cannot be opened: {e}")))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(std::fs::TryLockError::WouldBlock) => {
            let message = Diagnostic::error("another carpus live works in this folder").in_file(&settings.out);
            Err(message.hint("end it with Ctrl-C, or choose another folder with --out").into())
        }
        // A file system without locks: whoever shares the folder is trusted not to do so at once.
        Err(std::fs::TryLockError::Error(_)) => Ok(lock),
    }
}

/// Requests to the process to end.
#[cfg(unix)]
struct Interrupts(Vec<tokio::signal::unix::Signal>);

#[cfg(unix)]
impl Interrupts {
    fn new() -> std::io::Result<Interrupts> {
        use tokio::signal::unix::{SignalKind, signal};
        let kinds = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()];
        kinds.into_iter().map(signal).collect::<Result<_, _>>().map(Interrupts)
    }

    fn next(&mut self) -> impl Future<Output = ()> {
        std::future::poll_fn(|context| {
            let any = self.0.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
            if any { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
        })
    }
}

/// Requests to the process to end.
#[cfg(not(unix))]
struct Interrupts;

#[cfg(not(unix))]
impl Interrupts {
    fn new() -> std::io::Result<Interrupts> {
        Ok(Interrupts)
    }

    async fn next(&mut self) {
        // Without the right to listen there is only the end of the process itself.
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
