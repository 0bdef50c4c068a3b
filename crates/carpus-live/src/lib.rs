//! A study in progress, in a browser: the server of `carpus live`.
//!
//! In: a study, a folder for its steps, the program `carpus` itself. The server listens on this machine alone, checks
//! the study whenever one of its files changes, runs commands that a person chooses in the page, one at a time, and
//! keeps every step in a ledger.
//!
//! A step is a command of the program, run as a process of its own in the folder in which the server was started: its
//! files are those of the command because the command writes them, effects that a laboratory defines itself are read
//! anew each time, and what a command does wrong ends the command alone. The process tells how far it is in lines
//! ([`carpus_session::progress_lines`]) and stops when its input is closed.
//!
//! Steps never change each other's folders. A command that goes on in a folder (`effect add` after `diagnose`, `effect
//! remove`) goes on in a copy of it.
//!
//! Who may ask: whoever has the token in the address that the server prints (`guard`). Reports are shown in
//! frames that have no access to the server.
//!
//! | file | contents |
//! |---|---|
//! | `settings` | what is asked for: study, folder, port, program |
//! | `ledger` | steps, the current one, `live/ledger.json` |
//! | `asked` | what the page asks for, as words of a command |
//! | `process` | a command as a process: progress, messages, stopping |
//! | `state` | what the page shows; who is told when it changes |
//! | `steps` | a step from its beginning to its end in the ledger |
//! | `watch` | files of the study, the check when they change |
//! | `guard` | host, origin, token, content security policies |
//! | `routes`, `events`, `files` | answers to requests |
//! | `server` | the port, the end |

mod asked;
mod events;
mod files;
mod guard;
mod ledger;
mod process;
mod routes;
mod server;
mod settings;
mod state;
mod steps;
mod watch;

pub use server::Server;
pub use settings::{Program, Settings};
